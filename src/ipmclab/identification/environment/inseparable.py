"""Age and environment: whether the order of the runs distinguishes one from the other.

Where conditions were changed in one direction only, each change of the environment is also a later run: what a law
takes up, ageing can take up as well. A run that goes back to an earlier condition shows what has changed for good.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ipmclab.fit.rows import listed
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import Solution
from ipmclab.model.environment.age import AGE
from ipmclab.model.environment.laws import is_of_environment
from ipmclab.normal_equations import inverse
from ipmclab.run import Finding
from ipmclab.strip_state.run_state import RunState

CODE: Final = "age-inseparable"

_MUCH: Final = 3.0
"""Times the standard error that age would have if the laws were known: its variance is then nine tenths theirs."""

_TOGETHER: Final = 0.5  # correlation with a law that is named


def inseparable(problem: Problem, solution: Solution) -> list[Finding]:
    """``age-inseparable``: how fast a parameter ages, and the laws with which it can be exchanged.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    """
    unknowns = problem.unknowns
    ages = [place for place, unknown in enumerate(unknowns) if unknown.base.startswith(AGE)]
    laws = [place for place, unknown in enumerate(unknowns) if is_of_environment(unknown.base)]
    if not ages or not laws:
        return []
    products = solution.evaluation.jacobian.T @ solution.evaluation.jacobian
    covariance = inverse(products)
    kept = [place for place in range(len(unknowns)) if place not in laws]
    without = inverse(products[np.ix_(kept, kept)])
    sizes = np.sqrt(np.maximum(covariance.diagonal(), 1e-300))
    states = [record.state for record in problem.records if record.state is not None]
    found = []
    for age in ages:
        alone = math.sqrt(without[kept.index(age), kept.index(age)])
        ratio = sizes[age] / alone if alone > 0.0 else math.inf
        if ratio < _MUCH:
            continue
        alike = {law: abs(covariance[age, law]) / (sizes[age] * sizes[law]) for law in laws}
        named = [unknowns[law].name for law in laws if alike[law] > _TOGETHER]
        named = named or [unknowns[max(alike, key=alike.__getitem__)].name]
        found.append(_finding(unknowns[age].name, named, float(ratio), states))
    return found


def _finding(age: str, laws: Sequence[str], ratio: float, states: Sequence[RunState]) -> Finding:
    first = states[0]
    there = (
        "" if first.relative_humidity is None else f" ({first.temperature:.4g} degC, {first.relative_humidity:.3g} %RH)"
    )
    return Finding(
        CODE,
        "warning",
        f"{age} and {listed(laws)} cannot be separated: a later run was also one in another environment, so ageing is "
        f"known {ratio:.2g} times worse than it would be if the laws were known",
        f"go back: repeat the condition of the first run{there} at the end, and between others on the way",
        values={"ratio": ratio},
    )
