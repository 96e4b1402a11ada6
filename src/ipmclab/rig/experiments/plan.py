"""What an experiment is going to do, stated and checked before anything moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.rig.channels import Rig
from ipmclab.rig.checks.rates import check_modules
from ipmclab.rig.experiments.experiment import Experiment
from ipmclab.rig.experiments.steps import FINGERPRINT, PlannedRun, PlannedStep, planned_steps, watched
from ipmclab.rig.request import check_measured, check_rate, check_signal
from ipmclab.rig.safety.guard import Alarm, Guard
from ipmclab.rig.safety.limits import Limits
from ipmclab.signals.signal import shortened
from ipmclab.store.journal.laboratory import BALLAST, free_space_needed
from ipmclab.units import CURRENT

if TYPE_CHECKING:
    from ipmclab.model import Actuator

FloatArray = npt.NDArray[np.float64]

USABLE: Final = 0.8
"""Share of a converter's range that an expected reading may reach."""

MOST_ROWS: Final = 400_000_000
"""Rows of one run: 11 hours at 10 kS/s."""

_LONGEST_LOOK: Final = 200_000
"""Rows of a signal over which the peak current is foretold."""

UNPROVEN: Final = "not proven on this hardware"


@dataclass(frozen=True)
class Plan:
    """What is going to happen.

    Parameters
    ----------
    experiment : Experiment
    rig : Rig
    limits : Limits
        What the guard watches.
    steps : tuple of PlannedStep
    bytes_needed, bytes_free : int
        On the disk of the laboratory folder.
    remarks : tuple of str
        What to think of before it begins.
    rig_proof : str
        The report of the hardware check list on this rig, or that there is none.
    """

    experiment: Experiment
    rig: Rig
    limits: Limits
    steps: tuple[PlannedStep, ...]
    bytes_needed: int
    bytes_free: int
    remarks: tuple[str, ...]
    rig_proof: str

    @property
    def seconds(self) -> float:
        """How long it takes at least, without what the operator does."""
        return sum(step.seconds for step in self.steps)

    @property
    def longest(self) -> float:
        """How long it takes at most [s], without what the operator does: each equilibrium waited for to its end."""
        waits = [step.visit.environment for step in self.steps if step.name == "equilibrium" and step.visit is not None]
        return self.seconds + sum(one.longest_wait - one.settle for one in waits)

    @property
    def conditions(self) -> tuple[dict[str, Any], ...]:
        """Each condition as a JSON document, with when it begins at the earliest [s]."""
        found: dict[int, dict[str, Any]] = {}
        passed = 0.0
        for step in self.steps:
            if step.visit is not None and step.visit.number not in found:
                environment = step.visit.environment
                found[step.visit.number] = {
                    "number": step.visit.number,
                    "name": environment.name,
                    "temperature": environment.temperature,
                    "relative_humidity": environment.relative_humidity,
                    "is_reference": step.visit.is_reference,
                    "starts": passed,
                }
            passed += step.seconds
        return tuple(found.values())

    def _watched(self) -> dict[str, str]:
        """The limits, and which of them nothing that is measured can show to be passed."""
        limit_texts = self.limits.as_text()
        unread = dict.fromkeys(_unread(self.experiment), "not watched: it is not measured")
        beyond = dict.fromkeys(self.limits.unwatched(self.rig, self.experiment.measured), "not watched")
        return {name: unread.get(name) or beyond.get(name) or text for name, text in limit_texts.items()}

    @property
    def runs(self) -> tuple[PlannedRun, ...]:
        """What is recorded."""
        return tuple(step.run for step in self.steps if step.run is not None)

    def as_dict(self) -> dict[str, Any]:
        """The plan as a JSON document (SI units)."""
        experiment = self.experiment
        return {
            "title": experiment.title,
            "sample": experiment.sample.id,
            "rig": self.rig.name,
            "rig_proof": self.rig_proof,
            "folder": str(experiment.folder),
            "rate": experiment.rate,
            "measured": list(experiment.measured),
            "steps": [
                {
                    "name": step.name,
                    "text": step.text,
                    "seconds": step.seconds,
                    "rows": None if step.run is None else step.run.rows,
                    "asks": step.question is not None,
                }
                for step in self.steps
            ],
            "conditions": list(self.conditions),
            "seconds": self.seconds,
            "longest": self.longest,
            "rows": sum(run.rows for run in self.runs),
            "bytes_needed": self.bytes_needed,
            "bytes_free": self.bytes_free,
            "limits": self._watched(),
            "remarks": list(self.remarks),
        }


def make_plan(
    experiment: Experiment,
    rig: Rig,
    *,
    bytes_free: int,
    actuator: Actuator | None = None,
    rig_proof: str = "",
) -> Plan:
    """Check an experiment against its rig, its limits and its disk.

    Parameters
    ----------
    experiment : Experiment
    rig : Rig
    bytes_free : int
        On the disk of the laboratory folder.
    actuator : Actuator, optional
        A model of the strip: foretells the peak current, and what the guard would end.
    rig_proof : str
        What is known of this hardware; empty for a virtual bench.

    Raises
    ------
    InputError
        A channel that the rig lacks, a signal beyond the output or beyond the limits, too many rows,
        an expected current beyond its limit, a disk without room.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> from ipmclab.rig.experiments.experiment_file import experiment_from_table
    >>> table = {"sample": "strip-1", "signal": "step 1 V", "rate": "50 Hz", "duration": "40 s", "fingerprint": False}
    >>> plan = make_plan(experiment_from_table(table), THESIS_RIG, bytes_free=10**9)
    >>> plan.seconds, [run.rows for run in plan.runs]
    (80.0, [2500])
    """
    where = experiment.where
    try:
        check_measured(rig, ["voltage", *experiment.measured])
    except InputError as error:
        raise error.at(f"{where}: measured", f"{rig.name}: {error.message}") from error
    _check_chamber(experiment, rig)
    limits = Limits.from_table(experiment.limits, where=f"{where}: limits")
    steps = planned_steps(experiment, rig)
    remarks: list[str] = []
    needed = BALLAST
    for run in (step.run for step in steps if step.run is not None):
        remarks += _check_run(run, rig, limits, where)
        # Of each channel its values, its raw volts and its quality; with them what the output gave.
        columns = ["output", *3 * ["voltage", *run.measured]]
        needed += free_space_needed(rate=run.rate, duration=run.seconds, columns=columns, ballast=0)
    if actuator is not None and "current" in experiment.measured:
        remarks += _current_remarks(experiment, rig, limits, actuator)
    remarks += limits.unwatched(rig, experiment.measured).values()
    remarks += [
        f"the limit of the {name} is not watched: it is not measured"
        for name in _unread(experiment)
        if name in experiment.limits
    ]
    remarks += _environment_remarks(experiment, rig, steps)
    if rig_proof:
        remarks.append(f"{rig.name}: {rig_proof}")
    if needed > bytes_free:
        raise InputError(
            f"the runs need {_megabytes(needed)}, the disk has {_megabytes(bytes_free)} left",
            code="no-room",
            where=str(experiment.folder),
            repair="make room, choose another folder, or record less",
        )
    return Plan(experiment, rig, limits, steps, needed, bytes_free, tuple(dict.fromkeys(remarks)), rig_proof)


def _check_chamber(experiment: Experiment, rig: Rig) -> None:
    """A chamber that a program sets needs a temperature; the humidity may be left to itself."""
    if rig.chamber is not None and any(one.temperature is None for one in experiment.environments):
        raise InputError(
            "the chamber of this rig is set by the program, and no temperature is stated",
            code="missing-key",
            where=f"{experiment.where}: environment.temperature",
            repair='add temperature = "25 degC"',
        )


def _environment_remarks(experiment: Experiment, rig: Rig, steps: Sequence[PlannedStep]) -> list[str]:
    """What to think of the conditions."""
    if not experiment.environments:
        return []
    found = []
    lacking = [name for name in ("chamber-on", "equilibrium") if not any(step.name == name for step in steps)]
    if lacking:
        found.append(
            f"conditions are stated, and no step is {' or '.join(lacking)}: runs are recorded in whatever air there is"
        )
    if not watched(experiment.environments[0], rig):
        found.append("this rig has no sensor for the environment: its equilibrium is the operator's word")
    longest = experiment.environments[0].longest_still
    seconds = max((step.seconds for step in steps if step.run is not None), default=0.0)
    if rig.chamber is not None and any(step.name == "chamber-off" for step in steps) and seconds > longest:
        found.append(
            f"a run takes {seconds:g} s with its zeros, the chamber may be still for {longest:g} s: such a run is "
            "recorded with its fan on"
        )
    if experiment.order == "listed" and experiment.reference is None and len(experiment.environments) > 2:
        found.append(
            "the conditions are visited once and no reference is visited again: what the environment does and what age "
            'does cannot be separated; order = "palindromic" or a [reference] cures that'
        )
    return found


def _unread(experiment: Experiment) -> tuple[str, ...]:
    """The limited quantities that are not measured: of displacement and force one at most is."""
    return tuple(name for name in ("displacement", "force") if name not in experiment.measured)


def _check_run(run: PlannedRun, rig: Rig, limits: Limits, where: str) -> list[str]:
    """What to think of a run that is refused neither by the bench nor by the limits."""
    if not 2 <= run.rows <= MOST_ROWS:
        raise InputError(
            f"{run.seconds:g} s at {run.rate:g} Hz are {run.rows} rows, a run has 2 to {MOST_ROWS}",
            code="too-many-rows" if run.rows > 2 else "too-short",
            where=f"{where}: duration",
            repair="record at another rate, or for another time",
        )
    applied = round(run.duration * run.rate)
    if not applied:
        raise InputError(
            f"the signal lasts {run.duration:g} s, a row {1.0 / run.rate:g} s: nothing of it would be applied",
            code="too-short",
            where=f"{where}: duration",
            repair="record for longer, or at a higher rate",
        )
    try:
        check_rate(rig, run.rate)
        check_modules(rig, run.measured, run.rate)
    except InputError as error:
        raise error.at(f"{where}: {error.where}") from error
    try:
        # The narrower of the two is what the operator has to know.
        strip_first = limits.voltage.most < min(-rig.output.low, rig.output.high)
        if strip_first:
            limits.refuse(run.signal, run.duration, run.rate)
        check_signal(rig, run.signal, applied, run.rate)
        if not strip_first:
            limits.refuse(run.signal, run.duration, run.rate)
    except InputError as error:
        raise error.at(f"{where}: signal", f"{shortened(str(run.signal))}: {error.message}") from error
    remarks = limits.remarks(run.signal, run.duration, run.rate)
    return [f"{shortened(str(run.signal))}: {text}" for text in remarks if run.purpose == "signal"]


def _current_remarks(experiment: Experiment, rig: Rig, limits: Limits, actuator: Actuator) -> list[str]:
    """What the model of the strip foretells of the current."""
    from ipmclab.model import simulate
    from ipmclab.model.stages.circuit import CONTACT

    in_series = rig.shunt_resistance + rig.source_resistance
    behind = actuator.replace(**{CONTACT: actuator[CONTACT] + in_series})
    found = []
    low, high = rig["current"].range
    most = USABLE * min(-low, high)
    for signal in experiment.signals:
        duration = min(experiment.duration, _LONGEST_LOOK / experiment.rate)
        try:
            run = simulate(behind, _within(signal, duration), duration=duration, rate=experiment.rate)
        except InputError:
            continue  # a signal that reaches beyond the look: its start says too little
        assert run.current is not None
        peak = float(np.max(np.abs(run.current)))
        named, shown = shortened(str(signal)), f"{CURRENT.to_display(peak):.3g} mA"
        if limits.current is not None and peak > limits.current.most:
            raise InputError(
                f"{named} is expected to draw {shown} (by {actuator.name}), "
                f"the limit is {CURRENT.to_display(limits.current.most):.3g} mA",
                code="beyond-limit",
                where=f"{experiment.where}: signal",
                repair=f'give a smaller amplitude, or state limits.current = "{1.2e3 * peak:.3g} mA"',
            )
        if peak > most:
            found.append(
                f"{named} is expected to draw {shown}: more than {100 * USABLE:.0f} % of what the channel of the "
                f"current reads ({CURRENT.to_display(min(-low, high)):.3g} mA); give it a wider range"
            )
        ended = _ended(run.voltage, run.current.clip(low, high), experiment.rate, rig, limits)
        if ended is not None:
            found.append(
                f"{named} is expected to be ended by the guard at {ended.time:.6g} s (by {actuator.name}): {ended}; "
                f"give a smaller amplitude, or state limits.{ended.limit} where this strip withstands more"
            )
    return found


def _ended(output: FloatArray, current: FloatArray, rate: float, rig: Rig, limits: Limits) -> Alarm | None:
    """The first alarm that would bring the output to 0 V, were these the readings."""
    sensed_upstream = rig.voltage_sensed == "upstream of shunt"
    voltage = output - current * (rig.source_resistance + (0.0 if sensed_upstream else rig.shunt_resistance))
    alarms = Guard(limits, rate, rig).look(0, {"voltage": voltage, "current": current})
    return next((alarm for alarm in alarms if alarm.action == "zero"), None)


def _within(signal: Any, duration: float) -> Any:
    signal.check_fits(duration)
    return signal


def unanswered(plan: Plan, answers: Mapping[str, str]) -> list[str]:
    """Steps that ask something to which no answer was given beforehand."""
    asked = dict.fromkeys(step.name for step in plan.steps if step.question is not None)
    return [name for name in asked if name not in answers]


def check_answers(plan: Plan, answers: Mapping[str, str]) -> None:
    """Refuse answers that fit no question.

    Raises
    ------
    InputError
    """
    questions = {step.name: step.question for step in plan.steps if step.question is not None}
    known = {**questions, "fingerprint": FINGERPRINT}
    for name, value in answers.items():
        question = known.get(name)
        if question is None:
            raise InputError(
                f"no step {name!r} asks a question",
                code="unknown-step",
                where=f"answer {name}",
                repair=suggest(name, known),
            )
        question.check(value)


def _megabytes(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{max(0.1, size / 1e6):.1f} MB"
