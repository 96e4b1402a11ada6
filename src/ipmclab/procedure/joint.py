"""Everything at once, in addition to the steps: all runs in one fit, with what was measured by hand known
beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from ipmclab.fit.fit import DETERMINED, Fit
from ipmclab.identification.identify import identify_freed
from ipmclab.identification.problem.free import FreeParameters, Prior
from ipmclab.identification.problem.unknowns import FARTHEST
from ipmclab.measurement.uncertain import Uncertain
from ipmclab.procedure import dc, density, push
from ipmclab.procedure.coupling import NAMES as COUPLING
from ipmclab.procedure.coupling import STATIC, as_far_as_determined
from ipmclab.procedure.strip import GEOMETRY, OTHER_FITS, actuator_of, amounts_of_fit, branch_names
from ipmclab.run import Finding, Run
from ipmclab.sample import Sample

SHEET: Final = "circuit.sheet_resistance"
CONTACT: Final = "circuit.contact_resistance"

_LENGTHS: Final = ("geometry.free_length", "geometry.sensing_length")
_APART: Final = 3.0  # standard errors: one in 370 by chance (convention)
_LEAST: Final = 1e-4  # of a value: what follows exactly from the dimensions is given this much room


@dataclass(frozen=True, eq=False)
class Joint:
    """The joint fit.

    Parameters
    ----------
    fit : Fit
        With dimensions and other measured numbers free under what is known of them.
    amounts : mapping of dotted name to Uncertain
        Of the parameters that it determined.
    static : Uncertain [m/V]
        d(0), which is known also where the zero of the coupling is not; its uncertainty is infinite where it is not.
    findings : tuple of Finding
    """

    fit: Fit
    amounts: Mapping[str, Uncertain]
    static: Uncertain
    findings: tuple[Finding, ...]


def joint(
    name: str,
    runs: Sequence[tuple[str, Run]],
    staged: Mapping[str, Uncertain],
    by_hand: Sequence[str],
    branches: int,
    sample: Sample | None,
) -> Joint:
    """Fit circuit, coupling, modulus and every uncertain dimension to all runs at once.

    What steps found without the runs is the prior: dimensions, sheet resistance, modulus, and a dc resistance from
    elsewhere. What they found from the runs is not, because these runs count here again.

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
    measured = {channel for _, run in runs for channel in run.channels}
    dimensions = _movable(staged)
    # Without the displacement nothing shows the density.
    merely = [*dimensions, *([density.NAME] if "displacement" in measured else []), CONTACT]
    priors = {
        key: _prior(staged[key], {} if key in dimensions else {one: staged[one] for one in dimensions})
        for key in (*by_hand, *merely)
        if staged[key].parts
    }
    priors = {key: replace(one, merely_uncertain=key in merely) for key, one in priors.items()}
    found_by_runs = [SHEET, dc.NAME, *branch_names(branches), *COUPLING, push.NAME]
    free = {*priors, *(key for key in found_by_runs if key not in by_hand)}
    held = {key: one for key, one in staged.items() if key not in free and one.parts}
    actuator = actuator_of(
        name, staged, branches, sample=sample, uncertain={key: one.uncertainty for key, one in held.items()}
    )
    fit = identify_freed(
        actuator,
        [run for _, run in runs],
        FreeParameters(tuple(key for key in actuator.parameter_values if key in free), priors=priors),
        [label for label, _ in runs],
    )
    found = amounts_of_fit(as_far_as_determined(fit), held, "all at once")
    amounts = {key: one for key, one in found.determined.items() if key not in merely}
    static = found.product(STATIC)
    if static.uncertainty > DETERMINED * static.value:
        static = Uncertain(static.value, {OTHER_FITS: math.inf})
    return Joint(found.fit, amounts, static, _compared(staged, amounts))


def _movable(staged: Mapping[str, Uncertain]) -> list[str]:
    """The dimensions that a fit may move: not the two lengths where the strip could seem shorter than it is read at."""
    free, sensing = (staged[name] for name in _LENGTHS)
    too_far = free.value - sensing.value > FARTHEST * (free.uncertainty + sensing.uncertainty)
    return [name for one in GEOMETRY if (name := f"geometry.{one}") not in _LENGTHS or too_far]


def _prior(amount: Uncertain, dimensions: Mapping[str, Uncertain]) -> Prior:
    """What is known of a number in addition to the dimensions from which it was computed, and how it moves with
    them."""
    follows = {
        name: amount.parts[source] / part
        for name, one in dimensions.items()
        for source, part in one.parts.items()
        if source in amount.parts
    }
    own = amount.without(source for one in dimensions.values() for source in one.parts)
    return Prior(amount.value, max(own.uncertainty, _LEAST * abs(amount.value)), follows)


def _compared(staged: Mapping[str, Uncertain], amounts: Mapping[str, Uncertain]) -> tuple[Finding, ...]:
    """Where all together moved a number further than its step said that it might be wrong."""
    found = []
    for name, together in amounts.items():
        alone = staged.get(name)
        if alone is None or math.isinf(alone.uncertainty):
            continue
        gap = abs(together.value - alone.value)
        if gap > _APART * alone.uncertainty > 0.0:
            found.append(
                Finding(
                    "steps-against-joint",
                    "warning",
                    f"{name}: step by step {alone.value:.4g}, all together {together.value:.4g}, "
                    f"{gap / alone.uncertainty:.2g} standard uncertainties of the step",
                    "one step is wrong, or the model lacks something that a run shows: look at the findings, and "
                    "repeat the step whose number moved",
                    values={"staged": alone.value, "joint": together.value},
                )
            )
    return tuple(found)
