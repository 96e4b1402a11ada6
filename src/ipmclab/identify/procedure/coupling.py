"""Step 6: the coupling from the blocked force (Friend, section 4.5)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from ipmclab.identify.diagnosis import DETERMINED
from ipmclab.identify.fit import Fit
from ipmclab.identify.identify import identify
from ipmclab.identify.procedure.amounts import Uncertain
from ipmclab.identify.procedure.branches import fit_findings
from ipmclab.identify.procedure.step import Result, Step, advice_for, assumed_finding
from ipmclab.identify.procedure.strip import actuator_of, amounts_of_fit
from ipmclab.run import Finding, Run
from ipmclab.units import STRAIN_COEFFICIENT

NAMES: Final = ("coupling.gain", "coupling.zero", "coupling.p1", "coupling.p2")
STATIC: Final = {"coupling.gain": 1.0, "coupling.zero": 1.0, "coupling.p2": -1.0}
"""d(0) = K_d Z_d/P_2d: known also where the zero is not seen."""


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
    fit = identify(actuator, [run for _, run in runs], free=NAMES, labels=[label for label, _ in runs])
    found = amounts_of_fit(fit, known, {}, "noise of the force")
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
        (*fit_findings(fit, ()), *_open(fit), *assumed_finding([static])),
        advice_for(static),
        done=is_known,
    )


def _open(fit: Fit) -> tuple[Finding, ...]:
    """What the runs do not tell of the coupling, in the words of the fit."""
    return tuple(
        Finding("not-determined", "info", one.sentence, "d(0) is what a slow voltage moves; the rest is how quickly")
        for one in fit.undetermined
    )
