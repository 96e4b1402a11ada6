"""The stiffness of a strip from a push: force against displacement, in and out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.measurement.push_lines import (
    FloatArray,
    Ways,
    columns_of,
    corner_of,
    is_negative,
    line_of,
    squares,
    ways_of,
)
from ipmclab.measurement.push_slips import outlier_in
from ipmclab.measurement.uncertain import REPEATS, Uncertain
from ipmclab.measurement.written import Written
from ipmclab.run import Finding

CALIBRATION: Final = "calibration of the push"

USUAL_SCALES: Final = math.hypot(REPEATS, REPEATS)
"""Relative standard uncertainty that the scales of force and displacement have where nobody states one."""

_FEWEST: Final = 4  # readings of one way
_SURE: Final = 1e-3
_BENT: Final = 0.05  # change of the slope over a push from which it counts
_LOOP: Final = 0.02  # width of the loop, as a part of the force, from which it counts
_EDGE: Final = 0.05  # of the travel in contact, left out where it begins: the corner is known no better
_CHANCE: Final = 6.0  # variances by which a straight line bends by chance


@dataclass(frozen=True, eq=False)
class Push:
    """Force against displacement while the load cell is moved against the strip, and back.

    Parameters
    ----------
    displacement : float array, shape (n,) [m]
        In the order in which it was done.
    force : float array, shape (n,) [N]
    calibration : float
        Relative standard uncertainty of the scales of force and displacement together.
    written : pair of Written, optional
        What is in a file for displacement and force.
    assumed : bool
        Whether nobody stated ``calibration``.
    """

    displacement: FloatArray
    force: FloatArray
    calibration: float = 0.0
    written: tuple[Written, Written] | None = None
    assumed: bool = False

    def slip(self) -> tuple[str, str] | None:
        """The file and key of a reading far from the line through the others, and what is to be said of it."""
        if self.written is None or not (np.all(np.isfinite(self.displacement)) and np.all(np.isfinite(self.force))):
            return None
        outlier = outlier_in(self.displacement, self.force)
        return None if outlier is None else outlier.slip(*self.written)


def stiffness(push: Push) -> tuple[Uncertain, tuple[Finding, ...]]:
    """The slope of force against displacement [N/m] where the load cell touches, and what is wrong with the push.

    Ways in and out get an intercept each and share the slope. Its uncertainty has the scatter about the lines (of
    correlated neighbours as many as are independent), half the difference between the slopes in and out, and
    the scales.
    """
    x, f, ways, touching, perhaps = in_contact(push)
    findings: list[Finding] = []
    missed = int(np.count_nonzero(~touching))
    if missed:
        findings.append(
            Finding(
                "push-without-contact",
                "info",
                f"in {missed} of {len(x)} readings the load cell did not touch the strip yet: they were left out",
                "",
                samples=_ranges(~touching),
            )
        )
    bent = None if perhaps is None else line_of(x[perhaps], f[perhaps], ways[perhaps])[0]
    x, f, ways = x[touching], f[touching], ways[touching]
    slope, error, residual = line_of(x, f, ways)
    if not slope > 0.0:
        raise InputError(
            f"the slope of the force is {slope:.3g} N/m: a strip pushes back",
            code="out-of-range",
            where="modulus.force",
            repair="give the force as positive where the displacement grows",
        )
    parts = {"scatter of the push": error}
    findings += _bent(x, f, ways)
    loop = _loop(x, f, ways, slope, residual)
    if bent is not None:
        # Either it touched all the time or it did not: the mean of the two, as far from each.
        parts["where the push touches"] = 0.5 * abs(bent - slope)
        slope = 0.5 * (bent + slope)
    parts[CALIBRATION] = slope * push.calibration
    if loop is not None:
        half, finding = loop
        parts["hysteresis of the push"] = half
        findings += [finding] if finding is not None else []
    else:
        findings.append(
            Finding(
                "push-one-way",
                "info",
                "the push goes one way only: friction and creep cannot be separated from stiffness",
                "read it on the way back too",
            )
        )
    assumed = frozenset({CALIBRATION} if push.assumed else ())
    return Uncertain(slope, {source: part for source, part in parts.items() if part}, assumed), tuple(findings)


class Contact(NamedTuple):
    """A push towards positive: its readings, the way, in or out, of each, and whether the load cell touched then.

    ``perhaps`` is there where that is open: then it touched in all of them, or only in these.
    """

    displacement: FloatArray
    force: FloatArray
    ways: Ways
    touching: npt.NDArray[np.bool_]
    perhaps: npt.NDArray[np.bool_] | None


def in_contact(push: Push) -> Contact:
    """Where the load cell touches the strip; a push towards negative is turned round.

    Raises
    ------
    InputError
        Too few readings, no travel, readings that are missing.
    """
    x, f = push.displacement, push.force
    if len(x) < _FEWEST:
        raise InputError(
            f"{len(x)} readings of the push",
            code="too-few-readings",
            where="modulus",
            repair=f"give at least {_FEWEST}, better ten in and ten out",
        )
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(f)) and float(np.ptp(x)) > 0.0):
        raise InputError(
            "the push does not move, or has readings that are missing",
            code="bad-value",
            where="modulus.displacement",
            repair="give force and displacement of every position",
        )
    if is_negative(x, f):
        x, f = -x, -f
    ways = ways_of(x)
    return Contact(x, f, ways, *_touching(x, f, ways))


def _touching(x: FloatArray, f: FloatArray, ways: Ways) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_] | None]:
    """Which readings were taken in contact, and which perhaps were: before, the force does not depend on the travel.

    The bend of a line that is flat at first is sought; it counts where it leaves far less than a straight one, and is
    open where it leaves less than chance would.
    """
    plain = squares(x, f, ways)
    where, best = corner_of(x, f, ways)
    everything = np.ones(len(x), dtype=np.bool_)
    # A straight line that bends by chance does so by a few variances.
    variance, least = best / max(len(x) - 4, 1), 1e-9 * float(np.ptp(f)) ** 2
    touching = x > where + _EDGE * (float(np.max(x)) - where) if where > -math.inf else everything
    if plain - best <= max(_CHANCE * variance, least) or np.count_nonzero(touching) < _FEWEST:
        return everything, None
    if plain - best <= 16.0 * variance or best > 0.5 * plain:
        return everything, touching
    return touching, None


def _bent(x: FloatArray, f: FloatArray, ways: Ways) -> list[Finding]:
    """Whether the force bends over the push: skins that yield, a contact that slides, a strip that bends far."""
    from scipy.special import fdtrc

    middle = x - float(np.mean(x))
    columns = np.column_stack([x, middle**2, columns_of(ways)])
    answer = np.linalg.lstsq(columns, f, rcond=None)[0]
    left = f - columns @ answer
    free = len(x) - columns.shape[1]
    if free < 2:
        return []
    straight, bent = squares(x, f, ways), float(left @ left)
    change = abs(2.0 * float(answer[1]) * float(np.ptp(x)) / float(answer[0])) if answer[0] else 0.0
    chance = float(fdtrc(1, free, (straight - bent) / (bent / free))) if bent > 0.0 else 0.0
    if chance > _SURE or change < _BENT:
        return []
    return [
        Finding(
            "push-not-straight",
            "warning",
            f"the slope changes by {100.0 * change:.0f} % over the push: one modulus does not describe it",
            "push over about twice the thickness, slowly, at the point that is read later; a small push feels the "
            "metal skins more",
        )
    ]


def _loop(
    x: FloatArray, f: FloatArray, ways: Ways, slope: float, residual: FloatArray
) -> tuple[float, Finding | None] | None:
    """What going in and out differ by: half the difference of the slopes, and a finding where the loop is wide."""
    centre = float(np.mean(x))
    both: tuple[list[tuple[float, float, float]], ...] = ([], [])  # slope, error and level of each way in, each way out
    counts = []
    for number in np.unique(ways):
        rows = np.flatnonzero(ways == number)
        if len(rows) >= 3 and float(np.ptp(x[rows])) > 0.0:
            one, error, _ = line_of(x[rows], f[rows], np.zeros(len(rows), dtype=np.intp))
            level = float(np.mean(f[rows])) + slope * (centre - float(np.mean(x[rows])))
            both[number % 2].append((one, error, level))
            counts.append(len(rows))
    if not all(both):
        return None
    (inwards, in_errors, in_levels), (outwards, out_errors, out_levels) = (np.array(some).T for some in both)
    slope_in, slope_out = float(np.mean(inwards)), float(np.mean(outwards))
    half = 0.5 * abs(slope_in - slope_out)
    scatter = math.hypot(*in_errors) / len(in_errors), math.hypot(*out_errors) / len(out_errors)
    width = float(abs(np.mean(in_levels) - np.mean(out_levels)))
    rise = slope * float(np.ptp(x))
    noise = math.sqrt(float(residual @ residual) / max(len(residual) - len(counts) - 1, 1))
    wide = width > _LOOP * rise and width > 4.0 * noise / math.sqrt(min(counts))
    # Two slopes of the same line differ by their scatter, which is counted already.
    counted = half if half > math.hypot(*scatter) else 0.0
    if not wide and not (counted and half > _LOOP * slope):
        return counted, None
    return counted, Finding(
        "push-hysteresis",
        "warning",
        f"in and out differ: the loop is {100.0 * width / rise:.1f} % of the force wide, the slopes are "
        f"{slope_in:.3g} and {slope_out:.3g} N/m",
        "push more slowly, let the force settle at each position, look for friction at the tip; their mean was taken",
        values={"width": width, "in": slope_in, "out": slope_out},
    )


def _ranges(rows: npt.NDArray[np.bool_]) -> tuple[tuple[int, int], ...]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    return tuple((int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True))
