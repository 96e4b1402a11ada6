"""The recorder: plays rows at a bench, guards the strip, and makes a run of what the bench reads."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Unpack

from ipmclab.errors import IpmclabError
from ipmclab.model.request import MOST_ROWS
from ipmclab.platform import on_end_request
from ipmclab.rig.bench import Bench
from ipmclab.rig.channels import Rig
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.keeping import JournalLike, Rows
from ipmclab.rig.recording.recording import Attendants, EndedEarly, Heartbeat, Outcome, Recording, with_run
from ipmclab.rig.recording.run_request import Listeners, RunOptions, RunRequest
from ipmclab.rig.recording.zeroing import Rest, read_rest, wait_for_preload
from ipmclab.rig.request import check_measured, check_rate
from ipmclab.rig.rows import RowSource
from ipmclab.rig.safety.guarded_bench import GuardedBench
from ipmclab.rig.safety.own_clock import OPENING, own_pauses_reported
from ipmclab.rig.safety.session_end import on_session_end
from ipmclab.run import SLOW_CHANNELS, Mark, Run, ZeroReading
from ipmclab.signals import Signal

if TYPE_CHECKING:
    from ipmclab.store.journal.header import JournalHeader

MOST_ROWS_IN_JOURNAL: Final = 1_000_000_000
"""Rows that a journal takes: a day at 10 kHz. More than memory holds."""


def record(
    bench: Bench,
    source: Signal | str | RowSource,
    *,
    control: Control | None = None,
    heartbeat: Heartbeat | None = None,
    on_block: Callable[[Rows], None] | None = None,
    on_mark: Callable[[Mark], None] | None = None,
    **asked: Unpack[RunOptions],
) -> Run:
    """Apply a signal at a bench and record the response, in memory.

    Before the record the channels are read at rest: what the laser and the load cell read then (its
    preload) is subtracted from every reading. Each row is read just before the output changes, so
    that a signal which acts from row 0 shows from row 1 on, and the run has the hold ``zero-before``.
    The output is brought to 0 V at the end, also after an error, and when a limit is passed; the run is
    ``aborted`` then, and its ``state_reason`` says why.

    Parameters
    ----------
    bench : Bench
    source : Signal, str or RowSource
        Applied for ``duration``.
    control : Control, optional
        Ends the run, or marks it, from another thread.
    heartbeat : Heartbeat, optional
        Armed while the output may differ from 0 V.
    on_block : callable of Rows, optional
        Called with the rows of each block, after the guard has checked them.
    on_mark : callable of Mark, optional
        Called with what happens: limits, gaps, notes.
    duration : float [s]
    rate : float [Hz]
    measured, rest_before, rest_after, metadata, limits, tares, zero_time, zero_after
        See ``RunRequest``; after the record nothing is read at rest where ``zero_after`` is left out.

    Returns
    -------
    run : Run
        With ``round((rest_before + duration + rest_after) * rate)`` rows, fewer when it was ended before. A lost
        reading is NaN and flagged, as is a reading at the limit of its converter.

    Raises
    ------
    InputError
        A signal that is longer than the duration, larger than the output gives or than the strip withstands,
        displacement and force at once, an unknown channel, fewer than 2 rows or more than 20 million.
    IpmclabError
        The bench failed. The exception has what was recorded as ``run``, and so has a KeyboardInterrupt.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.rig.virtual import VirtualBench
    >>> run = record(VirtualBench(load_actuator("friend-2")), "step 1 V", duration=2.0, rate=50.0)
    >>> len(run), run.hold, run.metadata.state, [name for name in run.channels if name in ("current", "force")]
    (100, 'zero-before', 'complete', ['current', 'force'])
    """
    asked.setdefault("zero_after", 0.0)
    request, listeners = RunRequest(source=source, **asked), Listeners(on_block=on_block, on_mark=on_mark)
    outcome = capture(bench, request, control=control, heartbeat=heartbeat, listeners=listeners)
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
    request: RunRequest,
    *,
    journal: Callable[[JournalHeader], JournalLike] | None = None,
    control: Control | None = None,
    heartbeat: Heartbeat | None = None,
    listeners: Listeners | None = None,
    finish: Callable[[Bench], Sequence[ZeroReading]] | None = None,
) -> Outcome:
    """Record one run, and say how it ended: ``record`` for those who keep runs in a laboratory.

    Parameters
    ----------
    bench : Bench
    request : RunRequest
    journal : callable of JournalHeader, optional
        Makes the journal, once the zeros are read and before the first volt; every row goes there, and
        ``Outcome.run`` is None. Without it everything stays in memory.
    control : Control, optional
        Ends the run, or marks it, from another thread.
    heartbeat : Heartbeat, optional
        Armed while the output may differ from 0 V.
    listeners : Listeners, optional
    finish : callable of Bench, optional
        Called with the output at 0 V after the zeros are read again; gives further readings, such as the tare.

    Returns
    -------
    outcome : Outcome
        Also when the bench or the journal failed once rows were coming: ``error`` is that failure.

    Raises
    ------
    InputError, IpmclabError
        What cannot be recorded, before a volt was given out. A KeyboardInterrupt, a request to end (SystemExit) or a
        fault of a callback passes to the caller, with the output at 0 V and what was kept marked as aborted.
    """
    played, rows, rate = request.played(MOST_ROWS if journal is None else MOST_ROWS_IN_JOURNAL)
    request = replace(request, rate=rate)
    check_measured(bench.rig, request.measured)
    check_rate(bench.rig, rate)
    guarded = GuardedBench(bench, request.limits)
    guarded.check(played, rate)
    attendants = Attendants(control or Control(), heartbeat, listeners or Listeners())
    recording = Recording(guarded, request, _names(bench.rig, request.measured), attendants)

    def leave(why: str) -> None:
        attendants.control.abort(why)
        bench.zero()

    with on_end_request(bench.zero), on_session_end(leave), _closing(guarded) as closed:
        with own_pauses_reported(OPENING):
            guarded.open(recording.names, rate)
        try:
            rest = _rest_before(guarded, recording, request, attendants.listeners)
        except EndedEarly as ended:
            outcome = Outcome("aborted", str(ended), request.metadata, 0)
        else:
            about = recording.prepare(rest, str(played))
            recording.keep_in(journal, about)
            with _brief_collections():
                outcome = recording.run(played, rows, about, finish)
    return outcome if outcome.error or not closed else replace(outcome, error=closed[0])


def _rest_before(bench: GuardedBench, recording: Recording, request: RunRequest, listeners: Listeners) -> Rest:
    """The channels at rest, once a preload has settled."""
    names, early = recording.names, recording.leave_early
    if request.most_drift is None or "force" not in names:
        return read_rest(bench, names, request.rate, when="before", duration=request.zero_time, on_block=early)
    return wait_for_preload(
        bench,
        names,
        request.rate,
        most_drift=request.most_drift,
        duration=request.zero_time,
        longest_wait=request.longest_wait,
        on_reading=listeners.on_preload,
        on_block=early,
    )


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
