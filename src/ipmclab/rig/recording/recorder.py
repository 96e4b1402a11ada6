"""The recorder: applies a signal at a bench, guards the strip, and makes a run of what the bench reads."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.model.simulate import MOST_ROWS, above_zero, count_rows
from ipmclab.platform import told_to_end
from ipmclab.rig.bench import Bench
from ipmclab.rig.channels import Rig
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.keeping import JournalLike, Rows
from ipmclab.rig.recording.recording import EndedEarly, Heartbeat, Outcome, Recording, with_run
from ipmclab.rig.recording.slow import Air
from ipmclab.rig.recording.zeroing import (
    LONGEST_WAIT,
    ZERO_TIME,
    read_rest,
    wait_for_preload,
)
from ipmclab.rig.request import check_measured, check_rate
from ipmclab.rig.safety.guarded_bench import GuardedBench
from ipmclab.rig.safety.limits import Limits
from ipmclab.run import SLOW_CHANNELS, Mark, Run, RunMetadata, ZeroReading
from ipmclab.signals import Sequence as SignalSequence
from ipmclab.signals import Signal, Step, parse
from ipmclab.signals.signal import EDGE

if TYPE_CHECKING:
    from ipmclab.store.journal.header import JournalHeader

MOST_ROWS_IN_JOURNAL: Final = 1_000_000_000
"""Rows that a journal takes: a day at 10 kHz. More than memory holds."""

DISCHARGE_TIME: Final = 5.0
"""How long [s] the discharge of the strip is recorded after a limit was passed, or after an emergency zero."""


def record(
    bench: Bench,
    signal: Signal | str,
    *,
    duration: float,
    rate: float,
    measured: Sequence[str] = ("current", "force"),
    rest_before: float = 0.0,
    rest_after: float = 0.0,
    metadata: RunMetadata | None = None,
    limits: Limits | None = None,
    control: Control | None = None,
    heartbeat: Heartbeat | None = None,
    on_block: Callable[[Rows], None] | None = None,
    on_mark: Callable[[Mark], None] | None = None,
    tares: Sequence[ZeroReading] = (),
    zero_time: float = ZERO_TIME,
    zero_after: float = 0.0,
) -> Run:
    """Apply a signal at a bench and record the response, in memory.

    Before the record the channels are read at rest: what the laser and the load cell tell then (its
    preload) is subtracted from every reading. Each row is read just before the output changes, so
    that a signal which acts from row 0 shows from row 1 on, and the run has the hold ``zero-before``.
    The output is brought to 0 V at the end, also after an error, and when a limit is passed; the run is
    ``aborted`` then, and its ``state_reason`` says why.

    Parameters
    ----------
    bench : Bench
    signal : Signal or str
        Applied for ``duration``.
    duration : float [s]
    rate : float [Hz]
    measured : sequence of str
        ``"current"`` and ``"displacement"`` or ``"force"``; the voltage and the current are always read, and so is
        the air where the rig has sensors for it.
    rest_before, rest_after : float [s]
        Time at 0 V that is recorded before and after the signal.
    metadata : RunMetadata, optional
        What is to be kept with the run: mounting, operator, notes... The recorder fills in what it knows.
    limits : Limits, optional
        What the guard watches; the defaults of ``Limits`` where it is left out.
    control : Control, optional
        Ends the run, or marks it, from another thread.
    heartbeat : Heartbeat, optional
        Armed while the output may differ from 0 V.
    on_block : callable of Rows, optional
        Called with the rows of each block, after the guard has seen them.
    on_mark : callable of Mark, optional
        Called with what happens: limits, gaps, notes.
    tares : sequence of ZeroReading, optional
        Readings of the load cell with the tip clear of it.
    zero_time, zero_after : float [s]
        How long the channels are read at rest before and after the record; 0 after it reads nothing.

    Returns
    -------
    run : Run
        With ``round((rest_before + duration + rest_after) * rate)`` rows, fewer when it was ended before. A lost
        reading is NaN and flagged, as is a reading at the limit of its converter.

    Raises
    ------
    InputError
        A signal that is longer than the duration, larger than the output gives or than the strip stands,
        displacement and force at once, an unknown channel, fewer than 2 rows or more than 20 million.
    IpmclabError
        The bench failed. The exception has what was recorded as ``run``, and so has a KeyboardInterrupt.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.rig import VirtualBench
    >>> run = record(VirtualBench(load_actuator("friend-2")), "step 1 V", duration=2.0, rate=50.0)
    >>> len(run), run.hold, run.metadata.state, [name for name in run.channels if name in ("current", "force")]
    (100, 'zero-before', 'complete', ['current', 'force'])
    """
    outcome = capture(
        bench,
        signal,
        duration=duration,
        rate=rate,
        measured=measured,
        rest_before=rest_before,
        rest_after=rest_after,
        metadata=metadata,
        limits=limits,
        control=control,
        heartbeat=heartbeat,
        on_block=on_block,
        on_mark=on_mark,
        tares=tares,
        zero_time=zero_time,
        zero_after=zero_after,
    )
    if outcome.error is not None:
        raise with_run(outcome.error, outcome.run)
    if outcome.run is None:
        raise IpmclabError(
            f"it was ended after {outcome.rows} rows: {outcome.reason}",
            code="too-short",
            where="recording",
            repair="record again",
        )
    return outcome.run


def capture(
    bench: Bench,
    signal: Signal | str,
    *,
    duration: float,
    rate: float,
    measured: Sequence[str] = ("current", "force"),
    rest_before: float = 0.0,
    rest_after: float = 0.0,
    metadata: RunMetadata | None = None,
    limits: Limits | None = None,
    journal: Callable[[JournalHeader], JournalLike] | None = None,
    control: Control | None = None,
    heartbeat: Heartbeat | None = None,
    on_block: Callable[[Rows], None] | None = None,
    on_mark: Callable[[Mark], None] | None = None,
    tares: Sequence[ZeroReading] = (),
    zero_time: float = ZERO_TIME,
    zero_after: float = ZERO_TIME,
    most_drift: float | None = None,
    longest_wait: float = LONGEST_WAIT,
    on_preload: Callable[[ZeroReading], None] | None = None,
    on_air: Callable[[Air], None] | None = None,
    on_end: Callable[[Mark, int], None] | None = None,
    finish: Callable[[Bench], Sequence[ZeroReading]] | None = None,
    discharge: float = DISCHARGE_TIME,
) -> Outcome:
    """Record one run, and say how it ended: ``record`` for those who keep runs in a laboratory.

    Parameters
    ----------
    bench, signal, duration, rate, measured, rest_before, rest_after, metadata, limits, control, heartbeat
        As for ``record``, and so ``on_block``, ``on_mark``, ``tares``, ``zero_time`` and ``zero_after``.
    journal : callable of JournalHeader, optional
        Makes the journal, once the zeros are read and before the first volt; every row goes there, and
        ``Outcome.run`` is None. Without it everything stays in memory.
    most_drift : float [N/s], optional
        The preload is read again until it drifts no faster.
    longest_wait : float [s]
        For that.
    on_preload : callable of ZeroReading, optional
        Called with each reading of the preload.
    on_air : callable of Air, optional
        Called with what the air around the strip is like, once a second.
    on_end : callable of Mark and int, optional
        Called, in the place of ``on_mark``, with what ended the signal early once the output is at 0 V: an operator or
        a limit; and with how many rows the run will have.
    finish : callable of Bench, optional
        Called with the output at 0 V after the zeros are read again; gives further readings, such as the tare.
    discharge : float [s]
        How long is recorded after a limit was passed, or after an emergency zero.

    Returns
    -------
    outcome : Outcome
        Also when the bench or the journal failed once rows were coming: ``error`` is that failure.

    Raises
    ------
    InputError, IpmclabError
        What cannot be recorded, before a volt was given out. A KeyboardInterrupt, a request to end (SystemExit) or a
        fault of a callback goes on to the caller, with the output at 0 V and what was kept marked as aborted.
    """
    duration = above_zero("duration", duration, "s")
    for name, value in (("rest_before", rest_before), ("rest_after", rest_after)):
        if not 0.0 <= value < math.inf:
            raise InputError(f"{name} is {value:g}", code="out-of-range", where=name, repair="give 0 s or more")
    most = MOST_ROWS if journal is None else MOST_ROWS_IN_JOURNAL
    rows, rate = count_rows(rest_before + duration + rest_after, rate, most=most)
    commanded = _with_rest(
        parse(signal) if isinstance(signal, str) else signal, rest_before, duration, rest_after, rate
    )
    limits = limits or Limits()
    check_measured(bench.rig, measured)
    check_rate(bench.rig, rate)
    guarded = GuardedBench(bench, limits)
    guarded.check(commanded, rows, rate)
    names = _names(bench.rig, measured)
    recording = Recording(guarded, limits, rate, names, control or Control(), on_block, on_mark, heartbeat)
    recording.rest_rows = round(rest_after * rate)
    recording.discharge_rows = round(discharge * rate)
    recording.on_air = on_air
    recording.on_end = on_end
    with told_to_end(bench.zero), _closing(guarded) as closed:
        guarded.open(names, rate)
        try:
            if most_drift is not None and "force" in names:
                rest = wait_for_preload(
                    guarded,
                    names,
                    rate,
                    most_drift=most_drift,
                    duration=zero_time,
                    longest_wait=longest_wait,
                    on_reading=on_preload,
                    on_block=recording.leave_early,
                )
            else:
                early = recording.leave_early
                rest = read_rest(guarded, names, rate, when="before", duration=zero_time, on_block=early)
        except EndedEarly as ended:
            return Outcome("aborted", str(ended), metadata or RunMetadata(), 0)
        about = recording.prepare(rest, tares, metadata or RunMetadata(), str(commanded), limits)
        recording.keep_in(journal, about)
        with _brief_collections():
            outcome = recording.run(commanded, rows, about, zero_after, finish)
    return outcome if outcome.error or not closed else replace(outcome, error=closed[0])


@contextmanager
def _brief_collections() -> Iterator[None]:
    """Let the garbage collector pass over what was there before.

    In a large process, such as a notebook's, it would stop every thread for longer than the guardian waits.
    """
    if gc.get_freeze_count():  # somebody else's, who will thaw it
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def _closing(bench: GuardedBench) -> Iterator[list[IpmclabError]]:
    """Close the bench at the end; what fails then goes into the list, so that it hides no earlier failure."""
    failures: list[IpmclabError] = []
    try:
        yield failures
    finally:
        try:
            bench.close()
        except IpmclabError as error:
            failures.append(error)


def _names(rig: Rig, measured: Sequence[str]) -> tuple[str, ...]:
    """What is read: what was asked for, what the guard needs, and the air."""
    known = [channel.name for channel in rig.channels]
    always = [name for name in ("current", *SLOW_CHANNELS) if name in known]
    return tuple(dict.fromkeys(["voltage", *measured, *always]))


def _with_rest(signal: Signal, before: float, duration: float, after: float, rate: float) -> Signal:
    """The signal in the time of the record."""
    signal.check_fits(duration, rate)
    if not before and not after:
        return signal
    parts: tuple[Signal, ...] = (signal,)
    lasts: tuple[float, ...] = ()
    if isinstance(signal, SignalSequence):
        parts, lasts = signal.signals, signal.durations
    shown: list[tuple[Signal, float]] = [(Step(0.0), before)] if before else []
    left = duration
    for part, last in zip(parts, (*lasts, math.inf), strict=False):
        if left > EDGE:
            shown.append((part, min(last, left)))
        left -= last
    return SignalSequence(tuple(part for part, _ in shown), tuple(last for _, last in shown))
