"""What a long fit is doing, reported to whoever asked, who may end it: the function that gets the reports may raise."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Final

OnProgress = Callable[[str, float], None]
"""Called with a sentence, and with the fraction of the work that is done."""

_PERIOD: Final = 0.1  # s between two calls with the same sentence


class _Teller:
    """Turns the model runs of a stage, of which nobody knows how many will follow, into a fraction that only grows."""

    def __init__(self, on_progress: OnProgress) -> None:
        self._tell = on_progress
        self._sentence = ""
        self._begin, self._end = 0.0, 0.0
        self._ticks, self._usual = 0, 1
        self._fraction = 0.0
        self._told = -math.inf
        self._aside = ""
        self._ended: BaseException | None = None
        self._owed = False
        self._interrupted = False

    def stage(self, sentence: str, begin: float, end: float, usual: int) -> None:
        self._sentence, self._begin, self._end = sentence, begin, end
        self._ticks, self._usual = 0, usual
        self._say()

    def tick(self) -> None:
        self._ticks += 1
        if self._ended is not None or self._interrupted or time.monotonic() - self._told >= _PERIOD:
            self._say()

    def aside(self, sentence: str) -> None:
        if self._ended is not None or (sentence == self._aside and time.monotonic() - self._told < _PERIOD):
            return
        self._told, self._aside = time.monotonic(), sentence
        try:
            self._tell(sentence, self._fraction)
        except KeyboardInterrupt:
            self._interrupted = True
        except BaseException as error:
            # Raised by the next tick, or at the end: who says something aside can be ended nowhere.
            self._ended, self._owed = error, True

    def pay(self) -> None:
        """Raise what was raised aside and has reached nobody yet."""
        if self._owed and self._ended is not None:
            raise self._ended

    def _say(self) -> None:
        if self._ended is not None:  # what was ended stays ended, whoever caught it on its way
            self._owed = False
            raise self._ended
        if self._interrupted:
            self._interrupted = False
            raise KeyboardInterrupt
        done = -math.expm1(-self._ticks / self._usual)
        self._fraction = max(self._fraction, self._begin + done * (self._end - self._begin))
        self._told, self._aside = time.monotonic(), ""
        try:
            self._tell(self._sentence, self._fraction)
        except KeyboardInterrupt:
            raise  # a work may keep what it has
        except BaseException as error:
            self._ended = error
            raise


class _OnlyAside(_Teller):
    """Says what the work waits for, and nothing else: who hears that can end nothing."""

    def __init__(self, of: _Teller) -> None:
        self._of = of

    def stage(self, sentence: str, begin: float, end: float, usual: int) -> None:
        pass

    def tick(self) -> None:
        pass

    def aside(self, sentence: str) -> None:
        self._of.aside(sentence)


_teller: ContextVar[_Teller | None] = ContextVar("teller", default=None)
_part: ContextVar[tuple[str, float, float]] = ContextVar("part", default=("", 0.0, 1.0))


@contextmanager
def reporting_to(on_progress: OnProgress | None) -> Iterator[None]:
    """What is done within is reported to a function; None leaves it to the one that gets the reports already, if any.

    Parameters
    ----------
    on_progress : function of (str, float), optional
        Called with a sentence and the fraction that is done, which only grows, at most ten times a second. Whatever
        it raises ends the work and reaches the caller; a ``KeyboardInterrupt`` a work may heed by keeping what stands.

    Examples
    --------
    >>> with reporting_to(print):
    ...     stage("searching", 0.0, 0.5)
    searching 0.0
    """
    if on_progress is None:
        yield
        return
    own = _Teller(on_progress)
    teller, part = _teller.set(own), _part.set(("", 0.0, 1.0))
    try:
        yield
        own.pay()
    finally:
        _teller.reset(teller)
        _part.reset(part)


@contextmanager
def unreported() -> Iterator[None]:
    """What is done within is not reported, but for what it waits for, so that who gets the reports cannot end it.

    Examples
    --------
    >>> with reporting_to(print):
    ...     stage("searching", 0.0, 0.5)
    ...     with unreported():
    ...         stage("keeping what was found", 0.5, 1.0)
    searching 0.0
    """
    teller = _teller.get()
    token = _teller.set(None if teller is None else _OnlyAside(teller))
    try:
        yield
    finally:
        _teller.reset(token)


_show: ContextVar[Callable[[Any], None] | None] = ContextVar("show", default=None)


@contextmanager
def first_answer_to(show: Callable[[Any], None]) -> Iterator[None]:
    """Hand what a work within has found first to a function, while the rest of the work goes on.

    Parameters
    ----------
    show : function of one argument
        Of ``identify`` it is called with the ``Fit`` as soon as its parameters are found: with intervals from the
        standard errors alone, and before it is asked what the model lacks.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> run = simulate(strip, "step 1 V", duration=10, rate=20)
    >>> with first_answer_to(lambda fit: print(sorted(fit.parameters))):
    ...     fit = identify(strip, run, free=["circuit.dc_resistivity"])
    ['circuit.dc_resistivity']
    """
    token = _show.set(show)
    try:
        yield
    finally:
        _show.reset(token)


def first_answer(make: Callable[[], Any]) -> None:
    """What a work has found first; it is made only where somebody is shown it."""
    show = _show.get()
    if show is not None:
        show(make())


@contextmanager
def part(sentence: str, begin: float, end: float) -> Iterator[None]:
    """A fit within a longer work: its stages are reported after a sentence, if any, within a part of the whole.

    Examples
    --------
    >>> with reporting_to(print), part("without the first run", 0.5, 0.75):
    ...     stage("searching", 0.2, 0.6)
    without the first run: searching 0.55
    """
    before, first, last = _part.get()
    length = last - first
    said = f"{before}{sentence}: " if sentence else before
    token = _part.set((said, first + begin * length, first + end * length))
    try:
        yield
    finally:
        _part.reset(token)


def stage(sentence: str, begin: float, end: float, usual: int = 100) -> None:
    """Begin a stage of the work.

    Parameters
    ----------
    sentence : str
    begin, end : float
        The fractions of the work between which it lies.
    usual : int
        How many ticks it usually takes.
    """
    teller = _teller.get()
    if teller is not None:
        before, first, last = _part.get()
        length = last - first
        teller.stage(before + sentence, first + begin * length, first + end * length, usual)


def aside(sentence: str) -> None:
    """Say what the stage waits for; its next tick says the stage again.

    Examples
    --------
    >>> with reporting_to(print):
    ...     stage("searching", 0.0, 0.5)
    ...     aside("compiling")
    searching 0.0
    compiling 0.0
    """
    teller = _teller.get()
    if teller is not None:
        teller.aside(_part.get()[0] + sentence)


def tick() -> None:
    """One more model run, likelihood, or other small piece of work is done: here the work can be ended."""
    teller = _teller.get()
    if teller is not None:
        teller.tick()
