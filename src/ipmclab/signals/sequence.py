"""Signals one after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.signals.signal import EDGE, Signal, check_value, write_value

FloatArray = npt.NDArray[np.float64]


def refuse_idle(signal: Signal, duration: float, *, where: str) -> None:
    """Refuse a part that ends before its own delay does: it would be 0 V throughout.

    Parameters
    ----------
    signal : Signal
    duration : float [s]
        How long the part lasts.
    where : str
        What the message names.

    Raises
    ------
    InputError
    """
    if signal.start >= duration - EDGE:
        raise InputError(
            f"the part lasts {duration:.9g} s and begins to act at {signal.start:.9g} s: it would be 0 V throughout",
            code="never-acts",
            where=where,
            repair=f"give a delay below {duration:.9g} s, or write 'step 0 V' for a rest",
        )


@dataclass(frozen=True)
class Sequence(Signal):
    """Signals one after the other.

    Parameters
    ----------
    signals : tuple of Signal
        The time of each starts at 0 where it begins, so that its delay and phase count from there.
    durations : tuple of float [s]
        How long each lasts. One fewer than the signals: the last has no end of its own.

    Examples
    --------
    >>> from ipmclab.signals import Step
    >>> joined = Sequence((Step(1.0), Step(0.5)), (2.0, 1.0))
    >>> joined.voltage([0.0, 1.0, 2.0, 3.0]).tolist()
    [1.0, 1.0, 0.5, 0.0]
    >>> print(joined)
    step 1 V for 2 s then step 0.5 V for 1 s
    """

    signals: tuple[Signal, ...]
    durations: tuple[float, ...]

    def __post_init__(self) -> None:
        signals, durations = tuple(self.signals), tuple(self.durations)
        if not signals or any(isinstance(one, Sequence) or not hasattr(one, "voltage") for one in signals):
            raise InputError(
                "a sequence is made of one or more signals that are no sequences themselves",
                code="bad-sequence",
                where="signals",
                repair="list their parts one after the other",
            )
        if len(durations) not in (len(signals), len(signals) - 1):
            raise InputError(
                f"{len(durations)} durations for {len(signals)} signals",
                code="unequal-lengths",
                where="durations",
                repair="say how long each lasts; only the last may go without",
            )
        checked = tuple(check_value("duration", one, where=f"durations[{k}]") for k, one in enumerate(durations))
        for k, (one, lasts) in enumerate(zip(signals, checked, strict=False)):
            refuse_idle(one, float(lasts), where=f"signals[{k}]")
        object.__setattr__(self, "signals", signals)
        object.__setattr__(self, "durations", checked)

    @property
    def duration(self) -> float:
        last = 0.0 if len(self.durations) == len(self.signals) else self.signals[-1].duration
        return math.fsum(self.durations) + last

    @property
    def last_start(self) -> float:
        last = self.signals[-1].start if len(self.durations) < len(self.signals) else 0.0
        return math.fsum(self.durations) + last if last else 0.0

    @property
    def reach(self) -> float:
        last = 0.0 if len(self.durations) == len(self.signals) else self.signals[-1].reach
        return math.fsum(self.durations) + last

    @property
    def fastest(self) -> float:
        return max(one.fastest for one in self.signals)

    def check_fits(self, duration: float, rate: float = math.inf) -> None:
        super().check_fits(duration, rate)
        for one in self.signals:
            one.check_fits(math.inf, rate)

    def _shape(self, time: FloatArray) -> FloatArray:
        starts = np.concatenate([[0.0], np.cumsum(self.durations[: len(self.signals) - 1])])
        part = np.searchsorted(starts, time + EDGE, side="right") - 1
        voltage = np.zeros_like(time)
        for k, one in enumerate(self.signals):
            voltage[part == k] = one.voltage(np.maximum(time[part == k] - starts[k], 0.0))
        return voltage

    def __str__(self) -> str:
        lasts = [f" for {write_value('duration', one)}" for one in self.durations] + [""]
        return " then ".join(f"{one}{last}" for one, last in zip(self.signals, lasts, strict=False))
