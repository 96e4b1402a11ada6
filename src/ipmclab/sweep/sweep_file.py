"""Sweep files: TOML, an actuator, a signal, metrics, and a design over ranges or a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from ipmclab.csv_file import read_lines, split_heading
from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.model.actuator import Actuator, unknown_parameter
from ipmclab.model.actuator_file import is_library_name, load_actuator
from ipmclab.model.batch import Batch, Record, checked_changes
from ipmclab.model.reductions import Reduced
from ipmclab.store.strict import Strict, validated
from ipmclab.sweep.design import Design, Kind, Range, Sampled, Table
from ipmclab.sweep.sweep import Sweep
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import Quantity, parse_quantity

_MOST_POINTS: Final = 2**30
"""Of a Sobol sequence, as SciPy makes it."""

_MOST_SLICES: Final = 10_000_000
"""Of a Latin hypercube, which is kept as a whole."""

_MOST_WAYS: Final = 100_000
"""Of a Morris design, which is kept as a whole."""

_ALONE: Final = {
    "morris": ("one way does not show how much an effect varies", 20),
    "saltelli": ("one pair of points does not show how sure an index is", 512),
}
"""Designs that show nothing with one point: why, and how many are usual."""

_MOST_PARAMETERS: Final = 50

_MOST_PER_FILE: Final = 10_000_000
"""Sets that are in the memory at once."""


class _RangeTable(Strict):
    low: str | float
    high: str | float
    scale: Literal["linear", "log"] = "linear"


class _DesignTable(Strict):
    kind: Kind
    base: int = Field(ge=1)
    seed: int = Field(ge=0, default=0)


class _SweepTable(Strict):
    actuator: str
    signal: str
    duration: str
    rate: str
    hold: Literal["zero", "zero-before", "first"] = "zero"
    metrics: tuple[str, ...] = Field(strict=False)
    sets_per_file: int = Field(ge=0, le=_MOST_PER_FILE, default=0)
    table: str | None = None
    design: _DesignTable | None = None
    ranges: dict[str, _RangeTable] | None = None


@tell_kinds
def read_sweep(path: str | Path) -> Sweep:
    """Read a sweep; files that it names are in the same folder unless their path says otherwise.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    sweep : Sweep

    Raises
    ------
    InputError
        No such file, no TOML, an unknown key, a wrong unit, a value that no strip can have.

    Examples
    --------
    >>> import tempfile
    >>> from ipmclab.sweep.template import TEMPLATE
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "mine.toml"
    ...     _ = path.write_text(TEMPLATE, encoding="utf-8")
    ...     read_sweep(path).design.count
    2560
    """
    path = Path(path)
    missing = InputError(
        "there is no such file",
        code="no-sweep",
        where=str(path),
        repair="write one to fill in: ipmclab sweep --template --out mine.toml",
    )
    text = read_text(path, kind="a sweep", missing=missing)
    return sweep_from_text(text, where=str(path), folder=path.parent)


def sweep_from_text(text: str, *, where: str = "sweep", folder: Path | None = None) -> Sweep:
    """Read a sweep from the text of its file.

    Parameters
    ----------
    text : str
    where : str
        What the messages name: the file.
    folder : Path, optional
        Where the paths in it start.

    Raises
    ------
    InputError
    """
    repair = "compare with the template: ipmclab sweep --template"
    document = parse_table(text, where=where, repair=repair)
    if isinstance(document.get("ranges"), dict):
        document["ranges"] = _by_name(document["ranges"], where=f"{where}: ranges")
    table = validated(_SweepTable, document, where=where)
    place = folder or Path()
    try:
        return _sweep(table, place)
    except InputError as error:
        at = f"{where}: {error.where}" if error.where and not error.where.startswith(where) else error.where or where
        raise error.at(at) from error


def _by_name(table: Mapping[str, Any], *, where: str) -> dict[str, Any]:
    """Parameters by dotted name, each once."""
    found: dict[str, Any] = {}
    for name, one in _dotted(table):
        if name in found:
            raise InputError(
                "this parameter has two ranges, one under its name in quotes and one without",
                code="two-ranges",
                where=f"{where}.{name}",
                repair="keep one of them",
            )
        found[name] = one
    return found


def _dotted(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Parameters by dotted name, also where the name was written without quotes, which TOML takes for tables."""
    for key, value in table.items():
        if isinstance(value, dict) and not value.keys() & {"low", "high", "scale"}:
            yield from _dotted(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _sweep(table: _SweepTable, folder: Path) -> Sweep:
    from ipmclab.signals import parse

    library = is_library_name(table.actuator)
    actuator = load_actuator(table.actuator if library else str(folder / table.actuator))
    signal = parse(table.signal, folder=folder)
    record = Record.of(table.duration, table.rate, table.hold)
    try:
        metrics = Reduced.of(table.metrics)
    except InputError as error:
        error.where = "metrics"  # the key of the file
        raise
    sweep = Sweep(actuator, signal, record, _design(table, actuator, folder), metrics, table.sets_per_file)
    Batch.of(actuator, signal, None, record, metrics.outputs)  # a signal that does not fit the record
    return sweep


def _design(table: _SweepTable, actuator: Actuator, folder: Path) -> Design:
    if table.table is not None:
        for key in ("design", "ranges"):
            if getattr(table, key) is not None:
                raise InputError(
                    f"there is a table, and a [{key}]", code="two-designs", where=key, repair="keep one of them"
                )
        return Table(_read_columns(folder / table.table, actuator))
    if table.design is None or not table.ranges:
        key = "ranges" if table.design is not None else "design"
        raise InputError(
            "it does not say which parameter sets there are",
            code="missing-key",
            where=key,
            repair='add [design] and [ranges], or table = "strips.csv"',
        )
    ranges = {name: _range(name, one, actuator) for name, one in table.ranges.items()}
    _check_counts(table.design, len(ranges))
    _check_corners(actuator, ranges)
    return Sampled(table.design.kind, ranges, table.design.base, table.design.seed)


def _range(name: str, table: _RangeTable, actuator: Actuator) -> Range:
    declarations = actuator.structure.declarations
    if name not in declarations:
        raise unknown_parameter(name, declarations)
    if declarations[name].transform == "count":
        raise InputError(
            "this is a whole number, and a range is drawn from without steps",
            code="bad-range",
            where=f"ranges.{name}",
            repair='give its values in a table (table = "sets.csv"), or one sweep for each',
        )
    low, high = (_value(end, declarations[name].quantity, where=f"ranges.{name}") for end in (table.low, table.high))
    if not low < high:
        raise InputError(
            f"low is {low:g} and high is {high:g} in SI units",
            code="bad-range",
            where=f"ranges.{name}",
            repair="give a high that is above low",
        )
    if table.scale == "log" and low <= 0.0:
        raise InputError(
            f"low is {low:g}, and a logarithm needs numbers above 0",
            code="bad-range",
            where=f"ranges.{name}",
            repair='give a low above 0, or scale = "linear"',
        )
    return Range(low, high, log=table.scale == "log")


def _value(given: str | float, quantity: Quantity, *, where: str) -> float:
    return parse_quantity(given if isinstance(given, str) else repr(float(given)), quantity, where=where)


def _check_counts(design: _DesignTable, parameters: int) -> None:
    most = {"latin-hypercube": _MOST_SLICES, "morris": _MOST_WAYS}.get(design.kind, _MOST_POINTS)
    if design.base > most or parameters > _MOST_PARAMETERS:
        raise InputError(
            f"{design.base} points of {parameters} parameters; a {design.kind} design has at most {most} points "
            f"of {_MOST_PARAMETERS} parameters",
            code="too-many",
            where="design.base",
            repair="take fewer" + ("" if most == _MOST_POINTS else ", or the kind sobol, which needs no memory"),
        )
    if design.base == 1 and design.kind in _ALONE:
        why, usual = _ALONE[design.kind]
        raise InputError(why, code="bad-base", where="design.base", repair=f"give {usual}, or at least 2")
    if design.kind in ("sobol", "saltelli") and design.base & (design.base - 1):
        below = 1 << (design.base.bit_length() - 1)
        raise InputError(
            f"{design.base} points of a Sobol sequence do not fill the ranges evenly",
            code="bad-base",
            where="design.base",
            repair=f"give a power of two, such as {below} or {2 * below}",
        )


def _check_corners(actuator: Actuator, ranges: Mapping[str, Range]) -> None:
    """Refuse ranges with values that are not allowed, before the first of them is simulated."""
    corners = {name: np.array([one.low, one.high]) for name, one in ranges.items()}
    free = "geometry.free_length"
    if free in corners:  # the shortest strip meets the furthest sensing point
        corners[free] = corners[free][::-1]
    checked_changes(actuator, corners)


def _read_columns(path: Path, actuator: Actuator) -> dict[str, np.ndarray]:
    """The columns of a CSV file, in SI units."""
    missing = InputError("there is no such file", code="no-table", where=str(path), repair="correct the path")
    lines = read_lines(path, missing=missing)
    if len(lines) < 2:
        raise InputError(
            "there is no parameter set", code="no-sets", where=str(path), repair="write one line for each set"
        )
    columns = [_column_head(head, actuator, path) for head in lines[0].cells]
    numbers = np.empty((len(lines) - 1, len(columns)))
    for place, (number, written, cells) in enumerate(lines[1:]):
        try:
            numbers[place] = np.array([float(cell) for cell in cells]).reshape(len(columns))
        except ValueError as error:
            raise InputError(
                f"{written.strip()!r} is not one number for each of {len(columns)} columns",
                code="bad-table",
                where=f"{path}, line {number}",
                repair="write numbers with a decimal point, between commas or semicolons",
            ) from error
    found = {name: numbers[:, place] * factor for place, (name, factor) in enumerate(columns)}
    if len(found) < len(columns):
        raise InputError("a parameter has two columns", code="bad-table", where=str(path), repair="keep one of them")
    try:
        return checked_changes(actuator, found)
    except InputError as error:
        error.where = f"{path}: {error.where}"
        raise


def _column_head(head: str, actuator: Actuator, path: Path) -> tuple[str, float]:
    name, unit = split_heading(head)
    if name not in actuator.structure.declarations:
        raise InputError(
            f"no parameter is called {name!r}",
            code="unknown-parameter",
            where=str(path),
            repair=suggest(name, actuator.structure.declarations),
        )
    if not unit:
        return name, 1.0
    quantity = actuator.structure.declarations[name].quantity
    return name, parse_quantity(f"1 {unit}", quantity, where=f"{path}: {name}")
