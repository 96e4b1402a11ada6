"""How well readings separate parameters: the combinations that they know best and worst, and sets nearly one.

The collinearity index of a set is that of Brun, Reichert and Kuensch (Water Resources Research 37 (2001) 1015): one
over the smallest singular value of its columns of the sensitivity, each scaled to length 1. A change of one parameter
of the set can be made good by the others to one part in that index.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import comb, inf
from typing import Final

import numpy as np

from ipmclab.fit.practical import CollinearSet, Combination, Practical
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.tangent import STRUCTURAL, rank_threshold
from ipmclab.identification.uncertainty.covariance import MOVED, left_of_the_asked
from ipmclab.identification.undetermined.diagnosis import sizes
from ipmclab.model.order import Order
from ipmclab.run import FloatArray
from ipmclab.ties import largest_first, upright

COLLINEAR: Final = 10.0
"""From this index on a set is named: a tenth of what a change of one parameter would show is left by the others."""

_LARGEST_SET: Final = 4  # of parameters: of five nobody fixes one
_MOST_SETS: Final = 20_000  # of one size, that take less than a second


def practical(problem: Problem, values: FloatArray, here: Evaluation, order: Order) -> Practical:
    """At some values of what is asked for, from the sensitivity of the (whitened) readings there."""
    nuisance = np.array([unknown.nuisance for unknown in problem.unknowns], dtype=bool)
    if nuisance.all():
        return Practical((), {}, ())
    asked = [unknown for _, unknown in problem.asked]
    block = left_of_the_asked(here, nuisance) * sizes(asked, values)
    return practical_from([order(unknown.name) for unknown in asked], block, here)


def practical_from(names: list[str], sensitivity: FloatArray, here: Evaluation | None = None) -> Practical:
    """From weighted relative sensitivities, shape (n_rows, n_names), of the evaluation where they were taken.

    Examples
    --------
    >>> found = practical_from(["a", "b"], np.array([[1.0, 0.6], [0.0, 0.8]]))
    >>> round(found.collinearity["a"], 6)
    1.25
    """
    count = len(names)
    _, singular, directions = np.linalg.svd(sensitivity, full_matrices=True)
    singular = np.concatenate([singular, np.zeros(count - len(singular))])
    determined = singular > (STRUCTURAL * singular[0] if here is None else rank_threshold(here, singular[0]))
    errors = np.where(determined, 1.0 / np.where(determined, singular, 1.0), inf)
    found = tuple(
        Combination(dict(zip(names, map(float, upright(row)), strict=True)), float(error))
        for row, error in zip(directions, errors, strict=True)
    )
    length = np.sqrt((sensitivity * sensitivity).sum(axis=0))
    moved = (np.abs(directions[~determined]) > MOVED).any(axis=0)
    own = np.sqrt(((directions[determined] / singular[determined, None]) ** 2).sum(axis=0)) * length
    indices = np.where(moved, inf, np.maximum(own, 1.0))
    scaled = sensitivity / np.where(length > 0.0, length, 1.0)
    return Practical(found, dict(zip(names, map(float, indices), strict=True)), tuple(_worst(names, scaled)))


def _worst(names: list[str], scaled: FloatArray) -> Iterator[CollinearSet]:
    gram = scaled.T @ scaled
    for size in range(2, min(_LARGEST_SET, len(names)) + 1):
        if comb(len(names), size) > _MOST_SETS:
            return
        sets = np.array(list(combinations(range(len(names)), size)))
        smallest = np.linalg.eigvalsh(gram[sets[:, :, None], sets[:, None, :]])[:, 0]
        worst = largest_first(-smallest)[0]
        # The squares lose half of the digits: the set itself is asked again.
        least = float(np.linalg.svd(scaled[:, sets[worst]], compute_uv=False)[-1]) if len(scaled) >= size else 0.0
        yield CollinearSet(tuple(names[k] for k in sets[worst]), 1.0 / least if least > STRUCTURAL else inf)
