"""An experiment as a form: its fields, what is wrong with each, the voltage it will apply, and its file."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from ipmclab.destination import write_text
from ipmclab.errors import InputError, suggest
from ipmclab.page.curves import Panel, Series
from ipmclab.page.lab import RUNS, Lab, files_of, plain_name
from ipmclab.rig.experiments.experiment import VIRTUAL, Experiment, experiment_from_table
from ipmclab.rig.safety.limits import Limits
from ipmclab.toml_file import glance, parse_table, read_text
from ipmclab.units import CURRENT, VOLTAGE

if TYPE_CHECKING:
    from ipmclab.rig.channels import Rig
    from ipmclab.rig.experiments.plan import Plan

WHERE: Final = "experiment"

Kind = Literal["text", "lines", "switch", "choice", "rig", "number"]


@dataclass(frozen=True)
class FormField:
    """One field of the form.

    Parameters
    ----------
    key : str
        Of the experiment file; a table's with a dot.
    label, hint : str
    default : str or bool
        Of a new experiment. A text that is empty is left out of the file.
    kind : str
    group : str
        Under which heading it stands.
    choices : mapping, optional
        Of a choice: value and what it is called.
    """

    key: str
    label: str
    hint: str = ""
    default: str | bool = ""
    kind: Kind = "text"
    group: str = "main"
    choices: Mapping[str, str] = field(default_factory=dict)


_MEASURED: Final = {
    "current, force": "current and force",
    "current, displacement": "current and displacement",
    "current": "current",
    "force": "force",
    "displacement": "displacement",
}

FIELDS: Final = (
    FormField("title", "Title", "is written in every run", "new experiment"),
    FormField("sample", "Sample", "the strip's id", ""),
    FormField("operator", "Operator", "your name", ""),
    FormField("signals", "Signals, one a line", "step 1 V, sine 1 V 0.1 Hz, chirp...", "step 1 V", "lines"),
    FormField("duration", "Duration of each", "such as 40 s", "40 s"),
    FormField("rate", "Rate", "such as 50 Hz", "50 Hz"),
    FormField("measured", "Measured", "", "current, force", "choice", choices=_MEASURED),
    FormField("rig", "Rig (bench)", "", VIRTUAL, "rig"),
    FormField("pair", "Both polarities of each signal", "", False, "switch", "options"),
    FormField("baseline", "First a run without voltage", "", False, "switch", "options"),
    FormField("fingerprint", "Fingerprint at 0.1 V before each", "", True, "switch", "options"),
    FormField("repeats", "Repeats of each", "1 or more", "1", "number", "options"),
    FormField("rest_before", "Rest at 0 V before", "5 s unless stated", "", "text", "options"),
    FormField("rest_after", "Rest at 0 V after", "5 s unless stated", "", "text", "options"),
    FormField("pause", "Pause between", "2 min unless stated", "", "text", "options"),
    FormField("zero_time", "Zeros are read for", "10 s unless stated", "", "text", "options"),
    FormField("environment.temperature", "Temperature", "the room's, or 25 degC", "", "text", "environment"),
    FormField("environment.relative_humidity", "Relative humidity", "the room's, or 80 %", "", "text",
              "environment"),
    FormField("environments", "Several conditions, one a line", "25 degC, 40 percent", "", "lines", "environment"),
    FormField("environment.settle", "Settled for", "30 min unless stated", "", "text", "environment"),
    FormField("environment.longest_wait", "Longest wait", "3 h unless stated", "", "text", "environment"),
    FormField("limits.voltage", "Voltage", "3.5 V unless stated", "", "text", "limits"),
    FormField("limits.current", "Current", "500 mA unless stated", "", "text", "limits"),
    FormField("limits.charge", "Charge", "10 C unless stated", "", "text", "limits"),
    FormField("limits.power", "Power", "0.3 W unless stated", "", "text", "limits"),
    FormField("actuator", "Model of the strip", "friend-2, or a file; foretells the current", "", "text", "more"),
    FormField("clamp_pressure", "Clamp pressure", "such as 100 kPa", "", "text", "more"),
    FormField("mounting_id", "Mounting", "new at each clamping", "", "text", "more"),
    FormField("notes", "Notes", "", "", "text", "more"),
)  # fmt: skip
"""The fields, in their order."""

GROUPS: Final = {
    "options": "How it is recorded",
    "environment": "Environment",
    "limits": "Limits of the guard",
    "more": "More",
}
"""The headings of what is folded away."""

_BY_KEY: Final = {one.key: one for one in FIELDS}
HARMLESS: Final = "step 0 V"
"""What is planned in the place of signals that are none."""

_WAITS: Final = {"settle", "longest_wait"}  # of an environment
_AIR: Final = {"temperature": "25 degC"}  # stands in for one that is not stated, so that its waits are checked too

_MOST_RUNS: Final = 8
_PREVIEW_ROWS: Final = 200_000
_OF_RANGE: Final = 0.95  # of what a channel reads: beyond it a reading is cut, and no more than a limit
_NO_SIGNAL: Final = ("no signal is named", "write one, such as step 1 V")
_IN_A_FORM: Final = {
    ("sample", "missing-key"): ("", "fill in the sample's id, such as strip-1"),
    ("signal", "missing-key"): _NO_SIGNAL,
    ("signals", "bad-value"): _NO_SIGNAL,
    ("duration", "missing-key"): ("it is empty", "write for example 40 s"),
    ("rate", "missing-key"): ("it is empty", "write for example 50 Hz"),
    ("repeats", "bad-value"): ("", "write 1 or more, such as 2"),
    ("environment", "missing-key"): ("", "fill in one of them, such as 25 degC"),
}
"""What is wrong, where it is said in other words, and what to do about it, where a form stands in place of the file: of
the field and the code."""

_DAMAGED: Final = "a letter in it is damaged, so that no file can hold it"
_ANEW: Final = "type it again"

Values = dict[str, str | bool]


@dataclass(frozen=True)
class Draft:
    """An experiment that is being written.

    Parameters
    ----------
    name : str
        Of its file, without the suffix; empty for one that has none yet.
    values : mapping
        Of each field.
    rest : mapping
        What the file has besides: it is kept as it is.
    """

    name: str
    values: Values
    rest: Mapping[str, Any]

    @property
    def digest(self) -> str:
        """Tells what a file says from what it said before."""
        said = repr((self.values, self.rest)).encode(errors="surrogatepass")
        return hashlib.sha256(said).hexdigest()[:16]

    @classmethod
    def new(cls) -> Draft:
        """What a new experiment starts from, on the virtual bench."""
        from ipmclab.rig.files.rig_file import load_rig

        limit = seen_limit(load_rig(VIRTUAL))
        return cls("", {one.key: one.default for one in FIELDS} | {"limits.current": limit}, {})

    @classmethod
    def read(cls, lab: Lab, name: str) -> Draft:
        """The experiment of a file in the lab.

        Raises
        ------
        InputError
            No such file, or no TOML.
        """
        path = lab.new_file(name, ".toml")
        missing = InputError("no such file", code="no-such-file", where=path.name, repair="see what the lab holds")
        table = parse_table(read_text(path, kind="an experiment", missing=missing), where=path.name)
        values: Values = {one.key: one.default if one.kind == "switch" else "" for one in FIELDS}
        values["measured"], values["rig"], values["repeats"] = "current, force", VIRTUAL, "1"
        rest = _copied(table)
        if "signal" in rest and "signals" not in rest:
            rest["signals"] = [rest.pop("signal")]
        for one in FIELDS:
            found = _taken(rest, one)
            if found is not None:
                values[one.key] = found
            elif one.key in rest and one.kind != "switch":
                values[one.key] = ""  # it stays as the file has it, right or wrong
        return cls(path.stem, values, rest)

    def table(self) -> dict[str, Any]:
        """The experiment as its file has it."""
        table = self.filled()
        if _is_idle(table):
            del table["environment"]
        return table

    def filled(self) -> dict[str, Any]:
        """Every field that is filled in, also those that the file leaves out as nothing asks for them."""
        table = _copied(self.rest)
        for key, value in self.values.items():
            given = _as_toml(_BY_KEY[key], value)
            if given is None or (given == [] and key in table):
                continue
            first, _, second = key.partition(".")
            if second:
                inner = table.setdefault(first, {})
                if isinstance(inner, dict):
                    inner[second] = given
            else:
                table[first] = given
        return table


@dataclass(frozen=True)
class Unsaved:
    """What a browser has kept of an experiment that was not saved.

    Parameters
    ----------
    origin : str
        The file that it was begun from, without the suffix; empty for a new experiment.
    base, draft : Draft
        What it was begun from as it is now, and what was made of it.
    problem : str
        Why the file cannot be gone on from, or that it says something else by now.
    """

    origin: str
    base: Draft
    draft: Draft
    problem: str = ""

    @classmethod
    def of(cls, lab: Lab, kept: object) -> Unsaved:
        """What a browser says that it has kept: ``{"from": file, "digest": of it, "values": {field: value}}``."""
        given = kept if isinstance(kept, dict) else {}
        origin, told, problem = given.get("from"), given.get("values"), ""
        origin = origin if isinstance(origin, str) else ""
        values: Mapping[str, Any] = told if isinstance(told, dict) else {}
        try:
            base = Draft.read(lab, origin) if origin else Draft.new()
        except InputError as error:
            origin, base, problem = "", Draft.new(), f"what it was begun from cannot be read: {error}"
        if origin and given.get("digest", base.digest) != base.digest:
            problem = f"{origin}.toml was changed since"
        changed = {one.key: values[one.key] for one in FIELDS if _may_be(one, values.get(one.key))}
        name = values.get("name")
        draft = replace(base, values={**base.values, **changed}, name=name if isinstance(name, str) else base.name)
        return cls(origin, base, draft, problem)


def _may_be(one: FormField, value: object) -> bool:
    """Whether a field can show a value."""
    if one.kind == "switch":
        return isinstance(value, bool)
    return isinstance(value, str) and (one.kind != "choice" or value in one.choices)


def _is_idle(table: Mapping[str, Any]) -> bool:
    """Whether it says how long to wait for an environment, but not for which."""
    inside = table.get("environment")
    return isinstance(inside, dict) and set(inside) <= _WAITS and "environments" not in table


def _copied(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _copied(value) if isinstance(value, dict) else value for key, value in table.items()}


def _taken(rest: dict[str, Any], one: FormField) -> str | bool | None:
    """The value of a field, taken out of a table where the form can hold it."""
    first, _, second = one.key.partition(".")
    inside = rest.get(first) if second else rest
    if not isinstance(inside, dict):
        return None
    key = second or first
    value = inside.get(key)
    if one.kind == "switch":
        found: str | bool | None = value if isinstance(value, bool) else None
    elif one.kind in ("lines", "choice"):
        are_texts = isinstance(value, list) and all(isinstance(text, str) for text in value)
        found = ("\n" if one.kind == "lines" else ", ").join(value) if are_texts and value is not None else None
        if one.kind == "choice" and found not in one.choices:
            found = None
    elif one.kind == "number":
        found = str(value) if isinstance(value, int) and not isinstance(value, bool) else None
    else:
        found = value if isinstance(value, str) else None
    if found is not None:
        del inside[key]
        if second and not inside:
            del rest[first]
    return found


def _as_toml(one: FormField, value: str | bool) -> Any:
    """The value of a field as the file has it; None where it is left out."""
    if isinstance(value, bool):
        return None if value == one.default else value
    text = value.strip()
    if one.kind == "lines":
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        return lines if lines or one.key == "signals" else None
    if one.kind == "choice":
        return [word.strip() for word in text.split(",")] if text else None
    if one.kind == "number":
        return int(text) if len(text) < 10 and text.lstrip("+-").isdecimal() else text or None
    return text or None


@dataclass(frozen=True)
class Checked:
    """What is wrong with a draft, and what it would do.

    Parameters
    ----------
    errors : mapping
        Message of each field; under the empty key what belongs to none.
    experiment : Experiment, optional
        Where it can be read at all.
    plan : Plan, optional
        Where it could be carried out.
    """

    errors: Mapping[str, str]
    experiment: Experiment | None
    plan: Plan | None


def check(lab: Lab, draft: Draft) -> Checked:
    """Look at a draft: every field's own mistake at once, then the whole against its rig and limits."""
    errors: dict[str, str] = {}
    table = {"folder": _folder(lab), **draft.filled()}  # as it is saved
    is_idle = _is_idle(table)
    if is_idle:
        table["environment"] |= _AIR
    damaged = ((key, f"{_DAMAGED}; {_ANEW}") for key in _damaged(draft))
    for key, value in [*damaged, *_too_long(table), *_outside(lab, table)]:
        errors[key] = value
        _repair(table, key)
    # The model of a strip takes a compiler to read; the recorder does that. Here it is enough that there is one.
    named = table.pop("actuator", None)
    if isinstance(named, str) and (unknown := _unknown(lab, named)):
        errors["actuator"] = unknown
    if "sample" not in table and named:
        table["sample"] = str(named)
    experiment = None
    for _ in range(2 * len(FIELDS)):
        try:
            experiment = experiment_from_table(table, folder=lab.root, where=WHERE, name=draft.name or "new")
            Limits.from_table(experiment.limits, where=f"{WHERE}: limits")
            if is_idle:
                experiment = replace(experiment, environments=())
            break
        except InputError as error:
            key, text = placed(error)
            if key in errors or not _repair(table, key, error):
                errors.setdefault(key, text)
                break
            errors[key] = text
    plan = None
    if experiment is not None and not errors:
        try:
            plan = _planned(lab, experiment)
        except InputError as error:
            key, text = placed(error)
            errors[key] = text
    return Checked(errors, experiment, plan)


def placed(error: InputError) -> tuple[str, str]:
    """The field that a message belongs to, empty where it is none's, and the message without its place."""
    key = error.where.removeprefix(f"{WHERE}: ")
    message, repair = _IN_A_FORM.get((key, error.code), ("", error.repair))
    message = message or error.message
    if error.code == "missing-unit":
        repair = repair.replace("'-", "'")  # a negative one would be refused next
    text = f"{message}; {repair}" if repair else message
    key = re.sub(r"^signal(s\.\d+)?$", "signals", key)
    for known in _BY_KEY:
        if key == known or (known != "signals" and key.startswith(f"{known}.")):
            return known, text
    if key in ("limits", "environment", "sample.id"):
        return {"limits": "limits.voltage", "environment": "environment.temperature"}.get(key, "sample"), text
    return "", f"{error.where}: {text}" if error.where and error.where != WHERE else text


def _repair(table: dict[str, Any], key: str, error: InputError | None = None) -> bool:
    """Put something harmless in the place of a mistake, so that the others show too."""
    one = _BY_KEY.get(key)
    if one is None:
        return False
    first, _, second = key.partition(".")
    if second:
        inside = table.get(first)
        if isinstance(inside, dict) and second in inside:
            del inside[second]
            if not inside:
                table.pop(first)
            elif _is_idle(table):
                inside |= _AIR
            return True
        return False
    if key == "signals":
        place = re.search(r"signals\.(\d+)", error.where if error is not None else "")
        lines = table.get("signals")
        if place is not None and isinstance(lines, list) and len(lines) > 1:
            del lines[int(place[1])]
        else:
            table["signals"] = [HARMLESS]
        return True
    harmless = {"sample": "unnamed", "duration": "40 s", "rate": "50 Hz", "rig": VIRTUAL, "repeats": 1}
    if key in harmless:
        table[key] = harmless[key]
    else:
        table.pop(key, None)
    return True


def _damaged(draft: Draft) -> list[str]:
    """The fields with half a letter (a lone surrogate of UTF-16), which no file can hold."""
    texts = {key: value for key, value in draft.values.items() if isinstance(value, str)}
    return [key for key, text in texts.items() if any("\ud800" <= letter <= "\udfff" for letter in text)]


def _too_long(table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The names that no list has room for."""
    for key in ("sample", "mounting_id"):
        given = table.get(key)
        try:
            plain_name(given if isinstance(given, str) else "", key)
        except InputError as error:
            yield key, f"{error.message}; {error.repair}"


def _outside(lab: Lab, table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The fields that name a file outside the lab."""
    named: list[tuple[str, str]] = []
    if isinstance(table.get("rig"), str) and table["rig"] != VIRTUAL:
        named.append(("rig", table["rig"]))
    actuator = table.get("actuator")
    if isinstance(actuator, str):
        named.append(("actuator", actuator.partition("+")[0]))
    signals = table.get("signals", [])
    texts = [text for text in signals if isinstance(text, str)] if isinstance(signals, list) else []
    named += [("signals", found) for text in texts for found in files_of(text)]
    for key, name in named:
        try:
            lab.path(name)
        except InputError as error:
            yield key, f"{error.message}; {error.repair}"
    folder, wanted = table["folder"], _folder(lab)
    if isinstance(folder, str) and os.path.realpath(lab.root / folder) != str(lab.laboratory_folder):
        yield "", f"it records into {folder!r}, this page shows the runs in {wanted!r}; change folder in the file"


def _folder(lab: Lab) -> str:
    """Where runs are recorded, as the file of an experiment says it."""
    return os.path.relpath(lab.laboratory_folder, lab.root)


def _unknown(lab: Lab, named: str) -> str:
    """Why a name is none of an actuator, alone or with stages behind a plus; nothing where there is one."""
    from ipmclab.model.actuator_file import is_library_name, library_names

    base = named.partition("+")[0].strip()
    try:
        if is_library_name(base) or any((lab.root / one).is_file() for one in (base, named)):
            return ""
    except (OSError, ValueError):
        pass  # no file can be called that
    own = [lab.below(path) for path in lab.tables() if {"geometry", "circuit"} <= {*(glance(path) or {})}]
    repair = suggest(base, [*own, *library_names()])
    return f"there is no actuator {base!r}, neither in the library nor in this folder; {repair}"


def _planned(lab: Lab, experiment: Experiment) -> Plan:
    from ipmclab.rig.checks.proof import proof_of
    from ipmclab.rig.experiments.plan import make_plan
    from ipmclab.rig.files.rig_file import load_rig

    if isinstance(experiment.rig, Path) and not experiment.rig.is_file():
        raise InputError(
            "there is no such rig file in the folder",
            code="no-rig",
            where=f"{WHERE}: rig",
            repair="choose another",
        )
    try:
        rig = load_rig(experiment.rig)
    except InputError as error:
        raise InputError(str(error), code=error.code, where=f"{WHERE}: rig", repair="") from error
    proof = proof_of(rig, experiment.rig) if rig.bench == "ni" else ""
    return make_plan(experiment, rig, bytes_free=shutil.disk_usage(lab.root).free, rig_proof=proof)


def preview(experiment: Experiment) -> list[Panel]:
    """The voltage that will be applied in each run, rests included, over the time of the run."""
    from ipmclab.rig.experiments.steps import planned_runs
    from ipmclab.signals.signal import shortened

    runs = [run for run in planned_runs(experiment) if run.repeat == 1]
    series = []
    styles = ("line", "dashed", "dotted")
    for place, run in enumerate(runs[:_MOST_RUNS]):
        rate = min(run.rate, _PREVIEW_ROWS / max(run.seconds, 1e-9))
        time = np.arange(max(2, round(run.seconds * rate))) / rate
        local = time - run.rest_before
        driven = (local >= 0) & (local < run.duration)
        values = np.zeros(len(time))
        values[driven] = run.signal.voltage(local[driven])
        label = "without voltage" if run.purpose == "baseline" else shortened(str(run.signal), 40)
        turns = np.diff(values) != 0  # between two of them the line is level: no row more is needed
        kept = np.concatenate([[True], turns[1:] | turns[:-1], [True]])
        series.append(Series(f"v{place}", label, time[kept], values[kept], place % 6, styles[place % 3]))
    return [Panel("voltage", "voltage", "V", series, VOLTAGE.to_display(1.0))]


def limit_at(lab: Lab, rig: str) -> str:
    """The limit of the current that a form proposes for a rig of the lab; nothing where it cannot be read."""
    from ipmclab.rig.files.rig_file import load_rig

    try:
        return seen_limit(load_rig(rig if rig == VIRTUAL else lab.path(rig)))
    except InputError:
        return ""


def seen_limit(rig: Rig) -> str:
    """A limit of the current that the rig sees to be passed; nothing where it sees the one that holds unless stated.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> seen_limit(THESIS_RIG)
    '190 mA'
    """
    standard = Limits().current
    if standard is None or "current" not in {channel.name for channel in rig.channels}:
        return ""
    most = _OF_RANGE * max(-rig["current"].range[0], rig["current"].range[1])
    return "" if standard.most <= most else f"{CURRENT.to_display(most):.4g} {CURRENT.display_unit}"


def experiments(lab: Lab) -> list[str]:
    """The names of the experiment files of the lab."""
    found = []
    for path in lab.tables():
        table = glance(path) or {}
        if ("signal" in table or "signals" in table) and "rate" in table and "channels" not in table:
            found.append(path.stem)
    return found


def rigs(lab: Lab) -> list[str]:
    """What a rig may be: the virtual one, and the rig files of the lab."""
    found = [VIRTUAL]
    for path in lab.tables():
        table = glance(path) or {}
        if "channels" in table or "bench" in table:
            found.append(path.name)
    return found


def save(lab: Lab, draft: Draft, *, replace: bool = False) -> Path:
    """Write a draft to its file; what the file says already is not written again.

    Raises
    ------
    InputError
        A name that is none, a file of that name which says something else, or a field that is no text.
    """
    import tomli_w

    path = lab.new_file(draft.name, ".toml")
    for key in _damaged(draft):
        raise InputError(f"{_BY_KEY[key].label}: {_DAMAGED}", code="damaged-text", where=key, repair=_ANEW)
    table = {"folder": _folder(lab), **draft.table()}
    if path.exists():
        try:
            there = {"folder": RUNS, **Draft.read(lab, draft.name).table()}  # what one means that does not say it
        except InputError:
            there = {}
        if there == table:
            return path
        if not replace:
            raise InputError(
                f"{path.name} is there already and says something else",
                code="file-exists",
                where="name",
                repair="give another name, or replace it",
            )
    write_text(tomli_w.dumps(table), path, overwrite=replace)
    return path
