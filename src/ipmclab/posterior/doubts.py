"""What contradicts the likelihood from which samples were drawn."""

from __future__ import annotations

from typing import Final

from ipmclab.fit.fit import Fit
from ipmclab.fit.in_brief import LACKING, is_aside
from ipmclab.identification.solved import Estimate
from ipmclab.identification.uncertainty.covariance import is_coloured
from ipmclab.posterior.density import AT_FLOOR
from ipmclab.run import Finding

_AGAINST: Final = frozenset({*LACKING, "mountings-differ", "prior-contradicted"})
"""Warnings with which samples describe the model, or an average, and not the strip. So does every error."""


def doubts(fit: Fit, estimate: Estimate) -> tuple[Finding, ...]:
    """Findings where the likelihood is not that of the readings, and what the fit itself does not believe.

    The intervals of a fit allow for residuals that no noise describes, samples cannot. Where mountings differ the
    intervals of the fit hold for none of them either.

    Parameters
    ----------
    fit : Fit
    estimate : Estimate
        The solved problem of it.
    """
    problem = estimate.correlated.problem
    outputs = {output for one in fit.observations for output in one.noise}
    found = [
        one for one in fit.findings if one.code in _AGAINST or (one.severity == "error" and not is_aside(one, outputs))
    ]
    repair = "use the intervals of the fit, which allow for it; a further branch or stage may help"
    if any(finding.code == "mountings-differ" for finding in found):
        repair = "name what the clamp changes in per_mounting, or sample each mounting by itself"
    labels = {record.place: record.label for record in problem.records}
    for (place, output), piece in problem.pieces.items():
        exact = problem.noise[place, output] <= AT_FLOOR * problem.floors[place, output]
        if exact or not is_coloured(estimate.correlated.whitened.residual[piece]):
            continue
        found.append(
            Finding(
                "posterior-too-narrow",
                "warning",
                f"{labels[place]}: no model of its noise describes how what is left of {output} is autocorrelated "
                "(Ljung-Box, p < 0.1 %), and the likelihood knows of no such noise: the samples are too narrow",
                repair,
                channel=output,
            )
        )
    return tuple(found)
