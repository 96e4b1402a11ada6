"""What is assumed of a run until its readings contradict it: a start from rest, and sensors whose zero is at zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.fit.unmodelled import lag_times, lagged
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import ASSUMED_REST, OFFSET, PreparedRun
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.descent import minimum_from, start_with_fewer, weigh
from ipmclab.identification.search.solve import Solution
from ipmclab.run import Finding, FloatArray

_BLIND: Final = 1e-4  # part of a column that the free parameters do not imitate, below which it says nothing


def assumed_zeros(problem: Problem, names: FreeParameters) -> list[int]:
    """Entries of the offsets and drifts that nobody freed by name, and that no row at 0 V shows."""
    shown = {(record.place, *one) for record in problem.records for one in record.shown}
    return [
        column
        for column, unknown in enumerate(problem.unknowns)
        if is_assumed_zero(unknown, names) and (unknown.place, *unknown.base.split(".")[1:]) not in shown
    ]


def is_assumed_zero(unknown: Unknown, names: FreeParameters) -> bool:
    """Whether it is an offset or a drift that nobody freed by name."""
    return unknown.is_of_sensor and unknown.base not in names.observation


def without_idle(problem: Problem, solution: Solution, names: FreeParameters) -> tuple[Problem, Solution]:
    """Take out offsets and starting states that turned out not to be needed."""
    unsure = {r.place for r in problem.records if r.start == "free" and r.run.metadata.starts_from_rest is None}
    groups: dict[tuple[int, str], list[int]] = {}
    asked = set(assumed_zeros(problem, names))
    for column, unknown in enumerate(problem.unknowns):
        offset = column in asked
        if unknown.place is None or not (offset or (unknown.is_start and unknown.place in unsure)):
            continue
        groups.setdefault((unknown.place, unknown.base if offset else "start"), []).append(column)
    idle = {key: columns for key, columns in groups.items() if could_be_zero(solution, columns)}
    if not idle:
        return problem, solution
    resting = {place for place, what in idle if what == "start"}
    return with_less(problem, solution, {column for columns in idle.values() for column in columns}, resting)


def with_less(problem: Problem, solution: Solution, dropped: Set[int], resting: Set[int]) -> tuple[Problem, Solution]:
    """The fit without some entries, some runs being at rest at their start."""
    kept = [column for column in range(len(problem.unknowns)) if column not in dropped]
    gone = {(problem.unknowns[column].base, problem.unknowns[column].place) for column in dropped}
    records = [replace(r, start=ASSUMED_REST) if r.place in resting else r for r in problem.records]
    records = [r.with_zero(asked=False) if (OFFSET, r.place) in gone else r for r in records]
    smaller = Problem(
        problem.base, records, [problem.unknowns[column] for column in kept], problem.responder, problem.noise
    )
    here = start_with_fewer(problem, smaller, solution, sorted(dropped))
    return weigh(smaller, minimum_from(smaller, here))


def not_at_rest(problem: Problem, solution: Solution) -> set[int]:
    """Places of runs whose readings contradict the start from rest that was assumed (F test).

    Where rows at 0 V were recorded and no current, force and displacement are not asked (``UNASKED_REST``): there a
    sensor wanders as a strip that creeps does, and under voltage a starting state would follow what the model lacks. A
    relaxation that is lacking decays as a state does: this has to explain more beside the voltage behind lags, too.
    """
    tested = [record for record in problem.records if record.start == ASSUMED_REST]
    if not tested:
        return set()
    theta, residual = solution.theta, solution.evaluation.residual
    basis = np.linalg.qr(solution.evaluation.jacobian)[0]
    by_start: dict[int, FloatArray] = {}
    for record in tested:
        by_state = problem.responder.start_columns(
            record, problem.values(theta, record.place), problem.delay(theta, record)
        )
        columns = np.zeros((len(residual), by_state.shape[2]))
        for row, (output, reading) in enumerate(record.readings.items()):
            piece = problem.pieces[record.place, output]
            columns[piece] = by_state[row][reading.used] / problem.noise[record.place, output]
        if _explains(columns, basis, residual):
            by_start[record.place] = columns
    beside = np.hstack([basis, _beyond(_lags(problem, len(residual)), basis)]) if by_start else basis
    return {place for place, columns in by_start.items() if _explains(columns, beside, residual)}


def _lags(problem: Problem, rows: int) -> FloatArray:
    """What relaxations add to each output, shape (n_rows, n_lags): the voltage behind lags, of all runs together."""
    constants = lag_times(min(r.step for r in problem.records), max(float(np.ptp(r.run.time)) for r in problem.records))
    outputs = sorted({output for _, output in problem.pieces})
    found = np.zeros((rows, len(outputs), len(constants)))
    for key, piece in problem.pieces.items():
        run = problem.record_at(key[0]).run
        lags = lagged(run.time, run.voltage, constants)[:, problem.readings[key].used]
        found[piece, outputs.index(key[1])] = lags.T / problem.noise[key]
    return found.reshape(rows, -1)


def _beyond(columns: FloatArray, basis: FloatArray) -> FloatArray:
    """Orthonormal columns of what some columns add to an orthonormal basis."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    vectors, singular, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    return np.asarray(vectors[:, singular > _BLIND])


def _explains(columns: FloatArray, basis: FloatArray, residual: FloatArray) -> bool:
    """Whether adding columns to a linearised fit, beside columns of the orthonormal ``basis``, explains too much."""
    from scipy.special import fdtrc

    vectors = _beyond(columns, basis)
    residual = residual - basis @ (basis.T @ residual)
    added = vectors.shape[1]
    freedom = len(residual) - basis.shape[1] - added
    explained = float(np.sum((vectors.T @ residual) ** 2))
    remaining = max(float(residual @ residual) - explained, 1e-300)
    return min(added, freedom) > 0 and bool(fdtrc(added, freedom, explained / added / (remaining / freedom)) < REJECT)


def could_be_zero(
    solution: Solution,
    columns: Sequence[int],
    covariance_of: Callable[[FloatArray], FloatArray] = lambda columns: columns.T @ columns,
) -> bool:
    """Whether some linear unknowns differ from zero by no more than the noise makes them (Wald's test, 0.1 %).

    Parameters
    ----------
    solution : Solution
    columns : sequence of int
        Their entries.
    covariance_of : function of float array, shape (n_rows, n)
        ``columns' V columns`` for noise of covariance V; that of white noise where it is left out.
    """
    from scipy.special import chdtrc

    theta, jacobian = solution.theta[list(columns)], solution.evaluation.jacobian
    own, others = jacobian[:, columns], np.delete(jacobian, columns, axis=1)
    if others.shape[1]:
        own = own - others @ np.linalg.lstsq(others, own, rcond=1e-12)[0]
    # The score of zero, beside its covariance: no inverse of what the readings hardly see.
    score = own.T @ (own @ theta)
    statistic = float(score @ np.linalg.lstsq(covariance_of(own), score, rcond=1e-10)[0])
    return bool(chdtrc(len(columns), statistic) > REJECT)


def start_not_at_rest(record: PreparedRun) -> Finding:
    """That a run did not start from rest, although it was assumed to."""
    return Finding(
        "start-not-at-rest",
        "warning",
        f"{record.label}: its readings contradict a start from rest (p < 0.1 %): the state at its start was fitted too",
        "let the strip rest at 0 V before the first row, and record a second of it",
    )


def zero_kept(problem: Problem, unknown: Unknown) -> Finding:
    """That a sensor's zero is not at zero, as an offset that was kept says."""
    output = unknown.base.rsplit(".", 1)[1]
    label = next(record.label for record in problem.records if record.place == unknown.place)
    return Finding(
        "sensor-zero",
        "info",
        f"{label}: the zero of its {output} is not at zero (p < 0.1 %), so the offset was fitted too",
        "record some seconds at 0 V first, and zero the channel at import on these rows",
        channel=output,
    )
