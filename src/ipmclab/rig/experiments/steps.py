"""The steps of an experiment, in the order of Friend's section 3.5, with what each asks of the operator."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from ipmclab.errors import InputError, suggest
from ipmclab.rig.channels import Rig
from ipmclab.rig.experiments import fingerprint
from ipmclab.rig.experiments.environments import TargetEnvironment
from ipmclab.rig.experiments.experiment import Experiment
from ipmclab.rig.experiments.visits import Visit, visits
from ipmclab.rig.safety.limit import AIR
from ipmclab.signals import Samples, Signal, Step
from ipmclab.signals import Sequence as SignalSequence
from ipmclab.signals.signal import shortened
from ipmclab.units import MASS, Quantity, parse_quantity

CHAMBER: Final = ("chamber-on", "equilibrium", "chamber-off")
"""The steps that are taken again for each condition."""

MOST_DRIFT: Final = 5e-6
"""The preload has settled when it drifts by less [N/s]: 0.2 mN in 40 s, against signals of 0.5 to 3.7 mN."""

UNKNOWN: Final = "unknown"
"""The answer that an act of a person was done, or not: nobody says which. It is what ``--yes`` answers."""

Purpose = Literal["signal", "baseline", "fingerprint", "reference"]


@dataclass(frozen=True)
class Question:
    """What only an operator can do or decide.

    Parameters
    ----------
    step : str
        Under which an answer may be given beforehand (``--answer STEP=VALUE``).
    text : str
    choices : tuple of str
    default : str
        What an operator confirms.
    again : bool
        It is asked once more in the same step: an answer given beforehand has been used up.
    unattended : str, optional
        What ``--yes`` answers where that is not the default: nobody is vouched for.
    quantity : Quantity, optional
        A number with its unit is an answer too, such as ``example``.
    example : str
    """

    step: str
    text: str
    choices: tuple[str, ...]
    default: str
    again: bool = False
    unattended: str = ""
    quantity: Quantity | None = None
    example: str = ""

    @classmethod
    def of_an_act(cls, step: str, text: str, *otherwise: str, done: str = "done") -> Question:
        """Whether a person has done something: only a person can say so."""
        return cls(step, text, (done, *otherwise, UNKNOWN), done, unattended=UNKNOWN)

    def check(self, value: str) -> str:
        """An answer in the spelling of the choices.

        Raises
        ------
        InputError
            None of the choices, and no number above 0 where one is asked for.
        """
        answer = value.strip().lower()
        if answer not in self.choices and self.quantity is not None:
            where = f"answer {self.step}"
            if parse_quantity(value, self.quantity, where=where) > 0.0:
                return value.strip()
            raise InputError(
                f"{value!r} is not above 0", code="bad-answer", where=where, repair=f"give for example {self.example}"
            )
        if answer not in self.choices:
            raise InputError(
                f"{value!r} is no answer to {self.step!r}",
                code="bad-answer",
                where=f"answer {self.step}",
                repair=suggest(answer, self.choices),
            )
        return answer


FINGERPRINT: Final = Question(
    "fingerprint",
    "the strip is not as it was: 'continue', 'clamp' it again, or 'hydrate' it and clamp it again",
    ("continue", "clamp", "hydrate"),
    "continue",
)
"""Asked when a fingerprint is outside the scatter of the earlier ones."""


@dataclass(frozen=True)
class PlannedRun:
    """One recording that is going to be made.

    Parameters
    ----------
    signal : Signal
        As it is applied.
    purpose : "signal", "baseline", "fingerprint" or "reference"
    duration, rest_before, rest_after : float [s]
    rate : float [Hz]
    measured : tuple of str
    zero_before, zero_after : float [s]
        How long the channels are read at rest before and after it.
    pair_id : str, optional
        Shared by the two polarities of one signal.
    repeat : int
        Counts from 1.
    uuid : str, optional
        That it will have, where it was given one beforehand.
    """

    signal: Signal
    purpose: Purpose
    duration: float
    rest_before: float
    rest_after: float
    rate: float
    measured: tuple[str, ...]
    zero_before: float
    zero_after: float
    pair_id: str | None = None
    repeat: int = 1
    uuid: str | None = None

    @property
    def seconds(self) -> float:
        """How long the record is [s]."""
        return self.rest_before + self.duration + self.rest_after

    @property
    def rows(self) -> int:
        """How many rows it has."""
        return round(self.seconds * self.rate)


@dataclass(frozen=True)
class PlannedStep:
    """One step of the experiment.

    Parameters
    ----------
    name : str
        Of ``experiment.STEPS``, or ``pause`` or ``fingerprint``.
    text : str
        What happens, for people.
    seconds : float [s]
        At least; 0 for what the operator does.
    question : Question, optional
        What it asks of the operator.
    run : PlannedRun, optional
        What it records.
    actions : tuple of str
        What the operator does then, in the words of a virtual rig.
    visit : Visit, optional
        The condition that it brings about, or waits for.
    """

    name: str
    text: str
    seconds: float = 0.0
    question: Question | None = None
    run: PlannedRun | None = None
    actions: tuple[str, ...] = ()
    visit: Visit | None = None


def planned_steps(experiment: Experiment, rig: Rig) -> tuple[PlannedStep, ...]:
    """Every step of an experiment, in order.

    Parameters
    ----------
    experiment : Experiment
    rig : Rig

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> from ipmclab.rig.experiments.experiment_file import experiment_from_table
    >>> table = {"sample": "strip-1", "signal": "step 1 V", "rate": "50 Hz", "duration": "40 s"}
    >>> [step.name for step in planned_steps(experiment_from_table(table), THESIS_RIG)]
    ['hydrate', 'clamp', 'fingerprint', 'pause', 'zero', 'preload', 'apply', 'hydrate']
    """
    wanted = experiment.steps or _default_steps(experiment)
    apply_at = wanted.index("apply")
    before = [name for name in wanted[:apply_at] if name not in ("zero", "preload", *CHAMBER)]
    steps = [prepare(name, experiment, rig) for name in before]
    conditions: tuple[Visit | None, ...] = planned_visits(experiment) or (None,)
    for visit in conditions:
        steps += [prepare(name, experiment, rig, visit) for name in CHAMBER if name in wanted]
        steps += _recording_steps(experiment, rig, wanted, list(planned_runs(experiment, visit)))
    if rig.chamber is not None and experiment.environments and "chamber-on" in wanted:
        steps.append(PlannedStep("standby", "the chamber regulates nothing any more"))
    steps += [prepare(name, experiment, rig) for name in wanted[apply_at + 1 :]]
    return tuple(steps)


def planned_visits(experiment: Experiment) -> tuple[Visit, ...]:
    """The conditions of an experiment in the order in which the chamber is brought to them; none in a room."""
    order = experiment.order if len(experiment.environments) > 1 else "listed"
    return visits(experiment.environments, order, experiment.reference) if experiment.environments else ()


def _recording_steps(
    experiment: Experiment, rig: Rig, wanted: Sequence[str], runs: Sequence[PlannedRun]
) -> list[PlannedStep]:
    """What is recorded under one condition, with what each run needs before it."""
    steps: list[PlannedStep] = []
    pause = PlannedStep("pause", "at 0 V: the strip discharges", experiment.pause)
    rests = [pause] if experiment.pause else []
    for place, run in enumerate(runs):
        steps += rests if place else []
        if experiment.fingerprint and run.purpose == "signal" and "current" in run.measured:
            steps += [fingerprint_step(experiment), *rests]
        for name in ("zero", "preload"):
            if name in wanted:
                steps.append(prepare(name, experiment, rig))
        what = "without voltage" if run.purpose == "baseline" else shortened(str(run.signal))
        of = f" ({place + 1} of {len(runs)})" if len(runs) > 1 else ""
        text = f"{what}, {run.duration:g} s, with {run.rest_before:g} s and {run.rest_after:g} s at 0 V{of}"
        zeros = {"before": run.zero_before, "after": run.zero_after}
        parts = [f"{seconds:g} s {when}" for when, seconds in zeros.items() if seconds]
        text += f"; zeros are read for {' and '.join(parts)}" if parts else ""
        steps.append(PlannedStep("apply", text, run.zero_before + run.seconds + run.zero_after, run=run))
    return steps


def planned_runs(experiment: Experiment, visit: Visit | None = None) -> Iterator[PlannedRun]:
    """What is recorded under one condition: baseline, then each signal with its repeats and both its polarities.

    At the reference it is one run; where a condition is visited again, the repeats are counted on.
    """
    template = PlannedRun(
        signal=Step(0.0),
        purpose="signal",
        duration=experiment.duration,
        rest_before=experiment.rest_before,
        rest_after=experiment.rest_after,
        rate=experiment.rate,
        measured=experiment.measured,
        zero_before=experiment.zero_time,
        zero_after=experiment.zero_time,
    )
    if experiment.listed:
        for one in experiment.listed:
            named = replace(template, pair_id=one.pair_id, uuid=one.uuid)
            yield replace(named, signal=one.signal, purpose=one.purpose, repeat=one.repeat)
        return
    again = 0 if visit is None else visit.again
    if visit is not None and visit.is_reference:
        assert experiment.reference is not None
        signal = experiment.reference.signal or experiment.signals[0]
        yield replace(template, purpose="reference", signal=signal, repeat=again + 1)
        return
    if experiment.baseline:
        yield replace(template, purpose="baseline")
    for signal in experiment.signals:
        for repeat in range(again * experiment.repeats + 1, (again + 1) * experiment.repeats + 1):
            if not experiment.pair:
                yield replace(template, signal=signal, repeat=repeat)
                continue
            pair_id = uuid.uuid4().hex[:12]
            for applied in (signal, reversed_signal(signal)):
                yield replace(template, signal=applied, repeat=repeat, pair_id=pair_id)


def fingerprint_step(experiment: Experiment) -> PlannedStep:
    """The short run at 0.1 V that shows whether the strip is still as it was."""
    run = PlannedRun(
        signal=Step(fingerprint.VOLTAGE),
        purpose="fingerprint",
        duration=fingerprint.DURATION,
        rest_before=fingerprint.REST,
        rest_after=fingerprint.REST,
        rate=max(experiment.rate, fingerprint.LEAST_RATE),
        measured=experiment.measured,
        zero_before=fingerprint.REST,
        zero_after=0.0,
    )
    return PlannedStep(
        "fingerprint", f"{fingerprint.VOLTAGE:g} V for {run.duration:g} s", run.zero_before + run.seconds, run=run
    )


def reversed_signal(signal: Signal) -> Signal:
    """The signal with the other polarity.

    Examples
    --------
    >>> from ipmclab.signals import parse
    >>> print(reversed_signal(parse("sine 1 V 0.1 Hz offset=0.5 V")))
    sine -1 V 0.1 Hz offset=-0.5 V
    """
    if isinstance(signal, SignalSequence):
        return replace(signal, signals=tuple(reversed_signal(one) for one in signal.signals))
    if isinstance(signal, Samples):
        return signal.reversed()
    changed = {}
    for name in ("amplitude", "offset"):
        if hasattr(signal, name):
            changed[name] = -getattr(signal, name)
    return replace(signal, **changed)


def prepare(name: str, experiment: Experiment, rig: Rig, visit: Visit | None = None) -> PlannedStep:
    """A step that makes ready for a run, or ends the experiment; one of the chamber for a visit of a condition."""
    if name in CHAMBER:
        return _chamber_step(name, experiment, rig, visit)
    force = "force" in experiment.measured
    strip = f"{experiment.sample.id}: "  # in a campaign another one than that of the step before
    if name == "hydrate":
        text = "the strip in its solvent between experiments; then take it out and tap it dry with tissue"
        return PlannedStep(name, text, question=Question.of_an_act(name, strip + text), actions=("rest",))
    if name == "clamp":
        at = f" at {experiment.clamp_pressure / 1e3:g} kPa" if experiment.clamp_pressure is not None else ""
        text = f"clamp the strip{at}; 'kept' if it has stayed in the clamp since its last run"
        return PlannedStep(name, text, question=Question.of_an_act(name, strip + text, "kept"), actions=("rest",))
    if name == "weigh":
        text = "weigh the strip, tapped dry; type its mass, or 'skip' to go without it"
        question = Question(name, strip + text, ("skip",), "skip", quantity=MASS, example="131 mg")
        return PlannedStep(name, text, question=question)
    if name == "zero":
        seconds = experiment.zero_time
        if force:
            text = "tip clear of the load cell: its tare is read"
            question = Question(name, text + "; 'skip' to go without it", ("done", "skip"), "done", unattended="skip")
            return PlannedStep(name, text, seconds, question, actions=("tip clear",))
        return PlannedStep(name, f"the channels are read at 0 V for {seconds:g} s before and after the run")
    text = f"tip on the load cell: the run waits until the preload drifts by less than {1e6 * MOST_DRIFT:g} uN/s"
    return PlannedStep(name, text, question=Question.of_an_act(name, text), actions=("tip on cell",))


def _chamber_step(name: str, experiment: Experiment, rig: Rig, visit: Visit | None) -> PlannedStep:
    """A step of the chamber: done by the program where the rig has a chamber that it can set, else by an operator."""
    environment = None if visit is None else visit.environment
    target = str(environment) if environment is not None else ""
    place = f" (condition {visit.number} of {visit.of})" if visit is not None and visit.of > 1 else ""
    of_reference = "reference: " if visit is not None and visit.is_reference else ""
    is_set_here = rig.chamber is not None and environment is not None
    if name == "chamber-on":
        text = f"{of_reference}chamber on, set to {target}{place}" if target else "chamber on"
        if is_set_here:
            return PlannedStep(name, text, visit=visit)
        actions = []
        if environment is not None and environment.temperature is not None:
            actions.append(f"temperature {environment.temperature:g} degC")
        if environment is not None and environment.relative_humidity is not None:
            actions.append(f"humidity {environment.relative_humidity:g} percent")
        return PlannedStep(name, text, 0.0, Question.of_an_act(name, text), actions=tuple(actions), visit=visit)
    if name == "equilibrium":
        if environment is None:
            raise InputError(
                "there is no environment to wait for",
                code="missing-key",
                where=f"{experiment.where}: steps",
                repair="add a table [environment], or leave the step out",
            )
        text = f"wait until {target} has held for {environment.settle:g} s, at most {environment.longest_wait:g} s"
        if watched(environment, rig):
            return PlannedStep(name, text, environment.settle, visit=visit)
        text += "; this rig has no sensor for it, so an operator says when"
        asked = Question.of_an_act(name, text, done="settled")
        return PlannedStep(name, text, environment.settle, asked, visit=visit)
    if environment is not None and is_set_here:
        drift = f"{environment.temperature_drift:g} K or {environment.humidity_drift:g} %RH"
        text = (
            "chamber still (fan and compressor off) while the strip is recorded, "
            f"for at most {environment.longest_still:g} s and a drift of {drift}"
        )
        return PlannedStep(name, text, visit=visit)
    text = "chamber off: its fan shakes the strip"
    return PlannedStep(name, text, question=Question.of_an_act(name, text), visit=visit)


def watched(environment: TargetEnvironment, rig: Rig) -> tuple[str, ...]:
    """What can be read of an environment: by the sensors of the rig, or else by those of its chamber."""
    names = {channel.name for channel in rig.channels} | ({"temperature"} if rig.thermometer is not None else set())
    return tuple(
        name for name in AIR if getattr(environment, name) is not None and (name in names or rig.chamber is not None)
    )


def _default_steps(experiment: Experiment) -> tuple[str, ...]:
    chamber = CHAMBER if experiment.environments else ()
    weigh = ("weigh",) if experiment.weigh else ()
    preload = ("preload",) if "force" in experiment.measured else ()
    return ("hydrate", *weigh, "clamp", *chamber, "zero", *preload, "apply", "hydrate")
