"""A fit under the noise that its own residuals show: find the noise, fit again, until both stay."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.noise.columns import CONSTANTS, Columns, constants, steps_between, without
from ipmclab.identify.noise.problem import CorrelatedProblem, Whitening, measured_rows
from ipmclab.identify.noise.screen import needs_search
from ipmclab.identify.noise.search import choose_terms, refine, rough_noise
from ipmclab.identify.noise.terms import Terms
from ipmclab.identify.observation import Record
from ipmclab.identify.problem import Evaluation, Problem
from ipmclab.identify.solve import STRUCTURAL, Solution, minimise, polish
from ipmclab.identify.unknowns import Unknown

FloatArray = npt.NDArray[np.float64]
Key = tuple[int, str]

_RIDGE: Final = 1e-9  # of what the readings know if they were white: keeps open what they do not
_TURNS: Final = 4
_SETTLED: Final = 0.1  # of a standard error, by which the parameters still move
_FLOOR: Final = 1.01  # times the rounding of the model: below it residuals are no noise


@dataclass(frozen=True, eq=False)
class Shape:
    """The noise of one output of one run, in units of the problem's noise.

    Parameters
    ----------
    terms : Terms
    entries : float array, shape (terms.shapes,)
    variance : float
    """

    terms: Terms
    entries: FloatArray
    variance: float


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


@dataclass(frozen=True, eq=False)
class Piece:
    """One output of one run, as the search needs it."""

    key: Key
    time: FloatArray
    steps: npt.NDArray[np.int64]
    inside: npt.NDArray[np.bool_]
    allowed: tuple[bool, bool]

    @classmethod
    def of(cls, record: Record, output: str, unknowns: Sequence[Unknown]) -> Piece:
        """Measured readings only: between them the noise goes on."""
        time = record.run.time[record.readings[output].exact]
        step = float(np.median(np.diff(record.run.time)))
        own = {unknown.base for unknown in unknowns if unknown.place in (None, record.place)}
        allowed = (f"observation.offset.{output}" not in own, f"observation.drift.{output}" not in own)
        inside = measured_rows(record, output)
        return cls((record.place, output), time, steps_between(time, step), inside, allowed)

    def whitening(self, shape: Shape) -> Whitening:
        """For a shape of the noise."""
        scale = math.sqrt(shape.variance)
        return Whitening.of(shape.terms, shape.entries, scale, self.time, self.steps, self.inside)


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
        before = shapes
        shapes = find_noise(problem, plain, pieces, before, anew=turn == 0)
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
                directions = _directions(here)
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


def _directions(here: Evaluation) -> FloatArray:
    """Combinations of the unknowns that the readings know, each to a standard error of 1 under white noise."""
    singular, directions = here.spectrum
    seen = singular > STRUCTURAL * singular[0] if len(singular) and singular[0] > 0 else np.zeros(0, dtype=bool)
    return np.asarray(directions[: len(seen)][seen].T / singular[seen])


def find_noise(
    problem: Problem, here: Evaluation, pieces: Sequence[Piece], known: Mapping[Key, Shape], *, anew: bool
) -> dict[Key, Shape]:
    """The noise of some outputs, given the residuals and derivatives of a plain problem at one point.

    Each is found given all others: they share the free parameters. Two rounds, since the first began with white.

    Parameters
    ----------
    problem : Problem
    here : Evaluation
        Not whitened.
    pieces : sequence of Piece
    known : mapping of (place, output) to Shape
        What was found before.
    anew : bool
        Whether the terms are to be chosen, not only their values refined.
    """
    directions = _directions(here)
    turned = np.vstack([directions.T @ here.rows[:-1], here.rows[-1:]])
    searched = {piece.key: piece for piece in pieces}
    parts = {key: np.zeros((len(turned), len(turned))) for key in searched}
    ready = {piece.key: columns_of(problem, turned, piece) for piece in pieces}
    rest = _RIDGE * np.eye(len(turned))
    rest[-1, -1] = 0.0
    begin = max((place.stop for place in problem.pieces.values()), default=0)
    stretches = [place for key, place in problem.pieces.items() if key not in searched]
    for stretch in [*stretches, slice(begin, turned.shape[1])]:
        rest += turned[:, stretch] @ turned[:, stretch].T
    shapes = dict(known)
    for key in searched:
        shape = shapes.get(key, Shape(Terms(), np.zeros(0), 1.0))
        parts[key] = products_of(ready[key], shape)
    alone = _RIDGE * np.eye(len(turned))
    alone[-1, -1] = 0.0
    if anew:
        for key, piece in searched.items():
            # First each by its own readings, with all that may drift: another's drift would drag the parameters along.
            rough = rough_noise(ready[key], alone, piece.allowed)
            shapes[key] = Shape(rough.terms, rough.entries, rough.likelihood.variance)
            parts[key] = rough.likelihood.products
    for turn in range(2 if len(pieces) > 1 else 1):
        for key, piece in searched.items():
            others = rest + sum(part for other, part in parts.items() if other != key)
            if anew and not turn:
                best = choose_terms(ready[key], others, piece.allowed)
            else:
                best = refine(ready[key], others, shapes[key].terms, [shapes[key].entries])
            shapes[key] = Shape(best.terms, best.entries, best.likelihood.variance)
            parts[key] = best.likelihood.products
        if anew and not turn:
            _share_constants(shapes, searched)
    return shapes


def _share_constants(shapes: dict[Key, Shape], pieces: Mapping[Key, Piece]) -> None:
    """What one run shows of an output's zero, no other run of that output is taken to be free of.

    A parameter can take up the drift of a run so well that the run itself shows none.
    """
    for key, piece in pieces.items():
        others = [shape.terms for (_, output), shape in shapes.items() if output == key[1]]
        terms = shapes[key].terms
        offset = piece.allowed[0] and any(other.offset for other in others)
        trend = piece.allowed[1] and any(other.trend for other in others)
        shapes[key] = replace(shapes[key], terms=replace(terms, offset=offset or terms.offset, trend=trend))


def columns_of(problem: Problem, turned: FloatArray, piece: Piece) -> Columns:
    """Offset, trend, directions and residual of one piece."""
    own = turned[:, problem.pieces[piece.key]][:, piece.inside]
    return Columns(np.ascontiguousarray(np.column_stack([constants(piece.time), own.T])), piece.steps)


def products_of(columns: Columns, shape: Shape) -> FloatArray:
    """What a piece adds to the normal equations under a noise."""
    every, _ = columns.products(shape.terms, shape.entries)
    return without(every, shape.terms)[0] / shape.variance
