"""Stages of which the readings show nothing: their parameters are named, never given a number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.identify.problem import Problem
from ipmclab.identify.solve import Solution, entry_errors, minimise, polish
from ipmclab.identify.unknowns import Unknown

REJECT: Final = 1e-3
"""A stage is seen when readings without it would lose so much as rarely as this."""

_SURELY: Final = 0.1  # standard error over value of a size that leaves no question
_STAGES: Final = (
    # What switches a stage off, and what then means nothing.
    (r"leak\.(exponential|butler_volmer)\.", ("current_density",)),
    (r"leak\.slow\.", ("growth",)),
    (r"relaxation\.\w+\.\d+\.", ("ratio", "lead")),
    (r"viscoelastic\.\d+\.", ("amplitude",)),
)
_CURES: Final = {
    "leak": "record above the threshold of the leak, 1.23 V behind the electrodes",
    "leak.slow": "record for longer at a voltage that leaks",
    "relaxation": "record for longer at a constant voltage, or with less noise",
    "viscoelastic": "record force with steps, or with less noise",
}


@dataclass(frozen=True)
class Unseen:
    """A stage that was taken out.

    Parameters
    ----------
    unknowns : tuple of Unknown
        Its free parameters.
    sentence : str
    """

    unknowns: tuple[Unknown, ...]
    sentence: str


def without_unseen(problem: Problem, solution: Solution) -> tuple[Problem, Solution, tuple[Unseen, ...]]:
    """Take out, one after the other, the stages without which the readings are met as well.

    At a size of zero the shape of a stage means nothing, and its size is whatever the shape allows, so that the
    curvature there is no measure of what is known. A stage is kept where leaving it out costs more than noise would.

    Parameters
    ----------
    problem : Problem
        With the noise found in the residuals.
    solution : Solution
    """
    found: list[Unseen] = []
    kept: set[str] = set()
    while True:
        stages = {name: own for name, own in _stages(problem).items() if name not in kept}
        worst: tuple[float, str, Problem, Solution] | None = None
        for name, (columns, sizes) in stages.items():
            if _is_sure(problem, solution, sizes):
                kept.add(name)
                continue
            smaller, there = _switched_off(problem, solution, columns, sizes)
            chance = _chance(solution, there, len(columns))
            if chance < REJECT:
                kept.add(name)
            elif worst is None or chance > worst[0]:
                worst = chance, name, smaller, there
        if worst is None:
            return problem, solution, tuple(found)
        chance, name, smaller, there = worst
        columns, _ = stages[name]
        found.append(_unseen(name, [problem.unknowns[column] for column in columns], chance))
        problem, solution = smaller, there


def can_be_unseen(problem: Problem) -> bool:
    """Whether the problem has a stage that can be switched off."""
    return bool(_stages(problem))


def _stages(problem: Problem) -> dict[str, tuple[list[int], list[int]]]:
    """For each stage that can be switched off: the entries that then mean nothing, and those of its size."""
    found: dict[str, tuple[list[int], list[int]]] = {}
    for pattern, sizes in _STAGES:
        for column, unknown in enumerate(problem.unknowns):
            match = re.match(pattern, unknown.base)
            if match is None:
                continue
            columns, own = found.setdefault(match[0], ([], []))
            columns.append(column)
            if unknown.base.removeprefix(match[0]) in sizes:
                own.append(column)
    if any(name.startswith(("leak.e", "leak.b")) for name in found) and "leak.slow." in found:
        # Without a leak it cannot be slow either.
        leak = next(name for name in found if name.startswith(("leak.e", "leak.b")))
        found[leak] = ([*found[leak][0], *found["leak.slow."][0]], [*found[leak][1], *found["leak.slow."][1]])
    # A size that is fixed is known not to be zero.
    return {name: (columns, own) for name, (columns, own) in found.items() if own and _all_sizes_free(problem, name)}


def _all_sizes_free(problem: Problem, name: str) -> bool:
    sizes = next(sizes for pattern, sizes in _STAGES if re.match(pattern, name))
    free = {unknown.base for unknown in problem.unknowns}
    return all(f"{name}{size}" in free or not problem.base.get(f"{name}{size}") for size in sizes)


def _is_sure(problem: Problem, solution: Solution, sizes: Sequence[int]) -> bool:
    errors = entry_errors(solution.evaluation)
    return any(
        errors[column] < _SURELY * (1.0 if problem.unknowns[column].log else abs(float(solution.theta[column])))
        for column in sizes
    )


def _switched_off(
    problem: Problem, solution: Solution, columns: Sequence[int], sizes: Sequence[int]
) -> tuple[Problem, Solution]:
    off = {problem.unknowns[column].base: 0.0 for column in sizes}
    left = [place for place in range(len(problem.unknowns)) if place not in set(columns)]
    smaller = problem.without(columns, off)
    theta = solution.theta[left]
    if not left:
        return smaller, Solution(theta, smaller.evaluate(theta), True, "nothing else is free", 1)
    again = polish(smaller, theta) or minimise(smaller, theta, evaluations=100)
    return smaller, again


def _chance(solution: Solution, there: Solution, count: int) -> float:
    """How often noise alone would lose as much when the stage is left out."""
    from scipy.special import chdtrc

    residual = solution.evaluation.residual
    power = solution.evaluation.cost
    neighbour = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    # Residuals that hang together count for fewer.
    spread = (1.0 + max(neighbour, 0.0)) / (1.0 - min(neighbour, 0.97))
    variance = power / max(len(residual) - len(solution.theta), 1) * spread
    lost = max(there.evaluation.cost - power, 0.0)
    return float(chdtrc(count, lost / variance)) if variance > 0 else float(lost == 0.0)


def _unseen(name: str, unknowns: Sequence[Unknown], chance: float) -> Unseen:
    listed = ", ".join(dict.fromkeys(unknown.name for unknown in unknowns))
    stage = name.rstrip(".")
    kind = next(kind for kind in ("leak.slow", "leak", "relaxation", "viscoelastic") if stage.startswith(kind))
    plural = "are" if len(unknowns) > 1 else "is"
    sentence = (
        f"{listed} {plural} not determined: these runs are met as well without {stage} (p = {chance:.2g}), and "
        f"everything else stands where it does without it; {_CURES[kind]}"
    )
    return Unseen(tuple(unknowns), sentence)
