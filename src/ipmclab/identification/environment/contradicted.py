"""Runs whose readings ask for other water than is known of them."""

from __future__ import annotations

from typing import Final

from ipmclab.confidence import REJECT
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.unknowns import SITES
from ipmclab.identification.search.solve import Solution
from ipmclab.run import Finding

CONTRADICTED: Final = "water-contradicted"


def water_contradicted(problem: Problem, solution: Solution) -> list[Finding]:
    """``water-contradicted``: the runs ask for other water than is known of them (chi-square, 0.1 %).

    Parameters
    ----------
    problem : Problem
    solution : Solution
    """
    from scipy.special import chdtrc

    shifts = {one.base: float(solution.theta[place]) for place, one in enumerate(problem.unknowns) if one.base == SITES}
    away = {}
    for place, unknown in enumerate(problem.unknowns):
        if unknown.is_water and unknown.prior is not None:
            # What is known of it beforehand has the error that weighed runs share.
            shared = sum(slope * shifts.get(other, 0.0) for other, (slope, _) in unknown.follows.items())
            away[place] = (float(solution.theta[place]) - (unknown.prior[0] + shared)) / unknown.prior[1]
    total = sum(one * one for one in away.values())
    if not away or chdtrc(len(away), total) > REJECT:
        return []
    worst = max(away, key=lambda place: abs(away[place]))
    run = problem.unknowns[worst].place
    assert run is not None
    record = problem.record_at(run)
    state, found = record.state, problem.water(solution.theta, run)
    assert state is not None
    assert found is not None
    return [
        Finding(
            CONTRADICTED,
            "warning",
            f"the laws do not bring the runs together: their readings ask for water contents that their sensors "
            f"contradict (p < 0.1 %), most in {record.label}: {found:.3g}, where {state.water_content:.3g} is "
            f"{state.how} ({abs(away[worst]):.2g} standard uncertainties)",
            "see whether the strip was in equilibrium, and whether a parameter without a law changes; weigh the strip",
            values={"chi_square": total, "runs": len(away)},
        )
    ]
