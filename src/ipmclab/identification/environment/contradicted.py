"""Runs whose readings ask for other water than is known of them."""

from __future__ import annotations

from typing import Final

from ipmclab.confidence import REJECT
from ipmclab.identification.problem.problem import Problem
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

    here, known = solution.evaluation, [unknown for unknown in problem.unknowns if unknown.prior is not None]
    of_known = zip(known, here.residual[len(here.of_readings) :].tolist(), strict=True)
    total = sum(left**2 for one, left in of_known if one.nuisance)
    away = {
        one.place: (one.value(entry) - one.beforehand[0]) / one.beforehand[1]
        for one, entry in zip(problem.unknowns, solution.theta.tolist(), strict=True)
        if one.is_water and one.place is not None and one.beforehand is not None
    }
    if not away or chdtrc(len(away), total) > REJECT:
        return []
    run = max(away, key=lambda place: abs(away[place]))
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
            f"{state.how} ({abs(away[run]):.2g} standard uncertainties)",
            "see whether the strip was in equilibrium, and whether a parameter without a law changes; weigh the strip",
            values={"chi_square": total, "runs": len(away)},
        )
    ]
