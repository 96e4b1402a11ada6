"""An experiment as a form: its fields, and the draft that they hold."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

from ipmclab.errors import InputError
from ipmclab.page.lab import Lab
from ipmclab.rig.experiments.experiment import VIRTUAL
from ipmclab.rig.safety.limits import Limits
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import CURRENT

if TYPE_CHECKING:
    from ipmclab.rig.channels import Rig


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
        Under which heading it is.
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


BY_KEY: Final = {one.key: one for one in FIELDS}
_WAITS: Final = {"settle", "longest_wait"}  # of an environment
_OF_RANGE: Final = 0.95  # of what a channel reads: beyond it a reading is cut, and no more than a limit
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
        What the file has in addition: it is kept as it is.
    """

    name: str
    values: Values
    rest: Mapping[str, Any]

    @property
    def digest(self) -> str:
        """Distinguishes what a file says from what it said before."""
        said = repr((self.values, self.rest)).encode(errors="surrogatepass")
        return hashlib.sha256(said).hexdigest()[:16]

    @classmethod
    def new(cls) -> Draft:
        """What a new experiment starts from, on the virtual bench."""
        from ipmclab.rig.files.rig_file import load_rig

        limit = readable_limit(load_rig(VIRTUAL))
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
        if is_idle_table(table):
            del table["environment"]
        return table

    def filled(self) -> dict[str, Any]:
        """Every field that is filled in, also those that the file leaves out as nothing needs them."""
        table = _copied(self.rest)
        for key, value in self.values.items():
            given = _as_toml(BY_KEY[key], value)
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
        Why the file cannot be continued, or that it says something else by now.
    """

    origin: str
    base: Draft
    draft: Draft
    problem: str = ""

    @classmethod
    def of(cls, lab: Lab, kept: object) -> Unsaved:
        """What a browser says that it has kept: ``{"from": file, "digest": of it, "values": {field: value}}``."""
        given = kept if isinstance(kept, dict) else {}
        origin, kept_values, problem = given.get("from"), given.get("values"), ""
        origin = origin if isinstance(origin, str) else ""
        values: Mapping[str, Any] = kept_values if isinstance(kept_values, dict) else {}
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


def is_idle_table(table: Mapping[str, Any]) -> bool:
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


def readable_limit(rig: Rig) -> str:
    """A limit of the current whose passing the rig can read; nothing where it can read that of the one that holds
    unless stated.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> readable_limit(THESIS_RIG)
    '190 mA'
    """
    standard = Limits().current
    if standard is None or "current" not in {channel.name for channel in rig.channels}:
        return ""
    most = _OF_RANGE * max(-rig["current"].range[0], rig["current"].range[1])
    return "" if standard.most <= most else f"{CURRENT.to_display(most):.4g} {CURRENT.display_unit}"
