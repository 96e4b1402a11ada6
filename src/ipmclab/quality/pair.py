"""Two runs of one signal with both polarities: what turns with the voltage, and what does not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.quality.record import RESPONSES
from ipmclab.run import FloatArray, Run
from ipmclab.units import CHANNELS

_OPPOSITE: Final = 0.05
"""Share of the largest voltage by which the voltages may fail to be opposite: noise, and steps of the converter
(convention)."""


@dataclass(frozen=True, eq=False)
class PairedRuns:
    """What two polarities have in common, and in what they differ.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    half_difference : mapping of channel to float array, shape (n_time,) [SI]
        Half of what the positive run reads more than the negative one: what turns with the voltage. A drift that both
        runs have in common, such as that of a curling strip, is not in it.
    half_sum : mapping of channel to float array, shape (n_time,) [SI]
        The mean of both: the drift in common, and what does not turn with the voltage.
    """

    time: FloatArray
    half_difference: Mapping[str, FloatArray]
    half_sum: Mapping[str, FloatArray]

    def texts(self) -> tuple[str, ...]:
        """One line for each channel, for people."""
        found = []
        for name, turned in self.half_difference.items():
            known = turned[np.isfinite(turned)]
            common = self.half_sum[name][np.isfinite(self.half_sum[name])]
            if not len(known) or not len(common):
                continue
            quantity = CHANNELS[name]
            peak, rms = float(np.max(np.abs(known))), float(np.sqrt(np.mean(common**2)))
            share = f" ({100.0 * rms / peak:.2g} % of that)" if peak else ""
            unit = quantity.display_unit
            found.append(
                f"{quantity.name}: half the difference of the pair peaks at {quantity.to_display(peak):.3g} {unit}, "
                f"half the sum is {quantity.to_display(rms):.3g} {unit} rms{share}"
            )
        return tuple(found)


def pair(plus: Run, minus: Run) -> PairedRuns:
    """Separate two runs that were recorded with a signal and with its reverse.

    Parameters
    ----------
    plus, minus : Run
        Of the same rate, with opposite voltages; the longer one counts as far as the shorter one goes. The half
        difference has the sign of ``plus``.

    Returns
    -------
    paired : PairedRuns
        Of the current, the displacement and the force, as far as both runs have them. NaN where one has no reading.

    Raises
    ------
    InputError
        Other times, or voltages that are not opposite.

    Examples
    --------
    >>> time = np.arange(200) / 50.0
    >>> drift = 1e-3 * time
    >>> plus = Run.from_arrays(time=time, voltage=np.ones(200), force=3e-3 + drift)
    >>> minus = Run.from_arrays(time=time, voltage=-np.ones(200), force=-3e-3 + drift)
    >>> paired = pair(plus, minus)
    >>> bool(np.allclose(paired.half_difference["force"], 3e-3)), bool(np.allclose(paired.half_sum["force"], drift))
    (True, True)
    """
    rows = min(len(plus), len(minus))
    time = plus.time[:rows]
    others = minus.time[:rows] - minus.time[0]
    if not np.allclose(time - time[0], others, rtol=0.0, atol=1e-3 * float(np.ptp(time[:2]))):
        raise InputError(
            "the rows of the two runs are at other times",
            code="no-pair",
            where="pair",
            repair="give two runs of one rate, without gaps",
        )
    largest = float(np.nanmax(np.abs(plus.voltage[:rows])))
    off = float(np.nanmax(np.abs(plus.voltage[:rows] + minus.voltage[:rows])))
    if off > _OPPOSITE * largest:
        raise InputError(
            f"the voltages are not opposite: their sum reaches {off:.3g} V",
            code="no-pair",
            where="pair",
            repair="give the two runs that ipmclab record --pair made of one signal",
        )
    names = [name for name in RESPONSES if name in plus.channels and name in minus.channels]
    both = {name: (plus.channels[name][:rows], minus.channels[name][:rows]) for name in names}
    return PairedRuns(
        time=time,
        half_difference={name: (one - other) / 2.0 for name, (one, other) in both.items()},
        half_sum={name: (one + other) / 2.0 for name, (one, other) in both.items()},
    )
