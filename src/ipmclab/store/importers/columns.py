"""What every importer gives: named columns of cells, and how to read numbers from them."""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.run import FloatArray
from ipmclab.store.importers.dates import DATE_ORDERS, DateOrder, read_dates

_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_OF_NUMBERS: Final = re.compile(r"[^0-9.eE+\-\s]")
_MISSING: Final = frozenset(
    (
        *("", "nan", "inf", "+inf", "-inf", "infinity", "+infinity", "-infinity"),
        *("na", "n/a", "null", "none", "#n/a", "#num!", "#div/0!", "#value!"),
        # What meters write beyond their range.
        *("ol", "+ol", "-ol", "o.l", "o.l.", "ovld", "ovrflw", "over"),
        *("overflow", "overload", "overrange", "out of range"),
    )
)
"""Texts, in lower case, that stand for a reading that is not there."""

_GROUPED: Final = {
    ".": re.compile(r"[+-]?[0-9]{1,3}(?:,[0-9]{3})+\.[0-9]*|[+-]?[0-9]{1,3}(?:[ \xa0\u202f'’][0-9]{3})+(?:\.[0-9]*)?"),
    ",": re.compile(r"[+-]?[0-9]{1,3}(?:[. \xa0\u202f'’][0-9]{3})+(?:,[0-9]*)?"),
}
"""Numbers with thousands marks, by their decimal mark."""


def is_missing(text: str) -> bool:
    """Whether a cell says that there is no reading."""
    return not text.strip(" -–—") or text.strip().lower() in _MISSING


class Clock(NamedTuple):
    """Time of row 0 and sampling period [s]."""

    start: float
    period: float


def clocks_from(starts: Sequence[float], periods: Sequence[float], moments: Sequence[float | None]) -> list[Clock]:
    """The clock of each channel of a file; times count from the channel that started first.

    Parameters
    ----------
    starts, periods : sequence of float [s]
        Of each channel: what its first time is since it started, and its sampling period.
    moments : sequence of (float or None) [s]
        When each channel started; None where the file does not say.
    """
    first = min((moment for moment in moments if moment is not None), default=0.0)
    clocks = []
    for start, period, moment in zip(starts, periods, moments, strict=True):
        late = 0.0 if moment is None else moment - first
        # Writers stamp the channels of one reading one after the other: less than half a row is no delay.
        clocks.append(Clock(start + (late if late > period / 2 else 0.0), period))
    return clocks


@dataclass(frozen=True)
class Columns:
    """The columns of a foreign file, before anything is known of their meaning.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    names : tuple of str
        Name of each column; empty texts where the file has none.
    cells : tuple of sequences
        The rows of each column: texts, numbers, None, or an array.
    place : function of (row, column) to str
        Where a cell is in the file, in the words of its format.
    clocks : tuple of (Clock or None), optional
        When the rows of each column were read, where the file records it.
    units : tuple of str, optional
        The unit of each column, where the file records them.
    decimal : str
        The decimal mark of numbers that are texts.
    times : tuple of int, optional
        The column with the times of each column, where the file gives each its own.
    """

    file: str
    names: tuple[str, ...]
    cells: tuple[Sequence[Any] | npt.NDArray[Any], ...]
    place: Callable[[int, int], str]
    clocks: tuple[Clock | None, ...] | None = None
    units: tuple[str, ...] | None = None
    decimal: str = "."
    times: tuple[int, ...] | None = None

    def find(self, column: int | str, *, where: str) -> int:
        """The number of the column that a map names.

        Raises
        ------
        InputError
            The file has no such column, or several of that name.
        """
        if isinstance(column, int):
            if not 0 <= column < len(self.cells):
                raise InputError(
                    f"column {column}, but {self.file} has {len(self.cells)} columns",
                    code="unknown-column",
                    where=where,
                    repair=f"give a number from 0 to {len(self.cells) - 1}",
                )
            return column
        count = self.names.count(column)
        if count == 1:
            return self.names.index(column)
        if count > 1:
            raise InputError(
                f"{self.file} has {count} columns {column!r}",
                code="ambiguous-column",
                where=where,
                repair="name the column by its number, counted from 0",
            )
        known = [name for name in self.names if name]
        raise InputError(
            f"{self.file} has no column {column!r}",
            code="unknown-column",
            where=where,
            repair=suggest(column, known) if known else "the file names no columns: give a number, counted from 0",
        )

    def numbers(self, column: int) -> FloatArray:
        """The numbers of a column as float64; NaN where a reading is missing or infinite.

        Raises
        ------
        InputError
            A cell that is not a number, named by its place in the file.
        """
        cells = self.cells[column]
        if isinstance(cells, np.ndarray):
            if cells.dtype.kind not in "iufb" or cells.ndim != 1:
                raise InputError(
                    f"an array of {cells.dtype} of shape {cells.shape}, not one column of real numbers",
                    code="bad-column",
                    where=f"{self.file}: {self.names[column]}",
                    repair="name another column",
                )
            values = cells.astype(np.float64)
        else:
            plain = _plain(cells) if self.decimal == "." else None
            each = (self._number(cell, row, column) for row, cell in enumerate(cells))
            values = np.fromiter(each, dtype=np.float64) if plain is None else plain
        return np.where(np.isfinite(values), values, np.nan)

    def dates(self, columns: Sequence[int], order: DateOrder) -> FloatArray:
        """Times from the first row [s], of columns that hold the date and the time of day; NaN for a blank cell.

        Raises
        ------
        InputError
            A cell that is no date in this order, named by its place in the file.
        """
        cells = self.cells[columns[0]]
        if len(columns) > 1:
            of_date, of_time = (self.cells[column] for column in columns)
            if len(of_date) != len(of_time):
                raise InputError(
                    f"{len(of_date)} dates for {len(of_time)} times of day",
                    code="unequal-lengths",
                    where=self.file,
                    repair="name the column with the date of each row as date_column",
                )
            cells = [_joined(day, time) for day, time in zip(of_date, of_time, strict=True)]
        try:
            read = read_dates(cells, order)
        except ValueError as error:
            row = int(error.args[0])
            raise InputError(
                f"{str(cells[row])[:60]!r} is no date written as {order}",
                code="bad-date",
                where=f"{self.file}: {self.place(row, columns[0])}",
                repair="write another order as dates in the map: " + ", ".join(DATE_ORDERS),
            ) from error
        first = next((time for time in read if time is not None), 0)
        return np.array([np.nan if time is None else (time - first) / 1e9 for time in read])

    def _number(self, cell: Any, row: int, column: int) -> float:
        if isinstance(cell, int | float) and not isinstance(cell, bool):
            try:
                return float(cell)
            except OverflowError:
                return np.nan
        if cell is None:
            return np.nan
        if isinstance(cell, str):
            text = cell.strip()
            pointed = text if self.decimal == "." else text.replace(".", " ").replace(self.decimal, ".")
            if _NUMBER.fullmatch(pointed):
                return float(pointed)
            if is_missing(text):
                return np.nan
            if self.decimal in _GROUPED and _GROUPED[self.decimal].fullmatch(text):
                raise self._complaint(
                    cell,
                    row,
                    column,
                    "thousands-mark",
                    f"it seems to have a thousands mark as well as the decimal {self.decimal!r} of the map: "
                    "save the record without thousands marks, or correct decimal in the map",
                )
            if self.decimal == "." and _NUMBER.fullmatch(text.replace(",", ".", 1)):
                raise self._complaint(cell, row, column, "decimal-comma", 'write decimal = "," under [file] of the map')
            if self.decimal == "," and _NUMBER.fullmatch(text):
                raise self._complaint(cell, row, column, "decimal-point", 'leave decimal = "," out of the map')
        raise self._complaint(
            cell,
            row,
            column,
            "not-a-number",
            "correct it in a copy of the file, or name another column; blanks, dashes, NaN, Inf and OVLD are read as "
            "missing",
        )

    def _complaint(self, cell: Any, row: int, column: int, code: str, repair: str) -> InputError:
        name = self.names[column] or f"number {column}"
        shown = repr(cell) if len(repr(cell)) <= 60 else repr(cell)[:57] + "..."
        return InputError(
            f"{shown} in column {name!r} is not a number",
            code=code,
            where=f"{self.file}: {self.place(row, column)}",
            repair=repair,
        )


def _plain(cells: Sequence[Any]) -> FloatArray | None:
    """Texts that are numbers, read all at once; None where one is anything else, or is written in another way."""
    try:
        # Of these letters alone, what Python reads as a number is what is one here.
        return None if _NOT_OF_NUMBERS.search("\n".join(cells)) else np.array(cells, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def _joined(day: Any, time: Any) -> Any:
    """The date and the time of day of one row as one cell; a blank one where either is."""
    if any(cell is None or not str(cell).strip() for cell in (day, time)):
        return None  # a date alone would be read as its midnight
    if isinstance(day, datetime.datetime) and isinstance(time, datetime.time):
        return datetime.datetime.combine(day.date(), time)
    return f"{day} {time}"


def open_error(path: Any, error: Exception, kind: str) -> InputError:
    """The message for a file that its format's reader cannot make sense of."""
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return InputError(
        f"it cannot be read as {kind}: {reason}",
        code="damaged-file",
        where=str(path),
        repair="see that the file is whole and that the map names its format",
    )
