"""The outputs whose noise is searched: those whose residuals could be noise, and which of them is not white."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.identification.noise.pieces import Piece, imitated
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import CONSTANTS, constants
from ipmclab.statespace.screen import needs_search

FLOOR: Final = 1.01
"""Times the rounding of the model: below it residuals are no noise, and never white."""


def searched_outputs(problem: Problem, here: Evaluation) -> tuple[list[Piece], set[str]]:
    """Every output of every run whose residuals could be noise, and the outputs of which some run's are not white."""
    found = []
    coloured: set[str] = set()
    basis: FloatArray | None = None
    for key, rows in problem.pieces.items():
        inside = problem.readings[key].exact_of_used
        residual = here.residual[rows][inside]
        if problem.noise[key] <= FLOOR * problem.floors[key] or len(residual) < 2 * CONSTANTS:
            continue
        if basis is None:
            basis = imitated(here)
        piece = Piece.of(problem.record_at(key[0]), key[1], problem.unknowns)
        found.append(piece)
        if needs_search(residual, _explained(basis[rows][inside], piece.time, residual)):
            coloured.add(key[1])
    return found, coloured


def _explained(basis: FloatArray, time: FloatArray, residual: FloatArray) -> float:
    """By how much an offset and a trend would lower the squares of a white fit, a chi-square with two degrees."""
    held = constants(time)
    across = basis.T @ held
    inner = held.T @ held - across.T @ across
    # The residual of the whole fit stands square to the basis; that of one piece nearly so.
    right = held.T @ residual
    values, vectors = np.linalg.eigh(inner)
    determined = values > 1e-6 * len(time)
    return float(np.sum((vectors[:, determined].T @ right) ** 2 / values[determined]))
