"""A record that begins with the voltage on shows no zero of its current: what that could do to the parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.as_fitted import listed
from ipmclab.identification.noise.zeros import LARGEST_ZERO
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import Solution, least_seen
from ipmclab.run import Finding, FloatArray
from ipmclab.ties import names_by_size
from ipmclab.units import CHANNELS

OFFSET: Final = "observation.offset.current"
_NOTHING: Final = 1e-5  # of a column: below it a difference of squares is rounding


def unshown_zeros(problem: Problem, solution: Solution) -> list[Finding]:
    """A finding for each run whose current was taken to read zero at 0 V, where that matters.

    It matters where a zero that the readings do not contradict (95 %), and of at most one per cent of the largest
    current, moves a parameter by more than its standard error: its interval then holds only without a zero.

    Parameters
    ----------
    problem : Problem
        With its rows whitened where the noise is not white.
    solution : Solution
    """
    jacobian = solution.evaluation.jacobian
    free = [k for k, unknown in enumerate(problem.unknowns) if unknown.log and not unknown.nuisance]
    records = [record for record in problem.records if record.zero_is_open and not _is_free(problem, record.place)]
    if not free or not records:
        return []
    singular, directions = solution.evaluation.spectrum
    shown = singular > least_seen(solution.evaluation, singular[0])
    inverse = directions[shown].T / singular[shown]
    errors = np.sqrt((inverse * inverse).sum(axis=1))
    found = []
    for record in records:
        column = _of_a_zero(problem, (record.place, "current"))
        along = inverse.T @ (column @ jacobian[problem.pieces[record.place, "current"]])
        moved = inverse @ along
        # What neither the parameters nor the noise imitate of it.
        power = float(column @ column)
        seen = math.sqrt(max(power - float(along @ along), 0.0))
        zero = LARGEST_ZERO * float(np.abs(record.readings["current"].measured).max(initial=0.0))
        zero = min(zero, NORMAL_95 / seen) if seen > _NOTHING * math.sqrt(power) else zero
        away = {problem.unknowns[k].name: abs(float(moved[k])) * zero for k in free if abs(moved[k]) * zero > errors[k]}
        if away:
            found.append(_finding(record.label, zero, away))
    return found


def _is_free(problem: Problem, place: int) -> bool:
    return any(unknown.base == OFFSET and unknown.belongs_to(place) for unknown in problem.unknowns)


def _of_a_zero(problem: Problem, key: tuple[int, str]) -> FloatArray:
    """What a zero of a sensor adds to its residuals [per SI unit]."""
    piece = problem.pieces[key]
    column = np.full((1, piece.stop - piece.start), 1.0 / problem.noise[key])
    return np.asarray(problem.whitened(key, column)[0])


def _finding(label: str, zero: float, away: Mapping[str, float]) -> Finding:
    channel = CHANNELS["current"]
    told = [f"{name} by {100.0 * math.expm1(min(away[name], 10.0)):.2g} %" for name in names_by_size(away)]
    theirs = "more than its standard error" if len(told) == 1 else "more than their standard errors"
    return Finding(
        "zero-not-shown",
        "warning",
        f"{label}: the record begins with the voltage on, so its current was taken to read zero at 0 V. A zero of "
        f"{channel.to_display(zero):.2g} {channel.display_unit}, which the readings do not contradict, would move "
        f"{listed(told)}, {theirs}",
        f"record 5 s at 0 V before the first edge, or free {OFFSET}",
        channel="current",
        values={"zero": zero, **away},
    )
