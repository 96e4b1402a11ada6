"""A foreign record and its import map become a run."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds
from ipmclab.run import QUALITY_FLAGS, FloatArray, Run
from ipmclab.store.document import locate
from ipmclab.store.exports.formats import format_of
from ipmclab.store.import_map import ChannelMap, ImportMap, load_import_map
from ipmclab.store.imported_channel import ImportedChannel, read_channel, zeroed_channel
from ipmclab.store.importers import read_columns
from ipmclab.store.importers.columns import Clock, Columns
from ipmclab.store.importers.together import refuse_separate_rows
from ipmclab.store.importers.unpacked import refuse_large
from ipmclab.units import CHANNELS

# The voltage has changed when it has left its first value by this part of its largest change; what stays within so
# many volts is noise.
_CHANGE = 0.05
_NO_VOLTAGE = 0.01


@tell_kinds
def import_run(path: str | os.PathLike[str], map: str | os.PathLike[str] | ImportMap | None = None) -> Run:  # noqa: A002
    """Read a foreign record as a run.

    Parameters
    ----------
    path : str or path
        The record.
    map : ImportMap, str or path, optional
        What its columns mean, or the TOML file that says so. A file that ``export_run`` wrote needs none.

    Returns
    -------
    run : Run
        All channels in SI units, positive as ipmclab counts; a sentinel is NaN with the
        quality flag ``sentinel``, a blank or infinite reading NaN with the flag ``missing``.

    Raises
    ------
    InputError
        A file that is missing, empty, truncated or not what the map says; a column that is
        not there; a cell that is not a number; time that does not increase.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> table = {
    ...     "file": {"format": "csv", "separator": ";"},
    ...     "sampling_period": "20 ms",
    ...     "channels": {"voltage": {"column": "U", "unit": "V"}, "current": {"column": "I", "unit": "mA"}},
    ... }
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "record.csv"
    ...     _ = file.write_text("U;I\\n0;0\\n1;60\\n1;Inf\\n")
    ...     run = import_run(file, ImportMap.from_table(table))
    >>> run.current, run.quality["current"]
    (array([0.  , 0.06,  nan]), array([0, 0, 1], dtype=uint8))
    """
    source = Path(path)
    check_source(source)
    if map is None:
        return _read_own_export(source)
    import_map = map if isinstance(map, ImportMap) else load_import_map(map)
    columns = read_columns(source, import_map.file)
    chosen = {
        name: columns.find(channel.column, where=f"channels.{name}.column")
        for name, channel in import_map.channels.items()
    }
    refuse_separate_rows(
        columns, chosen, [name for name, channel in import_map.channels.items() if channel.index is not None]
    )
    channels = {
        name: read_channel(name, channel, columns, chosen[name]) for name, channel in import_map.channels.items()
    }
    channels = _counted_from_zero(import_map, channels)
    n_rows = 1 + max((int(channel.rows[-1]) for channel in channels.values() if len(channel.rows)), default=-1)
    start, stop = import_map.rows or (0, n_rows)
    if stop > n_rows:
        raise InputError(
            f"rows {start} to {stop}, but the file has {n_rows}",
            code="out-of-range",
            where=f"{source}: rows",
            repair=f"end at {n_rows} or before",
        )
    channels = {name: channel.over_all_rows(n_rows) for name, channel in channels.items()}
    _check_zero_rows(import_map, channels["voltage"].values, (start, stop), source)
    channels = {
        name: zeroed_channel(channel, name, import_map.channels[name], source).rows_earlier(
            import_map.channels[name].rows_late
        )
        for name, channel in channels.items()
    }
    time = channels.pop("time").values if "time" in channels else _clock(import_map, columns, n_rows, chosen)
    kept = np.arange(start, stop)
    if "time" in import_map.channels:
        kept = _rows_in_time(time, kept, import_map.channels["time"], columns)
    from ipmclab.version import __version__

    metadata = replace(
        import_map.run_metadata(),
        sampling_period_known=import_map.sampling_period is None,
        ranges={name: channel.limits for name, channel in channels.items() if channel.limits is not None},
        calibrations={name: channel.scaling for name, channel in channels.items()},
        source_file=source.name,
        software_version=__version__,
    )
    return locate(
        str(source),
        Run.from_arrays,
        time=time[kept],
        quality={name: channel.flags[kept] for name, channel in channels.items() if channel.flags[kept].any()},
        hold=import_map.hold,
        metadata=metadata,
        **{name: channel.values[kept] for name, channel in channels.items()},
    )


def unmet_sentinels(run: Run, map: ImportMap) -> list[str]:  # noqa: A002  # as in import_run
    """Of each channel whose sentinels stand for no reading of the file, as after ``-99,9`` with a comma, a sentence."""
    flags = {name: run.quality.get(name, np.zeros(0, dtype=np.uint8)) for name in map.channels}
    return [
        f"No reading of the {CHANNELS[name].name} is {' or '.join(f'{one:g}' for one in channel.sentinels)}"
        for name, channel in map.channels.items()
        if channel.sentinels and name in CHANNELS and not (flags[name] & QUALITY_FLAGS["sentinel"]).any()
    ]


def _counted_from_zero(import_map: ImportMap, channels: Mapping[str, ImportedChannel]) -> dict[str, ImportedChannel]:
    """Channels whose index columns count from 0: where all of them begin at 1 or later, they count from 1."""
    own = {name: one for name, one in channels.items() if import_map.channels[name].index is not None}
    first = min((int(one.rows[0]) for one in own.values() if len(one.rows)), default=0)
    if first != 1 or not channels.keys() - {"time"} <= own.keys():
        return dict(channels)
    return {name: replace(one, rows=one.rows - 1) if name in own else one for name, one in channels.items()}


def check_source(source: Path) -> None:
    """Refuse a file that is not there, a folder, an empty file, and one that holds more than memory can."""
    where = str(source)
    try:
        about = source.stat()
    except (OSError, ValueError) as error:
        raise InputError(
            "no such file", code="no-such-file", where=where, repair="see where the record was saved"
        ) from error
    if stat.S_ISDIR(about.st_mode):
        raise InputError("this is a folder", code="is-a-folder", where=where, repair="name a record in it")
    if about.st_size == 0:
        raise InputError(
            "the file is empty (0 bytes)",
            code="empty-file",
            where=where,
            repair="copy it again from where it was recorded",
        )
    refuse_large(source)


def is_own_export(path: str | os.PathLike[str]) -> bool:
    """Whether ipmclab exported a file, so that it needs no map.

    Raises
    ------
    InputError
        No such file, an empty one, or an export that was changed since.
    """
    check_source(Path(path))
    try:
        _read_own_export(Path(path))
    except InputError as error:
        if error.code == "missing-map":
            return False
        raise
    return True


def _read_own_export(source: Path) -> Run:
    run: Run | None = None
    if source.suffix.lower() in (".csv", ".xlsx", ".mat"):
        try:
            run = format_of(source).read_back(source)
        except InputError as error:
            if error.code != "bad-encoding":  # our own text is UTF-8
                raise
    if run is None:
        raise InputError(
            "not a file that ipmclab exported: nothing says what its columns mean",
            code="missing-map",
            where=str(source),
            repair="read a run file with read_run"
            if source.suffix == ".nc"
            else "give an import map: guess_map makes one",
        )
    return run


def _rows_in_time(
    time: FloatArray, rows: npt.NDArray[np.int64], channel: ChannelMap, columns: Columns
) -> npt.NDArray[np.int64]:
    """The rows with a time after the one before; refuses others, save those that the map drops."""
    if channel.duplicates == "drop":
        rows = rows[np.append(True, np.diff(time[rows]) != 0.0)]  # the first row has none before it
    wrong = np.flatnonzero(~(np.diff(time[rows], prepend=-np.inf) > 0))
    if not len(wrong):
        return rows
    here, before = int(rows[wrong[0]]), int(rows[wrong[0] - 1])
    number = columns.find(channel.column, where="channels.time.column")
    where = f"{columns.file}: {columns.place(here, number)}"
    if np.isnan(time[here]):
        message, repair = "the row has no time", "cut the record there with rows in the map, or give the row its time"
    elif time[here] == time[before]:
        again = int(np.count_nonzero(np.diff(time[rows]) == 0.0))
        message = f"the time {time[here]:.9g} s is that of the row before ({again} such rows in all)"
        repair = 'write duplicates = "drop" under [channels.time] of the map to keep the first row of each time'
    else:
        message = f"the time {time[here]:.9g} s is not after that of the row before, {time[before]:.9g} s"
        repair = "sort the rows, or cut the record there with rows in the map"
    raise InputError(message, code="bad-time", where=where, repair=repair)


def _check_zero_rows(import_map: ImportMap, voltage: FloatArray, rows: tuple[int, int], source: Path) -> None:
    """Refuse a zero that is taken after the voltage has changed: the strip is then no longer at rest.

    The voltage counts from the zero, or the first of the rows that are taken, to the last of them.
    """
    for name, channel in import_map.channels.items():
        if channel.zero_rows is None:
            continue
        first, stop = min(channel.zero_rows[0], rows[0]), max(channel.zero_rows[1], rows[1])
        counted = voltage[first:stop]
        moved = np.abs(counted - next(iter(counted[np.isfinite(counted)]), np.nan))
        largest = float(np.fmax.reduce(moved, initial=0.0))  # a gap is no change
        if not largest > _NO_VOLTAGE:
            continue
        change = first + int(np.argmax(moved > _CHANGE * largest))
        if channel.zero_rows[1] > change:
            raise InputError(
                f"rows {list(channel.zero_rows)} are to be at rest, but the voltage changes at row {change}",
                code="zero-after-change",
                where=f"{source}: channels.{name}.zero_rows",
                repair=f"end at {change} or before, or give the reading at rest as zero_at",
            )


def _clock(import_map: ImportMap, columns: Columns, n_rows: int, chosen: Mapping[str, int]) -> FloatArray:
    clocks = [columns.clocks[number] for number in chosen.values()] if columns.clocks else []
    recorded = next((clock for clock in clocks if clock is not None), None)  # there is one at most
    stated = import_map.period
    start, period = recorded or Clock(0.0, stated or 0.0)
    if recorded and stated is not None:
        raise InputError(
            f"the map states a sampling period of {stated:g} s, but the file records {period:g} s",
            code="period-mismatch",
            where=f"{columns.file}: sampling_period",
            repair="leave it out of the map",
        )
    if not period > 0:
        raise InputError(
            "neither the map nor the file says when the rows were read",
            code="no-time",
            where=columns.file,
            repair="add [channels.time] or sampling_period to the map",
        )
    rows = np.arange(n_rows, dtype=np.float64)
    # k / 25 is nearer to the decimal than k * 0.04: row 3 is at 0.12 s, not at 0.12000000000000001 s.
    rate = round(1.0 / period, 9)
    return start + (rows / rate if rate * period == 1.0 else rows * period)
