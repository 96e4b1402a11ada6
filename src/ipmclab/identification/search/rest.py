"""Whether a run began at rest, and whether a sensor's zero is at zero: asked of the readings themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import ASSUMED_REST
from ipmclab.identification.search.solve import Solution
from ipmclab.run import FloatArray

_BLIND: Final = 1e-4  # part of a column that the free parameters do not imitate, below which it says nothing


def not_at_rest(problem: Problem, solution: Solution) -> set[int]:
    """Places of runs whose readings contradict the start from rest that was assumed (F test).

    Where rows at 0 V were recorded and no current, force and displacement are not asked (``UNASKED_REST``): there a
    sensor wanders as a strip that creeps does, and under voltage a starting state would follow what the model lacks.
    """
    tested = [record for record in problem.records if record.start == ASSUMED_REST]
    if not tested:
        return set()
    theta, residual = solution.theta, solution.evaluation.residual
    basis = np.linalg.qr(solution.evaluation.jacobian)[0]
    found: set[int] = set()
    for record in tested:
        by_state = problem.responder.start_columns(
            record, problem.values(theta, record.place), problem.delay(theta, record)
        )
        columns = np.zeros((len(residual), by_state.shape[2]))
        for row, (output, reading) in enumerate(record.readings.items()):
            piece = problem.pieces[record.place, output]
            columns[piece] = by_state[row][reading.used] / problem.noise[record.place, output]
        if _explains(columns, basis, residual, len(theta)):
            found.add(record.place)
    return found


def _explains(columns: FloatArray, basis: FloatArray, residual: FloatArray, unknowns: int) -> bool:
    """Whether adding columns to a linearised fit, whose Jacobian has the orthonormal ``basis``, explains too much."""
    from scipy.special import fdtrc

    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    if not columns.shape[1]:
        return False
    vectors, singular, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    vectors = vectors[:, singular > _BLIND]
    added = vectors.shape[1]
    freedom = len(residual) - unknowns - added
    if not added or freedom < 1:
        return False
    explained = float(np.sum((vectors.T @ residual) ** 2))
    remaining = max(float(residual @ residual) - explained, 1e-300)
    return bool(fdtrc(added, freedom, explained / added / (remaining / freedom)) < REJECT)


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
