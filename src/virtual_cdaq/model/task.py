"""A task: its channels, its timing, its states, and what it reserves."""

from __future__ import annotations

import enum
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np

from virtual_cdaq.model.buffers import InputBuffer, OutputBuffer, default_input_size
from virtual_cdaq.model.channels import AUTOMATIC, HIGH_RESOLUTION, Channel, Converter
from virtual_cdaq.model.clock import TICKS_PER_SECOND, sample_period, ticks
from virtual_cdaq.model.engines import Engine
from virtual_cdaq.model.errors import ChassisError, unsupported_value
from virtual_cdaq.model.modules import HIGH_RESOLUTION_CONVERSION, HIGH_SPEED_CONVERSION

FINITE, CONTINUOUS, SINGLE_POINT = 10178, 10123, 12522  # DAQmx_Val_FiniteSamps, _ContSamps, _HWTimedSinglePoint
FEWEST_SAMPLES = 2  # of a finite task
STOPPED_BEFORE_DONE = 200010  # a warning
EXPORTED_TO = ("SAMP_CLK_OUTPUT_TERM", "START_TRIG_OUTPUT_TERM")
ON_DEMAND, SAMPLE_CLOCK = 10390, 10388  # DAQmx_Val_OnDemand, _SampClk


class State(enum.IntEnum):
    """How far a task is on its way to running."""

    UNVERIFIED = 0
    VERIFIED = 1
    RESERVED = 2
    COMMITTED = 3
    RUNNING = 4


@dataclass
class Timing:
    """When a task samples."""

    kind: int = ON_DEMAND
    rate: float = 1000.0
    source: str = ""
    mode: int = CONTINUOUS
    samples: int = 1000


@dataclass
class Listener:
    """Somebody who wants to know when something happens to a task.

    Parameters
    ----------
    kind : {"acquired", "transferred", "signal", "done"}
    every : int
        Samples per channel between two calls.
    call : callable
        Takes the status: 0, or the code of the error that ended the task.
    reported : int
        How often it was called since the task's start.
    close : callable
        Ends whatever waits for the calls.
    """

    kind: Literal["acquired", "transferred", "signal", "done"]
    every: int
    call: Callable[[int], None]
    reported: int = 0
    close: Callable[[], None] = lambda: None


class Host(Protocol):
    """What a task needs of the chassis that it is on."""

    fastest_slow_clock: float
    changed: threading.Condition

    def check_present(self, task: Task) -> None:
        """Refuse when the chassis is unplugged."""

    def check_destination(self, terminal: str) -> None:
        """Refuse to route a signal to a terminal that is not there."""

    def take(self, task: Task) -> None:
        """Reserve an engine and the modules for a task."""

    def release(self, task: Task) -> None:
        """Give back what a task holds."""

    def engine_of_terminal(self, terminal: str, signal: str = ...) -> Engine | None:
        """The engine behind a terminal; None for the task's own."""

    def start_clock(self, task: Task) -> None:
        """Let the engine of a task run, at once or when its trigger comes."""

    def stop_clock(self, task: Task) -> None:
        """Let the engine of a task stand."""

    def converter(self, channel: Channel, *, high_resolution: bool = ...) -> Converter:
        """The converter of a new acquisition on a channel."""

    def advance(self) -> None:
        """Catch up with the clock."""


@dataclass(eq=False)
class Task:
    """One task on a chassis. All its methods are called with the lock of the chassis held.

    Parameters
    ----------
    chassis : Host
    name : str

    Attributes
    ----------
    kind : {"", "ai", "ao"}
        Empty until it has a channel.
    state : State
    explicit : State
        The state that it was brought to by the program, to which a stop returns it.
    engine : Engine or None
        Its own, once reserved.
    clock : Engine or None
        Whose edges it follows: its own engine or another.
    edges : int
        Edges counted since the start.
    ended : bool
        Whether a finite task has done its samples.
    failure : ChassisError or None
        What ended it before its time.
    """

    chassis: Host
    name: str
    channels: list[Channel] = field(default_factory=list)
    kind: Literal["", "ai", "ao"] = ""
    timing: Timing = field(default_factory=Timing)
    trigger: str = ""
    retriggerable: bool = False
    state: State = State.UNVERIFIED
    explicit: State = State.UNVERIFIED
    engine: Engine | None = None
    clock: Engine | None = None
    armed: bool = False
    edges: int = 0
    ended: bool = False
    failure: ChassisError | None = None
    reported_failure: bool = False
    started_by_read: bool = False
    regenerate: bool = True
    overwrite: bool = False
    input_size: int | None = None
    output_size: int | None = None
    input_buffer: InputBuffer | None = None
    output_buffer: OutputBuffer | None = None
    listeners: list[Listener] = field(default_factory=list)
    properties: dict[str, Any] = field(default_factory=dict)
    converters: list[Converter] = field(default_factory=list)
    conversion: int = -1
    held: Any = None
    slow_period: int = 1

    # What it is

    @property
    def hardware_timed(self) -> bool:
        """Whether a sample clock times it."""
        return self.timing.kind == SAMPLE_CLOCK

    @property
    def finite(self) -> bool:
        """Whether it ends by itself."""
        return self.timing.mode == FINITE and not self.retriggerable

    @property
    def running(self) -> bool:
        """Whether it was started and not stopped."""
        return self.state == State.RUNNING

    @property
    def devices(self) -> list[str]:
        """The modules of its channels."""
        return list(dict.fromkeys(channel.device for channel in self.channels))

    @property
    def rate(self) -> float:
        """The rate that the chassis makes of the one asked for [S/s]."""
        return TICKS_PER_SECOND / sample_period(self.timing.rate)

    @property
    def highest_rate(self) -> float:
        """The highest rate of the task's modules together [S/s]; a slow module repeats itself instead."""
        rates = []
        for device in self.devices:
            mine = [channel for channel in self.channels if channel.device == device]
            module = mine[0].module
            if not module.slow:
                rates.append(min(module.rate, module.aggregate_rate / len(mine)))
        return min(rates, default=self.chassis.fastest_slow_clock)

    @property
    def done(self) -> bool:
        """Whether nothing more comes of it."""
        return not self.running or not self.hardware_timed or self.ended or self.failure is not None

    # Configuration

    def add(self, channel: Channel) -> None:
        """Take a channel in."""
        self.refuse_while_running()
        kind = channel.module.kind
        if self.kind and self.kind != kind:
            raise ChassisError(-200559, f"Channel: {channel.physical}\nTask: {self.name}")
        if any(other.name == channel.name for other in self.channels):
            raise ChassisError(-200489, f"Channel: {channel.name}\nTask: {self.name}")
        self.channels.append(channel)
        self.kind = kind
        self.changed()

    def set_sample_clock(self, rate: float, source: str, mode: int, samples: int) -> None:
        """Let a sample clock time the task."""
        self.refuse_while_running()
        if not self.channels:
            raise ChassisError(-200478, f"Task: {self.name}")
        if mode == SINGLE_POINT:
            raise unsupported_value("SampQuant.SampMode", "hardware-timed single point", "finite or continuous samples")
        if mode not in (FINITE, CONTINUOUS):
            raise unsupported_value("SampQuant.SampMode", mode, "finite or continuous samples")
        if not rate > 0.0:
            raise unsupported_value("SampClk.Rate", rate, "above 0 S/s")
        timing = Timing(SAMPLE_CLOCK, rate, "" if source == "OnboardClock" else source, mode, samples)
        self.check_rate(timing)
        self.timing = timing
        self.changed()

    def check_samples(self) -> None:
        """Refuse a finite task of too few samples."""
        timing = self.timing
        if timing.kind == SAMPLE_CLOCK and timing.mode == FINITE and timing.samples < FEWEST_SAMPLES:
            raise unsupported_value("SampQuant.SampPerChan", timing.samples, f"at least {FEWEST_SAMPLES}")

    def check_rate(self, timing: Timing) -> None:
        """Refuse a rate that a module cannot do."""
        if timing.kind == SAMPLE_CLOCK and timing.rate > self.highest_rate * (1 + 1e-9):
            raise unsupported_value(
                "SampClk.Rate", timing.rate, f"at most {self.highest_rate:g} S/s for {len(self.channels)} channels"
            )

    def changed(self) -> None:
        """Forget what was prepared for the configuration before."""
        if self.state > State.UNVERIFIED:
            self.unreserve()
        self.explicit = State.UNVERIFIED
        self.output_buffer = None

    def refuse_while_running(self) -> None:
        """Refuse a change while the task runs (-200479)."""
        if self.running:
            raise ChassisError(-200479, f"Task: {self.name}")

    # States

    def verify(self) -> None:
        """Check that the configuration can be."""
        if not self.channels:
            raise ChassisError(-200478, f"Task: {self.name}")
        self.check_samples()
        self.check_rate(self.timing)
        if self.trigger and not self.hardware_timed:
            raise ChassisError(-200262, f"Task: {self.name}")
        for signal in EXPORTED_TO:
            self.chassis.check_destination(self.properties.get(signal, ""))
        self.chassis.check_present(self)
        self.state = max(self.state, State.VERIFIED)

    def reserve(self) -> None:
        """Take the engine and the modules."""
        if self.state >= State.RESERVED:
            return
        self.verify()
        if self.hardware_timed:
            self.chassis.engine_of_terminal(self.timing.source)
        self.chassis.take(self)
        self.state = State.RESERVED

    def commit(self) -> None:
        """Make everything ready for a start."""
        self.reserve()
        if self.state >= State.COMMITTED:
            return
        if self.hardware_timed and self.kind == "ai":
            self.input_buffer = InputBuffer(len(self.channels), self.input_buffer_size())
        self.state = State.COMMITTED

    def input_buffer_size(self) -> int:
        """Samples per channel of the buffer: as set, or as NI-DAQmx chooses."""
        if self.input_size is not None:
            return self.input_size
        if self.finite:
            return self.timing.samples
        return max(self.timing.samples, default_input_size(self.timing.rate))

    def start(self) -> None:
        """Run."""
        if self.running:
            raise ChassisError(-200479, f"Task: {self.name}")
        before = self.state
        try:
            self.commit()
            self._begin()
        except ChassisError:
            if before < State.RESERVED:
                self.unreserve()
            raise

    def _begin(self) -> None:
        if self.hardware_timed and self.kind == "ao":
            buffer = self.output_buffer
            if buffer is None or buffer.written == 0:
                raise ChassisError(-200462, f"Task: {self.name}")
            if buffer.size < 2:
                raise ChassisError(-200609, f"Buffer: {buffer.size} sample\nTask: {self.name}")
            buffer.rewind()
        self.edges = 0
        self.ended = False
        self.failure = None
        self.reported_failure = False
        self.started_by_read = False
        for listener in self.listeners:
            listener.reported = 0
        self.state = State.RUNNING
        if self.kind == "ai":
            self._prepare_input()
        if self.hardware_timed:
            self.chassis.start_clock(self)
        self.chassis.changed.notify_all()

    def _prepare_input(self) -> None:
        if self.hardware_timed:
            self.input_buffer = InputBuffer(len(self.channels), self.input_buffer_size())
        slow = [channel for channel in self.channels if channel.module.slow]
        fine = False
        if slow:
            mode = slow[0].timing_mode
            fits = self.hardware_timed and self.rate * HIGH_RESOLUTION_CONVERSION * len(slow) <= 1.0
            fine = mode == HIGH_RESOLUTION or (mode == AUTOMATIC and fits)
            each = HIGH_RESOLUTION_CONVERSION if fine else HIGH_SPEED_CONVERSION
            self.slow_period = ticks(each * len(slow))
        self.conversion = -1
        self.held = np.zeros((len(self.channels), 1), dtype=np.int32)
        self.converters = [self.chassis.converter(channel, high_resolution=fine) for channel in self.channels]

    def stop(self) -> int:
        """Stop, and go back to where the program had brought the task.

        Returns
        -------
        int
            0, or the warning 200010 when a finite generation or acquisition was not done.
        """
        failure = None
        warning = 0
        if self.running:
            self.chassis.advance()
            failure = self.failure
            if self.hardware_timed and self.finite and not self.ended and failure is None:
                warning = STOPPED_BEFORE_DONE
            self.chassis.stop_clock(self)
            self.state = State.COMMITTED
            self.armed = False
            if self.explicit < State.RESERVED:
                self.unreserve()
        self.failure = None
        self.chassis.changed.notify_all()
        if failure is not None and not self.reported_failure:
            self.reported_failure = True
            raise failure
        return warning

    def unreserve(self) -> None:
        """Give the engine and the modules back."""
        self.chassis.release(self)
        self.state = State.VERIFIED
        self.armed = False

    def abort(self, failure: ChassisError | None = None) -> None:
        """End at once, as a reset of the device does."""
        was_running = self.running
        self.chassis.stop_clock(self)
        self.unreserve()
        self.explicit = State.UNVERIFIED
        if was_running and failure is not None:
            self.failure = failure
        self.chassis.changed.notify_all()

    def fail(self, failure: ChassisError) -> None:
        """End before its time; its reservation stays until it is stopped."""
        if self.failure is None:
            self.failure = failure

    def raise_failure(self) -> None:
        """Report to the program what ended the task."""
        if self.failure is not None:
            self.reported_failure = True
            raise self.failure

    # Times

    def edge_tick(self, edge: int) -> int | None:
        """When the task's own edge number `edge` comes [ticks]; None if that is not known."""
        if self.clock is None or self.armed or self.done:
            return None
        return self.clock.tick(self.clock.next + edge - self.edges)

    def fed_until(self) -> float:
        """Until when an output has samples [ticks]; for ever where it needs no more, or is no timed output."""
        buffer = self.output_buffer
        if self.kind != "ao" or self.regenerate or buffer is None or self.done:
            return math.inf
        if self.finite and buffer.written >= self.timing.samples:
            return math.inf
        dry = self.edge_tick(buffer.written)
        return math.inf if dry is None else dry - 1

    def done_tick(self) -> int | None:
        """When the task is done [ticks]; None if that is not known."""
        if not self.finite or self.clock is None or self.armed or self.done:
            return None
        last = self.timing.samples
        if self.kind == "ai":
            return self.edge_tick(last - 1)
        if self.clock is self.engine:
            return self.clock.start + last * self.clock.period if self.clock.running else None
        # On a clock of another engine the output is done one edge after its last sample.
        return self.edge_tick(last)
