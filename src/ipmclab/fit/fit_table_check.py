"""Whether a ``[fit]`` table, which anybody may have edited, holds what a fit can say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Final, get_args

from ipmclab.errors import suggest
from ipmclab.fit.fit import Direction, FittedParameter
from ipmclab.fit.observation import Observation
from ipmclab.model import Actuator
from ipmclab.model.parameters import Parameter
from ipmclab.model.ports import OUTPUTS
from ipmclab.run import Effect, Finding, Severity
from ipmclab.strip_state.run_state import RunState
from ipmclab.units import CHANNELS

_ROUNDING: Final = 1e-9  # of a value, by which its interval may miss it
_ASYMMETRY: Final = 1e-5  # of two standard errors: the inverse of a nearly singular matrix is not quite symmetric
_TEXTS: Final = ("message", "software_version")
_TEXTS_OF_RUN: Final = ("label", "content_sha256", "hold", "start")
_OF_OUTPUTS: Final = ("offset", "drift", "noise", "samples", "span")


class BadTable(ValueError):
    """What is wrong in a ``[fit]`` table, and at which key."""

    def __init__(self, key: str, what: str) -> None:
        super().__init__(what)
        self.key = key
        self.what = what


def check_fit_table(table: Mapping[str, Any], actuator: Actuator) -> None:
    """Refuse a table that no fit can have written.

    Parameters
    ----------
    table : mapping
    actuator : Actuator
        In whose file it is; it gives the units.

    Raises
    ------
    BadTable
    """
    declared = actuator.parameters()
    entries = [_table_of(one, key, FittedParameter) for key, one in _each(table, "parameters", "fit")]
    for place, entry in enumerate(entries):
        _check_parameter(entry, f"fit.parameters[{place}]", declared)
    names = [entry["name"] for entry in entries]
    for place, name in enumerate(names):
        if name in names[:place]:
            raise BadTable(f"fit.parameters[{place}].name", f"{name} is there twice")
    rank = _at(table, "rank", "fit")
    if not _is_whole(rank) or not 0 <= rank <= len(entries):
        raise BadTable(
            "fit.rank", f"{_said(rank)} is not a whole number from 0 to {len(entries)}, the number of parameters"
        )
    _yes_or_no(table, "converged", "fit")
    if not _is_whole(_at(table, "evaluations", "fit")) or table["evaluations"] < 0:
        raise BadTable("fit.evaluations", f"{_said(table['evaluations'])} is not a whole number of 0 or more")
    for key in _TEXTS:
        _text(table, key, "fit")
    for key, one in _each(table, "singular_values", "fit"):
        if not _number(one, key) >= 0.0:
            raise BadTable(key, f"{_said(one)} is not a number of 0 or more")
    _check_correlations(table, entries)
    covariance = _table(_at(table, "covariance", "fit"), "fit.covariance")
    _check_covariance(covariance)
    for key, one in _each(table, "undetermined", "fit"):
        _check_direction(_table_of(one, key, Direction), key)
    for key, one in _each(table, "runs", "fit"):
        _check_run(_table_of(one, key, Observation), key)
    for key, one in _each(table, "findings", "fit"):
        _check_finding(_table_of(one, key, Finding), key)


def _check_direction(direction: Mapping[str, Any], key: str) -> None:
    _text(direction, "sentence", key)
    _numbers(_at(direction, "coefficients", key), f"{key}.coefficients")
    if not _number(_at(direction, "error", key), f"{key}.error") >= 0.0:
        raise BadTable(f"{key}.error", f"{_said(direction['error'])} is not a standard error: it must be 0 or more")


def _check_parameter(entry: Mapping[str, Any], key: str, declared: Mapping[str, Parameter]) -> None:
    name = _text(entry, "name", key)
    value = _number(_at(entry, "value", key), f"{key}.value")
    if not math.isfinite(value):
        raise BadTable(f"{key}.value", f"the value of {name} is {_said(value)}, not a number")
    _text(entry, "symbol", key)
    unit, expected = _text(entry, "unit", key), _unit(name.partition("[")[0], declared)
    if expected is not None and unit != expected:
        raise BadTable(f"{key}.unit", f"{name} is in {expected or 'no unit'}, not in {unit or 'none'}")
    error = _number(_at(entry, "standard_error", key), f"{key}.standard_error")
    if not error >= 0.0:
        raise BadTable(f"{key}.standard_error", f"that of {name} is {_said(error)}: it must be 0 or more, or inf")
    low, high = _pair(entry, "interval", key)
    slack = _ROUNDING * abs(value)
    if not low - slack <= value <= high + slack:
        raise BadTable(
            f"{key}.interval",
            f"{_said(low)} to {_said(high)} does not hold the value of {name}, {_said(value)}"
            if low <= high
            else f"that of {name} goes from {_said(low)} down to {_said(high)}: the lower end comes first",
        )
    if "interval_next_mounting" in entry:
        # That of another mounting need not hold the value of this one.
        low, high = _pair(entry, "interval_next_mounting", key)
        if not low <= high:
            raise BadTable(
                f"{key}.interval_next_mounting",
                f"that of {name} goes from {_said(low)} down to {_said(high)}: the lower end comes first",
            )
    if "prior" in entry and not _pair(entry, "prior", key)[1] >= 0.0:
        raise BadTable(f"{key}.prior", f"the second of {entry['prior']} is its standard uncertainty: 0 or more")
    for flag in ("determined", "at_bound", *(["prior_of_literature"] if "prior_of_literature" in entry else [])):
        _yes_or_no(entry, flag, key)


def _unit(base: str, declared: Mapping[str, Parameter]) -> str | None:
    """The SI unit of a free parameter; None of one that the actuator no longer has."""
    if base in declared:
        return declared[base].unit
    kind, _, channel = base.removeprefix("observation.").partition(".")
    if base == "observation.delay":
        return "s"
    if kind not in ("offset", "drift") or channel not in CHANNELS:
        return None
    return CHANNELS[channel].unit if kind == "offset" else f"{CHANNELS[channel].unit}/s"


def _check_correlations(table: Mapping[str, Any], entries: Sequence[Mapping[str, Any]]) -> None:
    key, count = "fit.correlations", len(entries)
    rows = _square(table, "correlations", "fit", count, "parameters")
    is_open = [math.isinf(entry["standard_error"]) or not entry["determined"] for entry in entries]
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            names = f"{entries[i]['name']} and {entries[j]['name']}"
            if i == j and value != 1.0:
                raise BadTable(f"{key}[{i}][{j}]", f"{entries[i]['name']} with itself is {_said(value)}, not 1")
            if math.isnan(value):
                if not (is_open[i] or is_open[j]):
                    raise BadTable(f"{key}[{i}][{j}]", f"that of {names} is nan, and both are determined")
            elif not -1.0 <= value <= 1.0:
                raise BadTable(f"{key}[{i}][{j}]", f"that of {names} is {_said(value)}: it must lie from -1 to 1")
            other = rows[j][i]
            if math.isnan(value) != math.isnan(other) or abs(value - other) > _ASYMMETRY:
                raise BadTable(f"{key}[{i}][{j}]", f"that of {names} is {_said(value)}, the other way {_said(other)}")


def _check_covariance(table: Mapping[str, Any]) -> None:
    key = "fit.covariance"
    names = [_is_text(one, place) for place, one in _each(table, "names", key)]
    if len(set(names)) != len(names):
        raise BadTable(f"{key}.names", "a name is there twice")
    rows = _square(table, "rows", key, len(names), "names")
    for i, row in enumerate(rows):
        if not 0.0 <= row[i] < math.inf:
            raise BadTable(
                f"{key}.rows[{i}][{i}]", f"the variance of {names[i]} is {_said(row[i])}: it must be 0 or more"
            )
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            size = max(math.sqrt(rows[i][i]) * math.sqrt(rows[j][j]), abs(value))
            if not (math.isfinite(value) and abs(value - rows[j][i]) <= _ASYMMETRY * size):
                raise BadTable(
                    f"{key}.rows[{i}][{j}]",
                    f"that of {names[i]} and {names[j]} is {_said(value)}, the other way {_said(rows[j][i])}",
                )


def _check_run(run: Mapping[str, Any], key: str) -> None:
    for name in _TEXTS_OF_RUN:
        _text(run, name, key)
    _numbers({"delay": _at(run, "delay", key), "series_resistance": run.get("series_resistance", 0.0)}, key)
    _is_text(run.get("mounting", ""), f"{key}.mounting")
    if "state" in run:
        state = _table_of(run["state"], f"{key}.state", RunState)
        _text(state, "how", f"{key}.state")
        tables = ("doses", "adds", "shared")
        for name in tables:
            _numbers(state.get(name, {}), f"{key}.state.{name}")
        if "tangent" in state:
            _pair(state, "tangent", f"{key}.state")
        _numbers({name: one for name, one in state.items() if name not in ("how", "tangent", *tables)}, f"{key}.state")
    _numbers(run.get("initial_state", {}), f"{key}.initial_state")
    for name in _OF_OUTPUTS:
        _numbers(run.get(name, {}), f"{key}.{name}")
        for output in run.get(name, {}):
            if output not in OUTPUTS:
                raise BadTable(f"{key}.{name}.{output}", f"unknown output {output!r}, {suggest(output, OUTPUTS)}")


def _check_finding(finding: Mapping[str, Any], key: str) -> None:
    for name in ("code", "message", "repair", "channel"):
        _text(finding, name, key)
    for name, allowed in (("severity", get_args(Severity)), ("effect", get_args(Effect))):
        if _text(finding, name, key) not in allowed:
            raise BadTable(f"{key}.{name}", f"{_said(finding[name])} is none of {', '.join(allowed)}")
    _table(_at(finding, "values", key), f"{key}.values")
    for place, rows in _each(finding, "samples", key):
        if len(ends := _each({"": rows}, "", place)) != 2 or not all(_is_whole(one) for _, one in ends):
            raise BadTable(place, f"{_said(rows)} is not a first and a last row")


def _square(table: Mapping[str, Any], name: str, key: str, count: int, of: str) -> list[list[float]]:
    rows = [[_number(value, place) for place, value in _each({"": row}, "", at)] for at, row in _each(table, name, key)]
    if len(rows) != count or any(len(row) != count for row in rows):
        raise BadTable(f"{key}.{name}", f"it has not one row and one column for each of the {count} {of}")
    return rows


def _at(table: Mapping[str, Any], name: str, key: str) -> Any:
    if name not in table:
        raise BadTable(f"{key}.{name}", "this key is missing")
    return table[name]


def _each(table: Mapping[str, Any], name: str, key: str) -> list[tuple[str, Any]]:
    """What is in a list, each with its key."""
    found = _at(table, name, key)
    at = f"{key}.{name}" if name else key
    if isinstance(found, str) or not isinstance(found, Sequence):
        raise BadTable(at, f"{_said(found)} is not a list")
    return [(f"{at}[{place}]", one) for place, one in enumerate(found)]


def _table(value: Any, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise BadTable(key, f"{_said(value)} is not a table")
    return value


def _table_of(value: Any, key: str, kind: type) -> Mapping[str, Any]:
    known = [field.name for field in fields(kind)]
    for name in (found := _table(value, key)):
        if name not in known:
            raise BadTable(f"{key}.{name}", f"unknown key {name!r}, {suggest(name, known)}")
    return found


def _numbers(value: Any, key: str) -> None:
    for name, one in _table(value, key).items():
        _number(one, f"{key}.{name}")


def _number(value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadTable(key, f"{_said(value)} is not a number")
    try:
        return float(value)
    except OverflowError:
        raise BadTable(key, f"{_said(value)} is too large") from None


def _pair(table: Mapping[str, Any], name: str, key: str) -> tuple[float, float]:
    ends = [_number(one, place) for place, one in _each(table, name, key)]
    if len(ends) != 2:
        raise BadTable(f"{key}.{name}", f"it holds {len(ends)} numbers, not 2")
    return ends[0], ends[1]


def _yes_or_no(table: Mapping[str, Any], name: str, key: str) -> None:
    if not isinstance(_at(table, name, key), bool):
        raise BadTable(f"{key}.{name}", f"{_said(table[name])} is neither true nor false")


def _text(table: Mapping[str, Any], name: str, key: str) -> str:
    return _is_text(_at(table, name, key), f"{key}.{name}")


def _is_text(value: Any, key: str) -> str:
    if not isinstance(value, str):
        raise BadTable(key, f"{_said(value)} is not a text")
    return value


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _said(value: Any) -> str:
    """A value as the file has it, cut short."""
    text = (
        f"{value:.6g}" if isinstance(value, float) else str(value).lower() if isinstance(value, bool) else repr(value)
    )
    return text if len(text) <= 40 else f"{text[:37]}..."
