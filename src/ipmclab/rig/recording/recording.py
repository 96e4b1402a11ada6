"""One recording at a bench: its rows are guarded, kept and reported, and it ends with the output at 0 V."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import Bench, Block, block_rows
from ipmclab.rig.recording.about import About
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.keeping import InJournal, InMemory, JournalLike, Keeper, Rows, State
from ipmclab.rig.recording.run_request import Listeners, RunRequest
from ipmclab.rig.recording.slow import Air, AirMean
from ipmclab.rig.recording.zeroing import Rest, read_rest
from ipmclab.rig.rows import RowSource
from ipmclab.rig.safety.guard import Alarm, Guard, rows_out_of_order
from ipmclab.rig.safety.guarded_bench import GuardedBench, output_stuck
from ipmclab.rig.safety.limit import AIR
from ipmclab.rig.scaling import Scaling
from ipmclab.run import SLOW_CHANNELS, Mark, Run, RunMetadata, ZeroReading

if TYPE_CHECKING:
    from ipmclab.store.journal.header import JournalHeader

FloatArray = npt.NDArray[np.float64]

START_TIME: Final = 2.0
"""How long [s] a bench may take to start a signal, and to end one."""

NOT_AT_ZERO: Final = ("output-not-zero", "output-unread")
"""The codes of a bench that could not bring its output to 0 V, or not see it there."""

DRIVEN: Final = ("output-stuck", *NOT_AT_ZERO)
"""The codes of failures after which the strip may still be driven: the guardian is not let go of."""

ZEROING_TIME: Final = 0.5
"""How long [s] it may take to bring the output to 0 V while a signal is given out."""


class Heartbeat(Protocol):
    """Somebody who brings the output to 0 V when this program no longer can: see ``ipmclab.rig.safety.guardian``."""

    @property
    def status(self) -> Path | None:
        """The file in which it says what it has come to."""

    def arm(self, block_time: float) -> None:
        """From now on watch for beats, which come at every block [s]."""

    def beat(self) -> None:
        """All is well. Raises IpmclabError when nobody watches any more."""

    def explain(self, failure: IpmclabError) -> None:
        """Put the cause in the place of a failure that only follows from it."""

    def hold(self, seconds: float) -> None:
        """The next beat may take so long [s]."""

    def disarm(self) -> None:
        """The output is at 0 V."""


@dataclass(frozen=True)
class Outcome:
    """How a recording ended.

    Parameters
    ----------
    state : "complete" or "aborted"
    reason : str
        Why it was aborted, or stopped.
    metadata : RunMetadata
        Of the run.
    rows : int
        That were read.
    alarm : Alarm, optional
        The limit that ended it.
    error : IpmclabError, optional
        What failed: the bench, the journal, the guardian.
    run : Run, optional
        Where the rows were kept in memory.
    """

    state: State
    reason: str
    metadata: RunMetadata
    rows: int
    alarm: Alarm | None = None
    error: IpmclabError | None = None
    run: Run | None = None


class EndedEarly(Exception):
    """It was asked to end before the signal began."""


@dataclass(frozen=True)
class Attendants:
    """Who attends a recording.

    Parameters
    ----------
    control : Control
        Ends it, or marks it, from another thread.
    heartbeat : Heartbeat, optional
        Watches over it.
    listeners : Listeners
        Get the events.
    """

    control: Control
    heartbeat: Heartbeat | None
    listeners: Listeners


class Recording:
    """One recording: what its steps share.

    Parameters
    ----------
    bench : GuardedBench
    request : RunRequest
    names : sequence of str
        The channels that are read.
    attendants : Attendants
    """

    def __init__(
        self, bench: GuardedBench, request: RunRequest, names: tuple[str, ...], attendants: Attendants
    ) -> None:
        self._bench = bench
        self._request = request
        self._control = attendants.control
        self._heartbeat = attendants.heartbeat
        self._listeners = attendants.listeners
        self._rate = rate = request.rate
        self.names = names
        self._fast = tuple(name for name in names if name not in SLOW_CHANNELS)
        self._guard = Guard(request.limits, rate, bench.rig)
        self._about = About(bench, request, names)
        air = [name for name in names if name in SLOW_CHANNELS]
        if bench.rig.thermometer is not None and "temperature" not in air:
            air.append("temperature")
        self._at_strip = tuple(air)
        if request.slow is not None:
            air += [name for name in SLOW_CHANNELS if name not in air]
        self._air = AirMean(tuple(air), rate)
        self._scaling = Scaling([bench.rig[name] for name in names], {})
        self._keeper: Keeper = InMemory(rate)
        self._rest_rows = round(request.rest_after * rate)
        self._discharge_rows = round(request.discharge * rate)
        self.read = 0
        self._rows = 0
        self._next_row = 0
        self._last_row: int | None = None
        self._early: list[str] = []
        self._hurried = False
        self.state: State = "complete"
        self.reason = ""
        self.alarm: Alarm | None = None

    def leave_early(self) -> None:
        """Look at the requests before the signal: any but a mark ends it all."""
        for request in self._control.take():
            if request.kind != "mark":
                raise EndedEarly(f"{request.text or request.kind}, before the signal began")
            self._early.append(request.text)

    def prepare(self, rest: Rest, signal: str) -> RunMetadata:
        """Set the zeros, and say what is known before the first row."""
        self._scaling = self._about.scaling(rest)
        return self._about.before(rest, self._scaling, signal)

    def keep_in(self, journal: Callable[[JournalHeader], JournalLike] | None, about: RunMetadata) -> None:
        """Make the journal, where there is to be one."""
        if journal is not None:
            from ipmclab.store.journal.header import JournalHeader

            columns = [
                *self._fast,
                *(f"{name}_quality" for name in self._fast),
                *(f"{name}_raw" for name in self.names),
            ]
            assert about.uuid is not None
            header = JournalHeader(about.uuid, self._rate, (*columns, "output_raw"), metadata=about)
            self._keeper = InJournal(journal(header), header)

    def run(
        self,
        played: RowSource,
        rows: int,
        about: RunMetadata,
        finish: Callable[[Bench], Sequence[ZeroReading]] | None,
    ) -> Outcome:
        """Play the rows, and whatever happens end with the output at 0 V and the rows kept."""
        error: IpmclabError | None = None
        try:
            try:
                # Before the guardian waits for beats: this computes what the output is given first.
                blocks = self._bench.apply(played, more=max(self._rest_rows, self._discharge_rows))
                if self._heartbeat is not None:
                    self._heartbeat.arm(block_rows(self._rate) / self._rate)
                self._hold(START_TIME)
                self._apply(blocks, played, rows)
            except IpmclabError as failure:
                error = failure
                if self._heartbeat is not None:
                    self._heartbeat.explain(failure)
                if self._listeners.on_mark is not None:  # at once: a frozen chassis takes long to be brought to 0 V
                    self._listeners.on_mark(Mark(self._time, str(error), "bench"))
            finally:  # also when the program is asked to end: an output that is not at 0 V is reported all the same
                first_error, error = error, self._zero(error)
                about = self._about.after(about)
                if error is not None:
                    self._keep_failure(error, is_reported=error is first_error)
            if error is None and not self._hurried:
                about, error = self._after(about, finish)
        except BaseException as fault:
            self._fail(_why(fault))
            self._end(about)
            with_run(fault, self._kept)
            raise
        unkept = self._end(about)
        return Outcome(self.state, self.reason, about, self.read, self.alarm, error or unkept, self._kept)

    def _apply(self, given: Iterator[Block], played: RowSource, rows: int) -> None:
        self._rows = rows
        for text in self._early:
            self._mark(Mark(0.0, text, "note"))
        self._about.applied()
        # A generator that is closed stops the clock of the bench.
        with closing(_generator(given)) as blocks:
            for block in blocks:
                rows_read = self._take(block)
                if rows_read is not None:
                    played.look(rows_read.first_row, rows_read.values)
                if self._heartbeat is not None:
                    self._heartbeat.beat()
                if self._next_row >= self._stop:
                    self._hold(START_TIME)
                    break
            for air in self._air.rest():
                self._keep_air(air)

    @property
    def _stop(self) -> int:
        """The row before which the record ends."""
        return self._rows if self._last_row is None else self._last_row

    @property
    def _time(self) -> float:
        """Of the next row [s]."""
        return self._next_row / self._rate

    def _take(self, block: Block) -> Rows | None:
        """A block: first the guard, then the rows are kept, then those who listen."""
        first_row = min(block.first_row, self._stop)
        missing = first_row - self._next_row
        count = min(len(block), self._stop - block.first_row)
        if missing < 0:
            raise rows_out_of_order(block.first_row, self._next_row)
        if missing > 0:
            self._mark(Mark(self._time, f"{missing} rows were lost before row {first_row}", "gap"))
        self._next_row = block.first_row + count
        if count <= 0:
            return None
        readings = {name: volts[:count] for name, volts in block.readings.items()}
        values = self._scaling.values(readings)
        flags = self._scaling.flags(readings)
        self._about.saw(block.first_row + len(block), values)
        slow = self._slow(block.temperature)
        rows = Rows(
            block.first_row,
            {name: values[name] for name in self._fast},
            {name: flags[name] for name in self._fast},
            {**readings, "output": block.output[:count]},
        )
        try:
            for alarm in self._guard.look(block.first_row, values, self._felt(slow), block.output[:count]):
                self._alarm(alarm)
            for request in self._control.take():
                self._ask(request.kind, request.text)
        except BaseException:  # such as an output that could not be brought to 0 V: that is reported, not a full disk
            with suppress(IpmclabError):
                self._keep(rows, slow, values)
            raise
        self._keep(rows, slow, values)
        if self._listeners.on_block is not None:
            self._listeners.on_block(rows)
        return rows

    def _slow(self, temperature: FloatArray) -> dict[str, FloatArray]:
        """What slow instruments have read since the block before: the rig's thermometer, and those outside the
        bench."""
        slow = {} if self._request.slow is None else dict(self._request.slow())
        if len(temperature):
            slow["temperature"] = temperature
        return slow

    def _felt(self, slow: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """The air by which the strip is guarded: that of the sensors at the strip, else that of the chamber's own."""
        air = {name: slow.get(name if name in self._at_strip else f"chamber_{name}") for name in AIR}
        return {name: readings for name, readings in air.items() if readings is not None}

    def _keep(self, rows: Rows, slow: Mapping[str, FloatArray], values: Mapping[str, FloatArray]) -> None:
        self._keeper.rows(rows)
        self.read += len(rows)
        known = {**slow, **{name: values[name] for name in self.names if name in SLOW_CHANNELS}}
        for air in self._air.add(rows.first_row, known, len(rows)):
            self._keep_air(air)

    def _keep_air(self, air: Air) -> None:
        self._keeper.air(air)
        if self._listeners.on_air is not None:
            self._listeners.on_air(air)
        self._about.breathed(air)

    def _alarm(self, alarm: Alarm) -> None:
        if alarm.kind == "stuck":
            raise output_stuck(alarm)
        is_end = alarm.action == "zero" and not self._guard.is_zeroed
        if is_end:
            self.alarm = alarm
            self._fail(str(alarm))
            self._zero_and_continue(self._discharge_rows)
        self._mark(Mark(alarm.time, str(alarm), "limit"), is_end=is_end)

    def _ask(self, kind: str, text: str) -> None:
        if kind == "mark":
            self._mark(Mark(self._time, text, "note"))
            return
        if kind == "stop":
            if self._guard.is_zeroed:
                return
            text = self.reason = f"stopped by the operator at {self._time:.6g} s"
            self._zero_and_continue(min(self._rest_rows, self._rows - self._next_row))
        else:  # also while a rest or a discharge is being recorded
            self._hurried = True
            self._fail(text)
            self._zero_and_continue(self._discharge_rows)
            if kind == "abort":
                self._last_row = self._next_row
        self._mark(Mark(self._time, text, "stop"), is_end=True)

    def _zero_and_continue(self, more: int) -> None:
        """Bring the output to 0 V, and record so many rows more."""
        self._hold(ZEROING_TIME)
        self._bench.zero()
        if not self._guard.is_zeroed:
            self._guard.zeroed(self._next_row)
            self._last_row = self._next_row + more

    def _fail(self, reason: str) -> None:
        """Keep the first reason."""
        if self.state == "complete":
            self.state, self.reason = "aborted", reason

    def _mark(self, mark: Mark, *, is_end: bool = False) -> None:
        """Keep what happened, and report it: what ended the signal, with the rows that the run will have."""
        self._keeper.mark(mark)
        if is_end and self._listeners.on_end is not None:
            self._listeners.on_end(mark, self._stop)
        elif self._listeners.on_mark is not None:
            self._listeners.on_mark(mark)

    def _keep_failure(self, error: IpmclabError, *, is_reported: bool) -> None:
        """Keep what ended the recording, and report it where nobody knows yet."""
        self._fail(str(error))
        mark = Mark(self._time, str(error), "bench")
        with suppress(IpmclabError):  # it may be the journal that failed
            self._keeper.mark(mark)
        if not is_reported and self._listeners.on_mark is not None:
            self._listeners.on_mark(mark)

    def _hold(self, seconds: float) -> None:
        if self._heartbeat is not None:
            self._heartbeat.hold(seconds)

    def _zero(self, error: IpmclabError | None) -> IpmclabError | None:
        """Bring the output to 0 V; the first failure is the one that is reported.

        The guardian is let go of only when that succeeded: otherwise the silence makes it act.
        """
        try:
            self._bench.zero()
        except IpmclabError as failure:
            return failure if error is None or failure.code in NOT_AT_ZERO else error
        if self._heartbeat is not None and (error is None or error.code not in DRIVEN):
            self._heartbeat.disarm()
        return error

    def _after(
        self, about: RunMetadata, finish: Callable[[Bench], Sequence[ZeroReading]] | None
    ) -> tuple[RunMetadata, IpmclabError | None]:
        """Read the zeros again. What fails here does not spoil the run, unless the output is not at 0 V."""
        found: list[ZeroReading] = []
        try:
            seconds = self._request.zero_after
            if seconds > 0.0:
                rest = read_rest(self._bench, self.names, self._rate, when="after", duration=seconds)
                found += rest.zeros
            if finish is not None:
                found += finish(self._bench)
        except IpmclabError as error:
            if error.code in DRIVEN:
                self._keep_failure(error, is_reported=False)
                if self._heartbeat is not None:  # it was let go of: its silence makes it act, as after any such failure
                    with suppress(IpmclabError):
                        self._heartbeat.arm(block_rows(self._rate) / self._rate)
                return self._about.with_zeros(about, found), error
            with suppress(IpmclabError):
                self._mark(Mark(self._time, f"the zeros could not be read after the run: {error}", "bench"))
        return self._about.with_zeros(about, found), None

    def _end(self, about: RunMetadata) -> IpmclabError | None:
        try:
            self._keeper.end(self.state, self.reason, about)
        except IpmclabError as error:
            return error
        return None

    @property
    def _kept(self) -> Run | None:
        return self._keeper.run if isinstance(self._keeper, InMemory) else None


def _generator(blocks: Iterator[Block]) -> Generator[Block, None, None]:
    """The blocks, with a ``close`` whatever the bench gives; it closes what they come from, too."""
    yield from blocks


def _why(fault: BaseException) -> str:
    """Why a recording ended, for its state."""
    if isinstance(fault, KeyboardInterrupt):
        return "interrupted from the keyboard"
    if isinstance(fault, SystemExit):
        return "the system asked the recorder to end"
    return f"{type(fault).__name__}: {fault}"


def with_run(fault: BaseException, run: Run | None) -> BaseException:
    """The exception, with what was recorded as its ``run``."""
    fault.__dict__["run"] = run
    return fault
