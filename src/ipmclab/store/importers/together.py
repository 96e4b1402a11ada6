"""Which columns of a record were read together: only their rows belong together."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from ipmclab.errors import InputError
from ipmclab.run import FloatArray
from ipmclab.store.importers.columns import Columns


def refuse_separate_rows(columns: Columns, chosen: Mapping[str, int], numbered: Collection[str]) -> None:
    """Refuse columns that were not read together: their rows would stand at wrong times.

    Parameters
    ----------
    columns : Columns
    chosen : mapping of channel to int
        The number of its column.
    numbered : collection of str
        The channels whose rows an index places.

    Raises
    ------
    InputError
        One column for two channels, other clocks or times, or another number of rows.
    """
    _refuse_one_for_two(columns, chosen)
    clocks = {columns.clocks[number] if columns.clocks else None for number in chosen.values()}
    shown = sorted(f"from {clock.start:g} s every {clock.period:g} s" for clock in clocks if clock is not None)
    if len(shown) > 1:
        raise InputError(
            f"the channels were not read together: {' and '.join(shown)}",
            code="unequal-rates",
            where=columns.file,
            repair="leave the channel of another clock out of the map",
        )
    _refuse_other_times(columns, chosen)
    lengths = {name: len(columns.cells[number]) for name, number in chosen.items() if name not in numbered}
    if len(set(lengths.values())) > 1 and None in clocks:
        raise InputError(
            "the channels have different numbers of rows, and nothing says which belong together: "
            + ", ".join(f"{name} {length}" for name, length in lengths.items()),
            code="unequal-lengths",
            where=columns.file,
            repair="leave the channel of another length out of the map, or give it an index",
        )


def _refuse_one_for_two(columns: Columns, chosen: Mapping[str, int]) -> None:
    """A map may name a column once by its name and once by its number."""
    taken: dict[int, str] = {}
    for name, number in chosen.items():
        if number in taken:
            raise InputError(
                f"column {number} of {columns.file} is mapped to {taken[number]} too",
                code="bad-value",
                where=f"channels.{name}.column",
                repair="name the column of each channel",
            )
        taken[number] = name


def _refuse_other_times(columns: Columns, chosen: Mapping[str, int]) -> None:
    """Where a file gives each column times of its own, they are to be the same within half a row."""
    given = sorted({columns.times[number] for number in chosen.values()}) if columns.times else []
    times = [columns.numbers(number) for number in given]
    for number, other in zip(given[1:], times[1:], strict=True):
        if not _are_near(times[0], other):
            raise InputError(
                f"the channels were not read together: the times in column {number} are not those in column {given[0]}",
                code="unequal-rates",
                where=columns.file,
                repair="leave the channel of another clock out of the map",
            )


def _are_near(times: FloatArray, others: FloatArray) -> bool:
    both = np.isfinite(times) & np.isfinite(others)  # a channel may end before another
    step = np.median(np.diff(times[both])) if np.count_nonzero(both) > 1 else 0.0
    return bool(np.all(np.abs(times[both] - others[both]) <= step / 2))
