"""Faults that can be made to happen."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from virtual_cdaq.model.channels import Channel
from virtual_cdaq.model.clock import seconds, ticks
from virtual_cdaq.model.converters import Floats, channel_key, noise
from virtual_cdaq.model.engines import Ticks

KINDS = ("freeze", "drop", "overrun", "stuck", "open", "noise", "unplug")
FOREVER = float("inf")

_TEXT = re.compile(
    r"(?P<kind>[a-z]+)(?:\s+(?P<volts>[0-9.]+(?:e-?\d+)?)\s*V)?(?:\s+on)?(?:\s+(?P<channel>\w+/\w+))?"
    r"\s+at\s+(?P<at>[0-9.]+)\s*s(?P<serving>\s+of\s+serving)?(?:\s+for\s+(?P<duration>[0-9.]+)\s*s)?"
)


@dataclass(frozen=True)
class Fault:
    """One fault.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    at : float [s]
        When, on the clock of the chassis.
    duration : float [s]
        How long; for ever if infinite. Of freeze, drop and unplug: on the wall.
    channel : str
        Of an open terminal or a burst of noise; all if empty.
    volts : float [V]
        Standard deviation of a burst of noise.
    of_serving : bool
        Whether `at` counts from the start of the chassis; else from the start of the first sample clock.
    """

    kind: str
    at: float = 0.0
    duration: float = FOREVER
    channel: str = ""
    volts: float = 1.0
    of_serving: bool = False


def parse_fault(text: str) -> Fault:
    """The fault that a line of text describes.

    Raises
    ------
    ValueError
        It describes none.

    Examples
    --------
    >>> parse_fault("freeze at 2 s").kind
    'freeze'
    >>> parse_fault("noise 0.5 V on cDAQ1Mod1/ai0 at 1 s for 0.2 s").duration
    0.2
    """
    match = _TEXT.fullmatch(text.strip())
    if match is None or match["kind"] not in KINDS:
        raise ValueError(
            f"fault '{text}': one of {', '.join(KINDS)}, then 'at 2 s' (of the first sample clock's run, or"
            " 'at 2 s of serving'), and if it ends 'for 1 s'; 'open cDAQ1Mod3/ai1 at 2 s', 'noise 0.5 V on"
            " cDAQ1Mod1/ai0 at 2 s for 1 s'"
        )
    return Fault(
        kind=match["kind"],
        at=float(match["at"]),
        duration=float(match["duration"]) if match["duration"] else FOREVER,
        channel=match["channel"] or "",
        volts=float(match["volts"] or 1.0),
        of_serving=match["serving"] is not None,
    )


class Faults:
    """The faults of a chassis: those to come and those at work.

    Parameters
    ----------
    planned : sequence of Fault
    """

    def __init__(self, planned: Sequence[Fault] = ()) -> None:
        self._of_serving = sorted((f for f in planned if f.of_serving), key=lambda f: f.at)
        self._of_run = sorted((f for f in planned if not f.of_serving), key=lambda f: f.at)
        self._begun: int | None = None
        self._frozen_until: float | None = None
        self._unplugged_until: float | None = None
        self._stuck = False
        self._stuck_end: int | None = None
        self._distortions: list[tuple[Fault, float]] = []
        self.on_drop: Callable[[float], None] = lambda _: None

    def begin(self, tick: int) -> None:
        """The first sample clock starts."""
        if self._begun is None:
            self._begun = tick

    def due(self) -> int | None:
        """When the next fault comes [ticks]."""
        found = [ticks(self._of_serving[0].at)] if self._of_serving else []
        if self._of_run and self._begun is not None:
            found.append(self._begun + ticks(self._of_run[0].at))
        if self._stuck_end is not None:
            found.append(self._stuck_end)
        return min(found, default=None)

    def due_at(self, tick: int) -> Iterator[Fault]:
        """Those that are due at `tick`, one after the other; a stuck output whose time is over moves again."""
        if self._stuck_end is not None and self._stuck_end <= tick:
            self._stuck, self._stuck_end = False, None
        while self._of_serving and ticks(self._of_serving[0].at) <= tick:
            yield self._of_serving.pop(0)
        while self._of_run and self._begun is not None and self._begun + ticks(self._of_run[0].at) <= tick:
            yield self._of_run.pop(0)

    def happen(self, fault: Fault, tick: int) -> None:
        """Let one fault be at work from now on."""
        now = time.monotonic()
        if fault.kind == "freeze":
            self._frozen_until = now + fault.duration
        elif fault.kind == "drop":
            self.on_drop(fault.duration)
        elif fault.kind == "unplug":
            self._unplugged_until = now + fault.duration
        elif fault.kind == "stuck":
            self._stuck = True
            self._stuck_end = None if fault.duration == FOREVER else tick + ticks(fault.duration)
        elif fault.kind in ("open", "noise"):
            self._distortions.append((fault, seconds(tick)))

    @property
    def frozen(self) -> bool:
        """Whether the chassis answers nobody."""
        return self._frozen_until is not None

    def thaw(self) -> None:
        """End a freeze whose time is over."""
        if self._frozen_until is not None and time.monotonic() >= self._frozen_until:
            self._frozen_until = None

    @property
    def unplugged(self) -> bool:
        """Whether the chassis is not there."""
        return self._unplugged_until is not None and time.monotonic() < self._unplugged_until

    @property
    def stuck(self) -> bool:
        """Whether the outputs stay where they are."""
        return self._stuck

    def distort(self, channel: Channel, values: Floats, points: Ticks) -> Floats:
        """What a faulty wire makes of a terminal's values at the given ticks."""
        if values.shape != points.shape:
            values = np.broadcast_to(values, points.shape)
        if not self._distortions:
            return values
        for fault, begin in self._distortions:
            if fault.channel not in ("", channel.physical):
                continue
            times = points / ticks(1.0)
            at_work = (times >= begin) & (times < begin + fault.duration)
            if not at_work.any():
                continue
            if fault.kind == "open":
                # An open NI 9217 input reads the end of its range; an open voltage input floats away.
                values = np.where(at_work, np.inf, values)
            else:
                key = channel_key(0, f"{channel.physical} burst", 0)
                # One value per millisecond of the chassis, so that no cutting into pieces changes it.
                first = int(points[0] // ticks(1e-5))
                last = int(points[-1] // ticks(1e-5))
                burst = noise(key, first, last - first + 1)[points // ticks(1e-5) - first]
                values = values + np.where(at_work, fault.volts * burst, 0.0)
        return np.asarray(values)
