"""Everything at once, beside the steps: all runs in one fit, with what was measured by hand known beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ipmclab.identify.fit import Fit, FittedParameter
from ipmclab.identify.fit_table import changed
from ipmclab.identify.identify import identify
from ipmclab.identify.procedure import dc, push
from ipmclab.identify.procedure.amounts import NORMAL_95, Uncertain, derived
from ipmclab.identify.procedure.coupling import NAMES as COUPLING
from ipmclab.identify.procedure.coupling import STATIC, as_far_as_seen
from ipmclab.identify.procedure.strip import FittedAmounts, actuator_of, amounts_of_fit, branch_names
from ipmclab.run import Finding, Run
from ipmclab.sample import Sample

SHEET: Final = "circuit.sheet_resistance"
NOISE: Final = "noise of the runs"

_LEFT_OUT: Final = frozenset({"exact-fixed-value", "fixed-uncertainty"})
_APART: Final = 3.0


@dataclass(frozen=True, eq=False)
class Joint:
    """The joint fit.

    Parameters
    ----------
    fit : Fit
        Its errors and intervals carry what the dimensions and other fixed numbers contribute.
    amounts : mapping of dotted name to Uncertain
        Of the parameters that it determined.
    static : Uncertain [m/V]
        d(0), which is known also where the zero of the coupling is not.
    prior : mapping of dotted name to Uncertain
        What was known beforehand.
    findings : tuple of Finding
    """

    fit: Fit
    amounts: Mapping[str, Uncertain]
    static: Uncertain
    prior: Mapping[str, Uncertain]
    findings: tuple[Finding, ...]


def joint(
    name: str,
    runs: Sequence[tuple[str, Run]],
    staged: Mapping[str, Uncertain],
    by_hand: Sequence[str],
    branches: int,
    sample: Sample | None,
) -> Joint:
    """Fit circuit, coupling and modulus to every run at once.

    What steps found without the runs is the prior: sheet resistance, modulus, and a dc resistance from elsewhere. What
    they found from the runs is not, because these runs count here again.

    Parameters
    ----------
    name : str
    runs : sequence of (label, Run)
    staged : mapping of dotted name to Uncertain
        What the steps found, and the dimensions.
    by_hand : sequence of str
        Of these, what does not come from the runs.
    branches : int
    sample : Sample, optional
    """
    shared = {source for key, one in staged.items() if key.startswith("geometry.") for source in one.parts}
    wanted = [SHEET, dc.NAME, *branch_names(branches), *COUPLING, push.NAME]
    prior = {key: staged[key] for key in wanted if key in by_hand and staged[key].without(shared).parts}
    free = [key for key in wanted if key in prior or key not in by_hand]
    # The fit takes the dimensions as exact; what they contribute is added below, to the centres of the priors too, so
    # that a width that stands in a sheet resistance and in a resistivity is one width.
    own = {key: one.without(shared).uncertainty for key, one in prior.items()}
    actuator = actuator_of(name, staged, branches, sample=sample, uncertain=own)
    fit = identify(
        actuator, [run for _, run in runs], free=free, prior=list(prior), labels=[label for label, _ in runs]
    )
    held = {key: one for key, one in staged.items() if key not in free}
    moving = {
        key: Uncertain(one.value, {s: p for s, p in one.parts.items() if s in shared}, one.assumed)
        for key, one in prior.items()
    }
    found = amounts_of_fit(as_far_as_seen(fit), held, moving, NOISE)
    amounts = found.determined
    wider = _with_all(found.fit, found, held)
    return Joint(wider, amounts, found.product(STATIC), prior, _compared(staged, amounts))


def _with_all(fit: Fit, found: FittedAmounts, held: Mapping[str, Uncertain]) -> Fit:
    """The fit with errors, intervals and correlations that hold what fixed numbers contribute."""
    amounts = found.determined
    parameters = {name: _wider(one, amounts.get(name)) for name, one in fit.parameters.items()}
    correlations = {
        one: {other: _correlation(amounts.get(one), amounts.get(other), same=one == other) for other in parameters}
        for one in parameters
    }
    every = {**found.all, **{name: one for name, one in held.items() if one.parts}}
    uncertain = {name: one.uncertainty for name, one in {**held, **amounts}.items() if one.parts}
    return changed(
        fit,
        actuator=replace(
            fit.actuator,
            standard_uncertainties={n: u for n, u in uncertain.items() if n in fit.actuator.parameter_values},
        ),
        parameters=parameters,
        correlations=correlations,
        covariance={one: {other: _product(a, b) for other, b in every.items()} for one, a in every.items()},
        findings=tuple(one for one in fit.findings if one.code not in _LEFT_OUT),
    )


def _wider(one: FittedParameter, amount: Uncertain | None) -> FittedParameter:
    if amount is None or not one.determined:
        return one
    told = [part for source, part in amount.parts.items() if source.partition("#")[0] != NOISE]
    added = NORMAL_95 * math.hypot(*told) / one.value if told else 0.0
    low, high = one.interval
    ends = (
        one.value * math.exp(-math.hypot(math.log(one.value / low), added)) if low > 0.0 else low,
        one.value * math.exp(math.hypot(math.log(high / one.value), added)) if math.isfinite(high) else high,
    )
    return replace(one, standard_error=amount.uncertainty, interval=ends)


def _correlation(one: Uncertain | None, other: Uncertain | None, *, same: bool) -> float:
    if same:
        return 1.0
    if one is None or other is None or not one.uncertainty or not other.uncertainty:
        return math.nan
    return float(np.clip(_product(one, other) / (one.uncertainty * other.uncertainty), -1.0, 1.0))


def _product(one: Uncertain, other: Uncertain) -> float:
    """Covariance of two numbers: what they share."""
    return sum(part * other.parts.get(source, 0.0) for source, part in one.parts.items())


def _compared(staged: Mapping[str, Uncertain], amounts: Mapping[str, Uncertain]) -> tuple[Finding, ...]:
    """Where the steps and the joint fit contradict each other."""
    found = []
    for name, together in amounts.items():
        alone = staged.get(name)
        if alone is None or math.isinf(alone.uncertainty):
            continue
        gap = derived(lambda a, b: a - b, alone, together)
        if gap.uncertainty and abs(gap.value) > _APART * gap.uncertainty:
            found.append(
                Finding(
                    "steps-against-joint",
                    "warning",
                    f"{name}: step by step {alone.value:.4g}, all together {together.value:.4g}, "
                    f"{abs(gap.value) / gap.uncertainty:.2g} standard uncertainties of their difference apart",
                    "one step is wrong, or the model lacks something that a run shows: look at the findings, and "
                    "repeat the step whose number moved",
                    values={"staged": alone.value, "joint": together.value},
                )
            )
    return tuple(found)
