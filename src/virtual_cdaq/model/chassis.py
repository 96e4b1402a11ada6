"""The chassis: slots, engines, the passage of time, and who holds what.

Nothing here runs by itself. Whoever looks (a read, a write, the pump of the server) first lets the chassis catch up
with its clock: all edges since the last look are worked through in one go, in the order in which they came, with the
plant behind the terminals. Inputs are read before outputs change on a common edge.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from virtual_cdaq.model.channels import Channel, Converter
from virtual_cdaq.model.clock import TICKS_PER_SECOND, LockStepClock, RealClock, sample_period, seconds, ticks
from virtual_cdaq.model.converters import Floats
from virtual_cdaq.model.engines import INPUT_ENGINES, OUTPUT_ENGINE, START_DELAY, Engine, Ticks
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.exchange import exchange
from virtual_cdaq.model.faults import Fault, Faults
from virtual_cdaq.model.listening import tell
from virtual_cdaq.model.modules import MODULES, Module
from virtual_cdaq.model.plant import Plant
from virtual_cdaq.model.scales import Scale
from virtual_cdaq.model.task import FINITE, State, Task

SEED = 20261121
AT_ONCE = 32_768  # edges of one clock that are worked through in one go
ON_DEMAND = 1e-3  # s that an on-demand call takes when time does not move between calls


@dataclass(frozen=True)
class Slot:
    """A module in its slot.

    Parameters
    ----------
    number : int
        From 1.
    device : str
        The name of the module, such as ``cDAQ1Mod1``.
    module : Module
    """

    number: int
    device: str
    module: Module


@dataclass(eq=False)
class HostedTask(Task):
    """A task that gives whoever holds it the whole chassis."""

    chassis: Chassis

    @property
    def all_devices(self) -> list[str]:
        """The modules of its channels, and the chassis that they are in."""
        return list(dict.fromkeys([*self.devices, self.chassis.name])) if self.channels else []


class Chassis:
    """A cDAQ-9174 with its modules and whatever is wired to them.

    Parameters
    ----------
    plant : Plant
    clock : RealClock or LockStepClock
    name : str
    modules : sequence of str
        Products, from slot 1 on.
    seed : int
        Of the converters' noise and offset.
    on_demand : float [s]
        What an on-demand call takes on a clock that otherwise does not move.
    faults : sequence of Fault

    Examples
    --------
    >>> from virtual_cdaq.model.plant import RcPlant
    >>> chassis = Chassis(RcPlant(), LockStepClock())
    >>> [slot.device for slot in chassis.slots]
    ['cDAQ1Mod1', 'cDAQ1Mod2', 'cDAQ1Mod3']
    """

    product = "cDAQ-9174"
    number = 29885
    trigger_inputs: tuple[str, ...] = ()  # a cDAQ-9174 has none without a digital module
    inner_channels: ClassVar[Mapping[str, str]] = {}  # names of inputs within the device; it has none
    category = 14658  # DAQmx_Val_CompactDAQChassis
    input_engines = INPUT_ENGINES
    fastest_slow_clock = 400.0  # S/s, of a task with nothing but slow modules

    def __init__(
        self,
        plant: Plant,
        clock: RealClock | LockStepClock,
        *,
        name: str = "cDAQ1",
        modules: Sequence[str] = ("NI 9205", "NI 9263", "NI 9217"),
        seed: int = SEED,
        on_demand: float = ON_DEMAND,
        faults: Sequence[Fault] = (),
    ) -> None:
        if not 1 <= len(modules) <= 4:
            raise ValueError(f"a cDAQ-9174 has 4 slots, not {len(modules)} modules")
        self.plant = plant
        self.clock = clock
        self._fed = (math.inf, 0, 0.0)  # until when the outputs have samples [ticks], seen when [ticks, s]
        self.name = name
        self.seed = seed
        self.slots = [
            Slot(number, self.device_name(number), MODULES[product]) for number, product in enumerate(modules, start=1)
        ]
        self.levels = {
            f"{slot.device}/ao{index}": 0.0
            for slot in self.slots
            if slot.module.kind == "ao"
            for index in range(slot.module.channels)
        }
        self.engines = {engine: Engine(engine) for engine in (*self.input_engines, OUTPUT_ENGINE)}
        self.tasks: list[HostedTask] = []
        self.scales: dict[str, Scale] = {}
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        self.caller = threading.local()
        self.closing = False
        self.faults = Faults(faults)
        self.on_level: Callable[[dict[str, float]], None] = lambda _: None
        self._shown = dict(self.levels)
        self._on_demand = ticks(on_demand)
        self.tick = 0
        self._acquisitions: dict[str, int] = {}

    def device_name(self, number: int) -> str:
        """The name of the module in a slot."""
        return f"{self.name}Mod{number}"

    @property
    def devices(self) -> list[str]:
        """The names of the chassis and its modules."""
        return list(dict.fromkeys([self.name, *(slot.device for slot in self.slots)]))

    @property
    def time(self) -> float:
        """How far the chassis has come [s]."""
        return seconds(self.tick)

    # Tasks and what they hold

    def new_task(self, name: str) -> HostedTask:
        """A task without channels."""
        task = HostedTask(self, name)
        self.tasks.append(task)
        return task

    def clear(self, task: HostedTask) -> None:
        """Stop a task and forget it."""
        try:
            if task.running:
                task.stop()
        except ChassisError:
            pass
        finally:
            task.unreserve()
            if task in self.tasks:
                self.tasks.remove(task)
            self.changed.notify_all()

    def take(self, task: Task) -> None:
        """Reserve an engine and the modules for `task`."""
        for other in self.tasks:
            if other is not task and other.state >= State.RESERVED:
                reason = _conflict(task, other)
                if reason:
                    raise ChassisError(-50103, f"{reason}\nTask: {task.name}\nHeld by: {other.name}")
        if not task.hardware_timed:
            return
        free = self.free_engine(task)
        if free is None:
            raise ChassisError(-50103, f"No timing engine is free.\nTask: {task.name}")
        free.reserved = True
        task.engine = free
        task.clock = self.engine_of_terminal(task.timing.source) or free

    def free_engine(self, task: Task) -> Engine | None:
        """The engine that a task would get now."""
        names = self.input_engines if task.kind == "ai" else (OUTPUT_ENGINE,)
        return next((self.engines[name] for name in names if not self.engines[name].reserved), None)

    def release(self, task: Task) -> None:
        """Give back what `task` holds."""
        engine = task.engine
        if engine is not None:
            engine.running = False
            engine.reserved = False
        task.engine = None
        task.clock = None

    def engine_of_terminal(self, terminal: str, signal: str = "SampleClock") -> Engine | None:
        """The engine behind a terminal such as ``/cDAQ1/te0/SampleClock``; None for the task's own.

        Raises
        ------
        ChassisError
            -89120, no such terminal.
        """
        if terminal in ("", "OnboardClock"):
            return None
        parts = terminal.strip("/").split("/")
        if len(parts) == 3 and parts[0].lower() == self.name.lower():
            parts = parts[1:]
        if len(parts) == 2 and parts[1].lower() == signal.lower():
            for name, engine in self.engines.items():
                if name.lower() == parts[0].lower():
                    return engine
        if parts[-1] in self.trigger_inputs:
            return None
        raise ChassisError(-89120, f"Terminal: {terminal}")

    def check_destination(self, terminal: str) -> None:
        """Refuse to route a signal to where this chassis has no terminal to give it away (-89121)."""
        if terminal and terminal.rpartition("/")[2] not in self.trigger_inputs:
            raise ChassisError(-89121, f"Destination: {terminal}")

    def full_terminal(self, terminal: str) -> str:
        """A terminal with the name of its device: ``/cDAQ1/te0/SampleClock``.

        Raises
        ------
        ChassisError
            -89120, no such terminal.
        """
        parts = terminal.strip("/").split("/")
        if parts[0].lower() == self.name.lower():
            parts = parts[1:]
        for signal in ("SampleClock", "StartTrigger"):
            if parts[-1].lower() == signal.lower():
                self.engine_of_terminal(terminal, signal)
                return "/".join(["", self.name, *parts])
        self.engine_of_terminal(terminal)
        return "/".join(["", self.name, *parts])

    def check_present(self, task: Task) -> None:
        """Refuse when the chassis is unplugged."""
        if self.faults.unplugged:
            raise ChassisError(-201003, f"Device: {self.name}\nTask: {task.name}")

    def converter(self, channel: Channel, *, high_resolution: bool = False) -> Converter:
        """The converter of a new acquisition on a channel."""
        acquisition = self._acquisitions.get(channel.physical, 0)
        self._acquisitions[channel.physical] = acquisition + 1
        # Of the sensor at the terminal, where the plant states it: added here, so that it goes by the sample too.
        sensor = getattr(self.plant, "noise", {}).get(channel.physical, 0.0)
        return Converter(channel, self.seed, acquisition, high_resolution=high_resolution, sensor_noise=sensor)

    def reset(self, devices: Iterable[str]) -> None:
        """Abort every task on the devices and bring their outputs to 0 V."""
        devices = set(devices)
        self.advance()
        for task in list(self.tasks):
            if devices & set(task.devices):
                task.abort(ChassisError(-88709, f"Task: {task.name}"))
        self.look()
        for physical in self.levels:
            if physical.split("/")[0] in devices:
                self.set_level(physical, 0.0)
        self.show()

    # Starting and stopping clocks

    def start_clock(self, task: Task) -> None:
        """Let the engine of a task run, at once or when its trigger comes."""
        if task.clock is not task.engine:
            return
        if task.trigger:
            task.armed = True
            return
        self.advance()
        self._begin_clock(task, max(self.clock.now(), self.tick) + START_DELAY)

    def _begin_clock(self, task: Task, tick: int) -> None:
        engine = task.engine
        assert engine is not None
        task.armed = False
        limit = task.timing.samples if task.timing.mode == FINITE else None
        engine.begin(tick, sample_period(task.timing.rate), limit)
        self.faults.begin(tick)
        for other in self.tasks:
            if other.armed and self.engine_of_terminal(other.trigger, "StartTrigger") is engine:
                self._begin_clock(other, tick)
        self.changed.notify_all()

    def pulse(self, terminal: str) -> None:
        """An edge on a trigger input: every task that waits for it starts."""
        self.advance()
        tick = max(self.clock.now(), self.tick) + START_DELAY
        for task in self.tasks:
            engine = task.engine
            if engine is None or task.trigger.rpartition("/")[2] != terminal:
                continue
            spent = engine.running and engine.limit is not None and engine.next >= engine.limit
            if task.armed or (task.retriggerable and task.running and spent):
                self._begin_clock(task, tick)

    def stop_clock(self, task: Task) -> None:
        """Let the engine of a task stand."""
        if task.engine is not None:
            task.engine.running = False

    # Time

    def advance(self) -> None:
        """Catch up with the clock."""
        self.run_to(self._present())

    def _present(self) -> int:
        """The present. A clock that is faster than life waits where an output would run dry.

        It waits until so much time has passed on the wall since the output was fed: whoever feeds it has as much as
        with a chassis of metal.
        """
        now = self.clock.now()
        if not isinstance(self.clock, RealClock) or self.clock.speed <= 1.0:
            return now
        fed, wall = (
            min((task.fed_until() for task in self.tasks if task.running), default=math.inf),
            time.perf_counter(),
        )
        if fed != self._fed[0]:
            self._fed = (fed, self.tick, wall)
        real = self._fed[1] + ticks(wall - self._fed[2])
        if now > max(fed, real):
            now = max(int(fed), real, self.tick)
            self.clock.continue_from(now)
        return now

    def pass_time(self) -> None:
        """What an on-demand call, or a look at a task, takes on a clock that does not move between calls."""
        if isinstance(self.clock, LockStepClock):
            self.clock.step_to(self.clock.now() + self._on_demand)
        self.advance()

    def run_to(self, target: int) -> None:
        """Work through all edges up to and with tick `target`, and through the faults that fall due on the way."""
        while True:
            due = self.faults.due()
            stop = target if due is None else min(target, max(due, self.tick))
            self._run(stop)
            if due is None or due > target:
                break
            for fault in self.faults.due_at(due):
                self.suffer(fault, due)
        tell(self.tasks)
        self.show()

    def suffer(self, fault: Fault, tick: int) -> None:
        """Let one fault happen now, with what it does to the tasks."""
        self.faults.happen(fault, tick)
        for task in self.tasks:
            if fault.kind == "unplug" and task.running:
                task.fail(ChassisError(-201003, f"Device: {self.name}\nTask: {task.name}"))
            elif fault.kind == "overrun" and task.running and task.kind == "ai" and task.hardware_timed:
                task.fail(ChassisError(-200279, f"Task: {task.name}", done=0))
        self.changed.notify_all()

    def look(self) -> tuple[Ticks, Mapping[str, Floats]]:
        """Let the plant come to the present, with the outputs as they are, and look at its terminals."""
        tick = max(self._present(), self.tick) + 1
        self.run_to(tick)
        points = np.array([tick + 1], dtype=np.int64)
        self.tick = tick + 1
        outputs = {physical: np.array([level]) for physical, level in self.levels.items()}
        return points, self.plant.advance(points / TICKS_PER_SECOND, outputs)

    def _run(self, target: int) -> None:
        while self.tick < target:
            stop = target
            running = [engine for engine in self.engines.values() if engine.running]
            if not running:
                self.tick = target
                return
            for engine in running:
                last = engine.tick(engine.next + AT_ONCE)
                if last is not None:
                    stop = min(stop, max(last, self.tick + 1))
            edges = {engine: engine.edges(stop) for engine in running}
            some = [each for each in edges.values() if each.size]
            if some:
                points = some[0] if len(some) == 1 else np.unique(np.concatenate(some))
                changes = exchange(self.tasks, self.plant, self.levels, self.faults, points, edges)
                for physical, level in changes:
                    self.set_level(physical, level)
                for engine, each in edges.items():
                    engine.next += each.size
            self.tick = stop
            for task in self.tasks:
                self._check_end(task)

    def _check_end(self, task: Task) -> None:
        """A finite output on its own clock is done one period after its last sample."""
        if task.running and task.kind == "ao" and task.engine is not None and task.clock is task.engine:
            engine = task.engine
            if engine.limit is not None and not task.ended and not task.armed and engine.next >= engine.limit:
                task.ended = self.tick >= engine.start + engine.limit * engine.period

    def set_level(self, physical: str, level: float) -> None:
        """Let an output give another voltage, unless it is stuck."""
        if not self.faults.stuck:
            self.levels[physical] = level

    def show(self) -> None:
        """Inform whoever follows the levels, when one has changed."""
        if self.levels != self._shown:
            self._shown = dict(self.levels)
            self.on_level(dict(self.levels))

    def wall_time(self, task: Task, back: int) -> float:
        """Wall time [s] of the sample `back` samples before a task's next to be read; the present without a clock."""
        now = time.time()
        if task.clock is None or task.input_buffer is None or not task.clock.running:
            return now
        tick = task.clock.start + (task.input_buffer.position - back) * task.clock.period
        return now - self.clock.wall(max(0, self.clock.now() - tick))

    def close(self) -> None:
        """Let every waiting call go."""
        with self.lock:
            self.closing = True
            self.changed.notify_all()


def _conflict(task: Task, other: Task) -> str:
    """Why two tasks cannot hold what they need at one time; empty if they can."""
    if task.kind != other.kind:
        return ""
    shared = [device for device in task.devices if device in other.devices]
    if not shared:
        return ""
    if task.kind == "ai":
        return f"Module: {', '.join(shared)}"
    if task.hardware_timed != other.hardware_timed:
        return f"The channels of {shared[0]} are all hardware-timed or all software-timed."
    mine = {channel.physical for channel in task.channels}
    both = sorted(mine & {channel.physical for channel in other.channels})
    return f"Channel: {', '.join(both)}" if both else ""
