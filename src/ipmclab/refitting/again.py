"""A fit again to other readings of the same runs: the same problem, its residuals shifted by what they differ."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.engine import Engine, in_order
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import Shifted, Solution, descend
from ipmclab.identification.solved import solved
from ipmclab.model.order import Order
from ipmclab.one_thread import on_one_thread
from ipmclab.progress import tick
from ipmclab.refitting.side_by_side import Polished, SideBySide

FloatArray = npt.NDArray[np.float64]

_NEAR: Final = 1e-8  # of the cost (convention)
_FROM_ELSEWHERE: Final = 40  # evaluations of a search from another fit that was as good
_TOGETHER: Final = 64  # fits that go side by side: 2 MB of readings for two runs of 2,000 rows


@dataclass(frozen=True, eq=False)
class Fitted:
    """What every fit to other readings starts from.

    Parameters
    ----------
    problem : Problem
    theta : float array, shape (n_unknown,)
    here : Evaluation
        At ``theta``.
    starts : sequence of float array
        Other fits that were as good, from which the search begins too.
    """

    problem: Problem
    theta: FloatArray
    here: Evaluation
    starts: Sequence[FloatArray] = ()

    @cached_property
    def beside(self) -> SideBySide | None:
        """The problem as fits go through it side by side, where they do."""
        return SideBySide.of(self.problem)


def fitted(fit: Fit) -> Fitted:
    """Where fits to other readings of the same runs start.

    Raises
    ------
    InputError
        As ``solved``.
    """
    estimate = solved(fit)
    starts = [rival.vector_of(estimate.problem.unknowns, estimate.solution.theta) for rival in estimate.rivals]
    correlated = estimate.correlated
    return Fitted(correlated.problem, correlated.solution.theta, correlated.solution.evaluation, starts)


def values_of(problem: Problem, thetas: Sequence[FloatArray]) -> dict[str, FloatArray]:
    """The value [SI] of each parameter in each of some fits, shape (n_fits,).

    Branches and modes are named by their place in the row of time constants, in each fit again; NaN where what is free
    has another place there.
    """
    first = problem.records[0].place
    asked = [(place, unknown) for place, unknown in enumerate(problem.unknowns) if not unknown.nuisance]
    each = []
    for theta in thetas:
        order = Order(problem.in_reference(theta, first))
        each.append({order(unknown.name): unknown.value(float(theta[place])) for place, unknown in asked})
    names = dict.fromkeys(name for one in each for name in one)
    return {name: np.array([one.get(name, np.nan) for one in each]) for name in names}


def fits_again(fitted: Fitted, shifts: Iterable[FloatArray], count: int, engine: Engine) -> list[FloatArray | None]:
    """Where the fit to each of some readings ends; None where it does not.

    Parameters
    ----------
    fitted : Fitted
    shifts : iterable of float array, shape (n_rows,)
        What the residuals are shifted by.
    count : int
        How many there are.
    engine : Engine
        The answer is the same on all, to the last bit.
    """
    size = 1 if fitted.beside is None else _TOGETHER
    found = in_order(engine, _fit_again, fitted, _in_blocks(shifts, size), -(-count // size))
    return [theta for block in found for theta in block]


def _in_blocks(shifts: Iterable[FloatArray], size: int) -> Iterator[FloatArray]:
    left = iter(shifts)
    while block := list(islice(left, size)):
        yield np.array(block)


@on_one_thread
def _fit_again(fitted: Fitted, shifts: FloatArray) -> list[FloatArray | None]:
    """Where the fits to some readings end."""
    first, *others = (_polished(fitted, start, shifts) for start in (fitted.theta, *fitted.starts))
    found: list[FloatArray | None] = []
    for place, shift in enumerate(shifts):
        shifted = Shifted(fitted.problem, shift)
        theta, cost, converged = _of_one(first, place) or _alone(
            descend(shifted, fitted.theta, shifted.shifted(fitted.here), tolerance=_NEAR)
        )
        for start, polished in zip(fitted.starts, others, strict=True):
            other = _of_one(polished, place) or _alone(
                descend(shifted, start, evaluations=_FROM_ELSEWHERE, tolerance=_NEAR)
            )
            theta, cost, converged = other if other[1] < cost else (theta, cost, converged)
        tick()
        found.append(theta if converged else None)
    return found


def _polished(fitted: Fitted, start: FloatArray, shifts: FloatArray) -> Polished | None:
    return None if fitted.beside is None else fitted.beside.polished(start, shifts)


def _of_one(polished: Polished | None, place: int) -> tuple[FloatArray, float, bool] | None:
    """Where one of the fits that went side by side has ended; None where another search has to find it."""
    if polished is None or not polished.ended[place]:
        return None
    return polished.thetas[place], float(polished.costs[place]), True


def _alone(solution: Solution) -> tuple[FloatArray, float, bool]:
    return solution.theta, solution.evaluation.cost, solution.converged
