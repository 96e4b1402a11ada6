"""What a fit leaves of one output: how much beyond noise, and whether it follows the voltage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.identification.diagnostics.evidence import Evidence
from ipmclab.identification.noise.pieces import Key, Piece, System, choose_noise, with_constants
from ipmclab.identification.noise.searched_outputs import FLOOR
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import Reading, drive
from ipmclab.identification.solved import Estimate
from ipmclab.identification.uncertainty.covariance import is_coloured
from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.run import FloatArray
from ipmclab.statespace.shape import Shape
from ipmclab.statespace.terms import Terms

_LAGS: Final = (0.002, 0.006, 0.02, 0.06, 0.2, 0.6)
"""Of the longest record: time constants by which a voltage is filtered."""

_HINT: Final = 0.05  # p-value beside the noise that was found, above which the likelihood is not asked
_BENT: Final = 0.05  # of what is asked for: the part that is not in proportion to the voltage
_MISFIT: Final = 1.3  # times the noise: what is left is large, and a linear look at it no guide


@dataclass(frozen=True, eq=False)
class Left:
    """What is left of one output in all runs that have it.

    Parameters
    ----------
    output : str
    problem : Problem
        Not whitened.
    theta : float array, shape (n_unknown,)
    here : Evaluation
        Of it there.
    pieces : tuple of Piece
    shapes : mapping of (place, output) to Shape
        The noise of each.
    coloured_in : set of int
        Places of the runs in which it is autocorrelated.
    beside : mapping of Piece to Shape
        The noise of the other outputs, where it is not white.
    """

    output: str
    problem: Problem
    theta: FloatArray
    here: Evaluation
    pieces: tuple[Piece, ...]
    shapes: Mapping[Key, Shape]
    coloured_in: Set[int]
    beside: Mapping[Piece, Shape] = field(default_factory=dict)

    @classmethod
    def of(cls, estimate: Estimate, output: str) -> Left:
        """From a solved problem, at the least squares of white noise: no noise has taken anything away there."""
        correlated = estimate.correlated
        problem, solution = estimate.white or (estimate.problem, estimate.solution)
        here = solution.evaluation
        records = [record for record in problem.records if output in record.readings]
        residuals = {
            record.place: here.residual[problem.pieces[record.place, output]][record.readings[output].exact_of_used]
            for record in records
        }
        # An offset and a slope of the noise need three readings to say anything of it.
        records = [record for record in records if len(residuals[record.place]) > 2]
        known = correlated.pieces
        pieces = tuple(
            known.get((record.place, output)) or Piece.of(record, output, problem.unknowns) for record in records
        )
        white = Shape(Terms(), np.zeros(0), 1.0)
        found = {}
        for key, shape in correlated.about_zeros.items():
            unit = correlated.problem.noise[key] / problem.noise[key]
            found[key] = replace(shape, variance=unit**2 * shape.variance)
        shapes = {piece.key: found.get(piece.key, white) for piece in pieces}
        beside = {known[key]: shape for key, shape in found.items() if key[1] != output}
        coloured = frozenset(
            key[0]
            for key, shape in shapes.items()
            if problem.noise[key] > FLOOR * problem.floors[key]
            and (not shape.terms.is_white or is_coloured(residuals[key[0]]))
        )
        if coloured and all(shape.terms.is_white for shape in shapes.values()):
            # No noise was found: here the model is what is doubted.
            system = System(problem, here, [*pieces, *beside]).given(beside)
            shapes = with_constants(system, choose_noise(system))
        return cls(output, problem, solution.theta, here, pieces, _drifting(pieces, shapes), coloured, beside)

    @property
    def noise(self) -> float:
        """Weighted squares that the scatter of neighbouring readings accounts for."""
        return self._squares_of(lambda reading: reading.noise)

    def _squares_of(self, size: Callable[[Reading], float]) -> float:
        """Weighted squares of one size [SI] in every reading of a run."""
        found = 0.0
        for piece in self.pieces:
            found += len(piece.time) * (size(self.problem.readings[piece.key]) / self.problem.noise[piece.key]) ** 2
        return found

    def squares(self, problem: Problem, here: Evaluation) -> float:
        """Weighted squares that some fit leaves of this output."""
        left = [here.residual[problem.pieces[piece.key]][piece.inside] for piece in self.pieces]
        return float(sum(one @ one for one in left))

    def is_large(self, problem: Problem, here: Evaluation) -> bool:
        """Whether some fit leaves more of this output than its noise."""
        return self.squares(problem, here) > _MISFIT**2 * self.noise

    @cached_property
    def is_rounding(self) -> bool:
        """Whether it is no more than rounding to the steps of a converter leaves, a twelfth of their squares.

        Of what answers slowly it is autocorrelated and follows the voltage, whatever the model is.
        """
        return self.squares(self.problem, self.here) < self._squares_of(lambda reading: reading.quantum) / 12.0

    @property
    def is_doubted(self) -> bool:
        """Whether it is neither white noise nor rounding."""
        return bool(self.coloured_in) and not self.is_rounding

    def evidence(self, added: FloatArray) -> Evidence:
        """Of changes that the model does not know."""
        return Evidence(self.problem, self.here, self.pieces, added, self.beside)

    @cached_property
    def follows(self) -> bool:
        """Whether it follows the voltage in some linear way that the model does not know."""
        return self.is_doubted and self._chance(bent=False) < REJECT

    @cached_property
    def bends(self) -> bool:
        """Whether it follows the voltage times its magnitude, to which no linear model answers."""
        # Under a single step both are in proportion, and the voltages do not distinguish the one from the other.
        volts = np.concatenate([r.run.voltage for r in self.problem.records if self.output in r.readings])
        bent = volts * np.abs(volts)
        bent_part = bent - volts * float(volts @ bent) / max(float(volts @ volts), 1e-300)
        could_bend = float(np.linalg.norm(bent_part)) > _BENT * float(np.linalg.norm(bent))
        return self.is_doubted and could_bend and self._chance(bent=True) < REJECT

    def _chance(self, *, bent: bool) -> float:
        """How often noise alone would make the output as much likelier if it may also follow the voltage in any way."""
        from scipy.special import chdtrc

        ways = of_voltage(self.problem, self.theta, self.output, bent=bent)
        evidence = self.evidence(ways)
        # With the noise that was found, which may have taken it for its own: half of it shows even then, unless it
        # is far more than the scatter of neighbouring readings.
        chance = float(chdtrc(len(ways), max(evidence.together(self.shapes), 0.0)))
        if chance > _HINT and not self.is_large(self.problem, self.here):
            return chance
        without, _ = evidence.deviance([], self.shapes)
        with_all, _ = evidence.deviance(range(len(ways)), self.shapes)
        return float(chdtrc(len(ways), max(without - with_all, 0.0)))


def deviance(doubted: Sequence[Left], problem: Problem, here: Evaluation) -> float:
    """Minus twice the log likelihood of some outputs together under the likeliest noise, that of all others as it is.

    Parameters
    ----------
    doubted : sequence of Left
        Of one fit.
    problem : Problem
        Of that fit, or of another one to the same readings.
    here : Evaluation
        Of it.
    """
    nothing = np.zeros((0, here.rows.shape[1]))
    # What that fit may move by itself is no constant of its noise.
    pieces = [piece.among(problem.unknowns) for left in doubted for piece in left.pieces]
    shapes = {key: shape for left in doubted for key, shape in left.shapes.items()}
    beside = {piece: shape for piece, shape in doubted[0].beside.items() if piece.key not in shapes}
    return Evidence(problem, here, pieces, nothing, beside).deviance([], _drifting(pieces, shapes))[0]


def _drifting(pieces: Sequence[Piece], shapes: Mapping[Key, Shape]) -> dict[Key, Shape]:
    """The noise of each piece with every constant that it may have: a sensor that drifts is no missing stage."""
    found = {}
    for piece in pieces:
        shape, allowed = shapes[piece.key], piece.allowed
        found[piece.key] = replace(shape, terms=replace(shape.terms, offset=allowed.offset, trend=allowed.trend))
    return found


def of_voltage(problem: Problem, theta: FloatArray, output: str, *, bent: bool = False) -> FloatArray:
    """The voltage and lagged copies of it, in every run that has an output; shape (n_columns, n_residual).

    Parameters
    ----------
    problem : Problem
    theta : float array, shape (n_unknown,)
    output : str
    bent : bool
        Of the voltage times its magnitude in its place: what no linear model answers to.
    """
    longest = max(float(record.run.time[-1] - record.run.time[0]) for record in problem.records)
    poles = -1.0 / (np.array(_LAGS) * longest)
    found = np.zeros((1 + len(poles), problem.beforehand.stop))
    for record in problem.records:
        if output not in record.readings:
            continue
        driven = drive(record, problem.delay(theta, record))
        if bent:
            start, end, present = (one * np.abs(one) for one in (driven.start, driven.end, driven.present))
            driven = Drive(driven.durations, driven.kind, start, end, present, driven.rows)
        lagged, _ = responses(driven, poles)
        used = record.readings[output].used
        key = record.place, output
        piece = problem.pieces[key]
        found[0, piece] = driven.present[used] / problem.noise[key]
        found[1:, piece] = lagged[:, used] / problem.noise[key]
    return found
