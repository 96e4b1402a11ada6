"""Whether a command that was taken read the numbers as they were written: read once more by others' programs."""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import pint

import ipmclab
from ipmclab.errors import IpmclabError

UNITS: Final = pint.UnitRegistry()


def wrong_numbers(words: list[str], folder: Path) -> list[str]:
    """What was read otherwise than it stands there; empty where all is well, or nobody else can read it."""
    found: list[str] = []
    if words[0] == "simulate":
        found += _simulated(words, folder)
    if words[0] == "import":
        found += _imported(words, folder)
    for word in words:
        if word == "strip.toml":
            found += _actuator(folder / word)
    return found


def _option(words: list[str], name: str) -> str | None:
    """The last value of an option; None where the command line is not that simple."""
    values = [after for word, after in pairwise(words) if word == name]
    return values[0] if len(values) == 1 and not any(word.startswith(f"{name}=") for word in words) else None


def _magnitude(text: str, unit: str) -> float | None:
    """A quantity, by pint; None where it cannot read it."""
    try:
        return float(UNITS.Quantity(text).to(unit).magnitude)
    except Exception:
        return None


def _simulated(words: list[str], folder: Path) -> list[str]:
    duration, rate = _option(words, "--duration"), _option(words, "--rate")
    signal, out = _option(words, "--signal"), _option(words, "--out")
    if not (duration and rate and signal and out) or not (folder / out).is_file():
        return []
    run = ipmclab.read_run(folder / out)
    wrong = []
    seconds, hertz = _magnitude(duration, "s"), _magnitude(rate, "Hz")
    if seconds is not None and hertz is not None and len(run) != round(seconds * hertz):
        wrong.append(f"{len(run)} rows of {duration!r} at {rate!r}")
    kind, *rest = signal.split(" ")
    volts = _magnitude(" ".join(rest), "V") if kind == "step" else None
    if volts is not None and not np.allclose(run.voltage, volts, rtol=1e-12):
        wrong.append(f"{run.voltage.max():g} V of {signal!r}")
    return wrong


def _actuator(path: Path) -> list[str]:
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        read = ipmclab.load_actuator(path)
    except (IpmclabError, ValueError, OSError):
        return []
    wrong = []
    for name, text in _leaves(table):
        if name not in read.parameter_values or not isinstance(text, str):
            continue
        unit = read.parameters()[name].quantity.unit
        magnitude = _magnitude(text.replace("ohm/sq", "ohm"), unit.replace("ohm/sq", "ohm") or "dimensionless")
        if magnitude is not None and not np.isclose(read[name], magnitude, rtol=1e-12, atol=0.0):
            wrong.append(f"{name} = {text!r} was read as {read[name]!r} {unit}")
    return wrong


def _leaves(table: Mapping[str, Any], at: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        name = f"{at}{key}"
        if isinstance(value, Mapping):
            if "value" in value:
                yield name, value["value"]
            else:
                yield from _leaves(value, f"{name}.")
        elif isinstance(value, list):
            for place, one in enumerate(value):
                if isinstance(one, Mapping):
                    yield from _leaves(one, f"{name}.{place}.")
        else:
            yield name, value


def _imported(words: list[str], folder: Path) -> list[str]:
    """The finite values of an imported table are numbers of its cells, in the unit that its map names."""
    out, chart = _option(words, "--out"), _option(words, "--map")
    table_file = next((word for word in words if word in ("record.csv", "english.csv")), None)
    if out is None or table_file is None or not (folder / out).is_file():
        return []
    try:
        run = ipmclab.read_run(folder / out)
        text = (folder / table_file).read_text(encoding="utf-8")
        channels = tomllib.loads((folder / chart).read_text(encoding="utf-8"))["channels"] if chart else _GUESSED
    except (IpmclabError, ValueError, KeyError, OSError, TypeError):
        return []
    if ";" in text:  # another table, with decimal commas
        return []
    rows = list(csv.reader(io.StringIO(text)))
    wrong = []
    for name in ("voltage", "current"):
        table = channels.get(name)
        if not isinstance(table, Mapping) or set(table) - {"column", "unit"} or name not in (*run.channels, "voltage"):
            continue
        scale = _magnitude(f"1 {table.get('unit', '')}", "V" if name == "voltage" else "A")
        values = run.voltage if name == "voltage" else run.channels[name]
        if scale is None:
            continue
        known = np.sort([scale * number for row in rows for cell in row if (number := _number(cell)) is not None])
        finite = values[np.isfinite(values)]
        place = np.clip(np.searchsorted(known, finite), 1, max(1, len(known) - 1)) if len(known) > 1 else None
        if place is None:
            continue
        miss = np.minimum(np.abs(known[place] - finite), np.abs(known[place - 1] - finite))
        if np.any(miss > 1e-9 * np.maximum(np.abs(finite), 1e-12)):
            bad = finite[np.argmax(miss)]
            wrong.append(f"the {name} has {bad:.6g}, which stands nowhere in the table")
    return wrong


_GUESSED: Final = {"voltage": {"unit": "V"}, "current": {"unit": "mA"}}


def _number(cell: str) -> float | None:
    try:
        number = float(cell)
    except ValueError:
        return None
    return number if np.isfinite(number) else None
