"""What speaks against the likelihood from which samples were drawn."""

from __future__ import annotations

from typing import Final

from ipmclab.identify.estimate import Estimate
from ipmclab.identify.fit import Fit
from ipmclab.identify.posterior.density import AT_FLOOR
from ipmclab.identify.uncertainty.covariance import is_coloured
from ipmclab.run import Finding

_AGAINST: Final = frozenset(
    {"model-explains-nothing", "model-incomplete", "impossible-current", "not-converged", "prior-contradicted"}
)


def doubts(fit: Fit, estimate: Estimate) -> tuple[Finding, ...]:
    """Findings where the likelihood is not that of the readings: the intervals of a fit allow for it, samples cannot.

    Parameters
    ----------
    fit : Fit
    estimate : Estimate
        The solved problem of it.
    """
    problem, solution = estimate.correlated.problem, estimate.correlated.solution
    found = [finding for finding in fit.findings if finding.code in _AGAINST]
    labels = {record.place: record.label for record in problem.records}
    for (place, output), piece in problem.pieces.items():
        exact = problem.noise[place, output] <= AT_FLOOR * problem.floors[place, output]
        if exact or not is_coloured(solution.evaluation.residual[piece]):
            continue
        found.append(
            Finding(
                "posterior-too-narrow",
                "warning",
                f"{labels[place]}: what is left of {output} hangs together as no model of its noise describes "
                "(Ljung-Box, p < 0.1 %), and the likelihood knows of no such noise: the samples are too narrow",
                "use the intervals of the fit, which allow for it; a further branch or stage may help",
                channel=output,
            )
        )
    return tuple(found)
