"""The import map: a small TOML file that says what the columns of a foreign record mean."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, ValidationError, field_validator, model_validator

from ipmclab.errors import InputError, unknown_name
from ipmclab.run import Hold, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.document import METADATA_QUANTITIES, parse_metadata
from ipmclab.store.importers import File
from ipmclab.store.importers.dates import DateOrder
from ipmclab.store.strict import Pair, Rows, Strict, as_input_error
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import CHANNELS, TIME, Quantity, parse_quantity, spell_unit

MAPPED: Final[dict[str, Quantity]] = {"time": TIME, **CHANNELS}
"""What a column can be."""

_SET_BY_IMPORT: Final = (
    "origin",
    "sample",
    "marks",
    "sampling_period_known",
    "ranges",
    "calibrations",
    "source_file",
    "software_version",
    "parameters",
    "findings",
)

_SENSIBLE: Final[dict[str, tuple[float, float]]] = {
    "shunt_resistance": (0.0, 1e6),
    "source_resistance": (0.0, 1e6),
    "mass": (0.0, 1.0),
    "clamp_pressure": (0.0, 1e9),
    "temperature": (-273.15, 1000.0),
    "relative_humidity": (0.0, 100.0),
    "minutes_out_of_water": (0.0, math.inf),
    "minutes_in_environment": (0.0, math.inf),
}
"""What metadata can be [ohm, Pa, degC, percent, min]: only a slip falls outside."""

_SHORTEST_PERIOD: Final = 1e-9
_LONGEST_PERIOD: Final = 1e9
"""Sampling periods [s]: only a slip falls outside."""

EXAMPLE_PERIOD: Final = "20 ms"
"""Of a sampling period: 40 may be ms as well as 0.04 may be s, so that no message repeats the number."""

Column = int | str
"""A column by its name, or by its number counted from 0."""


class ChannelMap(Strict):
    """How a column becomes a channel.

    The number in the file is scaled (``factor * number + offset``, or the straight line through two
    ``points``), read in ``unit``, zeroed (``zero_at``, or the mean over ``zero_rows``), then given its ``sign``.
    Times that are written as dates have ``dates``, the order of day, month and year, and no unit; of rows with one
    time ``duplicates = "drop"`` keeps the first. A channel that was read some rows after the voltage has
    ``rows_late``, below zero where it was read before it.
    """

    column: Column
    index: Column | None = None
    unit: Annotated[str, AfterValidator(spell_unit)] | None = None
    factor: float | None = None
    offset: float | None = None
    points: Annotated[tuple[Pair, Pair], Field(strict=False)] | None = None
    sentinels: Annotated[tuple[float, ...], Field(strict=False)] = ()
    zero_at: str | None = None
    zero_rows: Rows | None = None
    sign: Literal[1, -1] = 1
    range: Pair | None = None
    dates: DateOrder | None = None
    date_column: Column | None = None
    duplicates: Literal["drop"] | None = None
    rows_late: int = 0

    @model_validator(mode="after")
    def _agree(self) -> ChannelMap:
        if self.points and (self.factor is not None or self.offset is not None):
            raise _contradiction("points", "points and factor or offset are both given", "keep one of them")
        if self.points and self.points[0][0] == self.points[1][0]:
            raise _contradiction("points", f"both points are at {self.points[0][0]:g}", "give two different numbers")
        if self.line[0] == 0:
            key, repair = (
                ("points", "give two different readings") if self.points else ("factor", "give another factor")
            )
            raise _contradiction(key, "a factor of 0 loses the reading", repair)
        if self.zero_at is not None and self.zero_rows is not None:
            raise _contradiction("zero_rows", "zero_at and zero_rows are both given", "keep one of them")
        _check_rows("zero_rows", self.zero_rows)
        if self.range and not self.range[0] < self.range[1]:
            raise _contradiction("range", f"{list(self.range)} does not increase", "give [low, high]")
        return self

    @property
    def line(self) -> tuple[float, float]:
        """Factor and offset of the scaling."""
        if self.points is None:
            return (1.0 if self.factor is None else self.factor), (self.offset or 0.0)
        (first, at_first), (second, at_second) = self.points
        factor = (at_second - at_first) / (second - first)
        return factor, at_first - factor * first

    @property
    def is_scaled(self) -> bool:
        return self.points is not None or self.factor is not None or self.offset is not None


class ImportMap(Strict):
    """What the columns of a foreign record mean.

    Read one with ``load_import_map``, or make one with ``ImportMap.from_table``.
    """

    file: File
    channels: dict[str, ChannelMap]
    sampling_period: str | None = None
    hold: Hold = "unknown"
    rows: Rows | None = None
    sample: dict[str, Any] | None = None
    metadata: dict[str, Any] = Field(default_factory=dict)

    @classmethod
    def from_table(cls, table: dict[str, Any], *, where: str = "import map") -> ImportMap:
        """Check a table as TOML gives it.

        Raises
        ------
        InputError
            An unknown key or channel, a wrong unit, contradictory or missing entries.

        Examples
        --------
        >>> ImportMap.from_table({"file": {"format": "csv"}, "channels": {"volts": {"column": 1}}})
        Traceback (most recent call last):
        ipmclab.errors.InputError: import map: channels.volts: unknown channel 'volts'; did you mean 'voltage'?
        """
        try:
            return cls.model_validate(table)
        except ValidationError as error:
            raise as_input_error(error, table, where=f"{where}: ") from error

    @field_validator("channels", mode="before")
    @classmethod
    def _name_channels(cls, channels: Any) -> Any:
        for name in channels if isinstance(channels, dict) else ():
            if name not in MAPPED:
                raise unknown_name("channel", name, MAPPED, where=name)
        return channels

    @model_validator(mode="after")
    def _agree(self) -> ImportMap:
        if "voltage" not in self.channels:
            raise InputError(
                "no voltage", code="missing-key", where="channels", repair="add [channels.voltage]: every run has one"
            )
        if "time" in self.channels and self.sampling_period is not None:
            raise _contradiction(
                "sampling_period", "a time column and a sampling period are both given", "keep one of them"
            )
        if self.sampling_period is not None and not self.period > 0:  # type: ignore[operator]
            raise _contradiction("sampling_period", f"{self.sampling_period!r} is not above 0", "give a time above 0")
        if self.period is not None and not _SHORTEST_PERIOD <= self.period <= _LONGEST_PERIOD:
            raise _contradiction(
                "sampling_period",
                f"{self.sampling_period!r} is outside {_SHORTEST_PERIOD:g} s to {_LONGEST_PERIOD:g} s",
                "correct the number or its unit",
            )
        _check_rows("rows", self.rows)
        named: dict[Column, str] = {}
        for name, channel in self.channels.items():
            _check_time_keys(name, channel)
            if channel.column in named:
                raise _contradiction(
                    f"channels.{name}.column",
                    f"column {channel.column!r} is mapped to {named[channel.column]} too",
                    "name the column of each channel",
                )
            named[channel.column] = name
            quantity = MAPPED[name]
            if channel.unit is not None and channel.unit not in quantity.units:
                raise InputError(
                    f"{channel.unit!r} is not one of {', '.join(quantity.units)}",
                    code="bad-unit",
                    where=f"channels.{name}.unit",
                    repair=f"give a unit of {quantity.name}",
                )
            if channel.zero_at is not None:
                parse_quantity(channel.zero_at, quantity, where=f"channels.{name}.zero_at")
        self.run_metadata()
        return self

    @property
    def period(self) -> float | None:
        """The stated sampling period [s]."""
        if self.sampling_period is None:
            return None
        return parse_quantity(self.sampling_period, TIME, where="sampling_period", example=EXAMPLE_PERIOD)

    def run_metadata(self) -> RunMetadata:
        """The metadata that the map states, sample included."""
        table = dict(self.metadata)
        known = [key for key in RunMetadata.__dataclass_fields__ if key not in _SET_BY_IMPORT]
        for key, value in table.items():
            where = f"metadata.{key}"
            if key not in known:
                raise unknown_name("key", key, known, where=where)
            quantity = TIME if key.startswith("minutes_") else METADATA_QUANTITIES.get(key)
            if quantity is None:
                continue
            unit = "min" if quantity is TIME else quantity.unit
            if not isinstance(value, str):
                raise InputError(
                    f"{value!r} has no unit",
                    code="missing-unit",
                    where=where,
                    repair=f"write for example '{value} {unit}'",
                )
            number = parse_quantity(value, quantity, where=where) / quantity.units[unit]
            low, high = _SENSIBLE[key]
            if not low <= number <= high:
                raise InputError(
                    f"{value!r} is outside {low:g} to {high:g} {unit}",
                    code="out-of-range",
                    where=where,
                    repair="give the measured value, or leave it out",
                )
            table[key] = number
        # Of what TOML can hold, only dates and times are not JSON.
        plain = json.loads(json.dumps(table, default=lambda date: date.isoformat()))
        metadata = parse_metadata(plain, where="metadata")
        if metadata.voltage_sensed == "upstream of shunt" and metadata.shunt_resistance is None:
            raise InputError(
                "the voltage was sensed upstream of the shunt, but the shunt is not stated",
                code="missing-key",
                where="metadata.shunt_resistance",
                repair='add shunt_resistance = "... ohm": the voltage over it is no part of the strip',
            )
        if self.sample is None:
            return metadata
        from dataclasses import replace

        return replace(metadata, sample=Sample.from_table(self.sample))


def load_import_map(path: str | os.PathLike[str]) -> ImportMap:
    """Read an import map.

    Parameters
    ----------
    path : str or path
        A TOML file.

    Raises
    ------
    InputError
        No such file, not TOML, or anything in it that ``ImportMap.from_table`` refuses.
    """
    where = str(path)
    missing = InputError("no such file", code="no-such-file", where=where, repair="see the maps under docs/import_maps")
    text = read_text(Path(path), kind="an import map", missing=missing)
    return ImportMap.from_table(parse_table(text, where=where), where=where)


def _contradiction(where: str, message: str, repair: str) -> InputError:
    return InputError(message, code="bad-value", where=where, repair=repair)


def _check_time_keys(name: str, channel: ChannelMap) -> None:
    for key in ("dates", "date_column", "duplicates"):
        if name != "time" and getattr(channel, key) is not None:
            raise _contradiction(f"channels.{name}.{key}", f"{key} is a key of the time", "move it to [channels.time]")
    if name in ("time", "voltage") and channel.rows_late:
        raise _contradiction(
            f"channels.{name}.rows_late", f"the {name} is what others are late beside", "give it to each of the others"
        )
    if channel.date_column is not None and channel.dates in (None, "time of day"):
        raise _contradiction(
            "channels.time.date_column", "the order of the date is not stated", 'add dates, such as "day-month-year"'
        )
    given = [key for key in ("unit", "factor", "offset", "points", "index") if getattr(channel, key) is not None]
    if channel.dates is not None and given:
        raise _contradiction(f"channels.time.{given[0]}", f"dates and {given[0]} are both given", "keep one of them")


def _check_rows(where: str, rows: tuple[int, int] | None) -> None:
    if rows is not None and not rows[0] < rows[1]:
        raise _contradiction(where, f"{list(rows)} holds no row", "give [start, stop] with stop after start")
