"""Through the procedure, step by step (Friend, figure 4.9)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from ipmclab.errors import InputError
from ipmclab.fit.fit_table import changed
from ipmclab.kinds import tell_kinds
from ipmclab.measurement.push import Push
from ipmclab.measurement.uncertain import Uncertain, derived
from ipmclab.procedure import dc
from ipmclab.procedure import density as density_step
from ipmclab.procedure import push as push_step
from ipmclab.procedure.branches import branches
from ipmclab.procedure.coupling import coupling
from ipmclab.procedure.four_probe import FourProbes, share_of_one_face, sheet_resistance, without_other_face
from ipmclab.procedure.joint import SHEET, Joint, joint
from ipmclab.procedure.procedure import Procedure
from ipmclab.procedure.slips import IMPOSSIBLE, looked_over
from ipmclab.procedure.step import Result, Step, advice_for, assumed_finding, finding_row
from ipmclab.procedure.strip import actuator_of
from ipmclab.progress import OnProgress, part, reporting_to, stage
from ipmclab.run import Finding
from ipmclab.units import (
    DENSITY,
    MODULUS,
    RESISTANCE,
    RESISTIVITY,
    SHEET_RESISTANCE,
    STRAIN_COEFFICIENT,
    Quantity,
)

_WORTH_SAYING: Final = 3e-3  # relative: a loss that no measurement here shows (convention)

_FIRST: Final = ("sheet_resistance",)

TO_DO: Final[Mapping[str, tuple[str, str]]] = {
    "sheet_resistance": (
        "sheet resistance by four probes",
        'lay four contacts on one face and read them (ipmclab rig sheet RIG --width "5 mm"): [sheet_resistance]',
    ),
    "dc_resistance": (dc.TITLE, "hold 1 V until the current no longer falls, and give the run in [dc_resistance]"),
    "branches": ("branches from the current", "record a step and a slow sine with their current: [branches]"),
    "density": ("density from mass and volume", "weigh the wet strip and give its mass in [density]"),
    "modulus": ("modulus from a push", "push the strip at 0 V with the load cell, in and out: [modulus]"),
    "coupling": ("coupling from the force", "record the blocked force under a step and a slow sine: [coupling]"),
}
"""Title of each step, in its order, and what is to be done for it."""


@dataclass(frozen=True, eq=False)
class Characterisation:
    """What came of a procedure.

    Parameters
    ----------
    name : str
    steps : tuple of Step
        All six in their order, done or not.
    staged : mapping of dotted name to Uncertain
        Dimensions, and what the steps found.
    joint : Joint, optional
        All runs at once; None while a step is missing.
    """

    name: str
    steps: tuple[Step, ...]
    staged: Mapping[str, Uncertain]
    joint: Joint | None

    @property
    def missing(self) -> tuple[Step, ...]:
        """Steps that are still to be done."""
        return tuple(step for step in self.steps if not step.done)

    @property
    def impossible(self) -> tuple[tuple[Step, Finding], ...]:
        """Steps that gave what no strip can have, and what is said of it."""
        return tuple((step, one) for step in self.steps for one in step.findings if one.code == IMPOSSIBLE)

    @property
    def compared(self) -> tuple[Compared, ...]:
        """Each parameter step by step and all together, and d(0); empty without the joint fit."""
        if self.joint is None:
            return ()
        declared = self.joint.fit.actuator.parameters()
        rows = [
            Compared(name, declared[name].quantity, declared[name].symbol, self.staged.get(name), together)
            for name, together in self.joint.amounts.items()
        ]
        alone = next((r.amount for step in self.steps for name, r in step.also.items() if name == "d(0)"), None)
        return (*rows, Compared("d(0)", STRAIN_COEFFICIENT, "d(0)", alone, self.joint.static))

    def to_table(self) -> dict[str, Any]:
        """The steps, and both results side by side, in the types that TOML has."""
        return {
            "steps": [step.to_table() for step in self.steps],
            "compared": [row.to_table() for row in self.compared],
            "findings": [finding_row(one) for one in (self.joint.findings if self.joint else ())],
        }


@dataclass(frozen=True)
class Compared:
    """One parameter step by step, and from all runs at once.

    Parameters
    ----------
    name : str
    quantity : Quantity
    symbol : str
    staged : Uncertain, optional
    joint : Uncertain
    """

    name: str
    quantity: Quantity
    symbol: str
    staged: Uncertain | None
    joint: Uncertain

    @property
    def said(self) -> tuple[str, str]:
        """Both as text."""
        alone = "" if self.staged is None else Result(self.staged, self.quantity).said
        return alone, Result(self.joint, self.quantity).said

    def to_table(self) -> dict[str, Any]:
        """The row in the types that TOML has."""
        alone = self.staged
        known = alone is not None and math.isfinite(alone.uncertainty)
        return {
            "name": self.name,
            "unit": self.quantity.unit,
            "symbol": self.symbol,
            **({"staged": alone.value, "staged_uncertainty": alone.uncertainty} if known and alone else {}),
            **(
                {"joint": self.joint.value, "joint_uncertainty": self.joint.uncertainty}
                if math.isfinite(self.joint.uncertainty)
                else {}
            ),
            "said": list(self.said),
        }


@tell_kinds
def follow_procedure(
    procedure: Procedure,
    *,
    all_at_once: bool = True,
    progress: OnProgress | None = None,
    step_done: Callable[[Step], None] | None = None,
) -> Characterisation:
    """Carry out every step for which there is something, and the joint fit when all are done.

    Parameters
    ----------
    procedure : Procedure
        Of ``read_procedure``.
    all_at_once : bool
        Whether the joint fit follows when all steps are done; it takes longer than all of them.
    progress : function of (str, float), optional
        Called with what is being done, and how far it is; what it raises ends the work.
    step_done : function of Step, optional
        Given each step as it is done, so that it is known also where another one fails; a step that another one makes
        better comes twice.

    Returns
    -------
    characterisation : Characterisation

    Raises
    ------
    InputError
        Something that was measured cannot be used: the first of it, when all steps that do not need it were carried out
        and given to ``step_done``, as is what those say that could not be.
    """
    with reporting_to(progress):
        return _follow(procedure, all_at_once, step_done or _nobody)


def _nobody(_: Step) -> None:
    """Nobody wants to know."""


def _follow(procedure: Procedure, all_at_once: bool, step_done: Callable[[Step], None]) -> Characterisation:
    known: dict[str, Uncertain] = {
        **procedure.geometry,
        "circuit.contact_resistance": procedure.contact_resistance,
    }
    steps: dict[str, Step] = {}
    by_hand: list[str] = []

    declared = actuator_of(procedure.name, {}, procedure.branch_count).parameters()

    failed: list[InputError] = []

    def attempt(name: str, carry_out: Callable[[], Step]) -> None:
        try:
            step = carry_out()
        except InputError as error:
            failed.append(error)
            step = _unusable(name, error)
        keep(step)

    def keep(step: Step) -> None:
        steps[step.name] = step = looked_over(step, declared)
        known.update(step.amounts)
        step_done(step)

    stage("sheet and dc resistance", 0.0, 0.05)
    attempt("sheet_resistance", lambda: _sheet(procedure))
    if SHEET in known:
        by_hand.append(SHEET)
        attempt("dc_resistance", lambda: _dc(procedure, known))
        again = _other_face(steps["sheet_resistance"], procedure, known)
        if again is not None:
            keep(again)
            known.pop(dc.NAME)
            attempt("dc_resistance", lambda: _dc(procedure, known))
        if isinstance(procedure.dc_resistance, Uncertain):
            by_hand.append(dc.NAME)
        if procedure.branches:
            with part("branches", 0.05, 0.15):
                attempt("branches", lambda: branches(procedure.name, procedure.branches, known, procedure.branch_count))
    attempt("density", lambda: _density(procedure, known))
    attempt("modulus", lambda: _modulus(procedure, known))
    by_hand.append(push_step.NAME)
    needed = (SHEET, dc.NAME, density_step.NAME, push_step.NAME)
    together: Joint | None = None
    complete = "branches" in steps and steps["branches"].done and all(name in known for name in needed)
    if procedure.coupling and complete:
        with part("coupling", 0.15, 0.35):
            attempt("coupling", lambda: coupling(procedure.name, procedure.coupling, known, procedure.branch_count))
        if all_at_once and steps["coupling"].done and not failed:
            with part("all runs at once", 0.35, 1.0):
                together = joint(
                    procedure.name, procedure.runs, known, by_hand, procedure.branch_count, procedure.sample
                )
    ordered = tuple(steps.get(name) or _undone(name, _waits_for(name, steps)) for name in TO_DO)
    if failed:
        _report_undone(ordered, steps, step_done)
        raise failed[0]
    found = Characterisation(procedure.name, ordered, known, together)
    if together is None:
        return found
    fit = changed(together.fit, procedure=found.to_table())
    return replace(found, joint=replace(together, fit=fit))


def _report_undone(ordered: Sequence[Step], done: Mapping[str, Step], step_done: Callable[[Step], None]) -> None:
    """Report the steps that were not carried out."""
    for step in ordered:
        if step.name not in done:
            step_done(step)


def _undone(name: str, waits: str = "") -> Step:
    title, what = TO_DO[name]
    return Step(name, title, waits or "not done yet", advice=what, done=False)


def _unusable(name: str, error: InputError) -> Step:
    message = f"{error.where}: {error.message}" if error.where else error.message
    findings = (Finding(error.code, "error", message, error.repair),)
    return Step(name, TO_DO[name][0], "cannot be used", findings=findings, done=False)


def _waits_for(name: str, steps: Mapping[str, Step]) -> str:
    """What has to be known before a step."""
    waits_for = {"dc_resistance": _FIRST, "branches": _FIRST, "coupling": (*_FIRST, "branches", "density", "modulus")}
    missing = [one for one in waits_for.get(name, ()) if one not in steps or not steps[one].done]
    return f"waits for the {', the '.join(one.replace('_', ' ') for one in missing)}" if missing else ""


def _given(name: str, key: str, amount: Uncertain, result: Result) -> Step:
    return Step(
        name,
        TO_DO[name][0],
        "from elsewhere",
        {key: result},
        findings=assumed_finding([amount]),
    )


def _sheet(procedure: Procedure) -> Step:
    given = procedure.sheet_resistance
    if given is None:
        return _undone("sheet_resistance")
    if isinstance(given, Uncertain):
        return _given("sheet_resistance", SHEET, given, Result(given, SHEET_RESISTANCE, "R_s"))
    found = sheet_resistance(given, procedure.geometry["geometry.width"], _length(procedure))
    return _of_sheet(found, given, procedure)


def _length(procedure: Procedure) -> Uncertain:
    lengths = procedure.geometry["geometry.free_length"], procedure.geometry["geometry.clamped_length"]
    return derived(lambda free, clamped: free + clamped, *lengths)


def _of_sheet(found: Uncertain, probes: FourProbes, procedure: Procedure) -> Step:
    width = procedure.geometry["geometry.width"]
    electrode = derived(lambda r, along, across: r * along / across, found, _length(procedure), width)
    how = (
        "R_s = R w/d for contacts across the width"
        if probes.contacts == "line"
        else "R_s = C V/I for four points in a row"
    )
    return Step(
        "sheet_resistance",
        TO_DO["sheet_resistance"][0],
        how,
        {SHEET: Result(found, SHEET_RESISTANCE, "R_s")},
        {"R_e": Result(electrode, RESISTANCE, "R_e")},
        assumed_finding([found]),
        advice_for(electrode) or advice_for(found),
    )


def _other_face(step: Step, procedure: Procedure, known: Mapping[str, Uncertain]) -> Step | None:
    """The first step once more, when the second has shown how well the membrane leads to the other face."""
    probes = procedure.sheet_resistance
    if not isinstance(probes, FourProbes) or probes.contacts != "line" or dc.NAME not in known:
        return None
    found, length = known[SHEET], _length(procedure)
    thickness, resistivity = procedure.geometry["geometry.thickness"], known[dc.NAME]
    if probes.outer is not None:
        return _of_sheet(without_other_face(found, probes, length, thickness, resistivity), probes, procedure)
    outer = min(2.0 * probes.spacing.value, length.value)
    lost = 1.0 - share_of_one_face(
        outer, probes.spacing.value, length.value, thickness.value, found.value, resistivity.value
    )
    if lost < _WORTH_SAYING:
        return None
    finding = Finding(
        "other-face",
        "info",
        f"of a real strip the meter reads up to {100.0 * lost:.1f} % too little, because a part of its current takes "
        f"the other face: counted with outer contacts {1e3 * outer:.3g} mm apart; it is not taken off",
        "give outer_spacing",
        values={"share": lost},
    )
    return replace(step, findings=(*step.findings, finding))


def _dc(procedure: Procedure, known: Mapping[str, Uncertain]) -> Step:
    given = procedure.dc_resistance
    if given is None:
        return _undone("dc_resistance")
    if not isinstance(given, Uncertain):
        return dc.dc_resistance(given, known)
    resistivity = derived(
        lambda r, free, clamped, w, h: r * (free + clamped) * w / h,
        given,
        *(known[f"geometry.{name}"] for name in ("free_length", "clamped_length", "width", "thickness")),
    )
    step = _given("dc_resistance", dc.NAME, given, Result(resistivity, RESISTIVITY, "ρ_dc"))
    return Step(
        step.name, step.title, step.how, step.results, {"R_dc": Result(given, RESISTANCE, "R_dc")}, step.findings
    )


def _density(procedure: Procedure, known: Mapping[str, Uncertain]) -> Step:
    if procedure.mass is not None:
        return density_step.density(procedure.mass, known)
    if procedure.density is not None:
        given = procedure.density
        return _given("density", density_step.NAME, given, Result(given, DENSITY, "ρ_m"))
    return _undone("density")


def _modulus(procedure: Procedure, known: Mapping[str, Uncertain]) -> Step:
    given = procedure.modulus
    if isinstance(given, Push):
        position = procedure.push_position or procedure.geometry["geometry.sensing_length"]
        return push_step.modulus(given, position, known)
    if given is not None:
        return _given("modulus", push_step.NAME, given, Result(given, MODULUS, "Y"))
    return _undone("modulus")
