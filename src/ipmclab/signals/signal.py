"""What every signal is: a voltage over time, with parameters that are checked and written alike."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import MISSING, Field, dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.units import ANGLE, FREQUENCY, NUMBER, TIME, VOLTAGE, Quantity, format_quantity, parse_quantity

FloatArray = npt.NDArray[np.float64]

EDGE: Final = 1e-9
"""An edge [s] that is at most this much later than a row falls on the row: k/rate and multiples of
a period are inexact in floating point, and rows are never this close together."""

QUANTITIES: Final[dict[str, Quantity]] = {
    "amplitude": VOLTAGE,
    "frequency": FREQUENCY,
    "start_frequency": FREQUENCY,
    "end_frequency": FREQUENCY,
    "lowest_frequency": FREQUENCY,
    "highest_frequency": FREQUENCY,
    "bit_time": TIME,
    "hold_time": TIME,
    "sweep_time": TIME,
    "phase": ANGLE,
    "offset": VOLTAGE,
    "delay": TIME,
    "duration": TIME,
    "time": TIME,
    "voltage": VOLTAGE,
    "order": NUMBER,
    "seed": NUMBER,
    "gain": NUMBER,
    "left_out": NUMBER,
}
"""The quantity of each number in a signal."""

CHOICES: Final = {"harmonics": ("all", "odd"), "phases": ("schroeder", "random")}
"""The parameters that are a word."""

_LEAST: Final = 1e-9
_MOST: Final = 1e9
"""Frequencies [Hz] and times [s] whose edges and periods can be distinguished: only a slip falls outside."""

_FROM_ZERO: Final = ("delay", "time")
_INTEGERS: Final = {"order": (2, 16), "seed": (0, 2**32 - 1), "left_out": (0, 100)}


def check_value(name: str, value: Any, *, where: str) -> float | int | str:
    """One parameter of a signal, checked.

    Raises
    ------
    InputError
        Not a number, not finite, not above 0 where it must be, far too small or too large a time or
        frequency, not an integer, or an unknown word.
    """
    if name in CHOICES:
        if value not in CHOICES[name]:
            raise InputError(
                f"unknown {name} {value!r}", code="unknown-word", where=where, repair=suggest(str(value), CHOICES[name])
            )
        return str(value)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    label, unit = name.replace("_", " "), QUANTITIES[name].unit
    written = f"{value:.12g} {unit}".rstrip() if isinstance(value, (int, float)) else repr(value)
    if not math.isfinite(number):
        raise InputError(f"the {label} is {written}", code="bad-number", where=where, repair="give a finite number")
    if name in _INTEGERS:
        low, high = _INTEGERS[name]
        if number != int(number) or not low <= number <= high:
            raise InputError(
                f"the {label} is {written}",
                code="out-of-range",
                where=where,
                repair=f"give a whole number from {low} to {high}",
            )
        return int(number)
    if name in _FROM_ZERO and number < 0:
        raise InputError(
            f"the {label} is {written}, before row 0", code="out-of-range", where=where, repair="give 0 s or more"
        )
    if QUANTITIES[name] in (FREQUENCY, TIME) and name not in _FROM_ZERO:
        example = "0.1 Hz" if QUANTITIES[name] is FREQUENCY else "0.5 s"
        if number <= 0:
            raise InputError(
                f"the {label} is {written}, it must be above 0",
                code="out-of-range",
                where=where,
                repair=f"give for example {example}",
            )
        if not _LEAST <= number <= _MOST:
            raise InputError(
                f"the {label} is {written}, outside {_LEAST:g} to {_MOST:g} {unit}",
                code="out-of-range",
                where=where,
                repair=f"give for example {example}",
            )
    return number


def write_value(name: str, value: float | int | str) -> str:
    """One parameter as text that reads back to the same value."""
    if isinstance(value, (int, str)):
        return str(value)
    if QUANTITIES[name] is ANGLE:
        degrees = f"{math.degrees(value):.12g} deg"
        if parse_quantity(degrees, ANGLE, where=name) == value:
            return degrees
    number, _, unit = format_quantity(value, QUANTITIES[name]).partition(" ")
    return f"{number.removesuffix('.0')} {unit}".rstrip()


def shortened(text: str, most: int = 100) -> str:
    """A text of a signal for people: one with many samples is cut.

    Examples
    --------
    >>> shortened("samples 0 s 1 V 1 s -1 V", 20)
    'samples 0 s 1 V 1...'
    """
    return text if len(text) <= most else f"{text[: most - 3]}..."


def whole_periods(time: FloatArray, period: float) -> npt.NDArray[np.int64]:
    """How many periods have passed at each time, with an edge on a row counted as passed."""
    return np.floor((time + EDGE) / period).astype(np.int64)


@dataclass(frozen=True)
class Signal(ABC):
    """A voltage over time. Use one of the signals below, or ``parse``."""

    word: ClassVar[str] = ""
    """The first word of its text."""

    def __post_init__(self) -> None:
        for parameter in fields(self):
            value = check_value(parameter.name, getattr(self, parameter.name), where=parameter.name)
            object.__setattr__(self, parameter.name, value)

    def voltage(self, time: npt.ArrayLike) -> FloatArray:
        """The voltage at each time.

        Parameters
        ----------
        time : float array, any shape [s]
            Time since row 0.

        Returns
        -------
        voltage : float array, the same shape [V]

        Examples
        --------
        >>> from ipmclab.signals import Square
        >>> Square(amplitude=1.0, frequency=0.25).voltage([0.0, 1.0, 2.0, 3.0, 4.0]).tolist()
        [1.0, 1.0, -1.0, -1.0, 1.0]
        """
        delay: float = getattr(self, "delay", 0.0)
        times = np.asarray(time, dtype=np.float64)
        # One dimension: NumPy computes a lone scalar otherwise than an array, in the last digit.
        since = times if times.ndim == 1 else times.ravel()
        since = since - delay if delay else since
        end = self.duration - delay - EDGE
        starts = since.size == 0 or since[since.argmin()] >= 0.0  # in half the time of min()
        if starts and (end == math.inf or since.max(initial=0.0) < end):  # as is usual
            return self._shape(since) if times.ndim == 1 else self._shape(since).reshape(times.shape)
        acts = (since >= -EDGE) & (since < end)
        return np.where(acts, self._shape(np.where(acts, np.maximum(since, 0.0), 0.0)), 0.0).reshape(times.shape)

    @property
    def duration(self) -> float:
        """Time [s] from row 0 to the end of the signal; infinite when it has none."""
        return math.inf

    @property
    def start(self) -> float:
        """Time [s] before which it is 0 V."""
        return float(getattr(self, "delay", 0.0))

    @property
    def last_start(self) -> float:
        """Time [s] at which the last delay that it states is over; 0 where it states none."""
        return self.start

    @property
    def reach(self) -> float:
        """Time [s] of the last thing that it states: its start, its last sample, the end of a part."""
        return self.start

    @property
    def fastest(self) -> float:
        """Highest frequency [Hz] that it states; two bits, or two held values, are a period. 0 when it states none."""
        return 0.0

    def check_fits(self, duration: float, rate: float = math.inf) -> None:
        """Refuse a signal of which a record would lose a part.

        Parameters
        ----------
        duration : float [s]
            Of the record.
        rate : float [Hz], optional
            Of its rows.

        Raises
        ------
        InputError
            When ``reach`` is later than the end of the record, or the last delay ends no earlier than that, or
            ``fastest`` is above half its rate: rows show, and apply, a slower signal then.

        Examples
        --------
        >>> from ipmclab.signals import Step
        >>> try:
        ...     Step(1.0, delay=50.0).check_fits(40.0)
        ... except InputError as error:
        ...     print(error)
        signal 'step 1 V delay=50 s': it reaches to 50 s, the record to 40 s; record longer, or shorten the signal
        """
        never_acts = self.last_start > 0.0 and self.last_start >= duration - EDGE
        if never_acts or self.reach > duration * (1.0 + 1e-9) + EDGE:
            raise InputError(
                f"it reaches to {self.reach:.9g} s, the record to {duration:.9g} s",
                code="signal-too-long",
                where=f"signal {shortened(str(self))!r}",
                repair="record longer, or shorten the signal",
            )
        if 2.0 * self.fastest > rate * (1.0 + 1e-9):
            raise InputError(
                f"it goes up to {self.fastest:.9g} Hz, rows at {rate:.9g} Hz follow it to {0.5 * rate:.9g} Hz",
                code="signal-too-fast",
                where=f"signal {shortened(str(self))!r}",
                repair=f"give a rate of {write_value('frequency', 2.0 * self.fastest)} or more, or a slower signal",
            )

    @abstractmethod
    def _shape(self, time: FloatArray) -> FloatArray:
        """The voltage at times since its own start."""

    def __str__(self) -> str:
        """The signal as text that ``parse`` reads back to an equal signal."""
        return self._text

    @cached_property
    def _text(self) -> str:
        words = [self.word]
        for parameter in fields(self):
            value = getattr(self, parameter.name)
            if is_unnamed(parameter):
                words.append(write_value(parameter.name, value))
            elif value != parameter.default:
                words.append(f"{parameter.name}={write_value(parameter.name, value)}")
        return " ".join(words)


def is_required(parameter: Field[Any]) -> bool:
    """Whether a parameter of a signal has no default."""
    return parameter.default is MISSING


def is_unnamed(parameter: Field[Any]) -> bool:
    """Whether a parameter is in text without its name: the required ones and some others, which come first."""
    return is_required(parameter) or "unnamed" in parameter.metadata
