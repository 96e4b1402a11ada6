"""The fingerprint of a strip: a short run at a low voltage that shows whether it is still as it was.

A strip that dried, or that sits otherwise in its clamp, shows in three numbers before the run is spoilt: the series
resistance, the capacitance and the drift at rest. They are compared with the earlier fingerprints of the same sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.run import Finding, FloatArray, Run
from ipmclab.units import CHANNELS

VOLTAGE: Final = 0.1
"""Of the step [V]: far below what moves or heats a strip."""

LEAST_RATE: Final = 50.0
"""Of its run [Hz]: below, the edge of the current is missed."""

DURATION: Final = 5.0
"""Of the step [s]."""

REST: Final = 2.0
"""At 0 V before and after the step [s]; the drift is read in the rest before."""

SCATTER: Final = 3.0
"""A number further from the median of the earlier ones than so many of their standard deviations is outside."""

LEAST_EARLIER: Final = 3
"""Earlier fingerprints from which a scatter can be determined."""

_LEAST_RELATIVE_SCATTER: Final = 0.05
"""Three fingerprints may agree by chance far better than a strip keeps its state: a change below this is none."""


_EDGE: Final = 3
"""Rows after the edge among which the largest current is."""


@dataclass(frozen=True)
class Fingerprint:
    """What a step of 0.1 V shows of a strip.

    Parameters
    ----------
    series_resistance : float [ohm]
        Voltage over the largest current after the edge.
    capacitance : float [F]
        Charge beyond the steady current, over the voltage.
    drift : float [SI unit of ``drift_of`` per s]
        Slope of the reading at rest before the step.
    drift_of : str
        Displacement or force where one was measured, else the current.
    drift_uncertainty : float [the same]
        Standard uncertainty of that slope.
    """

    series_resistance: float
    capacitance: float
    drift: float
    drift_of: str
    drift_uncertainty: float

    def __str__(self) -> str:
        """The three numbers for people."""
        quantity = CHANNELS[self.drift_of]
        return (
            f"series resistance {self.series_resistance:.3g} ohm, capacitance {1e3 * self.capacitance:.3g} mF, "
            f"drift of the {quantity.name} {quantity.to_display(self.drift):+.2g} {quantity.display_unit}/s"
        )

    def as_dict(self) -> dict[str, float | str]:
        """The numbers as they are in a JSON document."""
        return {
            "series_resistance": self.series_resistance,
            "capacitance": self.capacitance,
            "drift": self.drift,
            "drift_of": self.drift_of,
            "drift_uncertainty": self.drift_uncertainty,
        }


def read_fingerprint(run: Run) -> Fingerprint | None:
    """The fingerprint in a run that applied a step, or None where it shows none.

    A strip that was still discharging when it began shows none: what is left of its charge counts as capacitance. Nor
    does one whose current was lost where it is largest, or all the time before. Elsewhere a lost reading lies between
    its neighbours.

    Parameters
    ----------
    run : Run
        With the current; a rest, a step, perhaps a rest.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> found = read_fingerprint(simulate(strip, "step 0.1 V delay=2 s", duration=7.0, rate=50.0))
    >>> f"{found.series_resistance:.1f} ohm"
    '16.6 ohm'
    """
    if run.current is None or run.metadata.starts_from_rest is False:
        return None
    # The first and the last row at more than half of the largest voltage bound the step.
    largest = float(np.max(np.abs(run.voltage)))
    acts = np.flatnonzero(np.abs(run.voltage) > largest / 2.0)
    if largest < VOLTAGE / 10.0 or len(acts) < 10 or acts[0] < 3:
        return None
    first, stop = int(acts[0]), int(acts[-1]) + 1
    there = np.isfinite(run.current)
    if not (there[:first].any() and there[first : first + _EDGE].all()):
        return None
    read = np.interp(run.time, run.time[there], run.current[there])
    current = read - np.mean(run.current[:first][there[:first]])
    voltage = float(np.mean(run.voltage[first + 1 : stop]))
    during = current[first:stop]
    steady = float(np.mean(during[-max(3, len(during) // 10) :]))
    peak = float(during[np.argmax(np.abs(during))])
    charge = float(np.sum(during - steady)) / run.rate
    if peak == 0.0:
        return None
    drift_of = next((name for name in ("displacement", "force") if name in run.channels), "current")
    slope, uncertainty = _slope(run, drift_of, first)
    return Fingerprint(voltage / peak, charge / voltage, slope, drift_of, uncertainty)


def fingerprint_finding(run: Run) -> Finding | None:
    """The numbers of a fingerprint as a finding of its run, which the catalogue keeps; None for another run."""
    if run.metadata.purpose != "fingerprint":
        return None
    found = read_fingerprint(run)
    if found is None:
        return None
    return Finding("fingerprint", "info", str(found), values=found.as_dict())


def inspect(run: Run) -> list[Finding]:
    """What is wrong with a run, and what its fingerprint shows: what the catalogue keeps."""
    from ipmclab.quality import check

    finding = fingerprint_finding(run)
    return [*check(run), *([finding] if finding is not None else [])]


def differences(found: Fingerprint, earlier: Sequence[Fingerprint]) -> list[str]:
    """Where a fingerprint is outside the scatter of the earlier ones of its sample, in words.

    Parameters
    ----------
    found : Fingerprint
    earlier : sequence of Fingerprint
        Fewer than three say nothing.

    Examples
    --------
    >>> before = [Fingerprint(16.0 + k / 10, 5e-3, 0.0, "current", 1e-7) for k in range(4)]
    >>> differences(Fingerprint(21.0, 5e-3, 0.0, "current", 1e-7), before)
    ['the series resistance is 21 ohm, before it was 16.1 +- 0.81 ohm']
    """
    lines = []
    scales = {"series_resistance": ("ohm", 1.0), "capacitance": ("mF", 1e3)}
    if len(earlier) >= LEAST_EARLIER:
        for name, (unit, factor) in scales.items():
            values = np.array([getattr(one, name) for one in earlier])
            usual, deviation = _usual(values)
            allowed = max(SCATTER * deviation, _LEAST_RELATIVE_SCATTER * abs(usual))
            value = getattr(found, name)
            if abs(value - usual) > allowed:
                lines.append(
                    f"the {name.replace('_', ' ')} is {value * factor:.3g} {unit}, "
                    f"before it was {usual * factor:.3g} +- {allowed * factor:.2g} {unit}"
                )
    alike = [one for one in earlier if one.drift_of == found.drift_of]
    if len(alike) >= LEAST_EARLIER:
        drifts = np.array([one.drift for one in alike])
        own = max(found.drift_uncertainty, *(one.drift_uncertainty for one in alike))
        usual, deviation = _usual(drifts)
        allowed = SCATTER * max(deviation, own)
        if abs(found.drift - usual) > allowed:
            quantity = CHANNELS[found.drift_of]
            shown = [quantity.to_display(number) for number in (found.drift, usual, allowed)]
            lines.append(
                f"the {quantity.name} drifts by {shown[0]:.2g} {quantity.display_unit}/s at rest, "
                f"before it was {shown[1]:.2g} +- {shown[2]:.2g} {quantity.display_unit}/s"
            )
    return lines


def _usual(values: FloatArray) -> tuple[float, float]:
    """Median and standard deviation, by ranks: one bad contact among the earlier ones must not excuse the next."""
    median = float(np.median(values))
    return median, 1.4826 * float(np.median(np.abs(values - median)))


def _slope(run: Run, channel: str, stop: int) -> tuple[float, float]:
    """Slope of a channel before a row and its standard uncertainty, from the scatter around the line."""
    time, values = run.time[:stop], getattr(run, channel)[:stop]
    there = np.isfinite(values)
    if there.sum() < 3:
        return 0.0, math.inf
    time, values = time[there] - time[there].mean(), values[there]
    squares = float(np.sum(time**2))
    slope = float(time @ values) / squares
    left = values - values.mean() - slope * time
    return slope, math.sqrt(float(left @ left) / (len(values) - 2) / squares)
