"""Questions to the readings whose answers hang on their noise, asked again under the noise that was found.

White noise is what a first fit takes for granted. Under noise that hangs together a start from rest is contradicted,
and a stage is seen, far more often than the tests say.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import replace

from ipmclab.identify.doubts import unexplained
from ipmclab.identify.noise.correlate import Correlated, correlate
from ipmclab.identify.problem import Problem
from ipmclab.identify.rest import is_idle
from ipmclab.identify.solve import Solution
from ipmclab.identify.unseen import Unseen, can_be_unseen, without_unseen


def noise_of(problem: Problem, solution: Solution, yielding: Sequence[int]) -> Correlated:
    """The fit under the noise of its own residuals, but not of outputs that the model does not explain.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    yielding : sequence of int
        Entries of zeros and slopes of sensors that nobody freed by name.
    """
    beyond = {str(finding.channel) for finding in unexplained(problem, solution)}
    return correlate(problem, solution, yielding, beyond)


def at_rest_after_all(
    problem: Problem, solution: Solution, yielding: Sequence[int], places: Set[int]
) -> dict[int, list[int]]:
    """Runs whose start differs from rest by no more than their noise does, and the entries of their start.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    yielding : sequence of int
        As for ``noise_of``.
    places : set of int
        Of the runs whose start was freed because white noise would contradict rest.
    """
    if not places:
        return {}
    under = noise_of(problem, solution, yielding)
    if not under.noise:
        return {}
    found: dict[int, list[int]] = {}
    for place in places:
        there = _starts(under.problem, place)
        if there and is_idle(under.solution, there):
            found[place] = _starts(problem, place)
    return found


def _starts(problem: Problem, place: int) -> list[int]:
    return [column for column, unknown in enumerate(problem.unknowns) if unknown.nuisance and unknown.place == place]


def unseen_under_noise(
    problem: Problem,
    solution: Solution,
    yielding: Sequence[int],
    again: Callable[[Problem, Solution], Solution],
) -> tuple[Problem, Solution, tuple[Unseen, ...], Correlated | None]:
    """Without the stages of which the readings show nothing beyond their noise.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    yielding : sequence of int
        As for ``noise_of``.
    again : function of (Problem, Solution)
        The fit of a problem from a vector near its minimum.

    Returns
    -------
    problem, solution
        Under white noise as before, the unseen stages taken out.
    unseen : tuple of Unseen
    beside : Correlated or None
        The fit that still had them, under its noise; None where nothing was taken out.
    """
    if not can_be_unseen(problem):
        return problem, solution, (), None
    beside = noise_of(problem, solution, yielding)
    smaller, _, unseen = without_unseen(beside.problem, beside.solution)
    if not unseen:
        return problem, solution, (), None
    names = {unknown.name for one in unseen for unknown in one.unknowns}
    gone = [column for column, unknown in enumerate(problem.unknowns) if unknown.name in names]
    kept = [column for column in range(len(problem.unknowns)) if column not in set(gone)]
    fewer = problem.without(
        gone, {problem.unknowns[column].base: smaller.base[problem.unknowns[column].base] for column in gone}
    )
    theta = solution.theta[kept]
    first = replace(solution, theta=theta, evaluation=fewer.evaluate(theta), evaluations=solution.evaluations + 1)
    return fewer, again(fewer, first) if kept else first, unseen, beside
