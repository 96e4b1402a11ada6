"""Every cross-check on one strip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ipmclab.consistency.against_motion import PUSHED, RANG, push_against_motion, resonance_against_motion
from ipmclab.consistency.capacitance import CODE as CAPACITANCE
from ipmclab.consistency.capacitance import capacitance_out_of_range
from ipmclab.consistency.dimensions import thickness_unusual
from ipmclab.consistency.dry_mass import CODE as DRY_MASS
from ipmclab.consistency.dry_mass import dry_mass_against_layers
from ipmclab.consistency.fact import Fact
from ipmclab.consistency.facts import facts_of_runs
from ipmclab.consistency.flick import CODE as FLICK
from ipmclab.consistency.flick import flicks, resonance_against_stiffness
from ipmclab.consistency.known import KnownStrip
from ipmclab.consistency.mass import CODE as MASS
from ipmclab.consistency.mass import density_against_mass
from ipmclab.consistency.peak import CODE as PEAK
from ipmclab.consistency.peak import peak_above_series_resistance
from ipmclab.consistency.prefix import CODE as PREFIX
from ipmclab.consistency.prefix import compared_runs, in_one_environment, prefix_of_facts, prefix_of_runs
from ipmclab.consistency.push import CODE as PUSH
from ipmclab.consistency.push import push_against_stiffness, pushes
from ipmclab.consistency.ratio import CODE as RATIO
from ipmclab.consistency.ratio import sine_against_step
from ipmclab.consistency.states import CODE as STATES
from ipmclab.consistency.states import two_states
from ipmclab.consistency.stiffness import CODE as STIFFNESS
from ipmclab.consistency.stiffness import motion_against_stiffness, motions_of
from ipmclab.consistency.thickness import CODE as THICKNESS
from ipmclab.consistency.thickness import thickness_against_membrane
from ipmclab.consistency.water import CODE as WATER
from ipmclab.consistency.water import water_uptake
from ipmclab.fit.fit import Fit
from ipmclab.model import Actuator
from ipmclab.run import Finding, Run
from ipmclab.sample import Sample

CHECKS: Final = (
    MASS,
    THICKNESS,
    DRY_MASS,
    WATER,
    CAPACITANCE,
    STIFFNESS,
    PUSH,
    FLICK,
    PUSHED,
    RANG,
    PEAK,
    STATES,
    PREFIX,
    RATIO,
)
"""Codes of the findings, in their order."""


def cross_check(
    actuator: Actuator,
    runs: Sequence[Run] = (),
    *,
    fit: Fit | None = None,
    facts: Sequence[Fact] = (),
    sample: Sample | None = None,
) -> tuple[Finding, ...]:
    """Hold what is known of one strip against what else is known of it.

    Each finding says what was compared, both values with their standard uncertainties, how many combined standard
    uncertainties they are apart (a finding begins at three), and the cheapest experiment that would decide. A check
    that lacks a number says nothing.

    Parameters
    ----------
    actuator : Actuator
        With the uncertainties that its file states.
    runs : sequence of Run, optional
        Of this strip; a run that names another sample is left out.
    fit : Fit, optional
        Whose uncertainties count for the parameters that it fitted; ``actuator`` is then usually ``fit.actuator``.
    facts : sequence of Fact, optional
        Numbers that do not come from these runs, such as ``published_facts(2)`` or a push test.
    sample : Sample, optional
        What the strip is made of, where the actuator does not say; else the runs are asked, if they agree.

    Returns
    -------
    findings : tuple of Finding
        Empty where everything agrees. ``values`` hold ``found`` and ``expected`` with their uncertainties, ``sigmas``,
        and what belongs to the check, in SI units.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.data import published_sample
    >>> for finding in cross_check(load_actuator("friend-2"), sample=published_sample(2)):
    ...     print(finding.code)
    density-against-mass
    thickness-against-membrane
    dry-mass-against-layers
    capacitance-out-of-range
    """
    known = KnownStrip(actuator, sample or actuator.sample or _reported_by(runs), fit)
    own = known.sample.id if known.sample else None
    mine = {place for place, run in enumerate(runs) if own in (None, _sample_of(run) or own)}
    together = [
        one
        for one in compared_runs(runs)
        if {one.values["first"], one.values["second"]} <= mine and in_one_environment(one, runs)
    ]
    compared = {(int(one.values["first"] or 0), int(one.values["second"] or 0)) for one in together}
    of_runs = (*facts_of_runs(runs), *pushes(runs), *flicks(runs))
    every = (*facts, *(fact for fact in of_runs if fact.place in mine))
    motions = motions_of(known, every)
    return (
        *thickness_unusual(actuator),
        *density_against_mass(known),
        *thickness_against_membrane(known),
        *dry_mass_against_layers(known),
        *water_uptake(known),
        *capacitance_out_of_range(known),
        *motion_against_stiffness(known, motions),
        *push_against_stiffness(known, every),
        *resonance_against_stiffness(known, every),
        *push_against_motion(known, every, motions),
        *resonance_against_motion(known, every, motions),
        *peak_above_series_resistance(known, every),
        *two_states(every, compared),
        *prefix_of_runs(together, runs, _outputs(fit)),
        *prefix_of_facts(every),
        *sine_against_step(known, every),
    )


def _reported_by(runs: Sequence[Run]) -> Sample | None:
    """The sample that the runs name: None where they name none, or more than one."""
    named = [run.metadata.sample for run in runs if run.metadata.sample is not None]
    return named[0] if named and all(one == named[0] for one in named) else None


def _outputs(fit: Fit | None) -> frozenset[str]:
    """The outputs that a fit used; nothing where there is none, or where it used none."""
    used = () if fit is None else (output for observation in fit.observations for output in observation.noise)
    return frozenset(used)


def _sample_of(run: Run) -> str | None:
    return run.metadata.sample.id if run.metadata.sample else None
