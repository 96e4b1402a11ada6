"""A slip of the pen in a push: one reading that lies far from the line through all others."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.measurement.push_lines import FloatArray, columns_of, corner_of, is_negative, squares, ways_of
from ipmclab.measurement.written import Written

_FEWEST: Final = 5
_MOST: Final = 200  # beyond, one reading of a table hardly counts, and looking at each takes long
_SLIP: Final = (
    0.1  # of the range of the other forces: a digit or a unit that is wrong moves a reading by at least as much
)
_TOUCHING: Final = 4
_CHANCE: Final = 1e-3  # that one of the readings lies as far away by its scatter


@dataclass(frozen=True)
class Outlier:
    """A reading of a push that lies far from the others.

    Parameters
    ----------
    place : int
    expected : float [N]
        What the line through the others has there.
    in_displacement : bool
        Whether it is the displacement that no other reading comes near.
    """

    place: int
    expected: float
    in_displacement: bool

    def slip(self, displacement: Written, force: Written) -> tuple[str, str]:
        """The file and key of the reading, and what is to be said of it, from what is there."""
        where = f"{(displacement if self.in_displacement else force).where}[{self.place}]"
        text = (
            f'"{force.texts[self.place]}" at "{displacement.texts[self.place]}", number {self.place + 1} of '
            f"{len(force.texts)}, is far from the line through the others, which has {1e3 * self.expected:.3g} mN "
            "there"
        )
        return where, text


def outlier_in(displacement: FloatArray, force: FloatArray) -> Outlier | None:
    """The reading without which all others lie on a line (flat before contact), while it is far from that; or None.

    Parameters
    ----------
    displacement : float array, shape (n,) [m]
        In the order in which it was done.
    force : float array, shape (n,) [N]

    Examples
    --------
    >>> travel = np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0])
    >>> outlier_in(1e-4 * travel, 1e-4 * np.array([0.0, 3.0, 6.1, 9.0, 60.0, 3.1, 0.0])).place
    4
    """
    if not _FEWEST <= len(force) <= _MOST:
        return None
    found: list[tuple[float, Outlier]] = []
    for place in range(len(force)):
        others = np.arange(len(force)) != place
        chance_away = _away(displacement[others], force[others], float(displacement[place]), float(force[place]))
        if chance_away is None or chance_away[0] * len(force) > _CHANCE:
            continue
        chance, expected = chance_away
        x = displacement[others]
        beyond = _outside(x, float(displacement[place])) > max(1.0, _outside(force[others], float(force[place])))
        found.append((chance, Outlier(place, expected, beyond)))
    return min(found, key=lambda one: one[0])[1] if found else None


def _away(x: FloatArray, f: FloatArray, at: float, read: float) -> tuple[float, float] | None:
    """How likely a reading lies as far from the line through the others, and what that has there."""
    from scipy.special import stdtr

    if not float(np.ptp(x)) > 0.0:
        return None
    sign = -1.0 if is_negative(x, f) else 1.0
    x, f, at, read = sign * x, sign * f, sign * at, sign * read
    ways = ways_of(x)
    corner, _ = corner_of(x, f, ways)
    bends = corner > -math.inf
    if bends and np.count_nonzero(x > corner) < _TOUCHING:
        return None  # where it bends is not known without this reading
    x, at = (np.maximum(x, corner), max(at, corner)) if bends else (x, at)
    columns = np.column_stack([x, columns_of(ways)])
    free = len(f) - columns.shape[1] - int(bends)
    if free < 1:
        return None
    answer = np.linalg.lstsq(columns, f, rcond=None)[0]
    variance = squares(x, f, ways) / free
    inverse = np.linalg.pinv(columns.T @ columns)
    numbers = np.unique(ways)
    closest = (math.inf, math.inf, 0.0)
    for way in numbers:
        row = np.concatenate([[at], (numbers == way).astype(float)])
        expected = float(row @ answer)
        error = math.sqrt(variance * (1.0 + float(row @ inverse @ row)))
        if abs(read - expected) < closest[0]:
            closest = (abs(read - expected), error, sign * expected)
    away, error, expected = closest
    if away <= _SLIP * float(np.ptp(f)):
        return None
    return 2.0 * float(stdtr(free, -away / error)) if error > 0.0 else 0.0, expected


def _outside(others: FloatArray, one: float) -> float:
    """How far a reading lies beyond all others, in ranges of them."""
    beyond = max(float(np.min(others)) - one, one - float(np.max(others)), 0.0)
    return beyond / (float(np.ptp(others)) or 1e-300)
