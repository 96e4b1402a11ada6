"""Whether a channel or the clock is off by a factor of about 1000: a unit that was read as another.

A strip answers in proportion to its voltage and its dimensions:

* current per volt and area of a face, I / (V A);
* strain of the surface per volt, d h / (L_s^2 V), where the voltage is what is left of it behind a lag of 1 s;
* stress per volt, F L_s / (w h^2 V), with the same voltage (a bent plate: F = Y w h^2 strain / (4 L_s));
* the time in which its fastest observed answer settles: of all first-order lags of the voltage, the one that
  explains most, in the whole record after the first edge and in its first quarter, sixteenth, ...; the shortest counts.

``KNOWN`` has the least and the most of each over the strips that are known: the seven samples of Friend's thesis
(``friend-1-measured`` to ``friend-7-measured`` under steps, sines of 0.01 to 1 Hz, squares, triangles and noise) and
the four records of another laboratory's strip of 1 to 3 V. They lie within a factor of 90 to 260 of each other: three
decades hold them all, and none of them when it is 1000 times larger or smaller. Without an actuator
the dimensions are those of the thesis. Motion under a voltage faster than about 1.6 Hz, and a channel that holds
nothing but noise, are not called too small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from ipmclab.quality.kept import kept
from ipmclab.quality.record import NO_VOLTAGE, RESPONSES, Channel, Record
from ipmclab.run import Finding, FloatArray

if TYPE_CHECKING:
    from ipmclab.model import Actuator

CODE: Final = "unit-off"
TIME: Final = "time"

KNOWN: Final[Mapping[str, tuple[float, float]]] = {
    "current": (24.0, 2500.0),  # S/m^2: sample 1 under 0.01 Hz; sample 2 under a square
    "displacement": (6.8e-5, 1.75e-2),  # 1/V: sample 7 under 1 Hz; the other strip, curling for 800 s at 1 V
    "force": (3.8e3, 3.4e5),  # Pa/V: sample 4 under 1 Hz; sample 2 under a square
    TIME: (0.067, 8.4),  # s: sample 1 under 3 V; sample 7, where no current is read
}
"""Least and most that known strips show; ``tests/quality/test_scale.py`` finds them again (derived from the strips
that are named)."""

_LEAST: Final[Mapping[str, float]] = {"current": 5.0, "displacement": 3.5e-5, "force": 1.5e3, TIME: 0.02}
"""What is just believed, and a thousand times this is the most: between a thousandth of the most that is known and the
least, about a factor of 2 from both, so that a unit that is off always lies outside (derived from ``KNOWN``)."""
_MOST_VOLTS: Final = 100.0
"""No strip is driven by more [V]: the known ones take 0.3 to 5 V, and in mV these are 300 and more (convention)."""
_FACTOR: Final = 1000.0  # ratio of the most to the least: a unit that is off by a prefix (derived)
_SLOWEST: Final = 60.0
"""Seconds in which a strip may settle: slow ones are more likely than a wrong unit up to a thousand times the least
(convention)."""
_SLOW: Final = 1.0  # s: the lag behind which a voltage counts for a motion (convention)
_LEFT: Final = 0.1
"""Share of the voltage that must be left behind the lag for a motion to be missed: faster ones hardly move a strip
(convention)."""
_FEWEST_ROWS: Final = 100  # rows from which a time is read (convention)
_BINS: Final = 250  # means of a record in which times are looked for: a limit
_LAGS: Final = 12  # times that are tried (convention)
_EXPLAINED: Final = {"current": 0.5, "displacement": 0.9, "force": 0.9}
"""Share of the variance that one lag must explain for its time to count; drift and glitches leave less of it
(convention)."""
_OWN_SHARE: Final = 0.02
"""Share of the variance that the lag must explain in addition to a voltage that a current follows: a resistor has no
time (convention)."""
_WAS_READ_AS: Final = {
    "current": ("mA", "A"),
    "displacement": ("mm", "m"),
    "force": ("mN", "N"),
    TIME: ("ms", "s"),
}
_NAMES: Final = {"L": "sensing_length", "h": "thickness", "w": "width", "F": "free_length", "C": "clamped_length"}
_USUAL: Final = {"L": 21e-3, "h": 0.245e-3, "w": 5e-3, "F": 25e-3, "C": 5e-3}
"""Of the strips of the thesis [m] (convention)."""


_OF_THE_CLOCK: Final = frozenset({"response-opposite", "resonance-aliased", "resonance-may-alias"})
_OF_A_SCALE: Final = frozenset({"resonance-aliased", "resonance-may-alias"})
"""Codes of findings that a clock, or a scale, brings about: they hold a motion against its voltage or its resonance."""


@dataclass(frozen=True)
class Scales:
    """What a record shows of its scales; a quantity that it does not show is left out.

    Parameters
    ----------
    per_volt : mapping of channel to float [SI unit of the channel per V]
    largest : mapping of channel to float [SI unit of the channel]
    hidden : frozenset of str
        Channels in which a motion would be too fast, or is lost in noise: too little of it says nothing.
    settling : float [s], optional
    """

    per_volt: Mapping[str, float]
    largest: Mapping[str, float]
    hidden: frozenset[str]
    settling: float | None


def wrong_scales(record: Record, noise_only: frozenset[str], actuator: Actuator | None = None) -> list[Finding]:
    """``unit-off``: a channel, or the clock, is about 1000 times off what known strips of these dimensions show.

    Parameters
    ----------
    record : Record
    noise_only : frozenset of str
        Channels that hold nothing but noise.
    actuator : Actuator, optional
        Whose dimensions are the strip's.
    """
    if not record.excited:
        return []
    volts = np.abs(record.run.voltage)
    if volts.max() > _MOST_VOLTS and float(np.median(volts[volts > NO_VOLTAGE])) > _MOST_VOLTS:
        return [_voltage(record, float(volts.max()))]  # every other scale is one per volt
    scales = kept(record.run, "scales", lambda: scales_of(record, noise_only))
    geometry = per_dimensions(actuator)
    if record.shows_no_edge:
        # What is left of an answer says of neither its size nor its speed how large it was.
        rest = replace(scales, hidden=frozenset(record.channels))
        return _off(record, rest, geometry)
    if scales.settling is not None:
        least, most = bounds(TIME)
        if not least <= scales.settling <= most:
            # Behind a clock that is off, no motion can be compared with a slow voltage.
            current = [one for one in _off(record, scales, geometry) if one.channel == "current"]
            return [_clock(scales.settling, least, most), *current]
    return _off(record, scales, geometry)


def per_dimensions(actuator: Actuator | None) -> dict[str, float]:
    """By what a channel per volt is multiplied to be that of a strip of any dimensions."""
    size = _USUAL if actuator is None else {key: actuator[f"geometry.{name}"] for key, name in _NAMES.items()}
    length, thickness, width = size["L"], size["h"], size["w"]
    return {
        "current": 1.0 / ((size["F"] + size["C"]) * width),
        "displacement": thickness / length**2,
        "force": length / (width * thickness**2),
    }


def without_consequences(findings: Sequence[Finding], off: Sequence[Finding]) -> list[Finding]:
    """Findings without those that only say, in another way, that a unit is off."""
    if not off:
        return list(findings)
    channels = {finding.channel for finding in off}
    return [
        finding
        for finding in findings
        if not (None in channels and finding.code in _OF_THE_CLOCK)
        and not (finding.channel in channels - {None} and finding.code in _OF_A_SCALE)
    ]


def bounds(quantity: str) -> tuple[float, float]:
    """Between which values a quantity of ``KNOWN`` is believed.

    Examples
    --------
    >>> bounds("time")
    (0.02, 60.0)
    """
    return _LEAST[quantity], _SLOWEST if quantity == TIME else _FACTOR * _LEAST[quantity]


def _off(record: Record, scales: Scales, geometry: Mapping[str, float]) -> list[Finding]:
    found = []
    for name, per_volt in scales.per_volt.items():
        low, high = (bound / geometry[name] for bound in bounds(name))
        if low <= per_volt <= high or (per_volt < low and name in scales.hidden):
            continue
        channel = record.channels[name]
        large = per_volt > high
        small, whole = _WAS_READ_AS[name]
        volts = scales.largest[name] / per_volt
        found.append(
            Finding(
                code=CODE,
                severity="error",
                channel=name,
                message=(
                    f"the {name} is about 1000 times too {'large' if large else 'small'} (it reaches "
                    f"{channel.show(scales.largest[name])}, where known strips of these dimensions give "
                    f"{channel.show(low * volts)} to {channel.show(high * volts)} for this voltage): "
                    + (f"{small} may have been read as {whole}" if large else f"{whole} may have been read as {small}")
                ),
                repair=(
                    "state the unit of this channel in the import map or the rig file and read the record again"
                    + ("" if large else "; if the unit is right, the strip hardly answers: look at its contacts")
                ),
                values={"per_volt": per_volt, "low": low, "high": high},
            )
        )
    return found


def _voltage(record: Record, volts: float) -> Finding:
    return Finding(
        code=CODE,
        severity="error",
        channel="voltage",
        message=(
            f"the voltage is about 1000 times too large (it reaches {record.voltage.show(volts)}, where strips are "
            "driven by a few V): mV may have been read as V"
        ),
        repair="state the unit of this channel in the import map or the rig file and read the record again",
        values={"largest": volts, "most": _MOST_VOLTS},
    )


def _clock(settling: float, low: float, high: float) -> Finding:
    long = settling > high
    small, whole = _WAS_READ_AS[TIME]
    return Finding(
        code=CODE,
        severity="error",
        message=(
            f"the time is about 1000 times too {'long' if long else 'short'} (the strip settles within "
            f"{settling:.3g} s, where known strips take {low:.2g} to {high:.2g} s): "
            + (f"{small} may have been read as {whole}" if long else f"{whole} may have been read as {small}")
        ),
        repair="state the unit of the time, or the sampling rate, in the import map and read the record again",
        values={"settling": settling, "low": low, "high": high},
    )


def scales_of(record: Record, noise_only: frozenset[str]) -> Scales:
    """What a record shows of its scales."""
    voltage = record.run.voltage
    volts = float(np.abs(voltage).max())
    per_bin = max(1, len(voltage) // _BINS)
    binned = _means(voltage, 0, per_bin, len(voltage) // per_bin)
    slow = float(np.abs(_lags(binned, np.array([_SLOW / (per_bin * record.period)]))).max())
    per_volt, largest = {}, {}
    hidden = set(noise_only)
    for name, channel in record.channels.items():
        is_current = name == "current"
        reached = max(abs(channel.low), abs(channel.high)) if is_current else channel.span
        if reached > 0.0:
            per_volt[name], largest[name] = reached / (volts if is_current else max(slow, _LEFT * volts)), reached
        if not is_current and slow < _LEFT * volts:
            hidden.add(name)
    times = (
        _settling(record, record.channels[name])
        for name in RESPONSES
        if name in record.channels and name not in noise_only
    )
    settling = next((time for time in times if time is not None), None)
    return Scales(per_volt, largest, frozenset(hidden), settling)


def _settling(record: Record, channel: Channel) -> float | None:
    """The shortest time that an answer takes, over ever shorter beginnings of the record; None where none shows."""
    voltage = record.run.voltage
    on = np.flatnonzero(np.abs(voltage) > 0.02 * np.abs(voltage).max())
    first = max(int(on[0]) - 5, 0)
    rows, shortest = len(voltage) - first, None
    while rows >= _FEWEST_ROWS:
        per_bin = max(1, rows // _BINS)
        bins = rows // per_bin

        volts, readings = (_means(values, first, per_bin, bins) for values in (voltage, channel.readings))
        found = _best_lag(volts, readings, channel.name)
        if found is not None and (shortest is None or found * per_bin < shortest):
            shortest = found * per_bin
        rows //= 4
    return None if shortest is None else shortest * record.period


def _means(values: FloatArray, first: int, per_bin: int, bins: int) -> FloatArray:
    return np.asarray(values[first : first + bins * per_bin].reshape(bins, per_bin).mean(axis=1))


def _best_lag(voltage: FloatArray, readings: FloatArray, name: str) -> float | None:
    """The time constant in rows of the lag of the voltage that explains most; a current follows the voltage, too."""
    known = np.isfinite(readings)
    if np.count_nonzero(known) < _FEWEST_ROWS // 2:
        return None
    centred = readings[known] - readings[known].mean()
    power = float(centred @ centred)
    if power <= 0.0:
        return None
    times = _times(len(voltage))
    lagged = _lags(voltage, times)[known]
    # What a constant, and for a current the voltage itself, explain is taken off both sides.
    left, lagged, beside = centred, lagged - lagged.mean(axis=0), voltage[known] - voltage[known].mean()
    if name == "current" and np.any(beside):
        share = beside / float(beside @ beside)
        left, lagged = left - beside * (share @ left), lagged - np.outer(beside, share @ lagged)
    explained = (lagged.T @ left) ** 2 / np.maximum(np.sum(lagged**2, axis=0), 1e-300)
    best = int(np.argmax(explained))
    unexplained = float(left @ left) - float(explained[best])
    shows = unexplained <= (1.0 - _EXPLAINED[name]) * power and explained[best] >= _OWN_SHARE * power
    return float(times[best]) if shows and 0 < best < _LAGS - 1 else None


@lru_cache(maxsize=64)
def _times(rows: int) -> FloatArray:
    """The time constants that are tried over so many rows, in rows."""
    return np.geomspace(0.3, 1.5 * rows, _LAGS)


def _lags(voltage: FloatArray, times: FloatArray) -> FloatArray:
    """A voltage behind first-order lags, given in rows, shape (n_rows, n_times)."""
    left = np.exp(-1.0 / times)
    lagged = (1.0 - left) * voltage[:, None]
    rows = 1  # that each entry sums over: twice as many at each turn
    while rows < len(voltage):
        lagged[rows:] = lagged[rows:] + left**rows * lagged[:-rows]
        rows *= 2
    return lagged
