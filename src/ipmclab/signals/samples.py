"""A voltage given by samples."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.signals.signal import EDGE, Signal, check_value, write_value

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Samples(Signal):
    """A voltage given by samples, each held until the next.

    It is 0 V before the first; the last holds as long as the one before it, then it is 0 V.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
        Increasing, from 0 or later.
    voltage : float array, shape (n_time,) [V]
        Kept as ``values``, and the times as ``times``.
    delay : float [s]
    path : str
        The file that they came from, for the text; empty when they came from arrays.
    gain : float
        What the samples of the file are multiplied by; ``values`` holds the product.

    Raises
    ------
    InputError
        Fewer than two samples, unequal lengths, a value that is not finite, or time that does
        not increase or starts before 0.

    Examples
    --------
    >>> signal = Samples([0.0, 1.0, 2.0], [0.0, 1.0, -1.0])
    >>> signal.voltage([0.5, 1.0, 1.5, 2.9, 3.0]).tolist()
    [0.0, 1.0, 1.0, -1.0, 0.0]
    """

    word: ClassVar[str] = "samples"
    times: FloatArray
    values: FloatArray
    delay: float = 0.0
    path: str = field(default="", metadata={"unnamed": True})
    gain: float = 1.0

    def __init__(
        self, time: npt.ArrayLike, voltage: npt.ArrayLike, delay: float = 0.0, path: str = "", gain: float = 1.0
    ) -> None:
        columns = {"times": _samples("time", time), "values": _samples("voltage", voltage)}
        if columns["times"].shape != columns["values"].shape:
            raise InputError(
                f"there are {columns['values'].size} voltages and {columns['times'].size} times",
                code="unequal-lengths",
                where="voltage",
                repair="give one voltage for each time",
            )
        early = np.flatnonzero(np.diff(columns["times"], prepend=-EDGE) < EDGE)
        if len(early):
            row = int(early[0])
            before = f"not after {columns['times'][row - 1]:.9g} s" if row else "before row 0"
            raise InputError(
                f"sample {row} is at {columns['times'][row]:.9g} s, {before}",
                code="bad-time",
                where="time",
                repair="give times that increase from 0 s or later",
            )
        checked = float(check_value("gain", gain, where="gain"))
        if checked != 1.0:
            columns["values"] = _samples("voltage", checked * columns["values"])
        for name, value in columns.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "delay", check_value("delay", delay, where="delay"))
        object.__setattr__(self, "path", str(path))
        # Without a file the text states the samples themselves, the gain included.
        object.__setattr__(self, "gain", checked if path else 1.0)

    def reversed(self) -> Samples:
        """The same with the other polarity; its text names the same file.

        Examples
        --------
        >>> print(Samples([0.0, 1.0], [0.5, 1.0], path="sweep.csv").reversed())
        file sweep.csv gain=-1
        """
        other = Samples(self.times, -self.values, self.delay)
        if self.path:
            object.__setattr__(other, "path", self.path)
            object.__setattr__(other, "gain", -self.gain)
        return other

    @property
    def duration(self) -> float:
        return float(self.delay + 2.0 * self.times[-1] - self.times[-2])

    @property
    def start(self) -> float:
        return float(self.delay + self.times[0])

    @property
    def reach(self) -> float:
        return float(self.delay + self.times[-1])

    def _shape(self, time: FloatArray) -> FloatArray:
        at = np.searchsorted(self.times, time + EDGE, side="right") - 1
        return np.where(at >= 0, self.values[at], 0.0)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Samples):
            return NotImplemented
        same = (self.delay, self.path, self.gain) == (other.delay, other.path, other.gain)
        return same and np.array_equal(self.times, other.times) and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return hash((self.times.tobytes(), self.values.tobytes(), self.delay, self.path, self.gain))

    def __repr__(self) -> str:
        return f"<Samples: {len(self.times)} to {self.times[-1]:g} s{', ' + self.path if self.path else ''}>"

    def __str__(self) -> str:
        if self.path:
            quote = "'" if '"' in self.path else '"'
            plain = re.fullmatch(r"[^\s='\"]+", self.path)
            words = ["file", self.path if plain else f"{quote}{self.path}{quote}"]
        else:
            words = [self.word]
            for time, value in zip(self.times.tolist(), self.values.tolist(), strict=True):
                words += [write_value("time", time), write_value("voltage", value)]
        if self.gain != 1.0:
            words.append(f"gain={write_value('gain', self.gain)}")
        if self.delay:
            words.append(f"delay={write_value('delay', self.delay)}")
        return " ".join(words)


def _samples(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        given: Any = np.ma.asarray(values)
        column = np.array(given.astype(np.float64).filled(np.nan))  # what a mask hides is no sample
    except (TypeError, ValueError):
        column = np.empty((0, 0))
    if column.ndim != 1 or len(column) < 2:
        raise InputError(
            f"this is not a column of two or more numbers: {values!r:.60}",
            code="bad-array",
            where=name,
            repair="give a one-dimensional array of floats",
        )
    gaps = np.flatnonzero(~np.isfinite(column))
    if len(gaps):
        raise InputError(
            f"sample {gaps[0]} is {column[gaps[0]]}",
            code="bad-number",
            where=name,
            repair="every sample needs a number",
        )
    column.setflags(write=False)
    return column
