"""Step 6: the coupling from the blocked force (Friend, section 4.5)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from ipmclab.fit.fit import DETERMINED, Fit
from ipmclab.fit.fit_table import changed
from ipmclab.fit.interrupted import uninterrupted
from ipmclab.identification.identify import identify
from ipmclab.identification.solved import solved
from ipmclab.measurement.uncertain import Uncertain
from ipmclab.procedure.branches import fit_findings
from ipmclab.procedure.step import Result, Step, advice_for, assumed_finding
from ipmclab.procedure.strip import actuator_of, amounts_of_fit
from ipmclab.run import Finding, Run
from ipmclab.units import STRAIN_COEFFICIENT

NAMES: Final = ("coupling.gain", "coupling.zero", "coupling.p1", "coupling.p2")
STATIC: Final = {"coupling.gain": 1.0, "coupling.zero": 1.0, "coupling.p2": -1.0}
"""d(0) = K_d Z_d/P_2d: known also where the zero is not determined."""


def as_far_as_determined(fit: Fit) -> Fit:
    """The fit with gain, zero and poles all open where the readings do not show all four, or other fits are as good.

    Then they trade against each other, and the curvature at one minimum can call a pole sharp that lies far from
    the true one; d(0) is the same in all of them.
    """
    coupled = {name: one for name, one in fit.parameters.items() if name in NAMES}
    if not solved(fit).rivals and all(one.determined for one in coupled.values()):
        return fit
    opened = {
        name: replace(one, standard_error=math.inf, interval=(0.0, math.inf), determined=False)
        for name, one in coupled.items()
        if one.determined
    }
    stated = {name: one for name, one in fit.actuator.standard_uncertainties.items() if name not in opened}
    return changed(
        fit,
        parameters={**fit.parameters, **opened},
        actuator=replace(fit.actuator, standard_uncertainties=stated),
    )


def coupling(name: str, runs: Sequence[tuple[str, Run]], known: Mapping[str, Uncertain], branches: int) -> Step:
    """K_d, Z_d, P_1d and P_2d from the force, with everything else held at what was measured (Friend, eqs 4.9, 4.12).

    Parameters
    ----------
    name : str
        Of the strip.
    runs : sequence of (label, Run)
        With the blocked force; motion at L_s counts too where a run has it.
    known : mapping of dotted name to Uncertain
        Everything but the coupling.
    branches : int
    """
    actuator = actuator_of(name, known, branches)
    fit = uninterrupted(identify(actuator, [run for _, run in runs], free=NAMES, labels=[label for label, _ in runs]))
    found = amounts_of_fit(as_far_as_determined(fit), known, "noise of the force")
    static, sure = found.product(STATIC), found.determined
    parameters = actuator.parameters()
    results = {
        key: Result(
            sure.get(key, Uncertain(fit.parameters[key].value, {"noise of the force": math.inf})),
            parameters[key].quantity,
            parameters[key].symbol,
        )
        for key in NAMES
    }
    is_known = static.uncertainty <= DETERMINED * static.value
    return Step(
        "coupling",
        "coupling from the force",
        f"least squares on the force of {', '.join(label for label, _ in runs)} (Friend, eqs 4.9 and 4.12)",
        results,
        {"d(0)": Result(static, STRAIN_COEFFICIENT, "d(0)")} if is_known else {},
        (*fit_findings(fit, ()), *_open(fit, sure), *assumed_finding([static])),
        advice_for(static),
        done=is_known,
    )


def _open(fit: Fit, sure: Mapping[str, Uncertain]) -> tuple[Finding, ...]:
    """What the runs do not show of the coupling, in the words of the fit."""
    repair = "d(0) is what a slow voltage moves; the rest is how quickly"
    sentences = [one.sentence for one in fit.undetermined]
    held_back = [name for name in NAMES if name not in sure and fit.parameters[name].determined]
    if held_back:
        sentences.append(
            f"{', '.join(held_back)}: not taken over, as the rest of the coupling is open or other fits fit alike"
        )
    return tuple(Finding("not-determined", "info", one, repair) for one in sentences)
