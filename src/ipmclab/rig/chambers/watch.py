"""A chamber as an experiment holds it: read about once a second in addition to everything else, and believed only so
far."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.chambers.chamber import Chamber, ChamberError, Conditions, Ranges, Stillness
from ipmclab.rig.chambers.driver import HUMIDITY_STEP, TEMPERATURE_STEP

FloatArray = npt.NDArray[np.float64]

PERIOD: Final = 1.0
"""How often [s] a chamber is read."""

SILENT: Final = 12.0
"""After so long [s] without a reading the chamber counts as lost: with the last attempt to read it, and that to let it
stand by, what is recorded ends within ``DEADLINE``."""

_TWICE: Final = 2
"""An alarm, or a set point that nobody asked for, counts once it is in so many readings."""


class ChamberWatch:
    """Reads a chamber in a thread of its own, never in the loop that samples a strip.

    Parameters
    ----------
    chamber : Chamber
        Closed with this.
    clock : callable, optional
        The time [s] of a simulated bench, which runs faster than that of the wall: the chamber, simulated too, is then
        read by that clock wherever its readings are asked for, and there is no thread.
    keeper : callable of bool, optional
        Called when the chamber regulates for this program (true), and that it is in standby again (false).

    Examples
    --------
    >>> from ipmclab.rig.chambers.virtual import VirtualChamber
    >>> watch = ChamberWatch(VirtualChamber(lambda: 0.0), clock=lambda: 0.0)
    >>> watch.set(25.0, 60.0)
    >>> {name: len(values) for name, values in watch.take().items()}
    {'chamber_temperature': 1, 'chamber_relative_humidity': 1}
    >>> watch.safe(), watch.close()
    (None, None)
    """

    def __init__(
        self,
        chamber: Chamber,
        *,
        clock: Callable[[], float] | None = None,
        keeper: Callable[[bool], None] | None = None,
    ) -> None:
        self._chamber = chamber
        self._is_simulated = clock is not None
        self._clock = clock or time.monotonic
        self._keeper = keeper
        self._lock = threading.Lock()
        self._readings: list[Conditions] = []
        self._latest: Conditions | None = None
        self._heard = self._clock()
        self._next = self._heard
        self._failure: ChamberError | None = None
        self._asked: tuple[float, float | None] | None = None
        self._is_ours = False
        self._is_still = False
        self._odd = ("", 0)
        self._problem: ChamberError | None = None
        self._began = time.monotonic()
        self._later: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self.on_reading: Callable[[Conditions], None] = lambda _: None
        """Called with each reading, in the thread that reads."""
        self.on_problem: Callable[[ChamberError], None] = lambda _: None
        """Called once, when the chamber can be relied on no more, in the thread that reads."""

    @property
    def ranges(self) -> Ranges:
        """What it can be set to."""
        return self._chamber.ranges

    @property
    def latest(self) -> Conditions | None:
        """The last reading."""
        return self._latest

    @property
    def is_still(self) -> bool:
        """Whether its fan and compressor are off for the strip's sake."""
        return self._is_still

    @property
    def is_ours(self) -> bool:
        """Whether this program ever commanded it to regulate: what follows another's program is not let stand by."""
        return self._is_ours

    def set(self, temperature: float, relative_humidity: float | None) -> None:
        """Regulate towards these from now on, and read it from now on. Raises InputError, ChamberError."""
        if self._keeper is not None:
            self._keeper(True)
        self._asked = None  # until it is set, what it states is another's word
        was_ours, self._is_ours = self._is_ours, True
        try:
            self._chamber.set(temperature, relative_humidity)
        except IpmclabError as error:
            if isinstance(error, InputError) or error.code == "chamber-in-use":  # it got no command
                self._is_ours = was_ours
                if self._keeper is not None and not was_ours:
                    self._keeper(False)
            raise
        with self._lock:
            self._asked, self._is_still, self._odd = (temperature, relative_humidity), False, ("", 0)
            self._heard = self._clock()
        self._start()

    def still(self, longest: float) -> Stillness:
        """Fan and compressor off. Raises ChamberError."""
        self._is_still = True
        try:
            return self._chamber.still(longest)
        except IpmclabError:
            self._is_still = False
            raise

    def resume(self) -> None:
        """Regulate again; nothing where it is not still. Raises ChamberError.

        Where it fails, the chamber does not do what it was asked, and the next readings say so.
        """
        if self._is_still:
            try:
                self._await_answer()
                self._chamber.resume()
            finally:
                self._is_still, self._odd = False, ("", 0)

    def resume_soon(self, done: Callable[[ChamberError | None], None]) -> None:
        """As ``resume``, without waiting for it: from the loop that samples a strip.

        Parameters
        ----------
        done : callable
            Called when it is resumed, or with what failed.
        """

        def act() -> None:
            try:
                self.resume()
            except Exception as error:
                done(_as_chamber_error(error))
            else:
                done(None)

        if self._is_simulated:
            act()
        else:
            self._later.put(act)

    def safe(self) -> None:
        """Let it stand by, whatever happened. Raises ChamberError only where it could not be reached."""
        self._asked, self._is_still = None, False
        self._stop_reading()  # a line that fails is asked no more than this
        self._chamber.safe()
        if self._keeper is not None:
            self._keeper(False)

    def close(self) -> None:
        """Read it no more, and let go of it."""
        self._stop_reading()
        self._chamber.close()

    def take(self) -> dict[str, FloatArray]:
        """What was read since the last call; never waits for the chamber.

        Returns
        -------
        readings : mapping of ``"chamber_temperature"`` and ``"chamber_relative_humidity"`` to float array
            [degC] [percent]
        """
        self._look()
        with self._lock:
            taken, self._readings = self._readings, []
        humidities = [one.relative_humidity for one in taken if one.relative_humidity is not None]
        return {
            "chamber_temperature": np.array([one.temperature for one in taken], dtype=np.float64),
            "chamber_relative_humidity": np.array(humidities, dtype=np.float64),
        }

    def check(self) -> None:
        """Raises ChamberError where the chamber can be relied on no more."""
        self._look()
        if self._problem is not None:
            raise self._problem

    def pace(self, seconds: float) -> None:
        """Let a simulated bench wait for a chamber that is not: until so long [s] has passed since it was set."""
        if not self._is_simulated:
            time.sleep(max(0.0, min(PERIOD, self._began + seconds - time.monotonic())))

    def begin(self) -> None:
        """What ``pace`` counts begins now."""
        self._began = time.monotonic()

    def _start(self) -> None:
        if not self._is_simulated and self._thread is None:
            self._heard = self._clock()
            self._ended = threading.Event()
            self._thread = threading.Thread(target=self._read_on, args=(self._ended,), name="chamber", daemon=True)
            self._thread.start()

    def _stop_reading(self) -> None:
        """Begin no further reading; one that is under way ends by its own deadline."""
        self._ended.set()
        self._thread = None

    def _read_on(self, ended: threading.Event) -> None:
        while not ended.is_set():
            began = self._clock()
            try:
                while not self._later.empty():
                    self._later.get()()
                self._read()
            except Exception as error:  # a thread that died would leave a chamber that nobody watches
                self._report(_as_chamber_error(error))
            ended.wait(max(0.05, PERIOD - (self._clock() - began)))

    def _look(self) -> None:
        """At a simulated bench: read when it is due by its clock. Else see, by the caller's own, that readings come."""
        if self._thread is not None:
            self._judge_silence()
        if self._is_simulated and self._asked is not None and self._clock() >= self._next:
            self._next = self._clock() + PERIOD
            self._read()

    def _read(self) -> None:
        try:
            conditions = self._chamber.read()
        except Exception as error:
            self._failure = self._failure or _as_chamber_error(error)
            self._judge_silence()
            return
        self._heard, self._failure = self._clock(), None
        with self._lock:
            self._latest = conditions
            self._readings.append(conditions)
            problem = self._doubt(conditions)
        self.on_reading(conditions)
        if problem is not None:
            self._report(problem)

    def _await_answer(self) -> None:
        """Where the last reading failed: wait until one comes, or silence is reported. Raises ChamberError.

        To resume it would take all its time in vain, and begin where the silence ends.
        """
        while self._failure is not None and self._thread not in (None, threading.current_thread()):
            self.check()
            time.sleep(0.05)

    def _judge_silence(self) -> None:
        silent = self._clock() - self._heard
        if silent >= SILENT:
            self._report(_lost(self._failure or _UNHEARD, silent))

    def _doubt(self, conditions: Conditions) -> ChamberError | None:
        """What is wrong with a chamber that answers, once it has been so in two readings."""
        error = _alarm(conditions) if conditions.alarms else None
        if error is None and self._asked is not None:
            error = _not_still(conditions) if self._is_still else _not_as_asked(conditions, *self._asked)
        said = "" if error is None else error.code
        self._odd = (said, self._odd[1] + 1 if said == self._odd[0] else 1)
        return error if self._odd[1] >= _TWICE else None

    def _report(self, problem: ChamberError) -> None:
        with self._lock:
            if self._problem is not None:
                return
            self._problem = problem
        with suppress(Exception):  # it is kept, and ``check`` raises it
            self.on_problem(problem)


_UNHEARD: Final = ChamberError(
    "the reading that is under way does not end",
    code="chamber-silent",
    where="chamber",
    repair="see that it is switched on, and look at its cable",
)


def _as_chamber_error(error: Exception) -> ChamberError:
    """What went wrong around a chamber, as an error that everybody here knows."""
    if isinstance(error, ChamberError):
        return error
    where, repair = "chamber", "record again; if it happens again, report this message to the developers"
    if isinstance(error, IpmclabError):
        return ChamberError(error.message, code=error.code, where=error.where, repair=error.repair)
    return ChamberError(
        f"{type(error).__name__} while the chamber was read: {error}", code="chamber-failed", where=where, repair=repair
    )


def _lost(failure: ChamberError, silent: float) -> ChamberError:
    return ChamberError(
        f"no reading has come from the chamber for {silent:.0f} s: {failure.message}",
        code=failure.code,
        where=failure.where,
        repair=failure.repair,
    )


def _alarm(conditions: Conditions) -> ChamberError:
    return ChamberError(
        f"the chamber raises an alarm: {', '.join(conditions.alarms)}",
        code="chamber-alarm",
        where="chamber",
        repair="clear its cause at the chamber, and record again",
    )


def _not_still(conditions: Conditions) -> ChamberError | None:
    """A chamber that somebody has set to work while it was still."""
    return _changed("it follows a program") if conditions.mode == "program" else None


def _not_as_asked(conditions: Conditions, temperature: float, relative_humidity: float | None) -> ChamberError | None:
    """A chamber that does something else than it was asked: somebody else has set it."""
    if conditions.mode not in ("constant", "unknown"):
        return _changed(f"it is in {conditions.mode}")
    pairs = (
        (conditions.temperature_set_point, temperature, TEMPERATURE_STEP, "degC"),
        (conditions.humidity_set_point, relative_humidity, HUMIDITY_STEP, "percent"),
    )
    for stated, asked, step, unit in pairs:
        if stated is not None and asked is not None:
            if abs(stated - asked) > step:
                return _changed(f"it is set to {stated:g} {unit}, not to {asked:g}")
        elif stated is not asked:
            states, wanted = ("no set point" if one is None else f"{one:g} {unit}" for one in (stated, asked))
            return _changed(f"it states {states}, {wanted} was asked for")
    return None


def _changed(what: str) -> ChamberError:
    return ChamberError(
        f"the chamber does not do what it was asked: {what}",
        code="chamber-changed",
        where="chamber",
        repair="let nobody else set it, at its panel or from another program, while an experiment runs",
    )
