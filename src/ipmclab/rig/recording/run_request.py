"""What is asked of a recording: what is played, what is read, what is known; and who listens."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Required, TypedDict

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.request import above_zero, count_rows
from ipmclab.rig.recording.keeping import Rows
from ipmclab.rig.recording.slow import Air
from ipmclab.rig.recording.zeroing import LONGEST_WAIT, ZERO_TIME
from ipmclab.rig.rows import RestedRows, RowSource, SignalRows
from ipmclab.rig.safety.limits import Limits
from ipmclab.run import Mark, RunMetadata, ZeroReading
from ipmclab.signals import Sequence as SignalSequence
from ipmclab.signals import Signal, Step, parse
from ipmclab.signals.signal import EDGE

FloatArray = npt.NDArray[np.float64]

DISCHARGE_TIME: Final = 5.0
"""How long [s] the discharge of the strip is recorded after a limit was passed, or after an emergency zero."""


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """One run that is to be recorded.

    Parameters
    ----------
    source : Signal, str or RowSource
        What is played: a signal, its text, or what decides its voltages while the readings come.
    duration : float [s], optional
        For which it is played; left out, a source other than a signal is played to its end.
    rate : float [Hz]
    measured : sequence of str
        ``"current"`` and ``"displacement"`` or ``"force"``; the voltage and the current are always read, and so is
        the air where the rig has sensors for it.
    rest_before, rest_after : float [s]
        Time at 0 V that is recorded before and after it.
    metadata : RunMetadata
        What is to be kept with the run: mounting, operator, notes... The recorder fills in what it knows.
    limits : Limits
        What the guard watches.
    tares : sequence of ZeroReading
        Readings of the load cell with the tip clear of it.
    zero_time, zero_after : float [s]
        How long the channels are read at rest before and after the record, 3 rows at least; 0 after it reads nothing.
    most_drift : float [N/s], optional
        The preload is read again until it drifts no faster.
    longest_wait : float [s]
        For that.
    discharge : float [s]
        How long is recorded after a limit was passed, or after an emergency zero.
    slow : callable, optional
        Gives at once what slow instruments outside the bench, such as a chamber, have read since the last call: for
        each of ``SLOW_CHANNELS`` that they read a float array, perhaps an empty one.

    Raises
    ------
    InputError
        A duration that is not above 0, or none for a signal; another time that is below 0, or has no end.

    Examples
    --------
    >>> RunRequest(source="step 1 V", duration=2.0, rate=50.0, rest_before=-1.0)
    Traceback (most recent call last):
    ...
    ipmclab.errors.InputError: rest_before: rest_before is -1; give 0 s or more
    """

    source: Signal | str | RowSource
    duration: float | None = None
    rate: float
    measured: Sequence[str] = ("current", "force")
    rest_before: float = 0.0
    rest_after: float = 0.0
    metadata: RunMetadata = field(default_factory=RunMetadata)
    limits: Limits = field(default_factory=Limits)
    tares: Sequence[ZeroReading] = ()
    zero_time: float = ZERO_TIME
    zero_after: float = ZERO_TIME
    most_drift: float | None = None
    longest_wait: float = LONGEST_WAIT
    discharge: float = DISCHARGE_TIME
    slow: Callable[[], Mapping[str, FloatArray]] | None = None

    def __post_init__(self) -> None:
        if self.duration is not None:
            object.__setattr__(self, "duration", above_zero("duration", self.duration, "s"))
        elif isinstance(self.source, (Signal, str)):
            raise InputError(
                "a signal is applied for a duration",
                code="missing-duration",
                where="duration",
                repair="say for how long, such as 40 s",
            )
        for name in ("rest_before", "rest_after", "zero_time", "zero_after", "longest_wait", "discharge"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise InputError(f"{name} is {value:g}", code="out-of-range", where=name, repair="give 0 s or more")

    def played(self, most: int) -> tuple[RowSource, int, float]:
        """What is played with its rest, how many rows that are, and their rate [Hz].

        Parameters
        ----------
        most : int
            Rows that can be kept; a source that continues until it is ended is ended there.

        Raises
        ------
        InputError
            A signal that does not fit into its duration, fewer than 2 rows or more than can be kept.
        """
        if self.duration is not None and isinstance(self.source, (Signal, str)):
            signal = parse(self.source) if isinstance(self.source, str) else self.source
            rows, rate = count_rows(self.rest_before + self.duration + self.rest_after, self.rate, most=most)
            rested = _with_rest(signal, self.rest_before, self.duration, self.rest_after, rate)
            return SignalRows(rested, rows), rows, rate
        assert not isinstance(self.source, (Signal, str))
        rate = above_zero("rate", self.rate, "Hz")
        before, after = round(self.rest_before * rate), round(self.rest_after * rate)
        asked = None if self.duration is None else round(self.duration * rate)
        known = [length for length in (self.source.length, asked) if length is not None]
        length = min(known, default=most - before - after)
        rows, rate = count_rows((before + length + after) / rate, rate, most=most)
        return RestedRows(self.source, before, after, length), rows, rate


class RunOptions(TypedDict, total=False):
    """What ``record`` takes of a ``RunRequest`` by name."""

    duration: float
    rate: Required[float]
    measured: Sequence[str]
    rest_before: float
    rest_after: float
    metadata: RunMetadata
    limits: Limits
    tares: Sequence[ZeroReading]
    zero_time: float
    zero_after: float


@dataclass(frozen=True)
class Listeners:
    """Who is called with what happens while a run is recorded; what they raise ends it.

    Parameters
    ----------
    on_block : callable of Rows, optional
        The rows of each block, after the guard has checked them.
    on_mark : callable of Mark, optional
        What happens: limits, gaps, notes.
    on_end : callable of Mark and int, optional
        In the place of ``on_mark``, what ended the signal early once the output is at 0 V: an operator or a limit; and
        how many rows the run will have.
    on_air : callable of Air, optional
        What the air around the strip is like, once a second.
    on_preload : callable of ZeroReading, optional
        Each reading of the preload.
    """

    on_block: Callable[[Rows], None] | None = None
    on_mark: Callable[[Mark], None] | None = None
    on_end: Callable[[Mark, int], None] | None = None
    on_air: Callable[[Air], None] | None = None
    on_preload: Callable[[ZeroReading], None] | None = None


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
