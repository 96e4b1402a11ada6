"""A fit under the noise that its own residuals show: find the noise, fit again, until both stay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.noise.columns import CONSTANTS, constants
from ipmclab.identify.noise.pieces import Key, Piece, Shape, System, choose_noise, directions_of, refine_noise
from ipmclab.identify.noise.problem import CorrelatedProblem, measured_rows
from ipmclab.identify.noise.screen import needs_search
from ipmclab.identify.problem import Evaluation, Problem
from ipmclab.identify.solve import Solution, minimise, polish

FloatArray = npt.NDArray[np.float64]

_TURNS: Final = 4
_SETTLED: Final = 0.1  # of a standard error, by which the parameters still move
_FLOOR: Final = 1.01  # times the rounding of the model: below it residuals are no noise


@dataclass(frozen=True, eq=False)
class Correlated:
    """A fit under correlated noise.

    Parameters
    ----------
    problem : Problem
        As it was where all noise is white.
    solution : Solution
    shapes : mapping of (place, output) to Shape
        Of those whose noise is not just white.
    """

    problem: Problem
    solution: Solution
    shapes: Mapping[Key, Shape]


def correlate(problem: Problem, solution: Solution) -> Correlated:
    """Find the noise of each output of each run in the residuals of a fit, and fit again under it.

    Where residuals show nothing but white noise, nothing is done.

    Parameters
    ----------
    problem : Problem
        Weighted by the scatter of its residuals.
    solution : Solution
    """
    pieces = _suspicious(problem, solution.evaluation)
    shapes: dict[Key, Shape] = {}
    plain, theta = solution.evaluation, solution.theta
    found, here = problem, solution
    for turn in range(_TURNS if pieces else 0):
        system = System(problem, plain, pieces)
        shapes = refine_noise(system, shapes) if turn else choose_noise(system)
        if all(shape.terms.is_white for shape in shapes.values()):
            return Correlated(problem, solution, {})
        whitenings = {piece.key: piece.whitening(shapes[piece.key]) for piece in pieces}
        found = CorrelatedProblem(problem, whitenings)
        here = _fit_again(found, theta, plain, solution)
        moved = _moved(here.evaluation, here.theta - theta)
        theta = here.theta
        solution = replace(solution, evaluations=here.evaluations)
        if turn and moved < _SETTLED:
            break
        plain = problem.evaluate(theta)
    return Correlated(found, here, shapes)


def _fit_again(problem: CorrelatedProblem, theta: FloatArray, plain: Evaluation, before: Solution) -> Solution:
    again = polish(problem, theta, problem.whiten(plain)) or minimise(problem, theta)
    return replace(
        again, converged=again.converged and before.converged, evaluations=again.evaluations + before.evaluations
    )


def _moved(here: Evaluation, step: FloatArray) -> float:
    """Length of a step in standard errors."""
    return float(np.linalg.norm(here.triangle[:, :-1] @ step))


def _suspicious(problem: Problem, here: Evaluation) -> list[Piece]:
    """Outputs of which some run shows more than white noise, in every run."""
    found = []
    coloured: set[str] = set()
    basis: FloatArray | None = None
    for record in problem.records:
        for output in record.readings:
            key = record.place, output
            if problem.noise[key] <= _FLOOR * problem.floors[key]:
                continue
            piece = problem.pieces[key]
            inside = measured_rows(record, output)
            residual = here.residual[piece] if inside.all() else here.residual[piece][inside]
            if len(residual) < 2 * CONSTANTS:
                continue
            if basis is None:
                directions = directions_of(here)
                basis = here.jacobian @ directions
            explained = _explained(basis[piece][inside], record.run.time[record.readings[output].exact], residual)
            found.append((record, output))
            if needs_search(residual, explained):
                coloured.add(output)
    return [Piece.of(record, output, problem.unknowns) for record, output in found if output in coloured]


def _explained(basis: FloatArray, time: FloatArray, residual: FloatArray) -> float:
    """By how much an offset and a trend would lower the squares of a white fit, a chi-square with two degrees."""
    held = constants(time)
    across = basis.T @ held
    inner = held.T @ held - across.T @ across
    # The residual of the whole fit stands square to the basis; that of one piece nearly so.
    right = held.T @ residual
    values, vectors = np.linalg.eigh(inner)
    seen = values > 1e-6 * len(time)
    return float(np.sum((vectors[:, seen].T @ right) ** 2 / values[seen]))
