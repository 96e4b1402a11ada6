"""How well readings tell parameters apart: the combinations that they know best and worst, and sets nearly one.

The collinearity index of a set is that of Brun, Reichert and Kuensch (Water Resources Research 37 (2001) 1015): one
over the smallest singular value of its columns of the sensitivity, each scaled to length 1. A change of one parameter
of the set can be made good by the others to one part in that index.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from math import comb, inf
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.order import Order
from ipmclab.identify.problem import Evaluation, Problem
from ipmclab.identify.solve import STRUCTURAL, Solution, least_seen

FloatArray = npt.NDArray[np.float64]

COLLINEAR: Final = 10.0
"""From this index on a set is told of: its parameters change places at a tenth of what a change would show."""

_LARGEST_SET: Final = 4
_MOST_SETS: Final = 20_000


@dataclass(frozen=True)
class Combination:
    """Parameters that move together.

    Parameters
    ----------
    coefficients : mapping of name to float
        Relative change of each along it (unit length).
    error : float
        Standard error along it, as a logarithm; infinite where the readings say nothing.
    """

    coefficients: Mapping[str, float]
    error: float


@dataclass(frozen=True)
class CollinearSet:
    """Parameters that nearly change places, and the index of them."""

    names: tuple[str, ...]
    index: float


@dataclass(frozen=True)
class Practical:
    """How well readings tell the free parameters apart.

    Parameters
    ----------
    combinations : tuple of Combination
        Eigenvectors of the information, the best known first.
    collinearity : mapping of name to float
        How many times larger the error of each parameter is than it were if all others were known; 1 where it stands
        alone, infinite where the readings say nothing of it.
    sets : tuple of CollinearSet
        Of each size from 2 on, the set with the largest index.
    """

    combinations: tuple[Combination, ...]
    collinearity: Mapping[str, float]
    sets: tuple[CollinearSet, ...]

    @classmethod
    def of(cls, problem: Problem, solution: Solution, order: Order) -> Practical:
        """At a solution, from the sensitivity of the (whitened) readings."""
        nuisance = np.array([unknown.nuisance for unknown in problem.unknowns], dtype=bool)
        if nuisance.all():
            return cls((), {}, ())
        asked = [unknown for unknown in problem.unknowns if not unknown.nuisance]
        values = [u.value(float(e)) for u, e in zip(problem.unknowns, solution.theta, strict=True) if not u.nuisance]
        size = np.array([1.0 if u.log else max(abs(v) / u.scale, 1.0) for u, v in zip(asked, values, strict=True)])
        # With the others in front, the lower right block is what is left of the asked ones.
        columns = np.concatenate([np.flatnonzero(nuisance), np.flatnonzero(~nuisance)])
        first = int(np.count_nonzero(nuisance))
        block = np.asarray(np.linalg.qr(solution.evaluation.triangle[:, columns], mode="r"))[first:, first:] * size
        return cls.from_sensitivity([order(unknown.name) for unknown in asked], block, solution.evaluation)

    @classmethod
    def from_sensitivity(cls, names: list[str], sensitivity: FloatArray, here: Evaluation | None = None) -> Practical:
        """From weighted relative sensitivities, shape (n_rows, n_names), of the evaluation where they were taken.

        Examples
        --------
        >>> found = Practical.from_sensitivity(["a", "b"], np.array([[1.0, 0.6], [0.0, 0.8]]))
        >>> round(found.collinearity["a"], 6)
        1.25
        """
        count = len(names)
        _, singular, directions = np.linalg.svd(sensitivity, full_matrices=True)
        singular = np.concatenate([singular, np.zeros(count - len(singular))])
        seen = singular > (STRUCTURAL * singular[0] if here is None else least_seen(here, singular[0]))
        errors = np.where(seen, 1.0 / np.where(seen, singular, 1.0), inf)
        found = tuple(
            Combination(
                dict(zip(names, map(float, row * np.sign(row[np.abs(row).argmax()])), strict=True)), float(error)
            )
            for row, error in zip(directions, errors, strict=True)
        )
        length = np.sqrt((sensitivity * sensitivity).sum(axis=0))
        moved = (np.abs(directions[~seen]) > 1e-3).any(axis=0)
        own = np.sqrt(((directions[seen] / singular[seen, None]) ** 2).sum(axis=0)) * length
        indices = np.where(moved, inf, np.maximum(own, 1.0))
        scaled = sensitivity / np.where(length > 0.0, length, 1.0)
        return cls(found, dict(zip(names, map(float, indices), strict=True)), tuple(_worst(names, scaled)))

    def to_table(self) -> dict[str, Any]:
        """In the types that TOML has."""
        return {
            "combinations": [{"coefficients": dict(c.coefficients), "error": c.error} for c in self.combinations],
            "collinearity": dict(self.collinearity),
            "sets": [{"names": list(one.names), "index": one.index} for one in self.sets],
        }

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Practical:
        """As ``to_table`` wrote it."""
        return cls(
            tuple(
                Combination({name: float(part) for name, part in c["coefficients"].items()}, float(c["error"]))
                for c in table["combinations"]
            ),
            {name: float(index) for name, index in table["collinearity"].items()},
            tuple(CollinearSet(tuple(one["names"]), float(one["index"])) for one in table["sets"]),
        )


def _worst(names: list[str], scaled: FloatArray) -> Iterator[CollinearSet]:
    gram = scaled.T @ scaled
    for size in range(2, min(_LARGEST_SET, len(names)) + 1):
        if comb(len(names), size) > _MOST_SETS:
            return
        sets = np.array(list(combinations(range(len(names)), size)))
        smallest = np.linalg.eigvalsh(gram[sets[:, :, None], sets[:, None, :]])[:, 0]
        worst = int(smallest.argmin())
        # The squares lose half of the digits: the set itself is asked again.
        least = float(np.linalg.svd(scaled[:, sets[worst]], compute_uv=False)[-1]) if len(scaled) >= size else 0.0
        yield CollinearSet(tuple(names[k] for k in sets[worst]), 1.0 / least if least > STRUCTURAL else inf)
