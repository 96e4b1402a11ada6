"""The experiment file: a TOML table becomes an experiment, or a message says what is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field, ValidationError

from ipmclab.errors import InputError, unknown_name
from ipmclab.rig.experiments.environments import (
    EXAMPLES,
    ConditionTable,
    EnvironmentTable,
    Reference,
    ReferenceTable,
    TargetEnvironment,
    conditions_from_texts,
    read_environments,
)
from ipmclab.rig.experiments.experiment import MEASURABLE, MOST_REPEATS, STEPS, VIRTUAL, Experiment
from ipmclab.rig.experiments.folder import check_folder
from ipmclab.sample import Sample
from ipmclab.signals import Signal, parse
from ipmclab.store.strict import Strict, as_input_error
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import (
    CHANNELS,
    FREQUENCY,
    PRESSURE,
    TIME,
    Quantity,
    parse_quantity,
)

_REST: Final = "5 s"
_PAUSE: Final = "2 min"
_ZERO: Final = "10 s"
_EXAMPLES: Final = {
    "rate": "50 Hz",
    "duration": "40 s",
    "clamp_pressure": "100 kPa",
    "rest_before": _REST,
    "rest_after": _REST,
    "pause": _PAUSE,
    "zero_time": _ZERO,
    **{f"environment.{key}": example for key, example in EXAMPLES.items()},
}
"""What is where a quantity belongs, for messages."""


TEMPLATE: Final = """\
title = "step and sine, 1 V"
sample = "strip-1"               # or a table [sample] with id, membrane, counter_ion...
rig = "rig.toml"                 # in the folder of this file; "virtual" needs no hardware
folder = "runs"                  # the laboratory folder: every run of every sample
signals = ["step 1 V", "sine 1 V 0.1 Hz"]
duration = "40 s"                # of each signal; 5 s at 0 V come before and after it
rate = "50 Hz"
measured = ["current", "force"]  # or displacement in place of force: the load cell holds the tip
repeats = 1
pair = false                     # true: each signal with both polarities
baseline = false                 # true: first a run without voltage
operator = "your name"
# actuator = "strip-1.toml"      # a model of the strip, where there is one: foretells the peak current
# environments = ["25 degC, 40 percent", "25 degC, 60 percent"]   # several conditions: up the list, and down again

# [environment]                  # leave it out at room conditions
# temperature = "25 degC"
# relative_humidity = "80 percent"
# settle = "30 min"

# [reference]                    # visited at the start, at the end and after every 4 conditions
# relative_humidity = "50 percent"

# [limits]                       # what the guard watches; 3.5 V where no voltage is stated
# voltage = "2 V"
# current = "150 mA"
"""
"""An experiment file to start from."""


class _Table(Strict):
    title: str | None = None
    sample: str | dict[str, Any] | None = None
    actuator: str | None = None
    rig: str = VIRTUAL
    folder: str = "runs"
    signal: str | None = None
    signals: Annotated[tuple[str, ...], Field(strict=False)] | None = None
    rate: str
    duration: str
    measured: Annotated[tuple[str, ...], Field(strict=False)] = ("current", "force")
    rest_before: str = _REST
    rest_after: str = _REST
    pause: str = _PAUSE
    zero_time: str = _ZERO
    repeats: int = 1
    pair: bool = False
    baseline: bool = False
    fingerprint: bool = True
    operator: str | None = None
    notes: str | None = None
    mounting_id: str | None = None
    clamp_pressure: str | None = None
    steps: Annotated[tuple[str, ...], Field(strict=False)] | None = None
    weigh: bool = False
    environment: EnvironmentTable | None = None
    environments: Annotated[tuple[ConditionTable, ...], Field(strict=False)] | None = None
    reference: ReferenceTable | None = None
    limits: dict[str, Any] = Field(default_factory=dict)


def load_experiment(path: str | Path) -> Experiment:
    """Read an experiment file.

    Parameters
    ----------
    path : str or Path
        A TOML file. What it names is looked for in the same folder.

    Raises
    ------
    InputError
        No such file, not TOML, or what ``experiment_from_table`` refuses.
    """
    path = Path(path)
    missing = InputError(
        "no such file",
        code="no-such-file",
        where=str(path),
        repair="ipmclab record --template prints an experiment file to start from",
    )
    table = parse_table(read_text(path, kind="an experiment", missing=missing), where=str(path))
    experiment = experiment_from_table(table, folder=path.parent, where=str(path), name=path.stem)
    check_folder(experiment.folder, where=f"{path}: folder")
    return experiment


def experiment_from_table(
    table: Mapping[str, Any], *, folder: Path = Path(), where: str = "experiment", name: str = "experiment"
) -> Experiment:
    """Check an experiment as TOML gives it.

    Parameters
    ----------
    table : mapping
    folder : Path
        Where what it names is looked for.
    where : str
        The file, for messages.
    name : str
        Its title where it states none.

    Raises
    ------
    InputError
        An unknown key, a wrong unit, no sample, a signal that is none or longer than the duration,
        displacement and force at once, an unknown step or steps in another order, an unknown limit.

    Examples
    --------
    >>> table = {"sample": "strip-1", "signal": "step 1 V", "rate": "50 Hz", "duration": "40 s"}
    >>> experiment = experiment_from_table(table)
    >>> experiment.sample.id, experiment.rate, [str(signal) for signal in experiment.signals]
    ('strip-1', 50.0, ['step 1 V'])
    """
    if {"channels", "bench", "shunt_resistance"} & set(table):
        raise InputError(
            "this looks like a rig file, not like an experiment",
            code="wrong-file",
            where=where,
            repair="name the experiment file, in which rig = names this one; ipmclab record --template prints one",
        )
    if "environments" in table:
        table = {**table, "environments": conditions_from_texts(table["environments"], f"{where}: environments")}
    try:
        read = _Table.model_validate(dict(table))
    except ValidationError as error:
        found = as_input_error(error, table, where=f"{where}: ")
        example = _EXAMPLES.get(found.where.rpartition(" ")[2])
        if example is not None and found.repair.endswith('"12.3 mm"'):
            found.repair = f'write it in quotes, with its unit: "{example}"'
        raise found from error

    def place(key: str) -> str:
        return f"{where}: {key}"

    signals = _signals(read, folder, place)
    duration = _quantity(read.duration, TIME, place("duration"), above_zero=True)
    rate = _quantity(read.rate, FREQUENCY, place("rate"), above_zero=True)
    for key, signal in signals:
        try:
            signal.check_fits(duration, rate)
        except InputError as error:
            raise error.at(place(key)) from error
    if not 1 <= read.repeats <= MOST_REPEATS:
        raise InputError(
            f"repeats is {read.repeats}",
            code="out-of-range",
            where=place("repeats"),
            repair=f"give 1 to {MOST_REPEATS}",
        )
    environments, reference = _environments(read, folder, place, duration, rate)
    pressure = read.clamp_pressure
    return Experiment(
        title=read.title or name,
        sample=_sample(read, folder, place),
        rig=read.rig if read.rig == VIRTUAL else folder / read.rig,
        folder=folder / read.folder,
        signals=tuple(signal for _, signal in signals),
        rate=rate,
        duration=duration,
        measured=_measured(read.measured, place("measured")),
        rest_before=_quantity(read.rest_before, TIME, place("rest_before")),
        rest_after=_quantity(read.rest_after, TIME, place("rest_after")),
        pause=_quantity(read.pause, TIME, place("pause")),
        zero_time=_quantity(read.zero_time, TIME, place("zero_time"), above_zero=True),
        repeats=read.repeats,
        pair=read.pair,
        baseline=read.baseline,
        fingerprint=read.fingerprint,
        actuator=beside(read.actuator, folder),
        operator=read.operator,
        notes=read.notes,
        mounting_id=read.mounting_id,
        clamp_pressure=None if pressure is None else _quantity(pressure, PRESSURE, place("clamp_pressure")),
        steps=_steps(read.steps, place("steps")),
        weigh=read.weigh,
        environments=environments,
        order=read.environment.order if read.environment is not None else "palindromic",
        reference=reference,
        limits=dict(read.limits),
        where=where,
    )


def _quantity(text: str, quantity: Quantity, where: str, *, above_zero: bool = False) -> float:
    value = parse_quantity(text, quantity, where=where)
    if value < 0 or (above_zero and value == 0):
        least = "it must be above 0" if above_zero else "it must be 0 or more"
        raise InputError(
            f"{text!r}, {least}",
            code="out-of-range",
            where=where,
            repair=f"give for example '{_EXAMPLES.get(where.rpartition(' ')[2], f'40 {quantity.display_unit}')}'",
        )
    return value


def _signals(read: _Table, folder: Path, place: Any) -> list[tuple[str, Signal]]:
    """The signals with the key where each is."""
    if (read.signal is None) == (read.signals is None):
        raise InputError(
            "no signal is given" if read.signal is None else "signal and signals are both given",
            code="missing-key" if read.signal is None else "bad-value",
            where=place("signal"),
            repair='add signal = "step 1 V"' if read.signal is None else "keep one of them",
        )
    texts = [("signal", read.signal)] if read.signal is not None else []
    texts += [(f"signals.{k}", text) for k, text in enumerate(read.signals or ())]
    if not texts:
        raise InputError(
            "the list is empty",
            code="bad-value",
            where=place("signals"),
            repair='write ["step 1 V", "sine 1 V 0.1 Hz"]',
        )
    found = []
    for key, text in texts:
        assert text is not None
        try:
            found.append((key, parse(text, folder=folder)))
        except InputError as error:
            raise error.at(place(key), f"{error.where}: {error.message}") from error
    return found


def _environments(
    read: _Table, folder: Path, place: Any, duration: float, rate: float
) -> tuple[tuple[TargetEnvironment, ...], Reference | None]:
    """The conditions, with the signal of the reference where it has its own."""
    signal = None
    if read.reference is not None and read.reference.signal is not None:
        try:
            signal = parse(read.reference.signal, folder=folder)
            signal.check_fits(duration, rate)
        except InputError as error:
            raise error.at(place("reference.signal")) from error
    return read_environments(read.environment, read.environments, read.reference, signal, place)


def _sample(read: _Table, folder: Path, place: Any) -> Sample:
    if isinstance(read.sample, dict):
        return Sample.from_table(read.sample, where=place("sample"))
    from_model = None
    if read.actuator is not None:
        from ipmclab.model import load_actuator

        actuator = load_actuator(beside(read.actuator, folder) or "")
        from_model = actuator.sample or Sample(id=actuator.name)
    if read.sample:
        return from_model if from_model is not None and from_model.id == read.sample else Sample(id=read.sample)
    if from_model is not None:
        return from_model
    raise InputError(
        "no sample is named: a run must say whose it is",
        code="missing-key",
        where=place("sample"),
        repair='add sample = "strip-1", or a table [sample] with its id',
    )


def beside(named: str | None, folder: Path) -> str | None:
    """The name of a library actuator, or the path of a file in the folder of the file that names it."""
    return str(folder / named) if named is not None and (folder / named).is_file() else named


def _measured(names: Sequence[str], where: str) -> tuple[str, ...]:
    known = [name for name in CHANNELS if name != "applied_voltage"]
    for name in names:
        if name not in known:
            raise unknown_name("channel", name, MEASURABLE, where=where)
    if "displacement" in names and "force" in names:
        raise InputError(
            "displacement and force cannot be measured in one run: the load cell holds the tip",
            code="blocked-tip",
            where=where,
            repair="write two experiments, one with each",
        )
    return tuple(name for name in dict.fromkeys(names) if name in MEASURABLE)


def _steps(names: Sequence[str] | None, where: str) -> tuple[str, ...] | None:
    if names is None:
        return None
    for name in names:
        if name not in STEPS:
            raise unknown_name("step", name, STEPS, where=where)
    if "apply" not in names:
        raise InputError("no step applies the signal", code="missing-key", where=where, repair='add "apply"')
    order = (*STEPS, "hydrate")
    at = 0
    for name in names:
        if name not in order[at:]:
            raise InputError(
                f"{name!r} comes too late or twice",
                code="bad-order",
                where=where,
                repair=f"use the order {', '.join(order)}",
            )
        at = order.index(name, at) + 1
    return tuple(names)
