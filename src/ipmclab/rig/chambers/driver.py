"""What every driver of a real chamber does alike: nothing is half set, and whatever fails ends in standby."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from ipmclab.rig.chambers.chamber import ChamberError, Conditions, Mode, Ranges, Stillness
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.line import LONGEST_QUIET

READ_TIME: Final = 6.0
"""A reading takes at most so long [s], and whoever comes second waits at most so long for the line."""

_POLITE: Final = 1.0
"""So long [s] a reading is left to end by itself where something else is to be done."""

SET_TIME: Final = 10.0
"""Setting takes at most so long [s]; where it fails, bringing the chamber to standby comes on top."""

SAFE_TIME: Final = 7.0
"""Bringing a chamber to standby takes at most so long [s]."""

AGAIN_TIME: Final = LONGEST_QUIET + 2.0
"""And where that has failed within the last ``AGAIN`` s, so long: a line that lost its place is listened to first."""

AGAIN: Final = 15.0

TEMPERATURE_STEP: Final = 0.11
HUMIDITY_STEP: Final = 0.6
"""A set point counts as taken within so much [K, percent]: controllers round to 0.1 K, some to 1 %RH."""

_SETTLE: Final = 0.1
"""How often [s] a chamber is asked whether it does already what it was commanded."""

_REGULATES_NOTHING: Final[tuple[Mode, ...]] = ("standby", "off")

_BY_HAND: Final = "switch the chamber off at its panel: it may continue to regulate"


@dataclass(frozen=True)
class Asked:
    """Set points: temperature [degC], relative humidity [percent] or None for none."""

    temperature: float
    relative_humidity: float | None

    def is_met_by(self, conditions: Conditions) -> bool:
        """Whether these are the set points that a chamber states."""
        near = _near(conditions.temperature_set_point, self.temperature, TEMPERATURE_STEP)
        return near and _near(conditions.humidity_set_point, self.relative_humidity, HUMIDITY_STEP)

    def __str__(self) -> str:
        """As people say it."""
        humidity = "no humidity" if self.relative_humidity is None else f"{self.relative_humidity:g} %RH"
        return f"{self.temperature:g} degC and {humidity}"


class Driver(ABC):
    """A chamber at the end of a line.

    What a subclass adds is its language: seven small methods, each of which has a deadline. The order of what is said,
    and what is done where it fails, is here. ``where`` names the chamber in messages.

    Parameters
    ----------
    where : str
    ranges : Ranges
    """

    def __init__(self, where: str, ranges: Ranges) -> None:
        self.where = where
        self._ranges = ranges
        self._lock = threading.RLock()
        self._unsafe_at = -math.inf
        self._begun: Deadline | None = None
        self._stops: Deadline | None = None  # what is left of a call that failed: bringing it to standby
        self._saving: set[int] = set()  # threads that wait in ``safe`` for the line
        self._reads = False
        self._is_known = False
        self._asked: Asked | None = None
        self._is_still = False

    @property
    def ranges(self) -> Ranges:
        """What it can be set to."""
        return self._ranges

    def set(self, temperature: float, relative_humidity: float | None) -> None:
        """Regulate towards these from now on: see ``Chamber.set``.

        The chamber is asked back what it was commanded. Where anything fails, it is brought to standby.
        """
        self._ranges.check(temperature, relative_humidity)
        with self._turn(SET_TIME) as deadline:
            if self._does(deadline) == "program":
                raise self._in_use("it follows a program that was started at its panel or by another computer")
            self._regulate(Asked(temperature, relative_humidity), deadline)

    def read(self) -> Conditions:
        """What it is like now: see ``Chamber.read``."""
        with self._turn(READ_TIME, reads=True) as deadline:
            return self._state(deadline)

    def still(self, longest: float) -> Stillness:
        """Standby, which stops fan and compressor: see ``Chamber.still``. How far the air drifts is not known here."""
        with self._turn(SAFE_TIME) as deadline:
            self._stop(deadline)
            self._is_still = True
        return Stillness(longest)

    def resume(self) -> None:
        """Regulate again as before ``still``: see ``Chamber.resume``."""
        with self._turn(SET_TIME) as deadline:
            if self._is_still and self._asked is not None:
                self._regulate(self._asked, deadline)
            self._is_still = False

    def safe(self) -> None:
        """Standby: see ``Chamber.safe``. What another thread has begun is cut short."""
        self._saving.add(threading.get_ident())
        self._cut_short()
        if self._stops is not None:
            self._stops.cut()
        with self._turn(self._safe_time, known=False, saves=True) as deadline:  # whoever it is, it can be made to stop
            try:
                self._stop(deadline)
            except ChamberError as error:
                raise ChamberError(
                    f"it could not be brought to standby: {error.message}",
                    code="chamber-not-safe",
                    where=self.where,
                    repair=_BY_HAND,
                ) from error
            finally:
                self._asked, self._is_still = None, False

    def close(self) -> None:
        """Let go of the line: see ``Chamber.close``."""
        self._cut_short()
        taken = self._lock.acquire(timeout=READ_TIME)
        try:
            self._hang_up()
        finally:
            if taken:
                self._lock.release()

    def _regulate(self, asked: Asked, deadline: Deadline) -> None:
        """Set points, then the start, then what it states of both; standby where anything fails."""
        try:
            self._send_temperature(asked.temperature, deadline)
            self._send_humidity(asked.relative_humidity, deadline)
            self._start(deadline)
            self._wait_for(("constant",), deadline)
            stated = self._state(deadline)
            if not asked.is_met_by(stated):
                raise ChamberError(
                    f"{asked} was asked for, and it states {stated}{self._guess(asked, stated)}",
                    code="chamber-refused",
                    where=self.where,
                    repair="look at the limits and the unit that are set at its panel, and that nobody else sets it",
                )
        except BaseException as error:
            self._asked = None
            failure = self._try_to_stop()
            if isinstance(error, ChamberError):
                raise ChamberError(
                    f"{error.message}; {failure}",
                    code=error.code,
                    where=error.where,
                    repair=error.repair if failure == _STOPPED else _BY_HAND,
                ) from error
            raise
        self._asked, self._is_still = asked, False

    def _guess(self, asked: Asked, stated: Conditions) -> str:
        """The unit that would explain a set point."""
        fahrenheit = 1.8 * asked.temperature + 32.0
        is_fahrenheit = _near(stated.temperature_set_point, fahrenheit, 0.2)
        return ": these are degrees Fahrenheit" if is_fahrenheit else ""

    def _try_to_stop(self) -> str:
        deadline = self._stops = Deadline(self._safe_time)
        if self._saving:  # looked at after the deadline is there to be cut: ``safe`` misses neither
            deadline.cut()
        try:
            self._stop(deadline)
        except ChamberError:
            return "it could not be brought to standby either"
        finally:
            self._stops = None
        return _STOPPED

    @property
    def _safe_time(self) -> float:
        """How long standby is tried for [s]: whoever could not be reached just now is not waited for as long again."""
        return AGAIN_TIME if time.monotonic() - self._unsafe_at < AGAIN else SAFE_TIME

    def _stop(self, deadline: Deadline) -> None:
        try:
            self._standby(deadline)
            self._wait_for(_REGULATES_NOTHING, deadline)
        except ChamberError:
            self._unsafe_at = time.monotonic()
            raise
        self._unsafe_at = -math.inf

    def _wait_for(self, modes: tuple[Mode, ...], deadline: Deadline) -> None:
        """Wait until it does what it was commanded. Raises ChamberError."""
        while (mode := self._does(deadline)) not in (*modes, "unknown"):
            if deadline.left < 2.0 * _SETTLE:
                raise ChamberError(
                    f"{modes[0]} was requested, and the chamber continues with {mode}",
                    code="chamber-refused",
                    where=self.where,
                    repair="look at its panel: it may be locked, or stopped by an alarm",
                )
            time.sleep(_SETTLE)

    def _in_use(self, why: str) -> ChamberError:
        return ChamberError(
            why, code="chamber-in-use", where=self.where, repair="end that, and see that nobody else uses the chamber"
        )

    def _cut_short(self) -> None:
        """Let another thread's call end as soon as it looks at its deadline."""
        begun = self._begun
        if begun is not None:
            begun.cut()

    @contextmanager
    def _turn(
        self, seconds: float, *, known: bool = True, reads: bool = False, saves: bool = False
    ) -> Iterator[Deadline]:
        """Have the line for oneself. A reading that does not end is cut short for anything else than a reading.

        Standby is never cut short: whoever waits for it wants nothing else, or may wait.
        """
        try:
            taken = self._lock.acquire(timeout=_POLITE)
            if not taken:
                if self._reads and not reads:
                    self._cut_short()
                taken = self._lock.acquire(timeout=READ_TIME)
        finally:
            self._saving.discard(threading.get_ident())
        if not taken:
            raise self._in_use(f"another part of this program has been speaking to it for {READ_TIME:g} s")
        try:
            deadline = Deadline(seconds)
            self._reads, self._begun = reads, None if saves else deadline
            if self._saving and not saves:  # they came after the line was taken, and before there was a deadline
                deadline.cut()
            if known and not self._is_known:
                self._identify(deadline)
                self._is_known = True
            yield deadline
        finally:
            self._begun = None
            self._lock.release()

    @abstractmethod
    def _identify(self, deadline: Deadline) -> None:
        """Whether it is the chamber that this driver is for. Raises ChamberError."""

    def _does(self, deadline: Deadline) -> Mode:
        """What it does now; a driver asks for less than everything where it can. Raises ChamberError."""
        return self._state(deadline).mode

    @abstractmethod
    def _state(self, deadline: Deadline) -> Conditions:
        """Everything that it states; set points only where it regulates. Raises ChamberError."""

    @abstractmethod
    def _send_temperature(self, temperature: float, deadline: Deadline) -> None:
        """Give it a set point [degC]. Raises ChamberError."""

    @abstractmethod
    def _send_humidity(self, relative_humidity: float | None, deadline: Deadline) -> None:
        """Give it a set point [percent], or none. Raises ChamberError."""

    @abstractmethod
    def _start(self, deadline: Deadline) -> None:
        """Let it regulate. Raises ChamberError."""

    @abstractmethod
    def _standby(self, deadline: Deadline) -> None:
        """Let it regulate nothing. Raises ChamberError."""

    @abstractmethod
    def _hang_up(self) -> None:
        """Let go of the line; never fails."""


_STOPPED: Final = "it was brought to standby"


def _near(stated: float | None, wanted: float | None, within: float) -> bool:
    if stated is None or wanted is None:
        return stated is wanted
    return abs(stated - wanted) <= within
