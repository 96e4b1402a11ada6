"""Laser: what a laser at a fixed place reads of a strip that bends far."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from ipmclab.model.parameters import Declaration
from ipmclab.model.stages.kind import Excitation, Numbers, StageKind, Trial, is_there
from ipmclab.units import LENGTH

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reading:
    """What a laser reads, and how that changes.

    Parameters
    ----------
    values : float array [m]
        Beyond the last place at which the laser sees the strip they continue in a straight line, so that a search that
        has lost the strip finds back to it; ``Laser.lost`` says where.
    by_displacement : float array
        Derivative by the displacement of small bending.
    by_sensing_length : float array
        Derivative by L_s while that displacement stays.
    """

    values: FloatArray
    by_displacement: FloatArray
    by_sensing_length: FloatArray


@dataclass(frozen=True)
class Laser:
    """A laser fixed at L_s from the clamp, which reads the height of a strip of uniform curvature there.

    The beam gives kappa L_s^2/2, what small bending makes of a curvature kappa. A strip of that curvature is an arc;
    it crosses the laser at the height (1 - cos phi)/kappa with sin phi = kappa L_s, which is tan(phi/2) L_s. The strip
    leaves the laser where its end has come nearer to the clamp than L_s, sin(kappa L_f)/kappa < L_s, or where it no
    longer reaches it, kappa L_s > 1; and the laser reads no further than its range. There is then no reading (NaN), as
    in a real record.
    """

    declarations: ClassVar[tuple[Declaration, ...]] = (
        Declaration("laser.range", LENGTH, "δ_max", 1e-6, 1.0, typical=12e-3),
    )

    def reading(self, displacement: npt.ArrayLike, values: Mapping[str, float]) -> Reading:
        """What the laser reads for a displacement of small bending [m]; ``values`` are the parameters.

        Examples
        --------
        >>> from ipmclab import load_actuator
        >>> strip = load_actuator("friend-2+laser").parameter_values
        >>> read = Laser().reading([0.0, 5e-3, 10e-3], strip)
        >>> (1e3 * read.values[:2]).round(3).tolist(), Laser().lost(read.values, strip).tolist()
        ([0.0, 5.321], [False, False, True])
        """
        length = values["geometry.sensing_length"]
        bent = np.asarray(displacement, dtype=np.float64)
        last = self.last_sine(values)
        sine = 2.0 * bent / length
        inside = np.clip(sine, -last, last)
        cosine = np.sqrt(1.0 - inside**2)
        height = inside / (1.0 + cosine)  # tan(phi/2)
        slope = 1.0 / (cosine * (1.0 + cosine))
        height = height + slope * (sine - inside)
        return Reading(length * height, 2.0 * slope, height - slope * sine)

    def lost(self, reading: npt.ArrayLike, values: Mapping[str, float]) -> npt.NDArray[np.bool_]:
        """Where a reading [m] is one that the laser cannot have."""
        last = self.last_reading(values)
        lost: npt.NDArray[np.bool_] = np.abs(np.asarray(reading, dtype=np.float64)) > last * (1.0 + 1e-12)
        return lost

    def last_reading(self, values: Mapping[str, float]) -> float:
        """The largest height [m] at which this laser sees this strip."""
        sine = self.last_sine(values)
        return values["geometry.sensing_length"] * sine / (1.0 + math.sqrt(1.0 - sine**2))

    def last_sine(self, values: Mapping[str, float]) -> float:
        """kappa L_s at which the laser loses the strip: the sine of its angle at the laser."""
        length = values["geometry.sensing_length"]
        by_strip = math.sin(_leaving(length / values["geometry.free_length"]))
        height = values["laser.range"] / length
        by_range = math.sin(2.0 * math.atan(height)) if height < 1.0 else 1.0
        # At the right angle the reading has an infinite slope, of which nothing can be made.
        return min(by_strip, by_range, _STEEPEST)


_STEEPEST = 1.0 - 1e-6


def _leaving(part: float) -> float:
    """The angle of the strip's end, at most a right one, at which it leaves a laser at this part of the length."""
    from scipy.optimize import brentq

    if part >= 1.0:
        return 0.0
    if part <= 2.0 / math.pi:
        return 0.5 * math.pi
    return float(brentq(lambda angle: math.sin(angle) / angle - part, 1e-9, 0.5 * math.pi, xtol=1e-15))


def read_far(values: FloatArray, outputs: Sequence[str], parameters: Mapping[str, float]) -> None:
    """Put what the laser reads, straight on beyond its last reading, in place of the displacement of small bending.

    Parameters
    ----------
    values : float array, shape (n_outputs, n_time)
        Changed in its row of the displacement, where there is one and the strip is before a laser.
    outputs : sequence of str
    parameters : mapping of dotted name to float [SI]
    """
    if "laser.range" in parameters and "displacement" in outputs:
        row = list(outputs).index("displacement")
        values[row] = Laser().reading(values[row], parameters).values


def blank_lost(
    values: FloatArray,
    outputs: Sequence[str],
    parameters: Mapping[str, float],
    *,
    kept: npt.NDArray[np.bool_] | None = None,
) -> None:
    """Take away the readings that ``read_far`` made up: NaN where the laser lost the strip, as in a real record.

    Parameters
    ----------
    values, outputs, parameters
        As of ``read_far``.
    kept : bool array, shape (n_time,), optional
        Rows that keep them nevertheless, because something was read there to compare with.
    """
    if "laser.range" in parameters and "displacement" in outputs:
        row = list(outputs).index("displacement")
        lost = Laser().lost(values[row], parameters)
        values[row, lost if kept is None else lost & ~kept] = np.nan


def _trials(values: Numbers, _excitation: Excitation) -> Iterator[Trial]:
    if not is_there(values, "laser.") and not is_there(values, "load."):
        yield Trial("laser")


KIND = StageKind(
    "laser",
    "laser.",
    outputs=("displacement",),
    held=("range",),
    shows="a strip that bends far in front of a fixed laser",
    trials=_trials,
)
