"""Properties of custom scales."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

from virtual_cdaq.attributes.table import Property, Table
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.scales import Scale

TYPES = {"linear": 10447, "map": 10448, "polynomial": 10449, "table": 10450}  # DAQmx_Val_Linear, ...
Side = Literal["before", "after"]


def _of(kind: str, get: Any, put: Any) -> Property:
    """A property that scales of one kind have."""

    def checked(scale: Scale) -> Scale:
        if scale.kind != kind:
            raise ChassisError(-200601, f"Custom scale: {scale.name}")
        return scale

    return Property(lambda scale: get(checked(scale)), lambda scale, value: put(checked(scale), value))


def _put(scale: Scale, side: Side, values: tuple[float, ...]) -> None:
    replace(scale, **{side: values}).check()  # type: ignore[arg-type]
    setattr(scale, side, values)


def _number(kind: str, side: Side, place: int) -> Property:
    def put(scale: Scale, value: float) -> None:
        values = list(getattr(scale, side))
        values[place] = value
        _put(scale, side, tuple(values))

    return _of(kind, lambda scale: getattr(scale, side)[place], put)


def _numbers(kind: str, side: Side) -> Property:
    return _of(kind, lambda scale: list(getattr(scale, side)), lambda scale, value: _put(scale, side, tuple(value)))


def _plain(name: str) -> Property:
    return Property(lambda scale: getattr(scale, name), lambda scale, value: setattr(scale, name, value))


SCALE: Table = {
    "TYPE": Property(lambda scale: TYPES[scale.kind]),
    "DESCR": _plain("description"),
    "PRE_SCALED_UNITS": _plain("units_before"),
    "SCALED_UNITS": _plain("units_after"),
    "LIN_SLOPE": _number("linear", "before", 1),
    "LIN_Y_INTERCEPT": _number("linear", "before", 0),
    "MAP_PRE_SCALED_MIN": _number("map", "before", 0),
    "MAP_PRE_SCALED_MAX": _number("map", "before", 1),
    "MAP_SCALED_MIN": _number("map", "after", 0),
    "MAP_SCALED_MAX": _number("map", "after", 1),
    "POLY_FORWARD_COEFF": _numbers("polynomial", "before"),
    "POLY_REVERSE_COEFF": _numbers("polynomial", "after"),
    "TABLE_PRE_SCALED_VALS": _numbers("table", "before"),
    "TABLE_SCALED_VALS": _numbers("table", "after"),
}
