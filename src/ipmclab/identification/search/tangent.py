"""What the derivatives at one point say: a step, errors, directions of which the readings say nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.run import FloatArray

STRUCTURAL: Final = 1e-7
"""A singular value below this part of the largest is a direction that no amount of such data determines."""

UNFELT: Final = 1e-30
"""Of the largest derivative: far below the rounding of a sum of squares."""

_SHARP: Final = 1e5
"""What is known that well is as good as exact: ``STRUCTURAL`` times as well is to within a factor of e^100."""


def gauss_newton(here: Evaluation) -> tuple[FloatArray, float]:
    """The step, and the decrease of the cost that it promises."""
    singular, directions, right, size = here.scaled_spectrum
    kept = singular > STRUCTURAL * singular.max(initial=0.0)
    turned = right[kept]
    return -(directions[kept].T @ (turned / singular[kept])) / size, float(turned @ turned)


def known_beforehand(here: Evaluation) -> float:
    """How many of the unknowns were known beforehand rather than fed by readings: the leverage of those rows."""
    if not here.beforehand:
        return 0.0
    singular, directions, _, size = here.scaled_spectrum
    kept = singular > STRUCTURAL * singular.max(initial=0.0)
    rows = here.jacobian[-here.beforehand :] / size
    return float(np.sum((rows @ directions[kept].T / singular[kept]) ** 2))


def entry_errors(here: Evaluation) -> FloatArray:
    """Standard error of each entry, infinite where a direction of which the readings say nothing moves it."""
    return np.asarray(np.hypot(*error_parts(here)))


def error_parts(here: Evaluation) -> FloatArray:
    """What the noise of the readings makes of these, and what an error of what was known beforehand, shape (2, n)."""
    singular, directions, _, size = here.scaled_spectrum
    kept = singular > STRUCTURAL * singular.max(initial=0.0)
    ways = directions[kept] / singular[kept, None] / size
    known = (((ways @ here.rows[:-1, len(here.of_readings) :]).T @ ways) ** 2).sum(axis=0)
    parts = np.sqrt(np.maximum([(ways**2).sum(axis=0) - known, known], 0.0))
    return np.where((np.abs(directions[~kept]) > 1e-3).any(axis=0), np.inf, parts)


def null_directions(here: Evaluation) -> FloatArray:
    """Unit vectors along which the readings say nothing, shape (n_null, n_unknown)."""
    singular, directions = here.spectrum
    return np.asarray(directions[singular <= rank_threshold(here, singular[0])])


def rank_threshold(here: Evaluation, largest: float) -> float:
    """The singular value up to which a direction is one of which the readings say nothing.

    That is a part of the largest, unless that is of something that was known beforehand, far better than the readings
    know anything: then they are held against what they themselves know best.
    """
    read, known = np.split(here.rows[:-1], [len(here.of_readings)], axis=1)
    if largest <= _SHARP or np.abs(known).max(initial=0.0) <= 0.5 * largest:
        return STRUCTURAL * largest
    best = float(np.sqrt((read * read).sum(axis=1).max(initial=0.0)))
    rounding = len(read) * float(np.finfo(np.float64).eps) * largest
    return max(STRUCTURAL * max(best, _SHARP), rounding)


def with_others(here: Evaluation, places: Sequence[int], moved: npt.ArrayLike) -> tuple[FloatArray, float]:
    """The step of all entries as some move by so much, and by how much the others then lower the cost.

    Along directions of which the readings say nothing the others stay.
    """
    triangle, right = here.triangle[:, :-1], here.triangle[:, -1]
    step = np.zeros(triangle.shape[1])
    step[places] = moved
    right = right + triangle @ step
    kept = np.ones(len(step), dtype=bool)
    kept[places] = False
    columns = triangle[:, kept]
    size = np.sqrt((columns * columns).sum(axis=0))
    size[size == 0.0] = 1.0
    left, singular, directions = np.linalg.svd(columns / size, full_matrices=False)
    determined = singular > STRUCTURAL * singular.max(initial=0.0)
    turned = left.T[determined] @ right
    step[kept] = -(directions[determined].T @ (turned / singular[determined])) / size
    return step, float(turned @ turned)
