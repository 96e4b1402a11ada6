"""Zeros of sensors that no reading shows, and what they could do to the parameters.

A record that begins with the voltage on shows no zero of its current, and a few rows at 0 V hardly do. A converter
whose steps are larger than the noise reads a small zero as none at rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.rows import listed
from ipmclab.identification.noise.pieces import directions_of
from ipmclab.identification.noise.zeros import LARGEST_ZERO
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import OFFSET, PreparedRun
from ipmclab.identification.search.solve import Solution
from ipmclab.run import Finding, FloatArray
from ipmclab.ties import names_by_size
from ipmclab.units import CHANNELS

_DITHERED: Final = 0.3  # of a step: with so much noise the mean of the readings shows what lies between two steps
_NOTHING: Final = 1e-5  # of a column: below it a difference of squares is rounding


def unshown_zeros(problem: Problem, solution: Solution) -> list[Finding]:
    """A finding for each run whose current was taken to read zero at 0 V, where that matters.

    Of a run that begins with the voltage on it matters where a zero that the readings do not contradict (95 %), and of
    at most one per cent of the largest current, moves a parameter by more than its standard error: its interval then
    holds only without a zero. Of one with rows at 0 V it matters where the standard error with which these show the
    zero moves a parameter by more than half of its interval.

    Parameters
    ----------
    problem : Problem
        With its rows whitened where the noise is not white.
    solution : Solution
    """
    jacobian = solution.evaluation.jacobian
    free = [k for k, unknown in enumerate(problem.unknowns) if unknown.log and not unknown.nuisance]
    freed = {unknown.place for unknown in problem.unknowns if unknown.base == OFFSET}
    records = [record for record in problem.records if record.zero_is_taken and record.place not in freed]
    if not free or not records:
        return []
    inverse = directions_of(solution.evaluation)
    errors = np.sqrt((inverse * inverse).sum(axis=1))
    found = []
    for record in records:
        key = record.place, "current"
        used = record.readings["current"].used
        column = _of_a_zero(problem, key, 1.0, np.ones(int(np.count_nonzero(used))))
        along = inverse.T @ (column @ jacobian[problem.pieces[key]])
        moved = inverse @ along
        if record.zero_is_unseen:
            # What neither the parameters nor the noise imitate of it.
            power = float(column @ column)
            remaining = math.sqrt(max(power - float(along @ along), 0.0))
            zero = LARGEST_ZERO * float(np.abs(record.readings["current"].measured).max(initial=0.0))
            zero = min(zero, NORMAL_95 / remaining) if remaining > _NOTHING * math.sqrt(power) else zero
            matters = errors
        else:
            at_rest = np.where(np.flatnonzero(used) < record.resting, 1.0, 0.0)
            zero = NORMAL_95 / float(np.linalg.norm(_of_a_zero(problem, key, 1.0, at_rest)))
            matters = NORMAL_95**2 * errors
        away = {
            problem.unknowns[k].name: abs(float(moved[k])) * zero for k in free if abs(moved[k]) * zero > matters[k]
        }
        if away:
            found.append(_finding(record, zero, away))
    return found


def hidden_zeros(problem: Problem, rows: int) -> FloatArray:
    """What the zeros that rounding hides add to the residuals, for one standard deviation of each.

    A zero of up to half a step to both sides (a rectangular distribution) is rounded away at rest, and is in every
    reading after it.

    Parameters
    ----------
    problem : Problem
    rows : int
        Of its residuals, those of priors among them.

    Returns
    -------
    columns : float array, shape (n_rows, n_hidden)
    """
    found = []
    for key, reading in problem.readings.items():
        record = problem.record_at(key[0])
        step = reading.quantum if record.resting else 0.0
        if not step or not np.std(record.run.channels[key[1]][: record.resting]) < _DITHERED * step:
            continue
        column = np.zeros(rows)
        after = np.where(np.flatnonzero(reading.used) >= record.resting, 1.0, 0.0)
        column[problem.pieces[key]] = _of_a_zero(problem, key, step / math.sqrt(12.0), after)
        found.append(column)
    return np.array(found).reshape(len(found), rows).T


def _of_a_zero(problem: Problem, key: tuple[int, str], size: float, where: FloatArray) -> FloatArray:
    """What a zero of a sensor [SI] adds to its residuals, in the rows where it is."""
    return np.asarray(problem.whitened(key, (size / problem.noise[key] * where)[None])[0])


def _finding(record: PreparedRun, zero: float, away: Mapping[str, float]) -> Finding:
    """``zero-not-shown`` of a run that begins with the voltage on, else ``zero-hardly-shown``."""
    size, one = CHANNELS["current"].text(zero), len(away) == 1
    moves = [f"{name} by {100.0 * math.expm1(min(away[name], 10.0)):.2g} %" for name in names_by_size(away)]
    if record.zero_is_unseen:
        code, repair = "zero-not-shown", f"record 5 s at 0 V before the first edge, or free {OFFSET}"
        said = (
            "the record begins with the voltage on, so its current was taken to read zero at 0 V. A zero of "
            f"{size}, which the readings do not contradict, would move {listed(moves)}, more than "
            f"{'its standard error' if one else 'their standard errors'}"
        )
    else:
        code, repair = "zero-hardly-shown", f"free {OFFSET}, or record longer at 0 V before the first edge"
        said = (
            f"its rows at 0 V show the zero of the current to {size} only (95 %). Such a zero would move "
            f"{listed(moves)}, farther than {'its interval, which counts' if one else 'their intervals, which count'} "
            "it as exact"
        )
    values = {"zero": zero, **away}
    return Finding(code, "warning", f"{record.label}: {said}", repair, channel="current", values=values)
