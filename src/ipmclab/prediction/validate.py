"""An actuator compared with runs that it was not identified from: free-run prediction and its scores."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.consistency.of_fit import units_off
from ipmclab.errors import InputError
from ipmclab.fit.ages import rates_of
from ipmclab.fit.as_fitted import why_changed
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_file import fit_of
from ipmclab.fit.row_marks import shared_rows
from ipmclab.identification.problem.earlier_fit import fitted_runs, zeros_of_fit
from ipmclab.identification.problem.free_run import predict, seen_from_sensor
from ipmclab.identification.problem.record import (
    READ_OUTPUTS,
    PreparedRun,
    label_of,
    prepare,
)
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator
from ipmclab.model.given import need_each_once
from ipmclab.model.stages.laser import blank_lost
from ipmclab.model.validity import validity
from ipmclab.prediction.bands_of_run import (
    another_mounting,
    band_of_run,
    beyond_fit,
    own_mounting,
    place_in,
)
from ipmclab.prediction.in_state import environment_of_run, state_in
from ipmclab.prediction.open_coupling import open_coupling
from ipmclab.prediction.outside_band import outside_band
from ipmclab.prediction.own_of_mounting import own_of_mounting
from ipmclab.prediction.read_off import edge_delay, sensor_zeros
from ipmclab.prediction.run_validation import RunValidation
from ipmclab.prediction.said_of_run import said_of_run
from ipmclab.prediction.scores import Comparison, Score, score
from ipmclab.quality import check
from ipmclab.quality.skew import is_far_off
from ipmclab.quality.usable import noise_only
from ipmclab.run import Finding, Run, RunMetadata
from ipmclab.shown import Shown
from ipmclab.strip_state.in_state import strip_in_state
from ipmclab.units import CHANNELS

FloatArray = npt.NDArray[np.float64]

_SILENT: Final = "nothing but noise was measured in this channel"


@dataclass(frozen=True, eq=False)
class Validation(Shown):
    """An actuator compared with runs.

    Parameters
    ----------
    actuator : Actuator
    runs : tuple of RunValidation
        In the order of the call.
    scores : mapping of output to Score
        Pooled over the runs that have the output.
    findings : tuple of Finding
        What the user must know: a run that the fit had used, a delay that was estimated, a zero
        that was taken off, an assumed rest.
    """

    actuator: Actuator
    runs: tuple[RunValidation, ...]
    scores: Mapping[str, Score]
    findings: tuple[Finding, ...]

    def __str__(self) -> str:
        """A line for the actuator, and one for each output of each run."""
        lines = [f"{self.actuator.name} against {len(self.runs)} run(s)"]
        for run in self.runs:
            for name, one in run.scores.items():
                quantity = CHANNELS[name]
                if one.fit_percent is None or one.rmse is None:
                    text = f"no score: {one.reason}"
                else:
                    rmse = f"{quantity.to_display(one.rmse):.3g} {quantity.display_unit}"
                    text = f"fit {one.fit_text}, RMSE {rmse}"
                    if one.inside_band is not None:
                        text += f", {100.0 * one.inside_band:.0f} % of the readings in the 95 % band"
                lines.append(f"  {run.label}, {name}: {text}" + (" (used in the fit)" if run.used_in_fit else ""))
        return "\n".join(lines)

    __repr__ = __str__

    def as_dict(self) -> dict[str, Any]:
        """The validation as ``--json`` prints it."""
        return {
            "actuator": self.actuator.name,
            "scores": {name: one.as_dict() for name, one in self.scores.items()},
            "runs": [one.as_dict() for one in self.runs],
        }


@tell_kinds
def validate(actuator: Actuator | Fit, runs: Sequence[Run] | Run, *, used: Iterable[str] = ()) -> Validation:
    """Predict runs from their voltage alone, and score the prediction against what was measured.

    The prediction is a free run from rest: nothing of the response is shown to the model and
    nothing is refitted. Two things that belong to the record and not to the strip are settled
    first, and said in ``findings``: the zero of each sensor, read before the voltage first moves (of
    a current that begins with a wave, what this shows of it), and the delay of a run whose hold is
    unknown, the one at which the predicted shape (its scale apart) is nearest to the readings. A run
    of the fit has what was found there: zero, drift, delay, and the parameters that each run has for
    itself. Where each mounting of the fit has parameters of its own, a run that names one of them is
    predicted with that mounting's.

    Parameters
    ----------
    actuator : Actuator or Fit
    runs : Run or sequence of Run
        With at least one of current, displacement and force.
    used : iterable of str
        ``content_sha256`` of runs that the actuator was identified from, in addition to those that its
        own ``fit_table`` names.

    Returns
    -------
    validation : Validation

    Raises
    ------
    InputError
        No actuator, no run, a run that is given twice, or one in which nothing was measured that the actuator predicts.
    IpmclabError
        A prediction that is not finite.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> actuator = load_actuator("friend-2")
    >>> run = simulate(actuator, "square 1 V 0.1 Hz", duration=20.0, rate=50.0)
    >>> validation = validate(actuator, run)
    >>> round(validation.scores["force"].fit_percent, 6)
    100.0
    """
    if isinstance(actuator, Fit):
        actuator = actuator.actuator  # which carries the table of the fit
    given = [runs] if isinstance(runs, Run) else list(runs)
    if not given:
        raise InputError("there is no run to predict", code="no-runs", where="runs", repair="give at least one run")
    labels = run_labels(given)
    need_each_once(given, labels)
    fit, wrong = _fit_of(actuator)
    known: dict[str, Mapping[str, Any]] = {sha256: {} for sha256 in used} | fitted_runs(actuator.fit_table)
    done: list[RunValidation] = []
    findings: list[Finding] = []
    marks = [one.marks for one in fit.observations if one.marks is not None] if fit is not None else []
    if wrong is not None:
        said = f"{wrong.where}: {wrong.message}: there is no 95 % band"
        findings.append(Finding(wrong.code, "warning", said, wrong.repair))
    elif fit is not None and (why := why_changed(fit)):
        fit = None
        said = f"{why}: its uncertainty does not hold for this actuator, and there is no 95 % band"
        repair = "identify again with these values, or take the file as identify wrote it"
        findings.append(Finding("changed-since-fit", "warning", said, repair))
    for place, (run, label) in enumerate(zip(given, labels, strict=True)):
        one = _validate_run(actuator, run, place, label, known.get(run.content_sha256), fit)
        one = one if one.used_in_fit else replace(one, rows_in_fit=shared_rows(marks, run))
        done.append(one)
        # A channel that cannot be right says nothing of a model, and comes before what follows from it.
        skewed = [found for found in one.record_findings if is_far_off(found)]
        findings += [
            replace(off, message=f"{label}: {off.message}", samples=(), effect="none")
            for off in [*units_off(actuator, run, one.comparisons), *skewed]
        ]
        findings += said_of_run(one)
        if fit is not None:
            findings += own_mounting(fit, run, label)
            findings += another_mounting(fit, run, label)
            findings += beyond_fit(fit, run, label)
        findings += [] if one.used_in_fit else environment_of_run(fit, actuator, run, label)
    findings += outside_band(done)
    pooled = {
        output: _pooled(output, [(place, one) for place, one in enumerate(done) if output in one.comparisons])
        for output in READ_OUTPUTS
        if any(output in one.comparisons for one in done)
    }
    if {"displacement", "force"} & pooled.keys():
        findings += open_coupling(actuator)
    return Validation(actuator, tuple(done), pooled, tuple(findings))


def _fit_of(actuator: Actuator) -> tuple[Fit | None, InputError | None]:
    """The fit that an actuator carries, or what is wrong with its table; neither where it was not fitted."""
    try:
        return (fit_of(actuator, where=actuator.name) if actuator.fit_table is not None else None), None
    except InputError as error:
        return None, error


def run_labels(runs: Sequence[Run]) -> list[str]:
    """A short name for each run, no two alike: its source file, its signal, or its place.

    Runs of one signal are distinguished by what was measured, else by their place.

    Examples
    --------
    >>> from ipmclab import RunMetadata
    >>> step = RunMetadata(signal="step 1 V")
    >>> first = Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 1.0], force=[0.0, 1e-3], metadata=step)
    >>> second = Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 1.0], current=[0.0, 1e-3], metadata=step)
    >>> run_labels([first, second])
    ['step 1 V (force)', 'step 1 V (current)']
    >>> run_labels([first, first])
    ['step 1 V (force) [0]', 'step 1 V (force) [1]']
    """
    names = [label_of(run, place) for place, run in enumerate(runs)]
    outputs = [", ".join(name for name in READ_OUTPUTS if name in run.channels) for run in runs]
    states = [
        f"{name} ({measured})" if names.count(name) > 1 and measured else name
        for name, measured in zip(names, outputs, strict=True)
    ]
    return [f"{name} [{place}]" if states.count(name) > 1 else name for place, name in enumerate(states)]


def _validate_run(
    actuator: Actuator, run: Run, place: int, label: str, fitted: Mapping[str, Any] | None, fit: Fit | None
) -> RunValidation:
    """Predict one run; ``fitted`` is what the fit that used it says of it, or None for a run that is new.

    ``fit`` is what the actuator carries, where it does.
    """
    outputs: list[str] = [name for name in READ_OUTPUTS if name in run.channels]
    if not outputs:
        raise InputError(
            f"nothing was measured that {actuator.name} predicts, the run has {', '.join(run.channels)}",
            code="nothing-to-compare",
            where=label,
            repair="give a run with current, displacement or force",
        )
    found = check(run)
    silent = noise_only(found)
    record = _without(prepare(run, place, outputs, found), silent)
    own = (fitted or {}).get("parameters")
    if own is None:
        own = {} if fit is None else own_of_mounting(fit, run.metadata.mounting_id)
    model = seen_from_sensor(actuator.replace(**own) if own else actuator, record.series_resistance)
    state = state_in(fit, actuator, run)
    there = model if state is None else strip_in_state(model, state, rates_of(fit))
    moving = {finding.channel for finding in found if finding.code == "not-at-rest"}  # which is no zero of a sensor
    of_fit = zeros_of_fit(fitted or {})
    still = [name for name in outputs if name not in moving and name not in of_fit]
    found_zeros = {**sensor_zeros(there, record, still, fit), **of_fit}
    zeros = {name: found_zeros[name] for name in outputs if found_zeros.get(name)}
    drifts, start = (fitted or {}).get("drift", {}), (fitted or {}).get("initial_state", {})
    since = run.time - run.time[0]
    measured = {name: run.channels[name] - zeros.get(name, 0.0) for name in outputs}
    drift = {name: drifts.get(name, 0.0) * since for name in outputs}
    still_measured = {name: measured[name] - drift[name] for name in outputs}
    delay = edge_delay(there, record, still_measured, fitted or {}) if record.delay_is_free else None
    every = np.array(predict(there, record, READ_OUTPUTS, delay or 0.0, start))
    read = record.readings.get("displacement")
    blank_lost(every, READ_OUTPUTS, there.parameter_values, kept=None if read is None else read.exact)
    predicted = dict(zip(READ_OUTPUTS, every, strict=True))
    reach = {} if fit is None else band_of_run(fit, model, record, place_in(fit, run), delay or 0.0, start, zeros)
    comparisons = {
        # A drift of the sensor is on the side of the model, as in the fit: the readings vary as they were read.
        name: Comparison(
            run.time, measured[name], predicted[name] + drift[name], record.readings[name].exact, reach.get(name)
        )
        for name in outputs
    }
    scores = {name: score(name, [one]) for name, one in comparisons.items()}
    for name in silent & scores.keys():
        scores[name] = replace(scores[name], reason=_SILENT)
    answer = Run(time=run.time, voltage=run.voltage, hold=run.hold, metadata=run.metadata, **predicted)
    about = RunMetadata(
        origin="simulated",
        sample=actuator.sample,
        signal=run.metadata.signal,
        findings=validity(there, answer, run.metadata.signal),
    )
    return RunValidation(
        run=run,
        label=label,
        predicted=replace(answer, metadata=about),
        comparisons=comparisons,
        scores=scores,
        zeros=zeros,
        delay=delay,
        used_in_fit=fitted is not None,
    )


def _without(record: PreparedRun, silent: Collection[str]) -> PreparedRun:
    """The record without readings of the channels in which nothing but noise was measured."""
    readings = {
        name: replace(reading, used=np.zeros_like(reading.used)) if name in silent else reading
        for name, reading in record.readings.items()
    }
    return replace(record, readings=readings)


def _pooled(output: str, members: Sequence[tuple[int, RunValidation]]) -> Score:
    pooled = score(output, [one.comparisons[output] for _, one in members])
    if pooled.max_error_run is not None:
        pooled = replace(pooled, max_error_run=members[pooled.max_error_run][0])
    else:
        pooled = replace(pooled, reason=members[0][1].scores[output].reason)
    return replace(pooled, autocorrelation=np.empty(0), autocorrelation_band=np.empty(0))
