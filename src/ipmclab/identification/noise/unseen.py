"""Stages of which the readings show nothing: their parameters are named, never given a number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.confidence import REJECT
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.model_error import WORSE
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.descent import minimum_near, start_with_fewer
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.tangent import entry_errors
from ipmclab.model.declared import has_shape
from ipmclab.model.kinds import kind_of
from ipmclab.model.stages.kind import StageKind

_SURELY: Final = 0.1  # standard error over value of a size that leaves no question


@dataclass(frozen=True)
class Unseen:
    """A stage that was taken out.

    Parameters
    ----------
    unknowns : tuple of Unknown
        Its free parameters.
    off : mapping of name to float [SI]
        The values that switch it off.
    sentence : str
    """

    unknowns: tuple[Unknown, ...]
    off: Mapping[str, float]
    sentence: str


def without_unseen(under: Correlated) -> tuple[tuple[Unseen, ...], Problem, Solution]:
    """Take out, one after the other, the stages without which the readings are met as well.

    At a size of zero the shape of a stage means nothing, and its size is whatever the shape allows, so that the
    curvature there is no measure of what is known. A stage is kept where leaving it out costs more than noise would.

    Parameters
    ----------
    under : Correlated

    Returns
    -------
    unseen : tuple of Unseen
    problem : Problem
        Without them.
    solution : Solution
        Its minimum, which meets the readings as well.
    """
    problem, solution = under.problem, under.solution
    found: list[Unseen] = []
    kept: set[str] = set()
    while True:
        stages = {name: own for name, own in _stages(problem).items() if name not in kept}
        worst: tuple[float, str, Problem, Solution] | None = None
        errors = entry_errors(solution.evaluation)
        units = [1.0 if u.log else abs(float(entry)) for u, entry in zip(problem.unknowns, solution.theta, strict=True)]
        for name, (columns, sizes) in stages.items():
            if any(errors[column] < _SURELY * units[column] for column in sizes):
                kept.add(name)
                continue
            smaller, there = _switched_off(problem, solution, columns, sizes)
            chance = _chance(under, solution, there, len(columns))
            # Noise that is slow enough describes whatever a stage explains: so it is asked too whether the prediction
            # is worse without it, by more than white noise feigns. How sure its parameters are, their intervals say.
            if chance < REJECT or there.evaluation.cost > _most(solution, len(columns)):
                kept.add(name)
            elif worst is None or chance > worst[0]:
                worst = chance, name, smaller, there
        if worst is None:
            return tuple(found), problem, solution
        chance, name, smaller, there = worst
        gone = [problem.unknowns[column] for column in stages[name][0]]
        off = {unknown.base: smaller.base[unknown.base] for unknown in gone}
        found.append(_unseen(name, gone, off, chance))
        problem, solution = smaller, there


def _stages(problem: Problem) -> dict[str, tuple[list[int], list[int]]]:
    """For each stage that can be switched off: the entries that then mean nothing, and those of its size."""
    found: dict[str, tuple[list[int], list[int]]] = {}
    kinds: dict[str, StageKind] = {}
    for column, unknown in enumerate(problem.unknowns):
        kind = kind_of(unknown.base)
        if kind is None or not kind.off or not has_shape(unknown.base):
            continue
        name = kind.one(unknown.base)
        kinds[name] = kind
        columns, own = found.setdefault(name, ([], []))
        columns.append(column)
        if kind.ending(unknown.base) in kind.off:
            own.append(column)
    for name, kind in kinds.items():
        for other in [one for one, of in kinds.items() if of.one_of and of.one_of == kind.follows]:
            # Without the one there is nothing of the other either.
            found[other] = ([*found[other][0], *found[name][0]], [*found[other][1], *found[name][1]])
    # A size that is fixed is known not to be zero.
    free = {unknown.base for unknown in problem.unknowns}
    return {
        name: (columns, own)
        for name, (columns, own) in found.items()
        if own and all(f"{name}{size}" in free or not problem.base.get(f"{name}{size}") for size in kinds[name].off)
    }


def _switched_off(
    problem: Problem, solution: Solution, columns: Sequence[int], sizes: Sequence[int]
) -> tuple[Problem, Solution]:
    """The problem without a stage, and its minimum, or where it does not come down to where it predicts as well."""
    off = {problem.unknowns[column].base: 0.0 for column in sizes}
    left = [place for place in range(len(problem.unknowns)) if place not in set(columns)]
    smaller = problem.without(columns, off)
    if not left:
        theta = solution.theta[left]
        return smaller, Solution(theta, smaller.evaluate(theta), True, "nothing else is free", 1)
    here = start_with_fewer(problem, smaller, solution, columns)
    fall = here.evaluation.cost - _most(solution, len(columns))
    return smaller, minimum_near(smaller, here.theta, here.evaluation, evaluations=100, fall=fall)


def _most(solution: Solution, count: int) -> float:
    """The cost up to which a fit without so many parameters predicts as well."""
    from scipy.special import chdtri

    by_chance = float(chdtri(count, REJECT)) * _variance(solution)
    return solution.evaluation.cost + max((WORSE**2 - 1.0) * solution.evaluation.cost, by_chance)


def _chance(under: Correlated, solution: Solution, there: Solution, count: int) -> float:
    """How often noise alone would lose as much when the stage is left out."""
    # What was known beforehand of the stage is gone with it.
    from scipy.special import chdtrc

    times = under.inflation(there.evaluation.of_readings - solution.evaluation.of_readings)
    variance = _variance(solution) * times
    lost = max(there.evaluation.cost - solution.evaluation.cost, 0.0)
    return float(chdtrc(count, lost / variance)) if variance > 0 else float(lost == 0.0)


def _variance(solution: Solution) -> float:
    """Of what is left of a reading."""
    return solution.evaluation.cost / max(len(solution.evaluation.residual) - len(solution.theta), 1)


def _unseen(name: str, unknowns: Sequence[Unknown], off: Mapping[str, float], chance: float) -> Unseen:
    listed = ", ".join(dict.fromkeys(unknown.name for unknown in unknowns))
    stage = name.rstrip(".")
    kind = kind_of(unknowns[0].base)
    cure = kind.to_show if kind is not None else ""
    plural = "are" if len(unknowns) > 1 else "is"
    sentence = (
        f"{listed} {plural} not determined: these runs are met as well without {stage} (p = {chance:.2g}), and "
        f"all other values are as they are without it; {cure}"
    )
    return Unseen(tuple(unknowns), off, sentence)
