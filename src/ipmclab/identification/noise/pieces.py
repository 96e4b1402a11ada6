"""The noise of every output of every run of a fit, given its residuals and their derivatives."""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.tangent import rank_threshold
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import CONSTANTS, Columns, constants, steps_between, without
from ipmclab.statespace.search import MOST_STEPS, Allowed, choose_terms, refine, rough_noise
from ipmclab.statespace.shape import Shape
from ipmclab.statespace.whitening import Whitening

Key = tuple[int, str]
"""Place of a run, and an output."""

_RIDGE: Final = 1e-9  # of what the readings know if they were white: keeps open what they do not


@dataclass(frozen=True, eq=False)
class Piece:
    """One output of one run, as the search needs it."""

    key: Key
    time: FloatArray
    step: float
    steps: npt.NDArray[np.int64]
    inside: npt.NDArray[np.bool_]
    allowed: Allowed

    @classmethod
    def of(cls, record: PreparedRun, output: str, unknowns: Sequence[Unknown]) -> Piece:
        """Measured readings only: between them the noise goes on."""
        time, inside = record.times_of(output), record.readings[output].exact_of_used
        steps = steps_between(time, record.step)
        return cls((record.place, output), time, record.step, steps, inside, Allowed()).among(unknowns)

    def among(self, unknowns: Sequence[Unknown]) -> Piece:
        """The same with no constants but those that the unknowns of a fit leave to the noise."""
        place, output = self.key
        own = {unknown.base for unknown in unknowns if unknown.place in (None, place)}
        offset, trend = f"observation.offset.{output}" not in own, f"observation.drift.{output}" not in own
        return replace(self, allowed=self.allowed._replace(offset=offset, trend=trend))

    def whitening(self, shape: Shape) -> Whitening:
        """For a shape of the noise."""
        scale = math.sqrt(shape.variance)
        return Whitening.of(shape.terms, shape.entries, scale, self.time, self.steps, self.inside)


def directions_of(here: Evaluation) -> FloatArray:
    """Combinations of the unknowns that the readings know, each to a standard error of 1 under white noise."""
    singular, directions = here.spectrum
    some = len(singular) and singular[0] > 0
    determined = singular > rank_threshold(here, singular[0]) if some else np.zeros(0, dtype=bool)
    return np.asarray(directions[: len(determined)][determined].T / singular[determined])


def imitated(here: Evaluation) -> FloatArray:
    """What the free parameters can do to the residuals: orthonormal columns, shape (n_residual, n_directions)."""
    return np.asarray(here.jacobian @ directions_of(here))


class System:
    """The normal equations of a fit at one point, as sums over its outputs and runs.

    Parameters
    ----------
    problem : Problem
    here : Evaluation
        Of it, not whitened.
    pieces : sequence of Piece
        Whose noise is to be found; all else is white as the problem says.
    added : float array, shape (n_added, n_residual), optional
        Changes of the weighted residuals that the fit has no unknown for; they stand behind its directions.
    """

    def __init__(
        self, problem: Problem, here: Evaluation, pieces: Sequence[Piece], added: FloatArray | None = None
    ) -> None:
        self.directions = directions_of(here)
        self.units = {piece.key: problem.noise[piece.key] for piece in pieces}
        more = here.rows[:0] if added is None else added
        turned = np.vstack([self.directions.T @ here.rows[:-1], more, here.rows[-1:]])
        self.pieces = {piece.key: piece for piece in pieces}
        self.ridge = _RIDGE * np.eye(len(turned))
        self.ridge[-1, -1] = 0.0
        self.rest = self.ridge.copy()
        stretches = [place for key, place in problem.pieces.items() if key not in self.pieces]
        for stretch in [*stretches, problem.beforehand]:
            self.rest += turned[:, stretch] @ turned[:, stretch].T
        self.columns = {
            piece.key: Columns(
                np.ascontiguousarray(
                    np.column_stack([constants(piece.time), turned[:, problem.pieces[piece.key]][:, piece.inside].T])
                ),
                piece.steps,
            )
            for piece in pieces
        }

    def among(self, kept: Sequence[int]) -> System:
        """The same with some of the directions and additions; the residual, the last of all, has to be among them."""
        fewer = copy.copy(self)
        fewer.rest, fewer.ridge = self.rest[np.ix_(kept, kept)], self.ridge[np.ix_(kept, kept)]
        places = [*range(CONSTANTS), *(CONSTANTS + place for place in kept)]
        fewer.columns = {
            key: Columns(np.ascontiguousarray(whole.matrix[:, places]), whole.steps)
            for key, whole in self.columns.items()
        }
        return fewer

    def given(self, shapes: Mapping[Piece, Shape]) -> System:
        """The same where the noise of some pieces is known: they belong to all else, under that noise."""
        fewer, known = copy.copy(self), {piece.key for piece in shapes}
        fewer.rest = self.rest + sum(self.part(piece.key, shape) for piece, shape in shapes.items())
        fewer.pieces = {key: piece for key, piece in self.pieces.items() if key not in known}
        fewer.columns = {key: columns for key, columns in self.columns.items() if key not in known}
        return fewer

    def part(self, key: Key, shape: Shape) -> FloatArray:
        """What a piece adds to the normal equations under a noise."""
        every, _ = self.columns[key].products(shape.terms, shape.entries)
        return without(every, shape.terms)[0] / shape.variance

    def others(self, parts: Mapping[Key, FloatArray], key: Key) -> FloatArray:
        """What all readings but those of one piece add."""
        return self.rest + sum(part for other, part in parts.items() if other != key)


def choose_noise(system: System) -> dict[Key, Shape]:
    """Terms and values of the noise of every piece, each given all others: they share the free parameters.

    Each is chosen beside the rough noise of all others, never beside what was just chosen for some: where runs disagree
    the terms of one decide those of the next, and the answer would hang on the order in which the runs were given.
    """
    shapes: dict[Key, Shape] = {}
    parts: dict[Key, FloatArray] = {}
    several = len(system.pieces) > 1
    for key, piece in system.pieces.items() if several else ():
        # First each by its own readings, with all that may drift: another's drift would drag the parameters along.
        rough = rough_noise(system.columns[key], system.ridge, piece.allowed)
        parts[key] = rough.likelihood.products
    for key, piece in system.pieces.items():
        best = choose_terms(system.columns[key], system.others(parts, key), piece.allowed)
        shapes[key] = Shape(best.terms, best.entries, best.likelihood.variance)
    return shapes


def with_constants(system: System, chosen: Mapping[Key, Shape], drifting: Collection[str] = ()) -> dict[Key, Shape]:
    """What was chosen for every piece, with the offsets and trends that others call for.

    Parameters
    ----------
    system : System
    chosen : mapping of (place, output) to Shape
    drifting : collection of str
        Outputs that may drift unseen: they have an offset and a trend whatever the criterion says.
    """
    shapes = {
        key: shape.with_drift() if key[1] in drifting and not shape.terms.walk else shape
        for key, shape in chosen.items()
    }
    if len(shapes) > 1 or drifting:
        _share_walk(shapes)
        _share_constants(shapes, system.pieces)
        shapes = refine_noise(system, shapes)
    return shapes


def refine_noise(system: System, shapes: Mapping[Key, Shape], steps: int = MOST_STEPS) -> dict[Key, Shape]:
    """The values that make the readings most likely, the terms being chosen.

    What leaves most comes first, in whatever order the runs were given: where runs disagree, the first takes up more.
    Where the likelihood alone counts, fewer ``steps`` of ``statespace.search.refine`` are enough.
    """
    found = dict(shapes)
    parts = {key: system.part(key, shape) for key, shape in shapes.items()}
    # In SI units: over their own scatter all leave the same, and rounding would decide.
    powers = {
        key: system.units[key] ** 2 * float(np.mean(np.square(system.columns[key].matrix[:, -1]))) for key in shapes
    }
    sequence = sorted(shapes, key=powers.__getitem__, reverse=True)
    for _ in range(2 if len(shapes) > 1 else 1):
        for key in sequence:
            own, others = system.columns[key], system.others(parts, key)
            best = refine(own, others, found[key].terms, [found[key].entries], steps)
            found[key] = Shape(best.terms, best.entries, best.likelihood.variance)
            parts[key] = best.likelihood.products
    return found


def _share_walk(shapes: dict[Key, Shape]) -> None:
    """An output that walks in one run does so in the others: the sensor is the same.

    In a run that is short for it, or at parameters that follow it, a walk passes for noise that fades slowly.
    """
    for output in {output for (_, output), shape in shapes.items() if shape.terms.walk}:
        walking = [shape for key, shape in shapes.items() if key[1] == output and shape.terms.walk]
        for key, shape in shapes.items():
            if key[1] == output and not shape.terms.walk:
                shapes[key] = max(walking, key=lambda shape: shape.variance)


def _share_constants(shapes: dict[Key, Shape], pieces: Mapping[Key, Piece]) -> None:
    """What one run shows of an output's zero, no other run of that output is taken to be free of.

    A parameter can take up the drift of a run so well that the run itself shows none. A trend comes with an offset:
    alone it would say that the sensor reads zero where it begins.
    """
    for key, piece in pieces.items():
        others = [shape.terms for (_, output), shape in shapes.items() if output == key[1]]
        terms = shapes[key].terms
        trend = piece.allowed.trend and any(other.trend for other in others)
        offset = piece.allowed.offset and (trend or any(other.offset for other in others))
        shapes[key] = replace(shapes[key], terms=replace(terms, offset=offset or terms.offset, trend=trend))
