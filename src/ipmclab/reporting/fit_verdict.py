"""The outcome of a fit and its validations in sentences, as the head of a report has them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ipmclab.fit.rows import listed
from ipmclab.fit.verdict import REFUSED
from ipmclab.fit.verdict import verdict as verdict_of
from ipmclab.prediction.remarks import averages
from ipmclab.prediction.validate import Validation
from ipmclab.prediction.verdict import SO_SAID
from ipmclab.prediction.verdict import verdict_of as verdict_of_runs
from ipmclab.reporting.wording import percent

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit


def verdict(fit: Fit, validations: Sequence[Validation]) -> tuple[list[str], bool]:
    """The outcome in sentences, and whether it calls for caution.

    Parameters
    ----------
    fit : Fit
    validations : sequence of Validation
        The first is that of the fit's own actuator; empty when nothing was predicted.

    Returns
    -------
    sentences : list of str
    doubt : bool
    """
    found = verdict_of_runs(validations[0], percent) if validations else None
    missed = {} if found is None else {output for output, *_ in found.missed}
    sentences = [verdict_of(fit, missed)]
    if not fit.converged:
        sentences.append(f"The identification did not converge: {fit.message}. The numbers below are not a model.")
    if found is None:
        sentences.append("No run was kept for validation: nothing here shows what the model predicts for other inputs.")
    else:
        # Of the fit's own actuator, which says of itself what stands first.
        sentences += [one for one in found.sentences if one != f"{sentences[0]}{SO_SAID}"]
    open_ones = [name for name, one in fit.parameters.items() if not one.determined]
    if open_ones:
        sentences.append(
            f"{len(open_ones)} of {len(fit.parameters)} free parameters {'is' if len(open_ones) == 1 else 'are'} not "
            f"determined by these runs: {listed(open_ones)}."
        )
    else:
        sentences.append(f"All {len(fit.parameters)} free parameters are determined.")
    averaged = sorted(averages(fit))
    if averaged:
        sentences.append(
            f"The mountings differ, so one value for all of them holds for none: {listed(averaged)}. Fit each "
            "mounting by itself, or name what the clamp changes in per_mounting."
        )
    bounds = [name for name, one in fit.parameters.items() if one.at_bound]
    if bounds:
        sentences.append(f"At a bound: {listed(bounds)}; such a value is a limit, not an estimate.")
    sentences += _holding(fit)
    return sentences, bool(
        not fit.converged
        or sentences[0].startswith(REFUSED)
        or open_ones
        or averaged
        or bounds
        or missed
        or found is None
        or not found.predicted
    )


def _holding(fit: Fit) -> Iterator[str]:
    """Where slow modes were fitted that stand in the way of holding a set point."""
    for finding in fit.findings:
        if finding.code == "set-point" and finding.severity == "warning":
            # A bound that is not finite is in no file: it is absent from a fit that was read.
            low, high = finding.values.get("low"), finding.values.get("high")
            reaches = (low is None or float(low) < 1.0) and (high is None or float(high) > 1.0)
            yield (
                f"These runs do not show whether a set point of the {finding.channel} can be held: the interval of r "
                "reaches over 1."
                if reaches
                else f"The {finding.channel} relaxes back by as much as the coupling gives, or more: integral action "
                "cannot hold a set point of it."
            )
