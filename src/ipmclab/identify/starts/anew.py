"""Other minima asked again under the noise that was found.

Least squares takes noise for white. A record that drifts then has its lowest minimum where a slow pole or zero follows
the drift, far from the strip's own; the noise found in the residuals there is that of a drift all the same. Under it
the other minima, and the one near a usual strip, may be far more likely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.noise.correlate import Correlated
from ipmclab.identify.noise.pieces import Piece, System
from ipmclab.identify.problem import Problem
from ipmclab.identify.solve import Solution, minimise
from ipmclab.identify.starts.start import TYPICAL
from ipmclab.identify.valleys import Rival

FloatArray = npt.NDArray[np.float64]

_TURNS: Final = 3
_EVALUATIONS: Final = 20  # of a search that is only to show where it leads
_NEAR: Final = 1e-8  # of the cost: for thousands of readings a ten-thousandth of chi-square
_HOPELESS: Final = 100.0  # of chi-square under the noise of another fit: its own noise will not make up for so much
_AS_GOOD: Final = 4.0  # of chi-square; answers that differ by less are the same
_SAME: Final = 1e-3  # of an entry: a search that ends so near found the same point


def anew(
    problem: Problem, first: Correlated, ends: Sequence[Rival], noise_at: Callable[[Solution], Correlated]
) -> tuple[Correlated, tuple[Rival, ...]]:
    """Search again from other starts under the noise that was found, and find the noise again where one ends.

    A noise found at one minimum suits that one: the best of the others is judged under the noise that is found there.

    Parameters
    ----------
    problem : Problem
        With white noise.
    first : Correlated
        From the minimum of least squares.
    ends : sequence of Rival
        Where the searches by least squares ended, the best first.
    noise_at : function of Solution
        The noise and the fit under it, from a point of ``problem``.

    Returns
    -------
    found : Correlated
        At the most likely minimum.
    rivals : tuple of Rival
        Other minima that are as good there.
    """
    found, visited = first, [(first, _criterion(first))]
    spent = first.solution.evaluations
    for turn in range(_TURNS):
        thetas = [_entries(found.problem, found.solution.theta, end.entries) for end in ends]
        tried = _searched(found.problem, [*(thetas if turn else thetas[1:]), *_usual(found)])
        spent += sum(one.evaluations for one in tried)
        known = [found.problem.evaluate(one.solution.theta).residual for one, _ in visited]
        others = [one for one in tried if all(_power(one.evaluation.residual - left) > _AS_GOOD for left in known)]
        best = min(others, key=lambda one: one.evaluation.cost, default=None)
        if best is None or best.evaluation.cost > found.solution.evaluation.cost + _HOPELESS:
            break
        other = noise_at(replace(in_full(problem, found.problem, best), evaluations=0))
        spent += other.solution.evaluations
        if not drifts(other):
            break
        visited.append((other, _criterion(other)))
        if visited[-1][1] >= min(criterion for _, criterion in visited[:-1]):
            break
        found = other
    found, least = min(visited, key=lambda pair: pair[1])
    allowed = found.solution.evaluation.cost + _AS_GOOD
    thetas = [one.theta for one in tried if one.evaluation.cost < allowed]
    # Each under the noise found there.
    thetas += [one.solution.theta for one, criterion in visited if criterion < least + _AS_GOOD]
    rivals = [theta for theta in thetas if np.abs(theta - found.solution.theta).max() > _SAME]
    found = replace(found, solution=replace(found.solution, evaluations=spent))
    return found, tuple(Rival.of(found.problem, theta) for theta in rivals)


def _power(residual: FloatArray) -> float:
    return float(residual @ residual)


def _criterion(found: Correlated) -> float:
    """Bayes's information criterion of the readings under the noise that was found; smaller is better."""
    problem = found.problem
    pieces = [Piece.of(problem.record_at(place), output, problem.unknowns) for place, output in found.shapes]
    system = System(problem, found.plain, pieces)
    height = found.solution.evaluation.cost
    for key, shape in found.shapes.items():
        columns = system.columns[key]
        _, logarithm = columns.products(shape.terms, shape.entries)
        terms = shape.terms.shapes + shape.terms.constants
        height += columns.count * math.log(shape.variance) + logarithm + terms * math.log(columns.count)
    return height


def drifts(found: Correlated) -> bool:
    """Whether readings show noise that goes away from zero, of which least squares is no judge."""
    return any(
        noise.terms.walk or (noise.terms.constants and not _is_blind(found, key[1]))
        for key, noise in found.noise.items()
    )


def _is_blind(found: Correlated, output: str) -> bool:
    """Whether an output drifts for nothing but that it might do so unseen."""
    return output in found.blind and found.blind[output].allowed


def _searched(problem: Problem, thetas: Sequence[FloatArray]) -> list[Solution]:
    return [minimise(problem, theta, evaluations=_EVALUATIONS, tolerance=_NEAR) for theta in thetas]


def _entries(problem: Problem, own: FloatArray, entries: Mapping[str, float]) -> FloatArray:
    names = [unknown.name for unknown in problem.unknowns]
    return np.array([entries.get(name, entry) for name, entry in zip(names, own, strict=True)])


def _usual(found: Correlated) -> list[FloatArray]:
    """The coupling of a usual strip, with the gain that these readings ask for; none where no coupling is free."""
    problem, theta = found.problem, found.solution.theta.copy()
    if not any(unknown.base.startswith("coupling.") for unknown in problem.unknowns):
        return []
    gain = None
    for place, unknown in enumerate(problem.unknowns):
        if unknown.base.startswith("coupling.") and unknown.base in TYPICAL:
            theta[place] = unknown.entry(float(np.clip(TYPICAL[unknown.base], unknown.lower, unknown.upper)))
            gain = place if unknown.base == "coupling.gain" else gain
    if gain is not None:
        here = problem.evaluate(theta)
        # Motion is in proportion to the gain: its derivative by the logarithm is the motion itself.
        motion = here.jacobian[:, gain]
        factor = float(motion @ (motion - here.residual)) / max(float(motion @ motion), 1e-300)
        theta[gain] += np.log(factor) if factor > 0.0 else 0.0
    return [theta]


def in_full(problem: Problem, smaller: Problem, solution: Solution) -> Solution:
    """A point of a problem whose zeros and slopes were left to the noise, with the best of these in the whole one."""
    entries = Rival.of(smaller, solution.theta).entries
    theta = _entries(problem, np.zeros(len(problem.unknowns)), entries)
    left = np.array([unknown.name not in entries for unknown in problem.unknowns], dtype=bool)
    here = problem.evaluate(theta)
    if left.any():
        theta[left] -= np.linalg.lstsq(here.jacobian[:, left], here.residual, rcond=1e-12)[0]
        here = problem.evaluate(theta)
    return replace(solution, theta=theta, evaluation=here)
