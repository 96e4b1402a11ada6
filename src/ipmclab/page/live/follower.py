"""A client of the recorder's process: joins whichever runs in the laboratory, and knows what it has reported."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from ipmclab.errors import IpmclabError
from ipmclab.page.live.columns import Columns, FloatArray
from ipmclab.page.live.guardians import left_by_others
from ipmclab.page.live.state import State
from ipmclab.platform import as_typed
from ipmclab.rig.bench import block_rows
from ipmclab.rig.process import aftermath
from ipmclab.rig.process.client import Recorder, forget_dead_recorders, launch, recorders
from ipmclab.rig.process.hub import SUFFIX
from ipmclab.rig.process.messages import Message
from ipmclab.run import SLOW_CHANNELS

_LOOK: Final = 0.3
"""How often [s] a laboratory without a recorder is looked at."""

_AGAIN: Final = 1.0
"""How long [s] after it was joined a recorder that was lost is joined again at the earliest."""

_HANGS: Final = 30.0
"""How long [s] one that does not answer is left alone by the follower; who asks for something tries it at once."""

_SILENT: Final = 1.5
"""After so long [s] without a reading it is said that none comes, where some have: whoever it is that hangs."""

_ACTS: Final = 1.0
"""How long [s] the guardian of a recorder that is gone has, before it is said that nobody knows of the output."""

_NEVER: Final = float("inf")
_WAIT: Final = 0.25
_JOURNAL_BEHIND: Final = 3.0
"""So long [s] blocks wait for the journal to have the rows before them: it is written twice a second."""


class Follower:
    """Follows the recorder of a laboratory folder, in a thread of its own.

    Parameters
    ----------
    folder : callable
        The laboratory folder, asked for each time: it may come to be later.
    """

    def __init__(self, folder: Callable[[], Path]) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._sending = threading.Lock()
        self._joining = threading.Lock()
        self._recorder: Recorder | None = None
        self._next: Recorder | None = None
        self._launching = False
        self._not_before: dict[Path, float] = {}  # when a recorder is joined again: never one that was followed
        self._answers = self._answers_sent = False
        self._status: Path | None = None  # of the guardian of the recorder that is followed, or was last
        self._looked = (0.0, 0.0)  # when at that, and at the others
        self._air: dict[str, float] = {}  # the last reading: between two of them the plots hold it
        self._ended = threading.Event()
        self.state = State()
        self.columns: Columns | None = None
        self._waiting: list[tuple[int, dict[str, FloatArray]]] = []  # blocks for which the journal is behind
        self._patience = 0.0
        self._thread = threading.Thread(target=self._follow, name="recorder follower", daemon=True)

    def start(self) -> None:
        """Begin to look for recorders."""
        self._thread.start()

    def close(self) -> None:
        """Leave; a recorder continues."""
        self._ended.set()
        self._thread.join(2.0)
        with self._sending:
            if self._recorder is not None:
                self._recorder.close()

    @property
    def is_joined(self) -> bool:
        """Whether a recorder is there now."""
        return self._recorder is not None

    @property
    def may_run(self) -> bool:
        """Whether a recorder is there that is not joined and was not heard to end."""
        if self._launching:
            return False
        with contextlib.suppress(OSError):
            return any(self._not_before.get(file) != _NEVER for file in recorders(self._folder()))
        return False

    @property
    def may_drive(self) -> bool:
        """Whether something may drive the output: a recorder that is joined, or one that may run."""
        # In this order: one that is joined between the two questions is found by the second.
        return self.may_run or self.is_joined

    def reach(self) -> None:
        """Join a recorder that is there now, where none is joined: what is asked next must reach it. May take long."""
        with self._joining:
            if self._recorder is None and self._next is None and not self._launching:
                recorder = self._searched(at_once=True)
                with self._lock:
                    self._next = recorder

    def launch(self, program: str, job: dict[str, Any]) -> None:
        """Start a recorder and follow it.

        Raises
        ------
        InputError, IpmclabError
            What it refuses, or that one is running here already.
        """
        with self._joining, self._lock:
            busy = self.is_joined or self._launching or self._next is not None
            self._launching = self._launching or not busy
        if busy:
            raise IpmclabError(
                "a recorder is at the bench already",
                code="bench-busy",
                where="bench",
                repair="stop or abort it first",
            )
        try:
            recorder = launch(program, job)
            with self._lock:
                self._next = recorder
        finally:
            self._launching = False

    def request(self, kind: str, **values: Any) -> bool:
        """Ask the recorder for something; False where none takes it in. May take as long as ``PROMPT``."""
        with self._sending:
            recorder = self._recorder or self._next
            if recorder is None:
                return False
            if not recorder.request(kind, **values):
                self._recorder = self._next = None  # so that it is joined again, at once by who must reach it
                self._not_before[recorder.file] = time.monotonic() + _AGAIN
                return False
        if kind == "answer":
            self.state.answered_here(values.get("number"))
        self.state.asked_here(kind)
        return True

    def let_answer(self, there: bool) -> None:
        """The recorder shall know whether somebody is there who could answer; it is sent a moment later."""
        self._answers = there

    def _follow(self) -> None:
        lost: Recorder | None = None
        since = 0.0
        while not self._ended.is_set():
            recorder = self._joined()
            self._look()
            if recorder is None:
                if lost is not None and self._reported_lost(lost, since):
                    lost = None
                self._ended.wait(_LOOK)
                continue
            self.state.joined(recorder.about, recorder.file.name)
            self._status = recorder.file.with_suffix(aftermath.SUFFIX)
            began, lost = time.monotonic(), None
            try:
                self._listen(recorder)
            except IpmclabError:
                lost, since = recorder, time.monotonic()  # it may only have hung up
                self._not_before[recorder.file] = began + _AGAIN
            finally:
                with self._sending:
                    self._recorder = None
                    if not self._ended.is_set():
                        recorder.close()

    def _reported_lost(self, recorder: Recorder, since: float) -> bool:
        """Say that a recorder is gone; False while it may run and only cannot be reached, which is said as such."""
        if self.may_run:
            if time.monotonic() - since > _AGAIN and self.state.bench != "lost":
                self._look(at_once=True)
                self.state.lost("it does not answer, and is tried again", is_gone=False)
            return False
        aftermath.fate(recorder.file, within=_ACTS)  # what it says later is read as well
        self._look(at_once=True)
        repair = f"ipmclab recover {as_typed(recorder.file.parent.parent)} keeps what it had recorded"
        self.state.lost(f"the recorder's process is gone: {repair}", is_gone=True)
        return True

    def _look(self, *, at_once: bool = False) -> None:
        """What the guardians have come to."""
        now, (own, others) = time.monotonic(), self._looked
        if self._status is not None and (at_once or now - own >= _WAIT):
            own = now
            self.state.guarded(*aftermath.read(self._status))
        if now - others >= _AGAIN:
            others = now
            name = self._status.with_suffix(SUFFIX).name if self._status is not None else ""
            with contextlib.suppress(OSError):
                self.state.left(left_by_others(self._folder(), name))
        self._looked = (own, others)

    def _joined(self) -> Recorder | None:
        """The recorder that was started here, else the newest of the folder that answers; requests go to it."""
        with self._joining:
            with self._lock:
                waiting = self._next  # requests find it there until it is followed
                if waiting is None and self._launching:
                    return None  # what is found meanwhile is the one that is coming
            recorder = waiting or self._searched()
            if recorder is None:
                return None
            with self._sending:
                if self._next is not waiting:  # a request hung up on it meanwhile
                    recorder.close()
                    return None
                self._recorder, self._next = recorder, None
                self._not_before[recorder.file] = _NEVER
                self._subscribe(recorder)
            return recorder

    def _subscribe(self, recorder: Recorder) -> None:
        self._answers_sent = self._answers
        recorder.request("subscribe", blocks=True, answers=self._answers_sent)

    def _searched(self, at_once: bool = False) -> Recorder | None:
        folder = self._folder()
        if not (folder / "recording").is_dir():
            return None
        with contextlib.suppress(OSError):
            for file in reversed(recorders(folder)):
                until = self._not_before.get(file, 0.0)
                if until == _NEVER or (until > time.monotonic() and not at_once):
                    continue
                try:
                    return Recorder(file)
                except IpmclabError as error:
                    if error.code == "recorder-hangs":
                        self._not_before[file] = time.monotonic() + _HANGS
                        if self.state.bench != "lost":
                            self._hangs(file, error)
                    else:
                        forget_dead_recorders(folder)
        return None

    def _hangs(self, file: Path, error: IpmclabError) -> None:
        """Say that a recorder which is there lets nobody in."""
        status = file.with_suffix(aftermath.SUFFIX)
        if status != self._status:
            about: dict[str, Any] = {}
            with contextlib.suppress(OSError, ValueError):
                about = json.loads(file.read_text(encoding="utf-8"))
            self.state.joined(about, file.name)
            self._status = status
        self._look(at_once=True)
        self.state.lost(f"{error.message.partition(';')[0]}; {error.repair}", is_gone=False)

    def _listen(self, recorder: Recorder) -> None:
        read = time.monotonic()
        while not self._ended.is_set():
            message = recorder.next(_WAIT, patience=0.0)
            # What ends a run comes after the guardian was let go of: it is looked at before that is taken.
            self._look(at_once=message is not None and message.kind in ("step", "question", "recorded", "ended"))
            if message is not None and message.kind == "block":
                read = time.monotonic()
            self.state.read_nothing(self._silence(time.monotonic() - read))
            if self._answers != self._answers_sent:
                with self._sending:
                    self._subscribe(recorder)
            if message is None:
                continue
            self._take(message)
            if message.kind == "ended":
                return

    def _silence(self, seconds: float) -> int | None:
        """Whole seconds without a reading, where some have come and others should; None where that may be."""
        run, columns, progress = self.state.run, self.columns, self.state.readings()["progress"] or {}
        if run is None or columns is None:
            return None
        rate, rows = float(run["rate"]), progress.get("of", run["rows"])
        waits = columns.rows_received < rows and seconds > max(_SILENT, 3.0 * block_rows(rate) / rate)
        return int(seconds) if waits else None

    def _take(self, message: Message) -> None:
        if message.kind == "block":
            self._take_block(message)
            return
        if message.kind == "air":
            air = {name: float(message[name]) for name in SLOW_CHANNELS if name in message.values}
            self._air.update(air)
            self.state.read(air)
            return
        if message.kind in ("run", "recorded", "ended") and self.columns is not None and self._waiting:
            self._patience = 0.0
            self._append(self.columns)
        if message.kind == "run":
            self.columns = None
            self._air.clear()
        self.state.take(message)

    def _take_block(self, message: Message) -> None:
        first = int(message["first_row"])
        run = self.state.run
        if run is None:
            return
        if self.columns is None:
            self.columns = Columns(list(message.arrays), float(run["rate"]))
            self._waiting, self._patience = [], time.monotonic() + _JOURNAL_BEHIND
        count = len(next(iter(message.arrays.values()), ()))
        air = {name: np.full(count, value) for name, value in self._air.items()}
        self._waiting.append((first, {**message.arrays, **air}))
        self._append(self.columns)
        latest = {}
        for name, readings in message.arrays.items():
            known = readings[np.isfinite(readings)]
            latest[name] = float(known[-1]) if len(known) else None
        self.state.read(latest)

    def _append(self, columns: Columns) -> None:
        """Put the blocks that came behind what was recorded before them; for the journal to have that, they wait."""
        first = self._waiting[0][0]
        if columns.rows_received < first:
            self._fill(columns, first)
        if columns.rows_received < first and self.state.journal is not None and time.monotonic() < self._patience:
            return
        for first, values in self._waiting:
            columns.append(first, values)
        self._waiting.clear()

    def _fill(self, columns: Columns, rows: int) -> None:
        """What was recorded before we came, from the journal."""
        from ipmclab.store.journal.record import read_journal

        if self.state.journal is None:
            return
        with contextlib.suppress(IpmclabError, OSError):
            record = read_journal(self.state.journal)
            places = {name: place for place, name in enumerate(record.header.columns)}
            for first, values in record.rows():
                if first >= rows:
                    break
                start, stop = max(columns.rows_received - first, 0), min(len(values), rows - first)
                found = {name: values[start:stop, places[name]] for name in columns.channels if name in places}
                columns.append(first + start, found)
