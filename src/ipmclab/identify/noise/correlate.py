"""A fit under the noise that its own residuals show: find the noise, fit again, until both stay."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.noise.blind import Blind, blind_outputs
from ipmclab.identify.noise.columns import CONSTANTS, constants
from ipmclab.identify.noise.model import NoiseModel
from ipmclab.identify.noise.pieces import (
    Key,
    Piece,
    Shape,
    System,
    choose_noise,
    directions_of,
    imitated,
    refine_noise,
    with_constants,
)
from ipmclab.identify.noise.problem import CorrelatedProblem, measured_rows
from ipmclab.identify.noise.robust import contradicts
from ipmclab.identify.noise.screen import needs_search
from ipmclab.identify.noise.spread import Spread, spread
from ipmclab.identify.problem import Evaluation, Problem
from ipmclab.identify.solve import Solution, minimise, polish
from ipmclab.identify.unknowns import Unknown

FloatArray = npt.NDArray[np.float64]

_TURNS: Final = 4
_SETTLED: Final = 0.1  # of a standard error, by which the parameters still move
_RAN_AWAY: Final = 10.0  # times the residual of least squares, which takes up all but a part of any drift
_FLOOR: Final = 1.01  # times the rounding of the model: below it residuals are no noise


@dataclass(frozen=True, eq=False)
class Correlated:
    """A fit under the noise that was found.

    Parameters
    ----------
    problem : Problem
        A ``CorrelatedProblem``; as it was where all noise is white.
    solution : Solution
    plain : Evaluation
        The residuals and derivatives there, not whitened.
    noise : mapping of (place, output) to NoiseModel
        Of the outputs of which some run shows more than white noise.
    offset, drift : mapping of (place, output) to float [SI, SI/s]
        The constants of the noise: what the sensor adds at the first row, and in a second.
    deviation : mapping of (place, output) to float [SI]
        Of the residuals.
    spread : Spread or None
        What not knowing the noise exactly adds.
    contradicted : set of str
        Outputs whose residuals looked like a noise under which the parameters would be others than least squares
        allows: the model lacks something there. Their noise counts as white.
    shapes : mapping of (place, output) to Shape
        What ``noise`` says, in units of the problem's noise.
    pieces : tuple of Piece
        Outputs that were looked at, as they were before any noise was found.
    """

    problem: Problem
    solution: Solution
    plain: Evaluation
    noise: Mapping[Key, NoiseModel] = field(default_factory=dict)
    offset: Mapping[Key, float] = field(default_factory=dict)
    drift: Mapping[Key, float] = field(default_factory=dict)
    deviation: Mapping[Key, float] = field(default_factory=dict)
    spread: Spread | None = None
    contradicted: Set[str] = frozenset()
    shapes: Mapping[Key, Shape] = field(default_factory=dict)
    blind: Mapping[str, Blind] = field(default_factory=dict)
    pieces: tuple[Piece, ...] = ()


def correlate(
    problem: Problem, solution: Solution, yielding: Sequence[int] = (), without: Set[str] = frozenset()
) -> Correlated:
    """Find the noise of each output of each run in the residuals of a fit, and fit again under it.

    Where residuals show nothing but white noise, nothing is done.

    Parameters
    ----------
    problem : Problem
        Weighted by the scatter of its residuals.
    solution : Solution
    yielding : sequence of int
        Entries of zeros and slopes of sensors that were freed because white noise would not have made them: under
        other noise they are asked anew, as constants of the noise.
    without : set of str
        Outputs that the model does not explain: what it leaves of them is no noise.
    """
    every, coloured = _pieces(problem, solution.evaluation, without)
    shapes: dict[Key, Shape] = {}
    plain, here = solution.evaluation, solution
    if not every or not problem.unknowns:
        return Correlated(problem, solution, plain)
    blind = blind_outputs(System(problem, plain, every), every)
    drifting = {output for output, one in blind.items() if one.allowed}
    pieces = [piece for piece in every if piece.key[1] in coloured | drifting]
    given = Correlated(problem, solution, plain, blind=blind, pieces=tuple(every))
    if not pieces:
        return given
    searched = {piece.key for piece in pieces}
    gone = [column for column in yielding if _belongs(problem.unknowns[column], searched)]
    if gone:
        problem = problem.without(gone, {})
        theta = np.delete(solution.theta, gone)
        plain = problem.evaluate(theta)
        here = replace(solution, theta=theta, evaluation=plain, evaluations=solution.evaluations + 1)
        pieces = [piece.among(problem.unknowns) for piece in pieces]
    found = CorrelatedProblem(problem, {})
    for turn in range(_TURNS):
        system = System(problem, plain, pieces)
        if turn:
            shapes = refine_noise(system, shapes)
        else:
            chosen = choose_noise(system)
            shapes = with_constants(system, chosen, drifting)
            hidden = blind_outputs(system, pieces, shapes)
            more = {output for output, one in hidden.items() if one.allowed}
            if more:
                shapes = with_constants(system, chosen, drifting | more)
            blind = {**blind, **hidden}
        if all(shape.terms.is_white for shape in shapes.values()):
            return given
        found = CorrelatedProblem(problem, {piece.key: piece.whitening(shapes[piece.key]) for piece in pieces})
        before, here = here, _fit_again(found, plain, here)
        plain = problem.evaluate(here.theta)
        if turn and _moved(here.evaluation, here.theta - before.theta) < _SETTLED:
            break
    correlated = replace(_told(found, here, plain, pieces, shapes), blind=blind)
    ran_away = _ran_away(problem, given.plain, plain)
    if ran_away or _contradicted(problem, given, [(piece, shapes[piece.key]) for piece in pieces], here):
        return replace(given, contradicted=frozenset(output for _, output in shapes))
    # A noise at the end of what a computer can tell apart is none that errors could be built on.
    return correlated if correlated.spread and correlated.spread.is_finite else given


def _told(
    problem: CorrelatedProblem, here: Solution, plain: Evaluation, pieces: Sequence[Piece], shapes: Mapping[Key, Shape]
) -> Correlated:
    """Everything in SI units."""
    noise: dict[Key, NoiseModel] = {}
    deviation: dict[Key, float] = {}
    offset: dict[Key, float] = {}
    drift: dict[Key, float] = {}
    for piece in pieces:
        key, shape, unit = piece.key, shapes[piece.key], problem.noise[piece.key]
        noise[key] = NoiseModel.of(shape.terms, shape.entries, unit * math.sqrt(shape.variance), piece.step)
        whitening = problem.whitenings[key]
        residual = plain.residual[problem.pieces[key]]
        middle, half = 0.5 * float(piece.time[0] + piece.time[-1]), 0.5 * float(piece.time[-1] - piece.time[0])
        # The residual is model less reading; time runs from -1 to 1 about the middle of the readings.
        answer = list(-unit * whitening.constants(residual)[0]) if shape.terms.constants else []
        level = float(answer.pop(0)) if shape.terms.offset else 0.0
        slope = float(answer.pop(0)) / half if shape.terms.trend else 0.0
        start = float(problem.record_at(key[0]).run.time[0])
        if shape.terms.trend:
            drift[key] = slope
        if shape.terms.constants:
            offset[key] = level - slope * (middle - start)
        left = unit * residual[piece.inside] + level + slope * (piece.time - middle)
        deviation[key] = float(np.sqrt(np.mean(left * left)))
    found = spread(System(problem.plain, plain, pieces), shapes)
    return Correlated(problem, here, plain, noise, offset, drift, deviation, found, shapes=shapes)


def _fit_again(problem: CorrelatedProblem, plain: Evaluation, before: Solution) -> Solution:
    theta = before.theta
    again = polish(problem, theta, problem.whiten(plain)) or minimise(problem, theta)
    return replace(
        again, converged=again.converged and before.converged, evaluations=again.evaluations + before.evaluations
    )


def _moved(here: Evaluation, step: FloatArray) -> float:
    """Length of a step in standard errors."""
    return float(np.linalg.norm(here.triangle[:, :-1] @ step))


def _contradicted(problem: Problem, given: Correlated, pieces: Sequence[tuple[Piece, Shape]], here: Solution) -> bool:
    """Whether the noise cannot be noise; under an unknown zero or a walk least squares is no judge of it."""
    if any(shape.terms.constants or shape.terms.walk for _, shape in pieces):
        return False
    if len(given.solution.theta) != len(here.theta):
        return False
    directions = directions_of(here.evaluation)
    step = here.theta - given.solution.theta
    return contradicts(problem, given.plain, pieces, step, directions @ directions.T)


def _ran_away(problem: Problem, least: Evaluation, there: Evaluation) -> bool:
    """Whether a fit leaves an output so far from its readings, drift and all, that no drift can be meant."""
    return any(
        float(there.residual[piece] @ there.residual[piece])
        > _RAN_AWAY**2 * max(float(least.residual[piece] @ least.residual[piece]), piece.stop - piece.start)
        for piece in problem.pieces.values()
    )


def _belongs(unknown: Unknown, keys: Set[Key]) -> bool:
    return (unknown.place, unknown.base.rsplit(".", 1)[1]) in keys


def _pieces(problem: Problem, here: Evaluation, without: Set[str]) -> tuple[list[Piece], set[str]]:
    """Every output of every run whose residuals could be noise, and the outputs of which some run's are not white."""
    found = []
    coloured: set[str] = set()
    basis: FloatArray | None = None
    for record in problem.records:
        for output in record.readings:
            key = record.place, output
            if output in without or problem.noise[key] <= _FLOOR * problem.floors[key]:
                continue
            piece = problem.pieces[key]
            inside = measured_rows(record, output)
            residual = here.residual[piece] if inside.all() else here.residual[piece][inside]
            if len(residual) < 2 * CONSTANTS:
                continue
            if basis is None:
                basis = imitated(here)
            explained = _explained(basis[piece][inside], record.run.time[record.readings[output].exact], residual)
            found.append(Piece.of(record, output, problem.unknowns))
            if needs_search(residual, explained):
                coloured.add(output)
    return found, coloured


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
