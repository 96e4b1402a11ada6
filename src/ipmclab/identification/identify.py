"""From runs to a fit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ipmclab.consistency.of_fit import with_cross_checks
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_table import changed, with_findings
from ipmclab.fit.interrupted import NO_COMPARISON, NO_PROFILES, NO_STAGES
from ipmclab.fit.mountings import Mounting
from ipmclab.fit.output_diagnosis import OutputDiagnosis
from ipmclab.identification.asked import (
    for_series_alone,
    given_labels,
    given_runs,
    need_mountings,
    need_readings,
    outputs_of_fit,
    refuse_counts,
)
from ipmclab.identification.build import build_fit
from ipmclab.identification.diagnostics.beyond import beyond_findings
from ipmclab.identification.diagnostics.diagnose import diagnose
from ipmclab.identification.environment.contradicted import water_contradicted
from ipmclab.identification.environment.inseparable import inseparable
from ipmclab.identification.environment.next_condition import next_condition
from ipmclab.identification.environment.with_states import with_states
from ipmclab.identification.estimate import estimate
from ipmclab.identification.mountings.mountings import differ, each_mounting, with_mountings
from ipmclab.identification.of_records import NOISE, GrowingLeak, findings_of_records, left_out_of
from ipmclab.identification.problem.earlier_fit import as_read_before, fitted_runs
from ipmclab.identification.problem.free import FreeParameters, parse_free
from ipmclab.identification.problem.priors import prior_findings, with_priors
from ipmclab.identification.problem.record import disambiguated, places_of_mountings, prepare
from ipmclab.identification.search.another_coupling import motion_of_another_coupling
from ipmclab.identification.solved import Estimate
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator
from ipmclab.model.declared import electrical
from ipmclab.model.given import need_each_once
from ipmclab.model.order import Order
from ipmclab.model.stages.leak import SLOW_TIME
from ipmclab.one_thread import on_one_thread
from ipmclab.progress import OnProgress, first_answer, part, reporting_to, stage, unreported
from ipmclab.quality.check import check_record
from ipmclab.quality.record import Record as Checked
from ipmclab.quality.usable import noise_only
from ipmclab.run import Finding, Run
from ipmclab.strip_state.doubtful import doubtful


@tell_kinds
def identify(
    actuator: Actuator,
    runs: Sequence[Run] | Run,
    *,
    free: str | Iterable[str] = "electrical",
    per_run: str | Iterable[str] = (),
    per_mounting: str | Iterable[str] = (),
    prior: str | Iterable[str] = (),
    labels: str | Sequence[str] | None = None,
    progress: OnProgress | None = None,
) -> Fit:
    """Identify parameters of an actuator from one or more runs at once.

    No starting values are needed: a free parameter's value in ``actuator`` is not used, except that along a
    direction that the readings leave open altogether the answer stays nearest to it. The input is the
    measured voltage. Current is used where a parameter of the circuit, the leak or the clamp is free; displacement and
    force where one of the coupling, the beam, the viscoelastic modulus or the dimensions or a series resistance is;
    the one of them that relaxes where its relaxation is.

    Parameters
    ----------
    actuator : Actuator
        Gives the fixed parameters, with their stated uncertainties.
    runs : sequence of Run
        Of any lengths, rates and channels. They share every parameter that is not per run.
    free : str or iterable of str
        ``electrical``, ``coupling``, ``leak``, ``relaxation``, ``viscoelastic``, ``clamp``, dotted names, or comma
        lists of them. ``observation.offset.<output>`` and
        ``observation.drift.<output>`` free the zero and the slope of a sensor, for each run.
    per_run : str or iterable of str
        Parameters of which each run has its own, such as ``circuit.contact_resistance``.
    per_mounting : str or iterable of str
        Parameters of which each mounting has its own: runs with the same ``mounting_id`` share them.
    prior : str or iterable of str
        Free parameters of which something is known beforehand: the value and the standard uncertainty in ``actuator``,
        or, where it states no uncertainty, the range that strips have. It counts like one more reading of the
        parameter, normal, or log-normal where the parameter is moved as a logarithm; with ``per_run``, one of each run.
    labels : sequence of str, optional
        A short name for each run, for messages and tables; else its source file, its signal or its place.
    progress : function of (str, float), optional
        Called with a sentence and the fraction that is done, at most ten times a second. Whatever it raises ends the
        fit and reaches the caller; a ``KeyboardInterrupt`` keeps what stands once the parameters are found.

    Returns
    -------
    fit : Fit

    Raises
    ------
    InputError
        No actuator, an unknown name, no runs, not one label for each, a run without the readings that the free
        parameters need, more unknowns than readings, a prior of which nothing is known.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> actuator = load_actuator("friend-2")
    >>> run = simulate(actuator, "step 1 V", duration=40, rate=50)
    >>> fit = identify(actuator, [run], free="electrical")
    >>> round(fit.parameters["circuit.dc_resistivity"].value, 6)
    43.420408
    """
    given = given_runs(runs)
    named = given_labels(labels, len(given))
    names = parse_free(actuator.parameter_values, free, per_run, per_mounting)
    need_mountings(given, names)
    refuse_counts(actuator, names)
    with reporting_to(progress):
        return identify_freed(actuator, given, with_priors(actuator, names, prior), named)


@on_one_thread
def identify_freed(
    actuator: Actuator,
    given: Sequence[Run],
    names: FreeParameters,
    labels: Sequence[str] | None,
    *,
    diagnosed: bool = True,
    followed: bool = True,
) -> Fit:
    """What ``identify`` does when it is settled what is free, and what of it is known beforehand.

    It says what the model lacks where ``diagnosed``, and follows profiles where ``followed``.
    """

    def of_these(places: Sequence[int], *, asked: bool = False, kept: bool = False) -> Fit:
        own = None if labels is None else [labels[place] for place in places]
        these = [given[place] for place in places]
        return _identify(
            actuator, these, names, own, diagnosed=asked and diagnosed, followed=followed, kept=kept and diagnosed
        )

    every = range(len(given))
    if len(places_of_mountings(enumerate(given))) < 2:
        return _completed(of_these(every, asked=True, kept=True), given)
    with part("each mounting", 0.0, 0.5):
        each = each_mounting(given, of_these)
    with part("all mountings", 0.5, 1.0):
        # Where mountings differ, what one value for all leaves needs no stage.
        fit = of_these(every, asked=not differ(each, actuator), kept=True)
    return _completed(fit, given, each)


def _completed(fit: Fit, given: Sequence[Run], each: Sequence[Mounting] = ()) -> Fit:
    """With what needs the whole fit: who ends it now keeps it."""
    with unreported():
        return with_cross_checks(with_mountings(fit, each) if each else fit, given)


def _identify(
    actuator: Actuator,
    given: Sequence[Run],
    names: FreeParameters,
    labels: Sequence[str] | None,
    *,
    diagnosed: bool,
    followed: bool,
    kept: bool,
) -> Fit:
    stage("reading the runs", 0.0, 0.05)
    outputs = outputs_of_fit(names)
    checked = [Checked.of(run) for run in given]
    found = [check_record(record) for record in checked]
    silent = [noise_only(findings) & set(outputs) for findings in found]
    records = [
        prepare(
            run, place, [name for name in outputs if name not in silent[place]], found[place], checked[place].channels
        )
        for place, run in enumerate(given)
    ]
    if labels is not None:
        records = [replace(record, label=label) for record, label in zip(records, labels, strict=True)]
    else:
        records = disambiguated(records)
    earlier = fitted_runs(actuator.fit_table)
    circuit_is_free = any(electrical(name) for name in names.moved.values())
    records = [
        as_read_before(record, earlier[content], circuit_is_free=circuit_is_free)
        if earlier and (content := run.content_sha256) in earlier
        else record
        for run, record in zip(given, records, strict=True)
    ]
    records = with_states(actuator, given, records, names.age)
    need_each_once(given, [record.label for record in records])
    need_readings(names, given, records, silent)
    lost = [{output for output, one in record.readings.items() if not one.used.any()} for record in records]
    records = [record.without(gone) for record, gone in zip(records, lost, strict=True)]
    left_out = [
        left_out_of(record, which, why)
        for record in records
        for which, why in ((silent[record.place], NOISE), (lost[record.place], "no usable reading"))
        if which
    ]
    foreign = motion_of_another_coupling(actuator, names, records, for_series_alone(names))
    if foreign:
        records = [record.without([finding.channel for finding in foreign if finding.channel]) for record in records]
        left_out += foreign
    result = estimate(actuator, names, records)
    if kept:
        first_answer(lambda: build_fit(actuator, given, result, (), followed=False))
    diagnoses: tuple[OutputDiagnosis, ...] = ()
    lacking: Sequence[Finding] = ()
    if diagnosed:
        try:
            stage("asking what the model lacks", 0.75, 0.8)
            diagnoses, lacking = diagnose(actuator, names, result)
        except KeyboardInterrupt:  # who does not want to wait keeps the fit
            lacking = (NO_STAGES,)
    unseen = {unknown.base for one in result.unseen for unknown in one.unknowns}
    growing: GrowingLeak = "hidden" if SLOW_TIME in unseen else "shown"
    with unreported():
        of_records = findings_of_records(records, found, growing if actuator.structure.slow_leak else "none")
    findings = (*of_records, *left_out, *result.findings, *lacking)
    try:
        stage("errors and intervals", 0.8, 1.0)
        fit = build_fit(actuator, given, result, findings, diagnoses, followed=followed)
    except KeyboardInterrupt:
        if not kept:  # one fit of a longer work, which is to end
            raise
        with unreported():
            fit = build_fit(actuator, given, result, (*findings, NO_PROFILES), diagnoses, followed=False)
    with unreported():
        beyond = [*beyond_findings(fit, records), *environment_findings(actuator, given, fit, result)]
    if names.priors:
        order = Order(result.problem.in_reference(result.solution.theta, result.problem.records[0].place))
        priors = {order(name): prior for name, prior in names.priors.items()}
        # Marked of which only the literature was known beforehand.
        of_literature = {
            name: replace(one, prior_of_literature=True)
            for name, one in fit.parameters.items()
            if one.prior is not None and priors[name.partition("[")[0]].of_literature
        }
        fit = changed(fit, parameters={**fit.parameters, **of_literature}) if of_literature else fit
        if NO_PROFILES in fit.findings:
            return with_findings(fit, beyond)
        try:
            with part("without what is known beforehand", 0.8, 1.0):
                alone = build_fit(actuator, given, estimate(actuator, names.without_priors, records), ())
            beyond += prior_findings(actuator, priors, fit, alone)
        except KeyboardInterrupt:
            if not kept:
                raise
            beyond.append(NO_COMPARISON)
    return with_findings(fit, beyond)


def environment_findings(actuator: Actuator, runs: Sequence[Run], fit: Fit, result: Estimate) -> list[Finding]:
    """What the states of the runs make doubtful, and what laws and ages they leave open."""
    doubts = [
        finding
        for run, record in zip(runs, result.problem.records, strict=True)
        if record.state is not None and record.state.water_content is not None
        for finding in doubtful(actuator, run, record.state, record.label)
    ]
    problem, solution = result.correlated.problem.plain, result.correlated.solution
    held = water_contradicted(problem, solution)
    return [*doubts, *held, *inseparable(problem, solution), *next_condition(fit, problem, solution)]
