"""One recording at a bench: its rows are guarded, kept and told, and it ends with the output at 0 V."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Final, Protocol
from uuid import uuid4

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import Bench, BenchError, Block, block_rows
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.keeping import InJournal, InMemory, JournalLike, Keeper, Rows, State
from ipmclab.rig.recording.scaling import Scaling
from ipmclab.rig.recording.slow import Air, AirMean
from ipmclab.rig.recording.zeroing import (
    Rest,
    contact_levels,
    is_discharged,
    read_rest,
    subtracted,
    uncertainties,
)
from ipmclab.rig.safety.guard import Alarm, Guard, rows_out_of_order
from ipmclab.rig.safety.guarded_bench import GuardedBench
from ipmclab.rig.safety.limits import Limits
from ipmclab.run import SLOW_CHANNELS, Mark, Run, RunMetadata, ZeroReading
from ipmclab.signals import Signal
from ipmclab.version import __version__

if TYPE_CHECKING:
    from ipmclab.store.journal.header import JournalHeader

FloatArray = npt.NDArray[np.float64]

START_TIME: Final = 2.0
"""How long [s] a bench may take to start a signal, and to end one."""

ZEROING_TIME: Final = 0.5
"""How long [s] it may take to bring the output to 0 V while a signal is given out."""

NO_CHARGE: Final = 0.01
"""A current at rest below this share of the run's largest is no reason to doubt that the strip was at rest."""


class Heartbeat(Protocol):
    """Somebody who brings the output to 0 V when this program no longer can: see ``ipmclab.rig.safety.guardian``."""

    def arm(self, block_time: float) -> None:
        """From now on watch for beats, which come at every block [s]."""

    def beat(self) -> None:
        """All is well. Raises IpmclabError when nobody watches any more."""

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


class Recording:
    """One recording: what its steps share."""

    def __init__(
        self,
        bench: GuardedBench,
        limits: Limits,
        rate: float,
        names: tuple[str, ...],
        control: Control,
        on_block: Callable[[Rows], None] | None,
        on_mark: Callable[[Mark], None] | None,
        heartbeat: Heartbeat | None,
    ) -> None:
        self._bench = bench
        self._heartbeat = heartbeat
        self._rate = rate
        self._names = names
        self._fast = tuple(name for name in names if name not in SLOW_CHANNELS)
        self._channels = [bench.rig[name] for name in names]
        self._control = control
        self._on_block = on_block
        self._on_mark = on_mark
        self._guard = Guard(limits, rate, bench.rig)
        air = [name for name in names if name in SLOW_CHANNELS]
        if bench.rig.thermometer is not None and "temperature" not in air:
            air.append("temperature")
        self._air_names = tuple(air)
        self._air = AirMean(self._air_names, rate)
        self._scaling = Scaling(self._channels, {})
        self._keeper: Keeper = InMemory(rate)
        self.rest_rows = 0
        self.discharge_rows = 0
        self.on_air: Callable[[Air], None] | None = None
        self.on_end: Callable[[Mark, int], None] | None = None
        self.read = 0
        self._rows = 0
        self._next_row = 0
        self._last_row: int | None = None
        self._early: list[str] = []
        self._hurried = False
        self._began: datetime | None = None
        self._left = 0.0
        self._peak = 0.0
        self._air_readings: dict[str, list[float]] = {}
        self.state: State = "complete"
        self.reason = ""
        self.alarm: Alarm | None = None

    def leave_early(self) -> None:
        """Look at the requests before the signal: any but a mark ends it all."""
        for request in self._control.take():
            if request.kind != "mark":
                raise EndedEarly(f"{request.text or request.kind}, before the signal began")
            self._early.append(request.text)

    def prepare(
        self, rest: Rest, tares: Sequence[ZeroReading], about: RunMetadata, signal: str, limits: Limits
    ) -> RunMetadata:
        """Set the zeros, and say what is known before the first row."""
        rig = self._bench.rig
        self._scaling = Scaling(self._channels, subtracted(rig, rest), contact_levels(rig, rest, tares))
        self._left = rest.ends["current"][1] if "current" in rest.ends else 0.0
        texts = limits.as_text()
        for name, reason in limits.unwatched(rig, self._names).items():
            texts[name] += f" ({reason})"
        zeros = (*about.zeros, *tares, *rest.zeros)
        fast = [channel for channel in self._channels if channel.name in self._fast]
        return replace(
            about,
            origin=self._bench.origin,
            sample=about.sample or self._bench.sample,
            signal=signal,
            voltage_sensed=rig.voltage_sensed,
            shunt_resistance=rig.shunt_resistance,
            source_resistance=rig.source_resistance,
            starts_from_rest=is_discharged(rig, rest),
            ranges={name: limits for name, limits in self._scaling.ranges.items() if name in self._fast},
            calibrations=self._scaling.calibrations,
            bench=self._bench.description,
            rig=rig.name,
            software_version=__version__,
            uuid=about.uuid or str(uuid4()),
            recorded_at=datetime.now().astimezone().isoformat("T", "milliseconds"),
            zeros=zeros,
            uncertainties=uncertainties(fast, zeros),
            limits=texts,
        )

    def keep_in(self, journal: Callable[[JournalHeader], JournalLike] | None, about: RunMetadata) -> None:
        """Make the journal, where there is to be one."""
        if journal is not None:
            from ipmclab.store.journal.header import JournalHeader

            columns = [
                *self._fast,
                *(f"{name}_quality" for name in self._fast),
                *(f"{name}_raw" for name in self._names),
            ]
            assert about.uuid is not None
            header = JournalHeader(about.uuid, self._rate, (*columns, "output_raw"), metadata=about)
            self._keeper = InJournal(journal(header), header)

    def run(
        self,
        signal: Signal,
        rows: int,
        about: RunMetadata,
        zero_after: float,
        finish: Callable[[Bench], Sequence[ZeroReading]] | None,
    ) -> Outcome:
        """Apply the signal, and whatever happens end with the output at 0 V and the rows kept."""
        error: IpmclabError | None = None
        try:
            try:
                # Before the guardian waits for beats: this computes what the output is given first.
                more = max(self.rest_rows, self.discharge_rows)
                blocks = self._bench.apply(signal, rows, more=more)
                if self._heartbeat is not None:
                    self._heartbeat.arm(block_rows(self._rate) / self._rate)
                self._hold(START_TIME)
                self._apply(blocks, rows)
            except IpmclabError as failure:
                error = failure
                if self._on_mark is not None:  # at once: a chassis that is frozen takes long to be brought to 0 V
                    self._on_mark(Mark(self._time, str(error), "bench"))
            finally:
                told, error = error, self._zero(error)
                about = self._seen(about)
            if error is not None:
                self._fail(str(error))
                with suppress(IpmclabError):  # it may be the journal that failed
                    self._keeper.mark(Mark(self._time, str(error), "bench"))
                if told is None and self._on_mark is not None:
                    self._on_mark(Mark(self._time, str(error), "bench"))
            elif not self._hurried:
                about = self._after(about, zero_after, finish)
        except BaseException as fault:
            self._fail(_why(fault))
            self._end(about)
            with_run(fault, self._kept)
            raise
        error = self._end(about) or error
        return Outcome(self.state, self.reason, about, self.read, self.alarm, error, self._kept)

    def _apply(self, given: Iterator[Block], rows: int) -> None:
        self._rows = rows
        for text in self._early:
            self._mark(Mark(0.0, text, "note"))
        begun = datetime.now().astimezone()
        # A generator that is closed stops the clock of the bench.
        with closing(_generator(given)) as blocks:
            for block in blocks:
                if self._began is None:
                    # The block has only just been read; a simulated bench does not take the time for it.
                    read_for = timedelta(seconds=(block.first_row + len(block)) / self._rate)
                    self._began = max(begun, datetime.now().astimezone() - read_for)
                self._take(block)
                if self._heartbeat is not None:
                    self._heartbeat.beat()
                if self._next_row >= self._stop:
                    self._hold(START_TIME)
                    break
            for air in self._air.rest():
                self._keep_air(air)

    def _seen(self, about: RunMetadata) -> RunMetadata:
        """What was known beforehand, with the time of row 0 and the air of this run."""
        air = {name: round(float(np.mean(values)), 3) for name, values in self._air_readings.items()}
        rest = about.starts_from_rest
        if rest is False and abs(self._left) <= NO_CHARGE * self._peak:
            rest = None  # too little to matter, too much to call it rest
        moment = self._began.isoformat("T", "milliseconds") if self._began is not None else about.recorded_at
        return replace(
            about,
            recorded_at=moment,
            starts_from_rest=rest,
            temperature=air.get("temperature", about.temperature),
            relative_humidity=air.get("relative_humidity", about.relative_humidity),
        )

    @property
    def _stop(self) -> int:
        """The row before which the record ends."""
        return self._rows if self._last_row is None else self._last_row

    @property
    def _time(self) -> float:
        """Of the next row [s]."""
        return self._next_row / self._rate

    def _take(self, block: Block) -> None:
        """A block: first the guard, then the rows are kept, then those who listen."""
        missing = block.first_row - self._next_row
        count = min(len(block), self._stop - block.first_row)
        if missing < 0:
            raise rows_out_of_order(block.first_row, self._next_row)
        if missing > 0:
            self._mark(Mark(self._time, f"{missing} rows were lost before row {block.first_row}", "gap"))
        self._next_row = block.first_row + len(block)
        if count <= 0:
            return
        readings = {name: volts[:count] for name, volts in block.readings.items()}
        values = self._scaling.values(readings)
        flags = self._scaling.flags(readings)
        if "current" in values:
            self._peak = max(self._peak, float(np.max(np.abs(np.nan_to_num(values["current"])))))
        rows = Rows(
            block.first_row,
            {name: values[name] for name in self._fast},
            {name: flags[name] for name in self._fast},
            {**readings, "output": block.output[:count]},
        )
        try:
            for alarm in self._guard.look(block.first_row, values, block.temperature, block.output[:count]):
                self._alarm(alarm)
            for request in self._control.take():
                self._ask(request.kind, request.text)
        finally:  # also when the output could not be brought to 0 V
            self._keep(rows, block.temperature, values)
        if self._on_block is not None:
            self._on_block(rows)

    def _keep(self, rows: Rows, temperature: FloatArray, values: Mapping[str, FloatArray]) -> None:
        self._keeper.rows(rows)
        self.read += len(rows)
        slow = {name: values[name] for name in self._names if name in SLOW_CHANNELS}
        if len(temperature) and "temperature" not in slow:
            slow["temperature"] = temperature
        for air in self._air.add(rows.first_row, slow, len(rows)):
            self._keep_air(air)

    def _keep_air(self, air: Air) -> None:
        self._keeper.air(air)
        if self.on_air is not None:
            self.on_air(air)
        for name, value in air.values.items():
            if math.isfinite(value):
                self._air_readings.setdefault(name, []).append(value)

    def _alarm(self, alarm: Alarm) -> None:
        if alarm.kind == "stuck":
            raise BenchError(str(alarm), code="output-stuck", where="voltage", repair="switch the output amplifier off")
        is_end = alarm.action == "zero" and not self._guard.is_zeroed
        if is_end:
            self.alarm = alarm
            self._fail(str(alarm))
            self._zero_and_go_on(self.discharge_rows)
        self._mark(Mark(alarm.time, str(alarm), "limit"), is_end=is_end)

    def _ask(self, kind: str, text: str) -> None:
        if kind == "mark":
            self._mark(Mark(self._time, text, "note"))
            return
        self._hurried = self._hurried or kind in ("abort", "zero")
        if kind == "abort":
            self._fail(text)
            self._zero_and_go_on(0)
            self._last_row = self._next_row  # also while a discharge is being recorded
        elif self._guard.is_zeroed:
            return
        elif kind == "zero":
            self._fail("emergency zero by the operator")
            self._zero_and_go_on(self.discharge_rows)
        else:
            self.reason = f"stopped by the operator at {self._time:.6g} s"
            self._zero_and_go_on(self.rest_rows)
        self._mark(Mark(self._time, self.reason, "stop"), is_end=True)

    def _zero_and_go_on(self, more: int) -> None:
        """Bring the output to 0 V, and record so many rows more."""
        self._hold(ZEROING_TIME)
        self._bench.zero()
        if not self._guard.is_zeroed:
            self._guard.zeroed(self._next_row)
            self._last_row = min(self._next_row + more, self._rows + max(self.rest_rows, self.discharge_rows))

    def _fail(self, reason: str) -> None:
        """Keep the first reason."""
        if self.state == "complete":
            self.state, self.reason = "aborted", reason

    def _mark(self, mark: Mark, *, is_end: bool = False) -> None:
        """Keep what happened, and tell it: what ended the signal, with the rows that the run will have."""
        self._keeper.mark(mark)
        if is_end and self.on_end is not None:
            self.on_end(mark, self._stop)
        elif self._on_mark is not None:
            self._on_mark(mark)

    def _hold(self, seconds: float) -> None:
        if self._heartbeat is not None:
            self._heartbeat.hold(seconds)

    def _zero(self, error: IpmclabError | None) -> IpmclabError | None:
        """Bring the output to 0 V; the first failure is the one that is told.

        The guardian is let go of only when that succeeded: otherwise the silence makes it act.
        """
        try:
            self._bench.zero()
        except IpmclabError as failure:
            return failure if error is None or failure.code == "output-not-zero" else error
        if self._heartbeat is not None and (error is None or error.code not in ("output-stuck", "output-not-zero")):
            self._heartbeat.disarm()
        return error

    def _after(
        self, about: RunMetadata, zero_after: float, finish: Callable[[Bench], Sequence[ZeroReading]] | None
    ) -> RunMetadata:
        """Read the zeros again. What fails here does not spoil the run."""
        found: list[ZeroReading] = []
        try:
            if zero_after > 0.0:
                rest = read_rest(self._bench, self._names, self._rate, when="after", duration=zero_after)
                found += rest.zeros
            if finish is not None:
                found += finish(self._bench)
        except IpmclabError as error:
            with suppress(IpmclabError):
                self._mark(Mark(self._time, f"the zeros could not be read after the run: {error}", "bench"))
        zeros = (*about.zeros, *found)
        fast = [channel for channel in self._channels if channel.name in self._fast]
        return replace(about, zeros=zeros, uncertainties=uncertainties(fast, zeros))

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
    """The blocks, with a ``close`` whatever the bench gives."""
    try:
        yield from blocks
    finally:
        close = getattr(blocks, "close", None)
        if close is not None:
            close()


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
