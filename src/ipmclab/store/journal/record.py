"""What is in a journal, also in one that a crash has cut or that a disk has damaged."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.run import RunMetadata
from ipmclab.store.document import parse_metadata
from ipmclab.store.journal.frames import DATA, END, EVENT, HEADER, HEADER_SIZE, Damage, Frame, read_frames
from ipmclab.store.journal.header import JournalHeader

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Event:
    """Something that happened at a time [s] of the record, with the numbers that belong to it."""

    kind: str
    time: float
    text: str = ""
    values: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Piece:
    """Rows that follow each other: the first of them, how many, and where they start in the file."""

    first_row: int
    rows: int
    offset: int


@dataclass(frozen=True)
class JournalRecord:
    """What a journal holds, without its rows, which ``rows`` reads piece by piece.

    Parameters
    ----------
    path : path
    header : JournalHeader
    pieces : tuple of Piece
    events : tuple of Event
    state : "complete", "aborted" or None
        How it says that it ended; None when it was cut before that.
    reason : str
    final_metadata : RunMetadata, optional
        What was known at the end.
    damage : tuple of Damage
        What is no whole frame.
    flagged : frozenset of str
        The columns of quality bits that have any.
    unread_voltages : int
        Rows whose voltage is not a finite number.
    """

    path: Path
    header: JournalHeader
    pieces: tuple[Piece, ...]
    events: tuple[Event, ...]
    state: Literal["complete", "aborted"] | None
    reason: str
    final_metadata: RunMetadata | None
    damage: tuple[Damage, ...]
    flagged: frozenset[str]
    unread_voltages: int

    @property
    def n_rows(self) -> int:
        """How many rows there are."""
        return sum(piece.rows for piece in self.pieces)

    @property
    def bytes_dropped(self) -> int:
        """Bytes that are no whole frame."""
        return sum(len(damage) for damage in self.damage)

    @property
    def gaps(self) -> tuple[tuple[int, int], ...]:
        """Rows that are missing before the last, as half-open ranges."""
        found = []
        expected = 0
        for piece in self.pieces:
            if piece.first_row > expected:
                found.append((expected, piece.first_row))
            expected = piece.first_row + piece.rows
        return tuple(found)

    def rows(self, stream: BinaryIO | None = None) -> Iterator[tuple[int, FloatArray]]:
        """The rows, piece by piece: the row of the run that the first is, and an array (n_rows, n_columns)."""
        if stream is None:
            with self.path.open("rb") as opened:
                yield from self.rows(opened)
            return
        columns = len(self.header.columns)
        for piece in self.pieces:
            stream.seek(piece.offset)
            yield piece.first_row, _values(stream.read(piece.rows * columns * 8), piece.rows, columns)


def read_journal(path: str | os.PathLike[str], stream: BinaryIO | None = None) -> JournalRecord:
    """Read what is in a journal; it may be one that is still being written.

    Parameters
    ----------
    path : str or path
    stream : binary file, optional
        The journal where it is open already.

    Raises
    ------
    InputError
        No such file, or one without a readable header.

    Examples
    --------
    >>> read_journal("nowhere.runj")
    Traceback (most recent call last):
    ipmclab.errors.InputError: nowhere.runj: it cannot be opened: No such file or directory; see where it was recorded
    """
    source = Path(path)
    if stream is None:
        with _opened(source) as opened:
            return read_journal(source, opened)
    return _Collector(source, _header(stream, str(path))).collect(read_frames(stream))


def read_header(path: str | os.PathLike[str]) -> JournalHeader:
    """Read only what a journal says of itself.

    Raises
    ------
    InputError
        No such file, or one without a readable header.
    """
    with _opened(Path(path)) as stream:
        return _header(stream, str(path))


def _opened(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise InputError(
            f"it cannot be opened: {error.strerror or error}",
            code="unreadable-file",
            where=str(path),
            repair="see where it was recorded",
        ) from error


def _header(stream: BinaryIO, where: str) -> JournalHeader:
    """What a journal says of itself: in its first frame or, where that is damaged, in the first whole copy of it."""
    rows, is_empty = 0, True
    for item in read_frames(stream):
        is_empty = False
        if isinstance(item, Frame):
            if item.kind == HEADER:
                return JournalHeader.from_json(item.payload, where=where)
            rows += item.rows
    if rows:
        raise InputError(
            f"its header is damaged, and there is no copy of it: {rows} rows are whole, but nothing says what they are",
            code="header-lost",
            where=where,
            repair="ipmclab recover writes them as numbered columns",
        )
    raise InputError(
        "it is empty (0 bytes)" if is_empty else "its first frame is no header of a journal",
        code="empty-file" if is_empty else "not-a-journal",
        where=where,
        repair="what is in it cannot be read",
    )


class _Collector:
    """Gathers what the frames of a journal say."""

    def __init__(self, path: Path, header: JournalHeader) -> None:
        self.path = path
        self.header = header
        self.pieces: list[Piece] = []
        self.events: list[Event] = []
        self.damage: list[Damage] = []
        self.flagged: set[str] = set()
        self.unread_voltages = 0
        self.end: dict[str, Any] = {}
        self.metadata: RunMetadata | None = None
        self.next_row = 0

    def collect(self, found: Iterator[Frame | Damage]) -> JournalRecord:
        for item in found:
            if isinstance(item, Damage):
                self.damage.append(item)
            elif item.kind == DATA:  # a header is the first frame, or a copy of it
                self._add_rows(item)
            elif item.kind in (EVENT, END):
                self._add_note(item)
        return JournalRecord(
            path=self.path,
            header=self.header,
            pieces=tuple(self.pieces),
            events=tuple(self.events),
            state=self.end.get("state"),
            reason=str(self.end.get("reason", "")),
            final_metadata=self.metadata,
            damage=tuple(self.damage),
            flagged=frozenset(self.flagged),
            unread_voltages=self.unread_voltages,
        )

    def _add_rows(self, frame: Frame) -> None:
        columns = self.header.columns
        if frame.columns != len(columns) or frame.first_row < self.next_row or not frame.rows:
            self.damage.append(Damage(frame.offset, frame.offset + len(frame), "a frame does not fit the header"))
            return
        values = _values(frame.payload, frame.rows, frame.columns)
        for place, name in enumerate(columns):
            if name.endswith("_quality") and values[:, place].any():
                self.flagged.add(name)
        self.unread_voltages += int(np.count_nonzero(~np.isfinite(values[:, columns.index("voltage")])))
        self.pieces.append(Piece(frame.first_row, frame.rows, frame.offset + HEADER_SIZE))
        self.next_row = frame.first_row + frame.rows

    def _add_note(self, frame: Frame) -> None:
        try:
            table = json.loads(frame.payload)
            if frame.kind == END:
                if table["state"] not in ("complete", "aborted"):
                    raise ValueError(table["state"])
                if "metadata" in table:
                    self.metadata = parse_metadata(table["metadata"], where=f"{self.path}: metadata")
                self.end = table
                return
            time = float(table["time"])
            if math.isfinite(time):
                self.events.append(Event(str(table["kind"]), time, str(table["text"]), dict(table.get("values", {}))))
        except (ValueError, KeyError, TypeError):
            self.damage.append(Damage(frame.offset, frame.offset + len(frame), "a frame holds neither event nor end"))


def _values(payload: bytes, rows: int, columns: int) -> FloatArray:
    return np.asarray(np.frombuffer(payload, dtype="<f8").reshape(rows, columns), dtype=np.float64)
