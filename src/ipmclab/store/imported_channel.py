"""One channel of a foreign record: its cells become SI values with their rows and flags."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.run import QUALITY_FLAGS, FloatArray
from ipmclab.store.import_map import MAPPED, ChannelMap
from ipmclab.store.importers.columns import Columns
from ipmclab.units import parse_quantity, spell_unit

# A sentinel that went through a float32 still counts as that sentinel.
_SENTINEL_TOLERANCE = 1e-7


# A unit at the end of a heading: "Strom [mA]", "Strom (mA)", "Strom_mA", "I / mA", "I in mA".
_HEADING_UNIT = re.compile(r"(?:[\[(]\s*([^\[\]()]+?)\s*[\])]|(?:[_/,]\s*| in )([^\s_/,]+))$")


@dataclass(frozen=True)
class ImportedChannel:
    """A channel on its way from the file to the run: SI values with their row numbers."""

    values: FloatArray
    flags: npt.NDArray[np.uint8]
    rows: npt.NDArray[np.int64]
    scaling: str
    limits: tuple[float, float] | None

    def over_all_rows(self, n_rows: int) -> ImportedChannel:
        """The channel over all rows of the record; rows that it lacks are missing."""
        values = np.full(n_rows, np.nan)
        flags = np.full(n_rows, QUALITY_FLAGS["missing"], dtype=np.uint8)
        values[self.rows] = self.values
        flags[self.rows] = self.flags
        return replace(self, values=values, flags=flags, rows=np.arange(n_rows))

    def rows_earlier(self, rows: int) -> ImportedChannel:
        """The channel over all rows of the record so many rows earlier; where it then has no row it is missing."""
        if not rows:
            return self
        moved = self.rows - rows
        kept = (moved >= 0) & (moved < len(self.values))
        which = f"{abs(rows)} row{'s' if abs(rows) > 1 else ''} {'earlier' if rows > 0 else 'later'}"
        scaling = f"{self.scaling}; {which} than in the file"
        there = replace(self, values=self.values[kept], flags=self.flags[kept], rows=moved[kept], scaling=scaling)
        return there.over_all_rows(len(self.values))


def read_channel(name: str, channel: ChannelMap, columns: Columns, number: int) -> ImportedChannel:
    if channel.dates is not None:
        return _read_dates(channel, columns, number)
    raw = columns.numbers(number)
    flags = np.where(np.isnan(raw), QUALITY_FLAGS["missing"], 0).astype(np.uint8)
    for sentinel in channel.sentinels:
        lost = np.isclose(raw, sentinel, rtol=_SENTINEL_TOLERANCE, atol=0.0)
        flags[lost] = QUALITY_FLAGS["sentinel"]
        raw = np.where(lost, np.nan, raw)
    rows: npt.NDArray[np.int64] = np.arange(len(raw))
    if channel.index is not None:
        rows = _row_numbers(name, channel.index, columns)
        _refuse_unnumbered(raw, len(rows), name, columns, number)
        raw, flags = raw[: len(rows)], flags[: len(rows)]
    unit = _unit(name, channel, columns, number)
    scaled = _to_si(np.append(raw, channel.range or ()), channel, MAPPED[name].units[unit])
    spoilt = np.flatnonzero(np.isfinite(raw) & ~np.isfinite(scaled[: len(raw)]))
    if len(spoilt):
        raise InputError(
            f"{raw[spoilt[0]]:g} in {name} is too large to be scaled",
            code="out-of-range",
            where=f"{columns.file}: {columns.place(int(spoilt[0]), number)}",
            repair="see the scaling in the map, and byte_order of a binary file",
        )
    low, high = sorted(scaled[len(raw) :].tolist()) or (None, None)
    if low is not None and not np.isfinite([low, high]).all():
        raise InputError(
            f"the range {list(channel.range or ())} is too large to be scaled",
            code="out-of-range",
            where=f"channels.{name}.range",
            repair="give it in the numbers of the file, before the scaling",
        )
    return ImportedChannel(
        values=scaled[: len(raw)],
        flags=flags,
        rows=rows,
        scaling=_describe(channel, unit),
        limits=None if low is None or high is None else (low, high),
    )


def _read_dates(channel: ChannelMap, columns: Columns, number: int) -> ImportedChannel:
    assert channel.dates is not None
    of_date = (
        [] if channel.date_column is None else [columns.find(channel.date_column, where="channels.time.date_column")]
    )
    values = columns.dates([*of_date, number], channel.dates)
    return ImportedChannel(
        values=values,
        flags=np.zeros(len(values), dtype=np.uint8),
        rows=np.arange(len(values)),
        scaling=f"column {channel.column!r}, dates",
        limits=None,
    )


def _row_numbers(name: str, index: int | str, columns: Columns) -> npt.NDArray[np.int64]:
    """The row of each cell, from the index column beside it, which may end early."""
    number = columns.find(index, where=f"channels.{name}.index")
    given = columns.numbers(number)
    filled = np.flatnonzero(~np.isnan(given))
    given = given[: filled[-1] + 1] if len(filled) else given[:0]
    wrong = np.flatnonzero(~((given == np.floor(given)) & (np.diff(given, prepend=-1.0) > 0)))
    if len(wrong):
        row = int(wrong[0])
        raise InputError(
            f"{given[row]:g} in the index column {index!r} of {name} is not a row number above the one before",
            code="bad-index",
            where=f"{columns.file}: {columns.place(row, number)}",
            repair="name the column that counts the rows, or leave index out of the map",
        )
    # An index far beyond the rows is a column of something else, and would fill the memory.
    if len(given) and given[-1] >= 10 * len(given) + 1000:
        raise InputError(
            f"{len(given)} rows are numbered up to {given[-1]:g} in the index column {index!r} of {name}",
            code="bad-index",
            where=columns.file,
            repair="name the column that counts the rows, or leave index out of the map",
        )
    return given.astype(np.int64)


def _refuse_unnumbered(raw: FloatArray, n_rows: int, name: str, columns: Columns, number: int) -> None:
    """Refuse readings below the last row number, for no row is theirs, and fewer readings than row numbers."""
    if len(raw) < n_rows:
        raise InputError(
            f"{len(raw)} readings of {name} have {n_rows} row numbers",
            code="bad-index",
            where=columns.file,
            repair="name the column that counts the rows of this channel",
        )
    beyond = n_rows + np.flatnonzero(np.isfinite(raw[n_rows:]))
    if len(beyond):
        raise InputError(
            f"{len(beyond)} readings of {name} have no row number",
            code="bad-index",
            where=f"{columns.file}: {columns.place(int(beyond[0]), number)}",
            repair="name the column that counts the rows of this channel",
        )


def _unit(name: str, channel: ChannelMap, columns: Columns, number: int) -> str:
    """The unit of the scaled numbers: the map's, or the one that is in the file, in its units row or a heading."""
    units = MAPPED[name].units
    where = f"channels.{name}.unit"
    written = columns.units[number] if columns.units else ""
    in_file = spell_unit(written)
    heading = columns.names[number]
    in_heading = _HEADING_UNIT.search(heading)
    if in_heading and not in_file:
        # Only a unit of this channel is taken for one: headings end in other words too.
        ending = spell_unit(in_heading[1] or in_heading[2])
        in_file = ending if ending in units else ""
    if channel.unit is None and (channel.is_scaled or not in_file):
        raise InputError(
            "no unit",
            code="missing-unit",
            where=where,
            repair=f"state the unit of the {'scaled ' if channel.is_scaled else ''}numbers: {', '.join(units)}",
        )
    if not channel.is_scaled and channel.unit and in_file in units and units[channel.unit] != units[in_file]:
        raise InputError(
            f"the map says {channel.unit!r}, the file {in_file!r}" + (f" (column {heading!r})" if heading else ""),
            code="unit-mismatch",
            where=where,
            repair="leave the unit out of the map to take the file's, or write factor = 1.0 where the file is wrong",
        )
    unit = channel.unit or in_file
    if unit not in units:
        raise InputError(
            f"the file says {unit!r}, which is not one of {', '.join(units)}",
            code="bad-unit",
            where=where,
            repair="scale the numbers in the map, and state the unit",
        )
    return unit


def _to_si(raw: FloatArray, channel: ChannelMap, per_unit: float) -> FloatArray:
    factor, offset = channel.line
    with np.errstate(over="ignore", invalid="ignore"):
        return (raw * factor + offset) * per_unit if channel.is_scaled else raw * per_unit


def zeroed_channel(channel: ImportedChannel, name: str, mapping: ChannelMap, source: Path) -> ImportedChannel:
    """Take the reading at rest off, then give the sign: limits follow the readings."""
    if mapping.zero_at is not None:
        rest = parse_quantity(mapping.zero_at, MAPPED[name], where=f"channels.{name}.zero_at")
    elif mapping.zero_rows is not None:
        chosen = channel.values[slice(*mapping.zero_rows)]
        if mapping.zero_rows[1] > len(channel.values) or np.isnan(chosen).all():
            raise InputError(
                f"rows {list(mapping.zero_rows)} hold no reading of {name} (the file has {len(channel.values)} rows)",
                code="out-of-range",
                where=f"{source}: channels.{name}.zero_rows",
                repair="name rows before the voltage changes, counted from 0",
            )
        rest = float(np.nanmean(chosen))
    else:
        rest = 0.0
    zeroed = channel.values - rest if rest else channel.values
    scaling = channel.scaling + (f"; minus {rest:.12g} {MAPPED[name].unit}" if rest else "")
    if mapping.zero_rows is not None:
        scaling += f" (mean of rows {mapping.zero_rows[0]} to {mapping.zero_rows[1] - 1})"
    if mapping.sign == -1:
        scaling += "; sign reversed"
    limits = channel.limits and sorted(mapping.sign * (limit - rest) for limit in channel.limits)
    return replace(
        channel,
        values=-zeroed if mapping.sign == -1 else zeroed,
        scaling=scaling,
        limits=(limits[0], limits[1]) if limits else None,
    )


def _describe(channel: ChannelMap, unit: str) -> str:
    text = f"column {channel.column!r}"
    if channel.points:
        (first, at_first), (second, at_second) = channel.points
        text += f", from {first!r} to {second!r} read as {at_first!r} to {at_second!r} {unit}"
    elif channel.is_scaled:
        factor, offset = channel.line
        text += f", times {factor!r}" + (f" plus {offset!r}" if offset else "") + f", in {unit}"
    else:
        text += f" in {unit}"
    return text
