"""The arrays of a run: what is refused of the columns that somebody gives."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest

FloatArray = npt.NDArray[np.float64]


def read_only(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The array, which cannot be written to through this."""
    if not values.flags.writeable:
        return values
    view = values.view()
    view.setflags(write=False)
    return view


def as_column(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        given: Any = np.ma.asarray(values)  # NumPy would show what a mask hides, such as the fill value of a file
        if given.dtype.kind in "cmM":
            raise TypeError(f"{given.dtype} is not a real number")  # NumPy would drop the imaginary part or the unit
        column = np.array(given.astype(np.float64).filled(np.nan))
    except (TypeError, ValueError) as error:
        raise InputError(
            "not an array of numbers", code="bad-array", where=name, repair="give a one-dimensional array of floats"
        ) from error
    if column.ndim != 1:
        raise InputError(
            f"the array has shape {column.shape}, it must have one dimension",
            code="bad-array",
            where=name,
            repair="give one column",
        )
    return column


def as_readings(name: str, values: npt.ArrayLike, length: int) -> FloatArray:
    column = as_column(name, values)
    if len(column) != length:
        raise InputError(
            f"{len(column)} values for {length} times",
            code="unequal-lengths",
            where=name,
            repair="give one value for each time",
        )
    infinite = np.flatnonzero(np.isinf(column))
    if len(infinite):
        raise InputError(
            f"sample {infinite[0]} is infinite",
            code="infinite-reading",
            where=name,
            repair="use NaN for a missing reading",
        )
    return column


def check_names(what: str, given: Collection[str], known: Collection[str]) -> None:
    """Refuse what belongs to no channel."""
    for name in given:
        if name not in known:
            words = "raw readings" if what == "raw" else what
            raise InputError(
                f"{words} of no channel: {name!r}", code="unknown-channel", where=what, repair=suggest(name, known)
            )


def as_flags(name: str, values: npt.ArrayLike, columns: Mapping[str, FloatArray]) -> npt.NDArray[np.uint8]:
    """The quality of a channel: bits for each of its values."""
    if name not in columns:
        raise InputError(
            f"quality for a channel that is not there: {name!r}",
            code="unknown-channel",
            where="quality",
            repair="leave it out",
        )
    flags = _bits(name, values)
    if flags.shape != columns[name].shape:
        raise InputError(
            f"{flags.size} flags for {columns[name].size} values",
            code="unequal-lengths",
            where=f"{name}_quality",
            repair="give one flag for each value",
        )
    return flags


def _bits(name: str, values: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    given = np.asarray(values)
    whole = given.dtype.kind in "biuf" and bool(np.all((given >= 0) & (given <= 255) & (given % 1 == 0)))
    if not whole:
        raise InputError(
            "not an array of quality bits",
            code="bad-quality",
            where=f"{name}_quality",
            repair="give whole numbers from 0 to 255, sums of QUALITY_FLAGS",
        )
    return np.ascontiguousarray(given, dtype=np.uint8)


def check_time(name: str, times: FloatArray, *, least: int = 2) -> None:
    """Refuse times that do not increase.

    Parameters
    ----------
    name : str
        What the messages name.
    times : float array, shape (n_time,) [s]
    least : int
        Rows that there must be.

    Raises
    ------
    InputError
        Too few rows, a time that is not finite or not after the one before.
    """
    if len(times) < least:
        raise InputError(
            f"{len(times)} rows, at least {least} are needed",
            code="too-short",
            where=name,
            repair="give a longer record",
        )
    if not np.all(np.isfinite(times)):
        row = int(np.flatnonzero(~np.isfinite(times))[0])
        raise InputError(f"row {row} is {times[row]}", code="bad-time", where=name, repair="every row needs its time")
    backwards = np.flatnonzero(np.diff(times) <= 0)
    if len(backwards):
        row = int(backwards[0]) + 1
        raise InputError(
            f"row {row} is at {times[row]:.9g} s, not after {times[row - 1]:.9g} s",
            code="bad-time",
            where=name,
            repair="sort the rows, or repair the clock",
        )
