"""The conditions around the strip during an experiment: set, waited for, kept still while a run is recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import Bench
from ipmclab.rig.chambers.chamber import ChamberError, Conditions
from ipmclab.rig.chambers.watch import ChamberWatch
from ipmclab.rig.experiments.bench_clock import BenchClock
from ipmclab.rig.experiments.environments import TargetEnvironment
from ipmclab.rig.experiments.equilibrium import Air, wait_for_equilibrium
from ipmclab.rig.experiments.steps import watched
from ipmclab.rig.experiments.visits import Visit
from ipmclab.rig.process.messages import Message
from ipmclab.rig.recording.slow import Air as SlowAir
from ipmclab.rig.safety.limit import AIR
from ipmclab.rig.safety.limits import Limits

FloatArray = npt.NDArray[np.float64]

_NOTED: Final = 10.0
"""How often [s] of its own time the waiting for the environment is noted."""

_TOLD: Final = 0.2
"""How often [s] of the wall's time readings are reported at most: a simulated bench is much faster."""

_SMOOTHED: Final = 10
"""Seconds of readings over which drift is averaged: noise is no drift."""

_UNITS: Final = {"temperature": "K", "relative_humidity": "%RH"}


class Desk(Protocol):
    """What this needs of the session."""

    def tell(self, message: Message) -> None:
        """Send to all who listen."""

    def note(self, text: str, *, passing: bool = False) -> None:
        """Something to know."""

    def mark(self, text: str) -> None:
        """Note something at this moment of the run."""

    def abort(self, reason: str = ...) -> None:
        """End the run now."""

    def is_over(self) -> bool:
        """Whether it was asked to end."""


@dataclass(frozen=True)
class Drift:
    """How far the air went while the chamber was still.

    Parameters
    ----------
    seconds : float [s]
    most : mapping of ``"temperature"`` [K] or ``"relative_humidity"`` [percent] to float
    """

    seconds: float
    most: Mapping[str, float]

    def __str__(self) -> str:
        """As people say it."""
        parts = [f"{name.replace('_', ' ')} {size:.2g} {_UNITS[name]}" for name, size in self.most.items()]
        return f"still for {self.seconds:.0f} s, in which the air drifted: {', '.join(parts) or 'not read'}"


class Conditioning:
    """Brings the air to the conditions of an experiment.

    Parameters
    ----------
    bench : Bench
    limits : Limits
    clock : BenchClock
    desk : Desk
    chamber : ChamberWatch, optional
        Where a program can set it; otherwise an operator does.
    """

    def __init__(
        self, bench: Bench, limits: Limits, clock: BenchClock, desk: Desk, chamber: ChamberWatch | None
    ) -> None:
        self._bench = bench
        self._limits = limits
        self._clock = clock
        self._desk = desk
        self._chamber = chamber
        self._visit: Visit | None = None
        self._keeps_still = False
        self._waits = False
        self._still_for = 0.0
        self._base: dict[str, float] = {}
        self._recent: dict[str, list[float]] = {}
        self._most: dict[str, float] = {}
        self._still_since: float | None = None
        self._resumes = False
        self._told = self._reported_reading = 0.0
        self.known: dict[str, Any] = {}
        """What a run is to say of its environment."""
        if chamber is not None:
            chamber.on_reading = self._report_reading
            chamber.on_problem = lambda problem: self._desk.abort(str(problem))

    @property
    def visit(self) -> Visit | None:
        """The condition that is being visited."""
        return self._visit

    @property
    def readings(self) -> Callable[[], Mapping[str, FloatArray]] | None:
        """What gives a recording the readings of the chamber."""
        return None if self._chamber is None else self._chamber.take

    def begin(self, visit: Visit | None) -> None:
        """Set the chamber to a condition, where a program can. Raises InputError, ChamberError."""
        self._visit = visit
        self._still_for, self._base = 0.0, {}
        self._keeps_still = self._waits = False
        self.known["chamber"] = "on"
        self._clock.start("in environment")
        if visit is None:
            return
        environment = visit.environment
        self._desk.tell(Message("condition", {"number": visit.number, "of": visit.of, "name": environment.name}))
        if self._chamber is not None and environment.temperature is not None:
            self._chamber.set(environment.temperature, environment.relative_humidity)

    def wait(self, visit: Visit | None) -> None:
        """Wait for the equilibrium of a condition. Raises what ``wait_for_equilibrium`` raises."""
        self._waits, self._visit = True, visit
        if self._visit is not None:
            self._wait(self._visit.environment, self._visit.environment.settle)

    def leave_still(self) -> None:
        """From now on the chamber is off, or still while a run is recorded."""
        if self._chamber is None:
            self.known["chamber"] = "off"
        self._keeps_still = True

    def stand_by(self) -> None:
        """Let the chamber regulate nothing, where it was ever set. Raises ChamberError."""
        if self._chamber is not None and self._chamber.is_ours:
            self._chamber.safe()

    @contextmanager
    def recording(self, seconds: float) -> Iterator[None]:
        """A block in which a run of so long [s] is recorded, with the chamber still where it may be.

        Before it the air has to be within its tolerance again for as long as the chamber was still before.

        Raises
        ------
        InputError, ChamberError
        """
        if self._chamber is None or self._visit is None:
            yield
            return
        environment = self._visit.environment
        if self._still_for and self._waits:
            self._wait(environment, min(environment.settle, self._still_for))
            self._still_for = 0.0
        if not self._keeps_still or seconds > environment.longest_still:
            self.known["chamber"] = "on"
            yield
            return
        self.known["chamber"] = "still"
        self._chamber.still(environment.longest_still)
        self._recent, self._most, self._still_since, self._resumes = {}, {}, None, False
        yield
        if not self._desk.is_over():  # what is over, also by an error, ends in standby and sets no chamber to work
            # Where it fails the chamber is in standby and nothing is still: the next readings show it.
            with suppress(ChamberError):
                self._chamber.resume()
        self._still_for = seconds
        self._desk.note(str(Drift(seconds, self._most)))

    def look(self, air: SlowAir) -> None:
        """The air of one more second of a run: too far from where it was, the chamber is resumed at once."""
        if self._chamber is None or not self._chamber.is_still or self._resumes or self._visit is None:
            return
        self._still_since = air.time if self._still_since is None else self._still_since
        environment = self._visit.environment
        for name, allowed in environment.most_drift.items():
            value = air.values.get(name, air.values.get(f"chamber_{name}", np.nan))
            if not np.isfinite(value):
                continue
            recent = [*self._recent.get(name, []), float(value)][-_SMOOTHED:]
            self._recent[name] = recent
            if len(recent) < _SMOOTHED:
                continue
            mean = float(np.mean(recent))
            drift = mean - self._base.setdefault(name, mean)
            self._most[name] = max(self._most.get(name, 0.0), abs(drift))
            if abs(drift) > allowed:
                self._resume(f"the {name.replace('_', ' ')} drifted by {drift:+.2g} {_UNITS[name]} while it was still")
                return
        if air.time - self._still_since > environment.longest_still:
            self._resume(f"it was still for {environment.longest_still:g} s")

    def leave(self) -> None:
        """The experiment is over, however: a chamber that was set goes to standby. Another's is not touched.

        Raises
        ------
        ChamberError
            It could not be reached.
        """
        if self._chamber is None or not self._chamber.is_ours:
            return
        try:
            self._chamber.safe()
        except ChamberError as error:
            text = f"the chamber may still hold its set points, standby could not be asked for: {error.message}"
            self._desk.note(text)
            raise ChamberError(
                text, code=error.code, where=error.where, repair="bring it to standby at its panel"
            ) from error

    def _resume(self, why: str) -> None:
        assert self._chamber is not None
        self._resumes = True  # it takes longer than a second: once is enough

        def done(error: ChamberError | None) -> None:
            self._desk.mark(f"the chamber is resumed: {why}" if error is None else f"it cannot be resumed: {error}")

        self._chamber.resume_soon(done)

    def _wait(self, environment: TargetEnvironment, settle: float) -> None:
        limits_watched = watched(environment, self._bench.rig)
        if not limits_watched:
            return
        noted, began = -_NOTED, self._clock.now
        if self._chamber is not None:
            self._chamber.begin()

        def on_air(air: Air) -> bool:
            nonlocal noted
            self._report_waiting(air, environment, settle)
            if air.time - noted >= _NOTED:
                noted = air.time
                self._desk.note(f"{air}, within tolerance for {air.settled_for:.0f} s", passing=True)
            return self._desk.is_over()

        air = wait_for_equilibrium(
            self._bench, environment, limits_watched, on_air, chamber=self._chamber, limits=self._limits, settle=settle
        )
        self._report_waiting(air, environment, settle, last=True)
        self._clock.passed(air.time, since=began)
        for name in AIR:
            value = getattr(air, name)
            if value is not None:
                self.known[name] = self._base[name] = value

    def _report_waiting(self, air: Air, environment: TargetEnvironment, settle: float, *, last: bool = False) -> None:
        if last or time.monotonic() - self._told >= _TOLD:
            self._told = time.monotonic()
            progress = {"waited": air.time, "longest": environment.longest_wait, "settled_for": air.settled_for}
            read = {name: getattr(air, name) for name in AIR if getattr(air, name) is not None}
            self._desk.tell(Message("equilibrium", {**progress, "settle": settle, "is_over": last, **read}))

    def _report_reading(self, conditions: Conditions) -> None:
        """In the thread that reads the chamber."""
        if time.monotonic() - self._reported_reading < _TOLD:
            return
        self._reported_reading = time.monotonic()
        progress = {
            "temperature": conditions.temperature,
            "relative_humidity": conditions.relative_humidity,
            "temperature_set_point": conditions.temperature_set_point,
            "humidity_set_point": conditions.humidity_set_point,
            "mode": conditions.mode,
            "is_still": self._chamber is not None and self._chamber.is_still,
            "alarms": list(conditions.alarms),
        }
        with suppress(IpmclabError):
            self._desk.tell(Message("chamber", progress))
