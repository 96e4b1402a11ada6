"""Which sets a worker is given at once, and what comes back: metrics alone, for the sets follow from their numbers.

How many files the sets go to is of no matter here: files are of a size that a stop may lose, chunks of one that is
worth the way to a worker.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.engine import Engine, Here, Pace
from ipmclab.errors import InputError, IpmclabError
from ipmclab.model.device import Device
from ipmclab.model.many import reduce_batch
from ipmclab.sweep.design import Table
from ipmclab.sweep.parts import Parts
from ipmclab.sweep.sweep import Sweep

FloatArray = npt.NDArray[np.float64]

_FIRST: Final = 64
"""Sets, before it is known how long one takes."""

MOST_VALUES: Final = 4_000_000
"""In a chunk that comes back: 32 MB."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive sets.

    Parameters
    ----------
    begin, end : int
    sets : mapping of dotted name to float array, shape (end - begin,) [SI], or None
        Of a design that does not follow from numbers.
    """

    begin: int
    end: int
    sets: Mapping[str, FloatArray] | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """The metrics of a chunk.

    Parameters
    ----------
    chunk : (begin, end)
    metrics : mapping of name to float array, shape (end - begin,) [SI]
    seconds : float [s]
        What they took.
    """

    chunk: tuple[int, int]
    metrics: Mapping[str, FloatArray]
    seconds: float


def without_values(sweep: Sweep) -> Sweep:
    """The sweep as it goes to every worker: values that do not follow from numbers go with each chunk."""
    return sweep if sweep.design.by_number else replace(sweep, design=Table({}))


def measure(sweep: Sweep, chunk: Chunk, *, device: Device = "cpu") -> Measured:
    """Simulate the sets of a chunk; ``auto`` takes a GPU where the worker has one.

    Raises
    ------
    IpmclabError
        A value that is not allowed, or an output that is not finite.
    """
    begun = time.perf_counter()
    try:
        sets = sweep.design.sets(chunk.begin, chunk.end) if chunk.sets is None else chunk.sets
        metrics = reduce_batch(sweep.batch(sets), sweep.metrics, device)
    except InputError as error:
        raise IpmclabError(
            f"sets {chunk.begin} to {chunk.end - 1}: {error.message}",
            code=error.code,
            where=error.where,
            repair=error.repair,
        ) from error
    return Measured((chunk.begin, chunk.end), metrics, time.perf_counter() - begun)


def pace_of(sweep: Sweep) -> Pace:
    """How many sets workers are given at once."""
    travels = len(sweep.metrics.names) + (0 if sweep.design.by_number else len(sweep.design.names))
    return Pace(first=_FIRST, most=max(1, MOST_VALUES // travels))


def chunks(sweep: Sweep, parts: Parts, pace: Pace, engine: Engine) -> Iterator[Chunk]:
    """The sets that lack, in their order: for workers by pace, in this process a whole part each."""
    here = isinstance(engine, Here)
    for begin, end in (parts.ends(part) for part in parts.lacking()) if here else _runs(parts):
        while begin < end:
            to = end if here else min(end, begin + pace.size(parts.count - begin, engine.workers))
            yield Chunk(begin, to, None if sweep.design.by_number else sweep.design.sets(begin, to))
            begin = to


def _runs(parts: Parts) -> Iterator[tuple[int, int]]:
    """Consecutive parts that lack, joined."""
    begin = end = 0
    for part in parts.lacking():
        first, after = parts.ends(part)
        if first != end:
            yield begin, end
            begin = first
        end = after
    yield begin, end


class Filling:
    """Parts that are coming together from chunks, in whatever order they come.

    Parameters
    ----------
    parts : Parts
    """

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._open: dict[int, tuple[dict[str, FloatArray], int]] = {}

    def take(self, measured: Measured) -> Iterator[tuple[int, dict[str, FloatArray]]]:
        """The parts that a chunk completes."""
        begin, end = measured.chunk
        for part in range(begin // self._parts.size, -(-end // self._parts.size)):
            first, after = self._parts.ends(part)
            low, high = max(begin, first), min(end, after)
            columns, lacking = self._open.pop(
                part, ({name: np.empty(after - first) for name in measured.metrics}, after - first)
            )
            for name, values in measured.metrics.items():
                columns[name][low - first : high - first] = values[low - begin : high - begin]
            lacking -= high - low
            if lacking:
                self._open[part] = columns, lacking
            else:
                yield part, columns
