"""The journal of a run that is being recorded: what was acknowledged is on the disk, whatever happens next."""

from __future__ import annotations

import errno
import json
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import is_still_at, lock_file, reserve, sync_file, sync_folder
from ipmclab.run import RunMetadata
from ipmclab.store.document import metadata_table
from ipmclab.store.journal.frames import DATA, END, EVENT, HEADER, Frame
from ipmclab.store.journal.header import JournalHeader as JournalHeader
from ipmclab.store.journal.laboratory import BALLAST, Laboratory
from ipmclab.store.journal.record import read_header as read_header
from ipmclab.store.journal.record import read_journal as read_journal

COMMIT_TIME: Final = 0.4
"""How long [s] rows wait for the next write: with the write itself well below the second that may be lost."""

QUEUE_BYTES: Final = 64 << 20
"""What may wait for a slow disk: 16 s of 4 channels with their raw volts at 60 kS/s each."""

_BATCH_BYTES: Final = 8 << 20
_PATIENCE: Final = 0.4  # seconds that ``append`` waits for room: less than the guardian waits for the recorder
_END_TIME: Final = 30.0  # seconds that the last write may take


class JournalError(IpmclabError):
    """The journal cannot be written any more (exit status 1). What was acknowledged is safe.

    ``code`` is ``"disk-full"``, ``"disk-slow"`` or ``"write-failed"``.
    """


@dataclass(frozen=True)
class _Rows:
    first_row: int
    values: npt.NDArray[np.float64]

    @property
    def size(self) -> int:
        return self.values.nbytes


@dataclass(frozen=True)
class _Note:
    kind: int
    payload: bytes

    @property
    def size(self) -> int:
        return len(self.payload)


class Journal:
    """The file that is written while a run is recorded.

    Rows and events go into a queue; a thread of its own writes them, one write and one sync at most every
    ``COMMIT_TIME``, so that a slow disk does not hold the recorder up. When a write fails, the file is cut back to its
    last whole frame, the next call raises, and what was not written is kept for ``end``, which first frees the room
    that was held back.

    Use ``Journal.create``; a journal may be used from one thread at a time, its properties from any.

    Examples
    --------
    >>> import tempfile
    >>> header = JournalHeader("3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee", 50.0, ("voltage", "current"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     journal = Journal.create(folder, header)
    ...     journal.append(0, [[0.0, 0.0], [1.0, 0.06]])
    ...     journal.event("note", 0.01, "touched the bench")
    ...     path = journal.end("complete")
    ...     read_journal(path).n_rows, journal.acknowledged
    (2, 2)
    """

    def __init__(
        self,
        path: Path,
        header: JournalHeader,
        descriptor: int,
        ballast: Path | None,
        on_commit: Callable[[int], None] | None,
    ) -> None:
        self.path = path
        self.header = header
        self._descriptor = descriptor
        self._is_open = True
        self._ballast = ballast
        self._on_commit = on_commit
        self._size = 0
        self._sequence = 0
        self._copy_at = 1
        self._header_payload = b""
        self._next_row = 0
        self._acknowledged = 0
        self._queue: deque[_Rows | _Note] = deque()
        self._queued = 0
        self._failure: Exception | None = None
        self._closing = False
        self._changed = threading.Condition()
        self._writer = threading.Thread(target=self._work, name=f"journal {header.uuid}", daemon=True)

    @classmethod
    def create(
        cls,
        laboratory: Laboratory | str | os.PathLike[str],
        header: JournalHeader,
        *,
        ballast: int = BALLAST,
        on_commit: Callable[[int], None] | None = None,
    ) -> Journal:
        """Make the journal of a new run: its header is on the disk when this returns.

        Parameters
        ----------
        laboratory : Laboratory or path
        header : JournalHeader
        ballast : int [bytes]
            What is held back for the end on a full disk.
        on_commit : callable of int, optional
            Called with ``acknowledged`` after each write, by the writing thread.

        Raises
        ------
        InputError
            A header that no file can keep, a journal of this run that is there already, a disk without room.
        IpmclabError
            The system refuses to write there.
        """
        laboratory = Laboratory.open(laboratory)
        header = replace(header, created_at=header.created_at or datetime.now().astimezone().isoformat("T", "seconds"))
        first = header.to_json()
        path, held = laboratory.journal(header.uuid), laboratory.ballast(header.uuid)
        try:
            descriptor = _create_locked(path)
        except FileExistsError as error:
            raise InputError(
                "this run has a journal already",
                code="file-exists",
                where=str(path),
                repair="give each run an id of its own; ipmclab recover finishes what a crash left",
            ) from error
        except OSError as error:
            raise _failed(path, error) from error
        journal = cls(path, header, descriptor, held if ballast else None, on_commit)
        journal._header_payload = first
        try:
            if ballast:
                _hold_room(held, ballast)
            journal._commit([_Note(HEADER, first)])
            sync_folder(path.parent)
        except OSError as error:
            journal._close()
            path.unlink(missing_ok=True)
            full = InputError(
                f"the disk has no room for a run: {laboratory.free_space() / 1e6:.0f} MB are free, "
                f"{ballast / 1e6:.0f} MB are held back alone for ending it safely",
                code="no-room",
                where=str(laboratory.root),
                repair="free some room, or record to another disk",
            )
            raise (full if error.errno == errno.ENOSPC else _failed(path, error)) from error
        journal._writer.start()
        return journal

    @property
    def acknowledged(self) -> int:
        """How many rows are on the disk: these are there again after a crash."""
        return self._acknowledged

    @property
    def failure(self) -> JournalError | None:
        """Why nothing can be written any more; None while all is well."""
        return _failed(self.path, self._failure) if self._failure else None

    def append(self, first_row: int, columns: npt.ArrayLike) -> None:
        """Add rows.

        Parameters
        ----------
        first_row : int
            Row of the run that the first one is. Rows that are left out are a gap: it stays visible in the run.
        columns : float array, shape (n_rows, n_columns) [SI]
            In the order of the header's columns.

        Raises
        ------
        InputError
            Another number of columns, or rows that were there already.
        JournalError
            An earlier write failed, or the disk has been too slow for too long.
        """
        values = np.array(columns, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != len(self.header.columns):
            raise InputError(
                f"an array of shape {values.shape} for {len(self.header.columns)} columns",
                code="bad-array",
                where="journal",
                repair=f"give the columns {', '.join(self.header.columns)} of each row",
            )
        if first_row < self._next_row:
            raise InputError(
                f"row {first_row} was there already: the next is row {self._next_row}",
                code="bad-row",
                where="journal",
                repair="give each row once, in order",
            )
        if len(values):
            self._put(_Rows(int(first_row), values))
            self._next_row = int(first_row) + len(values)

    def event(self, kind: str, time: float, text: str = "", **values: float | str | None) -> None:
        """Add something that happened.

        Parameters
        ----------
        kind : str
            ``"environment"`` with ``temperature`` [degC], ``relative_humidity`` [percent] and the chamber's own, under
            the names of ``SLOW_CHANNELS``, which become readings;
            anything else (``"note"``, ``"limit"``, ``"gap"``, ``"bench"``, ``"stop"``) becomes a mark.
        time : float [s]
            Of the record.
        text : str
        **values
            Numbers that belong to it.

        Raises
        ------
        InputError
            Values that no file can keep.
        JournalError
            An earlier write failed, or the disk has been too slow for too long.
        """
        try:
            payload = json.dumps(
                {"kind": kind, "time": float(time), "text": text, **({"values": values} if values else {})},
                allow_nan=False,
                default=float,  # a number of NumPy
            ).encode()
        except (TypeError, ValueError) as error:
            raise InputError(
                f"the event {kind!r} cannot be written: {error}",
                code="bad-event",
                where="journal",
                repair="give finite numbers and texts",
            ) from error
        self._put(_Note(EVENT, payload))

    def end(self, state: Literal["complete", "aborted"], reason: str = "", metadata: RunMetadata | None = None) -> Path:
        """Write what is left and how the recording ended, and let go of the file. A second call does nothing.

        Parameters
        ----------
        state : "complete" or "aborted"
        reason : str
            Why it was aborted.
        metadata : RunMetadata, optional
            What is known at the end; it takes the place of the header's.

        Returns
        -------
        path : path
            Of the journal, for ``finalise``.

        Raises
        ------
        InputError
            Another state, or metadata that no file can keep: the journal is still open then.
        JournalError
            Not even the room that was held back is enough. What was acknowledged is safe: ``recover`` finishes it.
        """
        if not self._is_open:
            return self.path
        if state not in ("complete", "aborted"):
            raise InputError(
                f"a recording does not end {state!r}",
                code="bad-state",
                where="journal",
                repair='end it "complete" or "aborted"',
            )
        table: dict[str, Any] = {"state": state, "reason": reason}
        if metadata is not None:
            table["metadata"] = metadata_table(metadata)
        self._stop_writing()
        try:
            if self._failure is not None:
                self._free_room()
            while self._queue:  # piece by piece: what has room is kept
                batch, _ = self._batch()
                self._commit(batch)
                for _ in batch:
                    self._queue.popleft()
            self._commit_end(_Note(END, json.dumps(table).encode()))
        except OSError as error:
            self._failure = error
            raise _failed(self.path, error) from error
        finally:
            self._close()
        return self.path

    def close(self) -> None:
        """Let go of the file without an end, as a crash would: ``recover`` makes a run of it. May be called twice."""
        if self._is_open:
            self._stop_writing()
            self._close()

    def _put(self, item: _Rows | _Note) -> None:
        with self._changed:
            if self._closing:
                raise JournalError(
                    "the recording has ended", code="write-failed", where=str(self.path), repair="begin another run"
                )
            self._changed.wait_for(lambda: self._failure or self._queued < QUEUE_BYTES, timeout=_PATIENCE)
            if self._failure is not None:
                raise _failed(self.path, self._failure) from self._failure
            if self._queued >= QUEUE_BYTES:
                raise JournalError(
                    f"the disk is too slow: {self._queued / 1e6:.0f} MB wait to be written",
                    code="disk-slow",
                    where=str(self.path),
                    repair="record to a local disk, with fewer channels or at a lower rate",
                )
            self._queue.append(item)
            self._queued += item.size
            self._changed.notify_all()

    def _work(self) -> None:
        """Write what is queued, until the end; the body of the writing thread."""
        last = time.monotonic() - COMMIT_TIME
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._closing)
                wait = last + COMMIT_TIME - time.monotonic()
                self._changed.wait_for(lambda: self._closing or self._queued >= _BATCH_BYTES, timeout=max(0.0, wait))
                batch, size = self._batch()
            if not batch:
                return
            last = time.monotonic()
            try:
                self._commit(batch)
            except Exception as error:  # also one that nobody thought of: the recorder must hear of it
                with self._changed:
                    self._failure = error
                    self._changed.notify_all()
                return
            with self._changed:
                for _ in batch:
                    self._queue.popleft()
                self._queued -= size
                self._changed.notify_all()
            if self._on_commit is not None:
                with suppress(Exception):  # whoever listens must not end the recording
                    self._on_commit(self._acknowledged)

    def _commit_end(self, end: _Note) -> None:
        try:
            self._commit([end])
        except OSError:
            self._free_room()
            self._commit([end])

    def _batch(self) -> tuple[list[_Rows | _Note], int]:
        """What is written next. It stays in the queue until it is on the disk."""
        batch: list[_Rows | _Note] = []
        size = 0
        for item in self._queue:
            if size >= _BATCH_BYTES:
                break
            batch.append(item)
            size += item.size
        return batch, size

    def _commit(self, items: list[_Rows | _Note]) -> None:
        """Bring items to the disk: one write, one sync; or none of them, and the error."""
        frames, rows = self._frames(items)
        is_copied = bool(rows) and self._sequence >= self._copy_at
        if is_copied:
            # A disk that damages the first frame must not take the rows with it. The copies lie ever further apart:
            # few of them, also in a journal of hours, and one of them near wherever a journal is cut.
            frames.append(Frame(HEADER, self._header_payload, self._sequence + len(frames)))
        data = memoryview(b"".join(frame.encode() for frame in frames))
        try:
            left = data
            while len(left):
                left = left[os.write(self._descriptor, left) :]
            sync_file(self._descriptor)
        except OSError:
            os.ftruncate(self._descriptor, self._size)
            raise
        self._size += len(data)
        self._sequence += len(frames)
        if is_copied:
            self._copy_at = 2 * self._sequence
        self._acknowledged += rows

    def _frames(self, items: list[_Rows | _Note]) -> tuple[list[Frame], int]:
        """Items as frames: rows that follow each other go into one."""
        frames: list[Frame] = []
        pieces: list[_Rows] = []
        total = 0

        def close_piece() -> None:
            if not pieces:
                return
            values = np.concatenate([piece.values for piece in pieces], dtype="<f8")
            sequence = self._sequence + len(frames)
            frames.append(Frame(DATA, values.tobytes(), sequence, values.shape[1], len(values), pieces[0].first_row))
            pieces.clear()

        for item in items:
            if isinstance(item, _Note):
                close_piece()
                frames.append(Frame(item.kind, item.payload, self._sequence + len(frames)))
                continue
            if pieces and item.first_row != pieces[-1].first_row + len(pieces[-1].values):
                close_piece()
            pieces.append(item)
            total += len(item.values)
        close_piece()
        return frames, total

    def _stop_writing(self) -> None:
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._writer.join(_END_TIME)
        if self._writer.is_alive():
            raise JournalError(
                f"the disk has not answered for {_END_TIME:.0f} s",
                code="disk-slow",
                where=str(self.path),
                repair="see that the disk is sound; then: ipmclab recover",
            )

    def _free_room(self) -> None:
        if self._ballast is not None:
            self._ballast.unlink(missing_ok=True)
            self._ballast = None

    def _close(self) -> None:
        os.close(self._descriptor)
        self._is_open = False
        self._free_room()


def _create_locked(path: Path) -> int:
    """A new file of this name that is ours."""
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0)
    while True:
        descriptor = os.open(path, flags, 0o644)
        # Between these two calls somebody's ``recover`` may have found an empty journal, and put it away.
        if lock_file(descriptor) and is_still_at(descriptor, path):
            return descriptor
        os.close(descriptor)


def _hold_room(path: Path, size: int) -> None:
    with path.open("wb") as stream:
        reserve(stream.fileno(), size)


def _failed(path: Path, error: Exception) -> JournalError:
    if getattr(error, "errno", None) == errno.ENOSPC:
        return JournalError(
            "the disk is full: nothing more can be recorded; what was recorded is safe",
            code="disk-full",
            where=str(path),
            repair="free some room, then: ipmclab recover",
        )
    return JournalError(
        f"the journal cannot be written: {getattr(error, 'strerror', None) or error}; what was recorded is safe",
        code="write-failed",
        where=str(path),
        repair="see that the disk is sound and that you may write there; then: ipmclab recover",
    )
