"""Experiments of the page: what is wrong with each field of a draft, the voltage that it will apply, and its file."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ipmclab.destination import write_text
from ipmclab.errors import InputError, suggest
from ipmclab.page.curves import Panel, Series
from ipmclab.page.experiment_form import BY_KEY, FIELDS, Draft, is_idle_table, readable_limit
from ipmclab.page.lab import RUNS, Lab, files_of, plain_name
from ipmclab.rig.experiments.experiment import VIRTUAL, Experiment
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.rig.safety.limits import Limits
from ipmclab.toml_file import glance
from ipmclab.units import VOLTAGE

if TYPE_CHECKING:
    from ipmclab.rig.experiments.plan import Plan

WHERE: Final = "experiment"


HARMLESS: Final = "step 0 V"
"""What is planned in the place of signals that are none."""

_AIR: Final = {"temperature": "25 degC"}  # replaces one that is not stated, so that its waits are checked too

_MOST_RUNS: Final = 8
_PREVIEW_ROWS: Final = 200_000
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
"""What is wrong, where it is said in other words, and what to do about it, where a form is in place of the file: of
the field and the code."""

_DAMAGED: Final = "a letter in it is damaged, so that no file can hold it"
_AGAIN: Final = "type it again"


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
    is_idle = is_idle_table(table)
    if is_idle:
        table["environment"] |= _AIR
    damaged = ((key, f"{_DAMAGED}; {_AGAIN}") for key in _damaged(draft))
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
    for known in BY_KEY:
        if key == known or (known != "signals" and key.startswith(f"{known}.")):
            return known, text
    if key in ("limits", "environment", "sample.id"):
        return {"limits": "limits.voltage", "environment": "environment.temperature"}.get(key, "sample"), text
    return "", f"{error.where}: {text}" if error.where and error.where != WHERE else text


def _repair(table: dict[str, Any], key: str, error: InputError | None = None) -> bool:
    """Put something harmless in the place of a mistake, so that the others show too."""
    one = BY_KEY.get(key)
    if one is None:
        return False
    first, _, second = key.partition(".")
    if second:
        inside = table.get(first)
        if isinstance(inside, dict) and second in inside:
            del inside[second]
            if not inside:
                table.pop(first)
            elif is_idle_table(table):
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
        return readable_limit(load_rig(rig if rig == VIRTUAL else lab.path(rig)))
    except InputError:
        return ""


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
        raise InputError(f"{BY_KEY[key].label}: {_DAMAGED}", code="damaged-text", where=key, repair=_AGAIN)
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
