"""What a fit leaves, as noise: its terms and size, and how it spreads the parameters of least squares.

The parameters are those of least squares: the best free-running prediction of the readings. The noise is found in what
that leaves, at that point, and says how sure the parameters are; it moves none of them, except that a sensor whose
residuals show a zero or a drift has these beside the parameters. A model that lacks something leaves more, and counts
as noise too, so that its intervals are wide; if the noise weighed the readings, it would take up what the model lacks
and the parameters would go where it is left. ``weighting`` says where it may weigh them all the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ipmclab.identification.noise.at_rest import Resting, slope_at_rest
from ipmclab.identification.noise.blind import Blind, blind_outputs
from ipmclab.identification.noise.model_error import WORSE, model_errors, slopes_of_model
from ipmclab.identification.noise.pieces import Key, Piece, System, choose_noise, refine_noise, with_constants
from ipmclab.identification.noise.searched_outputs import searched_outputs
from ipmclab.identification.noise.whitening import CorrelatedProblem
from ipmclab.identification.noise.zeros import DriftingProblem, Projection, Zero
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import Solution
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import origin
from ipmclab.statespace.noise_model import NoiseModel
from ipmclab.statespace.shape import Shape, drawn, spread_by
from ipmclab.statespace.terms import Terms
from ipmclab.statespace.whitening import Whitening


@dataclass(frozen=True, eq=False)
class Correlated:
    """A fit, and the noise in what it leaves.

    Parameters
    ----------
    problem : Problem
        Of least squares; a ``DriftingProblem`` where sensors have a zero or a slope beside the parameters.
    solution : Solution
    plain : Evaluation
        The residuals and derivatives there, zeros and slopes in them.
    shapes : mapping of (place, output) to Shape
        The noise, in units of the problem's noise, of the outputs of which some run shows more than white noise.
    pieces : mapping of (place, output) to Piece
        Outputs that were looked at.
    blind : mapping of output to Blind
        Outputs of which no run would show a drift.
    """

    problem: Problem
    solution: Solution
    plain: Evaluation
    shapes: Mapping[Key, Shape] = field(default_factory=dict)
    pieces: Mapping[Key, Piece] = field(default_factory=dict)
    blind: Mapping[str, Blind] = field(default_factory=dict)

    def at(self, solution: Solution) -> Correlated:
        """The same noise at another point that is as good."""
        if solution.theta is self.solution.theta:
            return replace(self, solution=solution)
        return replace(self, solution=solution, plain=self.problem.plain.evaluate(solution.theta))

    @cached_property
    def noise(self) -> dict[Key, NoiseModel]:
        """What ``shapes`` says, in SI units."""
        return {
            key: NoiseModel.of(
                shape.terms, shape.entries, self.problem.noise[key] * math.sqrt(shape.variance), self.pieces[key].step
            )
            for key, shape in self.shapes.items()
        }

    @property
    def is_weighted(self) -> bool:
        """Whether the noise weighs the readings, so that the rows of the problem are whitened."""
        return isinstance(self.problem, CorrelatedProblem)

    @property
    def zeros(self) -> Mapping[Key, Zero]:
        """Of the sensors that have any beside the parameters of least squares."""
        return self.problem.zeros if isinstance(self.problem, DriftingProblem) else {}

    @cached_property
    def about_zeros(self) -> dict[Key, Shape]:
        """The noise, about the zeros and slopes that stand beside the parameters too."""
        zeros = self.zeros
        return {key: shape.about(zeros[key].terms) if key in zeros else shape for key, shape in self.shapes.items()}

    @cached_property
    def _constants(self) -> dict[Key, tuple[float, float]]:
        """Zero [SI] at the first row, and slope [SI/s], of the sensors that have any."""
        found = {}
        for key, piece in self.pieces.items():
            residual = self.plain.residual[self.problem.pieces[key]]
            if key in self.zeros:
                terms, answer = self.zeros[key].terms, self.problem.constants(key, residual)  # type: ignore[attr-defined]
            elif self.is_weighted and key in self.shapes and self.shapes[key].terms.constants:
                terms, answer = self.shapes[key].terms, -self.whitenings[key].constants(residual)[0]
            else:
                continue
            values = list(self.problem.noise[key] * answer)
            level = float(values.pop(0)) if terms.offset else 0.0
            half = 0.5 * float(piece.time[-1] - piece.time[0])
            slope = float(values.pop(0)) / half if terms.trend else 0.0
            begins = origin(piece.time, terms) - float(self.problem.record_at(key[0]).run.time[0])
            found[key] = level - slope * begins, slope
        return found

    @property
    def offset(self) -> dict[Key, float]:
        """What the sensor adds at the first row [SI]."""
        return {key: offset for key, (offset, _) in self._constants.items()}

    @property
    def drift(self) -> dict[Key, float]:
        """What it adds in a second [SI/s]."""
        return {key: drift for key, (_, drift) in self._constants.items() if drift}

    def of_sensor(self, key: Key) -> FloatArray:
        """What its zero and its slope add to each row of an output of a run [SI], unknowns of the fit or beside it."""
        place, output = key
        unknowns = np.zeros(len(self.problem.record_at(place).run.time))
        return self.problem.with_sensor(place, output, self.solution.theta, unknowns) + self.beside(key)

    def beside(self, key: Key) -> FloatArray:
        """What a zero and a slope that stand beside the unknowns add to each row [SI]."""
        offset, drift = self._constants.get(key, (0.0, 0.0))
        time = self.problem.record_at(key[0]).run.time
        return np.asarray(offset + drift * (time - time[0]))

    @property
    def deviation(self) -> dict[Key, float]:
        """Of the residuals, zero and slope taken out [SI]; never nothing, for others divide by it."""
        found = {}
        for key in self.shapes:
            rows = self.left(key)[self.pieces[key].inside]
            own = self.problem.noise[key] * float(np.sqrt(np.mean(rows * rows)))
            found[key] = max(own, self.problem.floors[key])
        return found

    def left(self, key: Key) -> FloatArray:
        """Residuals of one output of one run about its zero and slope, in units of the problem's noise."""
        residual = self.plain.residual[self.problem.pieces[key]]
        if key not in self._constants:
            return residual
        added = self.beside(key)[self.problem.readings[key].used]
        return np.asarray(residual + np.where(self.pieces[key].inside, added / self.problem.noise[key], 0.0))

    def resting(self, key: Key) -> Resting:
        """The noise of one output of one run, and the same of the readings at 0 V alone."""
        rows = self.left(key)[self.pieces[key].inside]
        return Resting.of(self.problem.record_at(key[0]), key[1], self.shapes[key], rows, self.problem.noise[key])

    @cached_property
    def whitenings(self) -> dict[Key, Whitening]:
        """What makes the rows of each output of each run independent."""
        return {key: self.pieces[key].whitening(shape) for key, shape in self.shapes.items()}

    @cached_property
    def whitened(self) -> Evaluation:
        """The residuals and derivatives as independent rows of variance 1, zeros and slopes taken out."""
        if self.is_weighted or not self.shapes:
            return self.solution.evaluation
        rows = self.plain.rows.copy()
        for key in self.zeros:
            rows[-1, self.problem.pieces[key]] = self.left(key)
        return self._white_problem.changed(Evaluation(rows, self.plain.beforehand))

    @cached_property
    def _white_problem(self) -> CorrelatedProblem:
        return CorrelatedProblem(self.problem.plain, self.whitenings)

    def white(self, key: Key, rows: FloatArray) -> FloatArray:
        """Rows of one output of one run, shape (n, n_rows), as independent ones of variance 1."""
        return self._white_problem.whitened(key, rows)

    def covariance_of(self, rows: FloatArray, key: Key, variance: FloatArray | None = None) -> FloatArray:
        """``rows' V rows`` for the noise of an output of a run, in units of the problem's noise.

        Parameters
        ----------
        rows : float array, shape (n_rows, n)
            Of an evaluation of the problem: zeros and slopes are taken out once more, as the normal equations do.
        key : (place, output)
        variance : float array, shape (n_rows,), optional
            Of each row, over that of the noise.
        """
        sized = np.sqrt(variance)[:, None] if variance is not None else 1.0
        if self.is_weighted or (key not in self.shapes and key not in self.zeros):
            scaled = rows * sized
            return np.asarray(scaled.T @ scaled)
        turned = self.problem.whitened(key, rows.T).T
        moved = np.zeros((0, rows.shape[1]))
        inside = self.problem.readings[key].exact_of_used
        if key in self.zeros:
            # What is known of a zero or a slope beforehand has an error too: of rows at 0 V, and of its own.
            projection, own_errors = self._known[key]
            moved = projection.columns.T @ turned[inside]
            turned[inside] -= projection.by_rows @ moved
            moved *= own_errors[:, None]
        beyond = (turned * sized)[~inside]
        own = (turned * sized)[inside]
        return np.asarray(self._noise_of(own, key) + moved.T @ moved + beyond.T @ beyond)

    def covariance_of_all(self, columns: FloatArray) -> FloatArray:
        """The same for the noise of all rows of an evaluation, and what was known beforehand."""
        beyond = columns[self.problem.beforehand]
        parts = (self.covariance_of(columns[piece], key) for key, piece in self.problem.pieces.items())
        return np.asarray(sum(parts) + beyond.T @ beyond)

    @cached_property
    def _at_rest(self) -> dict[Key, tuple[int, Shape]]:
        """Where what is found under voltage is not there at 0 V: so many first rows, and the noise that they have.

        What a model lacks begins with the voltage; a strip at rest draws nothing, whatever it is.
        """
        found = {}
        for key in self.shapes:
            resting = self.resting(key)
            if resting.is_at_rest_too is False:
                found[key] = len(resting.left), resting.noise_at_rest(self.problem.floors[key] ** 2)
        return found

    def _noise_of(self, columns: FloatArray, key: Key) -> FloatArray:
        """``columns' V columns`` of the measured rows of an output of a run."""
        shape = self.shapes.get(key)
        if shape is None or not (shape.terms.order or shape.terms.walk):
            return np.asarray((1.0 if shape is None else shape.variance) * (columns.T @ columns))
        count, own = self._at_rest.get(key, (0, shape))
        steps = self.pieces[key].steps
        driven = spread_by(columns[count:], steps[count:], shape)
        return driven + spread_by(columns[:count], steps[:count], own) if count else driven

    @cached_property
    def _known(self) -> dict[Key, tuple[Projection, FloatArray]]:
        """What is known of a zero and a slope beforehand, and the errors of that beside those of the rows at 0 V."""
        found = {}
        for key in self.zeros:
            projection: Projection = self.problem.projections[key]  # type: ignore[attr-defined]
            of_rows = self._noise_of(projection.by_rows, key).diagonal()
            found[key] = projection, np.sqrt(np.maximum(projection.known**2 - of_rows, 0.0))
        return found

    def inflation(self, change: FloatArray) -> float:
        """How many times as much the noise moves the readings along a change of the residuals as white noise would.

        Of those of the readings alone too.
        """
        power = float(change @ change)
        if power <= 0.0 or not self.shapes or self.is_weighted:
            return 1.0
        return max(float(self.covariance_of_all(change[:, None])[0, 0] / power), 1.0)

    def drawn(self, generator: np.random.Generator) -> FloatArray:
        """A draw of the noise in the residuals of the problem; zeros and slopes, which no parameter follows, aside."""
        found = generator.standard_normal(self.solution.evaluation.residual.size)
        if self.is_weighted:
            return found
        for key, shape in self.shapes.items():
            rows = found[self.problem.pieces[key]]
            count, own = self._at_rest.get(key, (0, shape))
            noise = drawn(shape, self.pieces[key].steps, generator)
            if count:
                noise[:count] = drawn(own, self.pieces[key].steps[:count], generator)
            rows[self.pieces[key].inside] = noise
        for key in self.zeros:
            rows = found[self.problem.pieces[key]]
            projection, own_errors = self._known[key]
            inside = self.pieces[key].inside
            of_rows = projection.by_rows.T @ rows[inside]
            rows[inside] += projection.columns @ (own_errors * generator.standard_normal(len(own_errors)) - of_rows)
            found[self.problem.pieces[key]] = self.problem.whitened(key, rows[None])[0]
        return found


Again = Callable[[Problem, Solution], tuple[Problem, Solution]]
"""The weights and the minimum of a problem, from near it or from elsewhere."""


def with_noise(
    problem: Problem, solution: Solution, yielding: Sequence[int], again: Again, still: Set[Key] = frozenset()
) -> Correlated:
    """Find the noise of each output of each run in the residuals of a fit.

    Parameters
    ----------
    problem : Problem
        Weighted by the scatter of its residuals.
    solution : Solution
    yielding : sequence of int
        Entries of zeros and slopes of sensors that were freed because white noise would not have made them: under
        other noise they are asked anew, as constants of the noise. Noise that is slow enough describes whatever they
        explain: where least squares predicts worse without them, they stay unknowns.
    again : function of (Problem, Solution)
        Least squares once more, where sensors turn out to have zeros or slopes.
    still : set of (place, output)
        Sensors that do not drift.
    """
    plain = solution.evaluation
    every, coloured = searched_outputs(problem, plain)
    pieces = {piece.key: piece for piece in every}
    if not every or not problem.unknowns:
        return Correlated(problem, solution, plain, pieces=pieces)
    blind = blind_outputs(System(problem, plain, every), every)
    drifting = {output for output, one in blind.items() if one.allowed}
    searched = [piece for piece in every if piece.key[1] in coloured | drifting]
    if not searched:
        return Correlated(problem, solution, plain, pieces=pieces, blind=blind)
    fewer, near = _without(problem, solution, yielding, {piece.key for piece in searched})
    searched = [piece.among(fewer.unknowns) for piece in searched]
    searched = [replace(p, allowed=p.allowed._replace(trend=False)) if p.key in still else p for p in searched]
    system = System(fewer, near.evaluation, searched)
    chosen = choose_noise(system)
    shapes = with_constants(system, chosen, drifting)
    hidden = blind_outputs(system, searched, shapes)
    more = {output for output, one in hidden.items() if one.allowed}
    if more:
        drifting = drifting | more
        shapes = with_constants(system, chosen, drifting)
    while mistaken := model_errors(fewer, near.evaluation, searched, shapes):
        searched = [replace(piece, allowed=mistaken.get(piece.key, piece.allowed)) for piece in searched]
        system = System(fewer, near.evaluation, searched)
        shapes = with_constants(system, choose_noise(system), drifting)
    if all(shape.terms.is_white for shape in shapes.values()):
        return Correlated(problem, solution, plain, pieces=pieces, blind={**blind, **hidden})
    zeros = {piece.key: zero for piece in searched if (zero := _zero_of(fewer, piece, shapes[piece.key])) is not None}
    least: Problem = DriftingProblem(fewer, zeros) if zeros else fewer
    plain = near.evaluation
    if least is not problem:
        least, near = again(least, replace(near, evaluation=least.evaluate(near.theta)))
        if fewer is not problem and _left_more(least, problem) > WORSE:
            kept = with_noise(problem, solution, (), again)
            if _left_more(least, kept.problem) > WORSE:  # and that is not what rows at 0 V say of a slope
                return kept
        plain = least.plain.evaluate(near.theta) if zeros else near.evaluation
        if isinstance(least, DriftingProblem) and (moving := slopes_of_model(least, plain, fewer, shapes)):
            return with_noise(problem, solution, yielding, again, still | moving)
        shapes = refine_noise(System(least.plain, plain, searched), shapes)
    pieces |= {piece.key: piece for piece in searched}
    return Correlated(least, near, plain, shapes, pieces, {**blind, **hidden})


def _left_more(without: Problem, problem: Problem) -> float:
    """Times what is left (rms), by the geometric mean over all readings: each problem weighs by what its fit leaves."""
    rows = {key: piece.stop - piece.start for key, piece in problem.pieces.items()}
    logarithms = (count * math.log(without.noise[key] / problem.noise[key]) for key, count in rows.items())
    return math.exp(sum(logarithms) / sum(rows.values()))


def _zero_of(problem: Problem, piece: Piece, shape: Shape) -> Zero | None:
    """The zero and slope beside the parameters.

    A walk begins somewhere, and a sensor of force or motion goes somewhere; where no row at 0 V says how far, a slope
    would take up the slow answer of the strip. A current has one only beside a walk, and where these rows show it.
    """
    record, output, terms = problem.record_at(piece.key[0]), piece.key[1], shape.terms
    unit = problem.noise[piece.key]
    known = False
    if output != "current" or terms.walk:
        rest = slope_at_rest(record, output, shape, unit)
        known = rest.is_shown if output == "current" else math.isfinite(rest.error)
    trend = (terms.trend or known) and piece.allowed.trend
    # At which time a slope adds nothing is arbitrary, unless an unknown of the fit says where the zero is.
    offset = (terms.offset or terms.walk or trend) and piece.allowed.offset
    return Zero.of(record, output, Terms(offset=offset, trend=trend), shape, unit) if offset or trend else None


def _without(problem: Problem, solution: Solution, yielding: Sequence[int], keys: Set[Key]) -> tuple[Problem, Solution]:
    """The problem without zeros and slopes that are now asked of the noise."""
    of = problem.unknowns
    gone = [column for column in yielding if (of[column].place, of[column].base.rsplit(".", 1)[1]) in keys]
    if not gone:
        return problem, solution
    fewer = problem.without(gone, {})
    theta = np.delete(solution.theta, gone)
    here = replace(solution, theta=theta, evaluation=fewer.evaluate(theta), evaluations=solution.evaluations + 1)
    return fewer, here
