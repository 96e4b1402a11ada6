"""Actuator files: TOML, quantities as texts with their unit, nothing unknown, nothing silently wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib import resources
from os.path import exists, isfile  # False, where those of Path raise for a name that is too long
from pathlib import Path
from typing import Any, Final

from ipmclab.destination import write_text
from ipmclab.errors import InputError, missing_key, suggest, unknown_name
from ipmclab.kinds import tell_kinds
from ipmclab.model import geometry
from ipmclab.model.actuator import Actuator
from ipmclab.model.environment import sorption
from ipmclab.model.kinds import kinds
from ipmclab.model.parameters import Declaration
from ipmclab.model.structure import Structure
from ipmclab.model.variants import with_stages
from ipmclab.sample import Sample
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import Quantity, parse_quantity, readable_quantity

_LIBRARY: Final = resources.files("ipmclab.model") / "library"
_OTHER_KEYS: Final = ("name", "sample", "fit")
_UNCERTAIN_KEYS: Final = ("value", "standard_uncertainty")
_RUN_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"


def library_names() -> list[str]:
    """Names of the actuators that come with ipmclab.

    Examples
    --------
    >>> library_names()[:2]
    ['friend-1-measured', 'friend-2']
    """
    return sorted(entry.name.removesuffix(".toml") for entry in _LIBRARY.iterdir() if entry.name.endswith(".toml"))


@tell_kinds
def load_actuator(name_or_path: str | Path) -> Actuator:
    """Read an actuator from the library or from a TOML file.

    Parameters
    ----------
    name_or_path : str or Path
        A library name (``"friend-2"``) or the path of a file; further stages may follow, each after a plus
        (``"friend-2+leak.cubic"``, see ``with_stages``).

    Returns
    -------
    actuator : Actuator

    Raises
    ------
    InputError
        No such actuator, no TOML, an unknown or missing key, a wrong unit, a value out of range.

    Examples
    --------
    >>> load_actuator("friend-2")["circuit.branches.1.permittivity"]
    0.48106
    """
    if isinstance(name_or_path, str) and name_or_path in library_names():
        text = (_LIBRARY / f"{name_or_path}.toml").read_text(encoding="utf-8")
        return replace(actuator_from_text(text, where=name_or_path), loaded_as=name_or_path)
    path = Path(name_or_path)
    if isinstance(name_or_path, str) and "+" in name_or_path and not exists(path):
        base, stages = stages_after(name_or_path)
        return with_stages(load_actuator(base), *stages)
    _refuse_a_run(path)
    states = [name for name in library_names() if name.startswith(f"{name_or_path}-")]
    missing = InputError(
        f"there is no actuator {str(name_or_path)!r}, neither in the library nor as a file",
        code="no-actuator",
        where="actuator",
        repair=f"choose one of {', '.join(states)}" if states else suggest(str(name_or_path), library_names()),
    )
    text = read_text(path, kind="an actuator", missing=missing)
    return replace(actuator_from_text(text, where=str(path)), loaded_as=str(name_or_path))


def is_library_name(name: str) -> bool:
    """Whether a text names an actuator of the library, alone or with further stages.

    Examples
    --------
    >>> is_library_name("friend-2+leak.cubic"), is_library_name("mine.toml+leak.cubic")
    (True, False)
    """
    return name.partition("+")[0].strip() in library_names()


def stages_after(name: str) -> tuple[str, list[str]]:
    """An actuator and the stages after it; a folder above its file may have a plus in its name too.

    Examples
    --------
    >>> stages_after("friend-2 + leak.cubic+clamp")
    ('friend-2', ['leak.cubic', 'clamp'])
    """
    if isfile(name):
        return name, []
    parts = name.split("+")
    for count in range(1, len(parts)):
        base = "+".join(parts[:count]).strip()
        if base in library_names() or isfile(base):
            return base, [stage.strip() for stage in parts[count:]]
    return parts[0].strip(), [stage.strip() for stage in parts[1:]]


def _refuse_a_run(path: Path) -> None:
    """Refuse a run, which is here when arguments are in the wrong order."""
    try:
        with path.open("rb") as stream:
            is_run = stream.read(len(_RUN_SIGNATURE)) == _RUN_SIGNATURE
    except (OSError, ValueError):
        return  # reading the text says what is wrong
    if is_run:
        raise InputError(
            "this is a run, not an actuator",
            code="not-an-actuator",
            where=str(path),
            repair="the actuator comes first, then the runs",
        )


def actuator_from_text(text: str, *, where: str = "actuator") -> Actuator:
    """Read an actuator from the text of its TOML file.

    Parameters
    ----------
    text : str
    where : str
        What the messages name: the file.

    Raises
    ------
    InputError
    """
    document = parse_table(text, where=where, repair="compare with the library's friend-2")
    tables = tuple(dict.fromkeys(kind.prefix.partition(".")[0] for kind in kinds()))
    for key in document:
        if key not in (*tables, *_OTHER_KEYS):
            known = (*tables, *_OTHER_KEYS)
            raise unknown_name("key", key, known, where=f"{where}: {key}")
    name, sample, fit = document.get("name"), document.get("sample"), document.get("fit")
    if not isinstance(name, str) or not name:
        raise InputError(
            "an actuator needs a name", code="missing-key", where=f"{where}: name", repair='add name = "..." at the top'
        )
    for key, table in (("sample", sample), ("fit", fit)):
        if table is not None and not isinstance(table, dict):
            raise InputError(
                f"{table!r} is not a table", code="bad-value", where=f"{where}: {key}", repair=f"write it below [{key}]"
            )
    if "hydration" in document:
        document["hydration"] = sorption.named(document["hydration"], where=where)
    values, uncertainties = _read_parameters({key: document[key] for key in tables if key in document}, where)
    return Actuator(
        name=name,
        parameter_values=values,
        standard_uncertainties=uncertainties,
        sample=None if sample is None else Sample.from_table(sample, where=f"{where}: sample"),
        fit_table=fit,
    )


def _read_parameters(tables: Mapping[str, Any], where: str) -> tuple[dict[str, float], dict[str, float]]:
    given = dict(_flatten(tables, ""))
    try:
        known = Structure.of(given).declarations
    except InputError as error:
        raise error.at(f"{where}: {error.where}") from error
    for name in given:
        if name not in known:
            parent = name.rpartition(".")[0]
            siblings = [other for other in known if other.rpartition(".")[0] == parent] or list(known)
            raise unknown_name("key", name, siblings, where=f"{where}: {name}")
    values: dict[str, float] = {}
    uncertainties: dict[str, float] = {}
    for name, declaration in known.items():
        place = f"{where}: {name}"
        if name not in given:
            if declaration.default is None:
                unit = declaration.quantity.display_unit
                raise missing_key(place, f'add {name.rpartition(".")[2]} = "... {unit}" ({declaration.symbol})')
            continue
        raw = given[name]
        if isinstance(raw, dict):
            raw, uncertainties[name] = _read_uncertain(raw, declaration, place)
        values[name] = _read_number(raw, declaration, place)
        declaration.check(values[name], where=place)
    geometry.check(values, where=f"{where}: ")
    sorption.check(values, where=f"{where}: ")
    return values, uncertainties


def _flatten(value: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Dotted names and what is there; a table that holds a value is one entry, not a table of entries."""
    if isinstance(value, list) and all(isinstance(entry, dict) for entry in value):
        entries: Any = enumerate(value)
    elif isinstance(value, dict) and (not prefix or not set(value) & set(_UNCERTAIN_KEYS)):
        entries = value.items()
    else:
        yield prefix, value
        return
    for key, entry in entries:
        yield from _flatten(entry, f"{prefix}.{key}" if prefix else str(key))


def _read_uncertain(table: dict[str, Any], declaration: Declaration, place: str) -> tuple[Any, float]:
    for key in table:
        if key not in _UNCERTAIN_KEYS:
            raise unknown_name("key", key, _UNCERTAIN_KEYS, where=f"{place}.{key}")
    if "value" not in table:
        raise missing_key(f"{place}.value", "add value = ...")
    if "standard_uncertainty" not in table:
        return table["value"], 0.0
    uncertainty_place = f"{place}.standard_uncertainty"
    uncertainty = _read_number(table["standard_uncertainty"], declaration, uncertainty_place)
    if not uncertainty >= 0:
        raise InputError(
            f"{table['standard_uncertainty']!r} is not 0 or more",
            code="out-of-range",
            where=uncertainty_place,
            repair="give one standard deviation",
        )
    return table["value"], uncertainty


def _read_number(raw: Any, declaration: Declaration, place: str) -> float:
    quantity = declaration.quantity
    if isinstance(raw, str):
        return parse_quantity(raw, quantity, where=place)
    if not quantity.unit and isinstance(raw, (int, float)) and not isinstance(raw, bool):
        try:
            return float(raw)
        except OverflowError:
            return math.inf  # which no declaration allows
    example = f'"... {quantity.display_unit}"' if quantity.unit else "a number"
    what = "has no unit" if isinstance(raw, (int, float)) and not isinstance(raw, bool) else f"is not a {quantity.name}"
    raise InputError(f"{raw!r} {what}", code="bad-value", where=place, repair=f"write {example}")


@tell_kinds
def write_actuator(actuator: Actuator, path: str | Path, *, overwrite: bool = False) -> None:
    """Write an actuator to a TOML file, from which ``load_actuator`` reads the same floats.

    Parameters
    ----------
    actuator : Actuator
    path : str or Path
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        No such folder, or an existing file.
    IpmclabError
        The system refuses to write there.
    """
    write_text(actuator_to_text(actuator), path, overwrite=overwrite)


def actuator_to_text(actuator: Actuator) -> str:
    """The text of an actuator's TOML file.

    Raises
    ------
    InputError
        An actuator with laws of the environment, which a file does not hold.

    Examples
    --------
    >>> print(actuator_to_text(load_actuator("friend-2")).splitlines()[2])
    free_length = "25 mm"
    """
    import tomli_w

    if actuator.environment_laws:
        raise InputError(
            "a file does not hold the laws by which parameters follow the environment",
            code="laws-in-file",
            where="environment_laws",
            repair="write the actuator of one environment: actuator.at(environment)",
        )
    lines = [tomli_w.dumps({"name": actuator.name}).rstrip()]
    table = ""
    for name, parameter in actuator.parameters().items():
        parent, _, key = name.rpartition(".")
        if parent != table:
            table = parent
            array, _, last = parent.rpartition(".")
            lines.append(f"[[{array}]]" if last.isdecimal() else f"[{parent}]")
        whole = parameter.transform == "count"
        value = f"{parameter.value:.0f}" if whole else _number_text(parameter.value, parameter.quantity)
        if parameter.standard_uncertainty > 0:
            uncertainty = _number_text(parameter.standard_uncertainty, parameter.quantity)
            value = f"{{ value = {value}, standard_uncertainty = {uncertainty} }}"
        lines.append(f"{key} = {value}")
    text = "\n".join(lines) + "\n"
    if actuator.sample is not None:
        text += tomli_w.dumps({"sample": actuator.sample.to_table()})
    if actuator.fit_table is not None:
        text += tomli_w.dumps({"fit": dict(actuator.fit_table)})
    return text


def _number_text(value: float, quantity: Quantity) -> str:
    """The number as TOML: in the unit that people read where that gives the same float, else in SI."""
    if not quantity.unit:
        return repr(value)
    return f'"{readable_quantity(value, quantity)}"'
