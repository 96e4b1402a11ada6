"""The run that a journal holds, block by block: hours of it never stand in memory."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt

from ipmclab.run import QUALITY_FLAGS, SLOW_CHANNELS, Hold, Mark, RunMetadata
from ipmclab.store.journal.guardian_word import EVENT as GUARDIAN
from ipmclab.store.journal.guardian_word import read_word
from ipmclab.store.journal.record import FloatArray, JournalRecord
from ipmclab.store.run_file import CHUNK_ROWS

ENVIRONMENT: Final = "environment"
"""The kind of event that carries readings of the slow channels."""

_MOST_GAP_MARKS: Final = 100
_MISSING: Final = QUALITY_FLAGS["missing"]


@dataclass(frozen=True)
class Layout:
    """What the run file of a journal will hold.

    Parameters
    ----------
    record : JournalRecord
    metadata : RunMetadata
        With the state of the run, and what happened as marks.
    environment : mapping of name to float array
        ``time_environment`` and the slow channels; empty when there are none.
    lengths : mapping of name to int
        Of every array, under its name in files.
    """

    record: JournalRecord
    metadata: RunMetadata
    environment: dict[str, FloatArray]
    lengths: dict[str, int]

    @property
    def hold(self) -> Hold:
        """What the voltage did between rows."""
        return self.record.header.hold

    def blocks(self, stream: BinaryIO) -> Iterator[dict[str, npt.NDArray[Any]]]:
        """The arrays that have a value at each row, in blocks of ``CHUNK_ROWS`` rows (the last is shorter)."""
        columns = self.record.header.columns
        buffer = np.empty((CHUNK_ROWS, len(columns)))
        rows = np.empty(CHUNK_ROWS, dtype=np.int64)
        filled, voltage = 0, 0.0
        for first_row, values in self.record.rows(stream):
            taken = 0
            while taken < len(values):
                room = min(CHUNK_ROWS - filled, len(values) - taken)
                buffer[filled : filled + room] = values[taken : taken + room]
                rows[filled : filled + room] = np.arange(first_row + taken, first_row + taken + room)
                filled, taken = filled + room, taken + room
                if filled == CHUNK_ROWS:
                    block = self._block(rows, buffer, voltage)
                    voltage = float(block["voltage"][-1])
                    yield block
                    filled = 0
        if filled:
            yield self._block(rows[:filled], buffer[:filled], voltage)

    def _block(self, rows: npt.NDArray[np.int64], values: FloatArray, voltage: float) -> dict[str, npt.NDArray[Any]]:
        """Columns as arrays of a run; ``voltage`` [V] is that of the row before."""
        found: dict[str, npt.NDArray[Any]] = {"time": rows / self.record.header.rate}
        for place, name in enumerate(self.record.header.columns):
            column = np.array(values[:, place])
            if name.endswith("_quality"):
                if name in self.lengths:
                    found[name] = column.astype(np.uint8)
                continue
            found[name] = np.where(np.isinf(column), np.nan, column)
        unread = np.isnan(found["voltage"])
        if "voltage_quality" in self.lengths:
            bits = found.get("voltage_quality", np.zeros(len(rows), dtype=np.uint8))
            found["voltage_quality"] = bits | np.where(unread, _MISSING, 0).astype(np.uint8)
        if unread.any():
            found["voltage"] = _filled(found["voltage"], found.get("output_raw"), voltage)
        return found


def layout_of(record: JournalRecord) -> Layout:
    """What the run file of a journal will hold."""
    rows = record.n_rows
    channels = [name for name in record.header.columns if not name.endswith("_quality")]
    lengths = dict.fromkeys(["time", *channels], rows)
    lengths |= {name: rows for name in record.header.columns if name in record.flagged}
    if record.unread_voltages:
        lengths["voltage_quality"] = rows
    environment = _environment(record)
    lengths |= {name: len(values) for name, values in environment.items()}
    state, reason = _state(record)
    known = record.final_metadata or record.header.metadata
    metadata = replace(
        known,
        uuid=record.header.uuid,
        state=state,
        state_reason=reason or None,
        recorded_at=known.recorded_at or record.header.created_at or None,
        marks=_marks(record, known.marks),
    )
    return Layout(record, metadata, environment, lengths)


def _state(record: JournalRecord) -> tuple[Any, str]:
    """The state of the run and the reason for it."""
    dropped = ""
    if record.damage:
        first = record.damage[0]
        dropped = f"{record.bytes_dropped} bytes dropped, the first at byte {first.start}: {first.reason}"
    if record.state is None:
        return "recovered", f"the recording was cut off before its end; {dropped or '0 bytes dropped'}{_output(record)}"
    if not dropped:
        return record.state, record.reason
    said = f"the recording ended {record.state}" + (f" ({record.reason})" if record.reason else "")
    return "recovered", f"{said}, but its journal is damaged; {dropped}"


def _output(record: JournalRecord) -> str:
    """What is known of the output after a recording that was cut off, where a guardian watched over it."""
    named = next((event.text for event in record.events if event.kind == GUARDIAN), "")
    if not named:
        return ""
    return f"; {read_word(record.path.with_name(Path(named).name), since=record.path.stat().st_mtime)}"


def _marks(record: JournalRecord, known: tuple[Mark, ...]) -> tuple[Mark, ...]:
    rate = record.header.rate
    marks = [*known, *(Mark(e.time, e.text, e.kind) for e in record.events if e.kind not in (ENVIRONMENT, GUARDIAN))]
    reported = [mark.time for mark in marks if mark.kind == "gap"]
    gaps = [
        (start, stop)
        for start, stop in record.gaps
        if not any((start - 1) / rate <= time <= (stop + 1) / rate for time in reported)
    ]
    for start, stop in gaps[:_MOST_GAP_MARKS]:
        rows = f"row {start} is" if stop - start == 1 else f"rows {start} to {stop - 1} are"
        marks.append(Mark(start / rate, f"{rows} missing ({(stop - start) / rate:.6g} s)", "gap"))
    if len(gaps) > _MOST_GAP_MARKS:
        more = gaps[_MOST_GAP_MARKS:]
        count = sum(stop - start for start, stop in more)
        marks.append(Mark(more[0][0] / rate, f"{len(more)} more gaps from here on, {count} rows", "gap"))
    if record.unread_voltages:
        text = f"the voltage could not be read in {record.unread_voltages} rows: what was commanded is there"
        marks.append(Mark(0.0, text, "bench"))
    return tuple(sorted(dict.fromkeys(marks), key=lambda mark: mark.time))


def _environment(record: JournalRecord) -> dict[str, FloatArray]:
    times: list[float] = []
    readings: dict[str, list[float]] = {name: [] for name in SLOW_CHANNELS}
    for event in record.events:
        if event.kind != ENVIRONMENT or (times and event.time <= times[-1]):
            continue
        times.append(event.time)
        for name, values in readings.items():
            value = event.values.get(name)
            values.append(float(value) if isinstance(value, int | float) and math.isfinite(value) else math.nan)
    arrays = {name: np.array(values) for name, values in readings.items() if not np.isnan(values).all()}
    return {"time_environment": np.array(times), **arrays} if arrays else {}


def _filled(voltage: FloatArray, output: FloatArray | None, before: float) -> FloatArray:
    """The voltage, with what was commanded (or else the last one read) where it could not be read."""
    if output is not None:
        voltage = np.where(np.isnan(voltage), output, voltage)
    padded = np.concatenate([[before], voltage])
    last = np.maximum.accumulate(np.where(np.isnan(padded), 0, np.arange(len(padded))))
    return np.asarray(padded[last][1:], dtype=np.float64)
