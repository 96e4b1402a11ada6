"""Designs: which parameter sets a sweep simulates, each known by its number, so that any part can be made alone."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from importlib.metadata import version
from typing import Any, Final, Literal, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.sweep.packages import salib

FloatArray = npt.NDArray[np.float64]
Kind = Literal["sobol", "latin-hypercube", "saltelli", "morris"]

KINDS: Final[tuple[Kind, ...]] = ("sobol", "latin-hypercube", "saltelli", "morris")


class Design(Protocol):
    """The parameter sets of a sweep."""

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that differ between sets."""

    @property
    def count(self) -> int:
        """How many sets there are."""

    @property
    def by_number(self) -> bool:
        """Whether sets follow from their numbers alone; else whoever makes some of them needs all."""

    def sets(self, begin: int, end: int) -> dict[str, FloatArray]:
        """The values [SI] of some of the sets, by parameter."""


@dataclass(frozen=True)
class Range:
    """Between which values a parameter goes, evenly or evenly in its logarithm.

    Parameters
    ----------
    low, high : float [SI]
    log : bool
    """

    low: float
    high: float
    log: bool = False

    def at(self, part: FloatArray) -> FloatArray:
        """The values at these parts of the way from low to high.

        Examples
        --------
        >>> Range(1.0, 100.0, log=True).at(np.array([0.0, 0.5, 1.0])).round(9).tolist()
        [1.0, 10.0, 100.0]
        """
        ratio, length = self.high / self.low if self.log else 1.0, self.high - self.low
        values = self.low * ratio**part if self.log else self.low + length * part
        return np.clip(values, self.low, self.high)  # rounding must not leave the allowed range


LEVELS: Final = 4
"""Values of each parameter on the grid of a ``morris`` design."""


def morris_problem(names: Sequence[str]) -> dict[str, Any]:
    """Parameters as SALib takes them: each from 0 to 1 of its way."""
    return {"num_vars": len(names), "names": list(names), "groups": None, "bounds": [[0.0, 1.0]] * len(names)}


@dataclass(frozen=True)
class Sampled:
    """A sampling design over ranges.

    ``sobol`` is a scrambled Sobol sequence: each further set fills the largest gap, and a longer design begins with the
    shorter one. ``latin-hypercube`` has one set in each of ``base`` slices of every parameter. ``saltelli`` is what
    Sobol indices are computed from: of each of ``base`` pairs of points (A, B) the set A, then one for each parameter
    that has it from B and the others from A, then B. ``morris`` goes ``base`` ways over a grid of four values of every
    parameter; each step of a way changes one of them, and Morris's effects are computed from the steps.

    Parameters
    ----------
    kind : "sobol", "latin-hypercube", "saltelli" or "morris"
    ranges : mapping of dotted name to Range
    base : int
        Points; of ``saltelli`` there are base x (parameters + 2) sets, of ``morris`` base x (parameters + 1).
    seed : int
    """

    kind: Kind
    ranges: Mapping[str, Range]
    base: int
    seed: int

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that differ between sets."""
        return tuple(self.ranges)

    @property
    def count(self) -> int:
        """How many sets there are."""
        each = {"saltelli": len(self.ranges) + 2, "morris": len(self.ranges) + 1}
        return self.base * each.get(self.kind, 1)

    @property
    def by_number(self) -> bool:
        """Whether sets follow from their numbers alone; else whoever makes some of them needs all."""
        return self.kind in ("sobol", "saltelli")

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be made again."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def sets(self, begin: int, end: int) -> dict[str, FloatArray]:
        """The values [SI] of some of the sets, by parameter.

        Examples
        --------
        >>> design = Sampled("saltelli", {"a": Range(0.0, 1.0), "b": Range(0.0, 1.0)}, 4, seed=0)
        >>> first = design.sets(0, 4)
        >>> first["a"][[0, 1]].tolist() == first["a"][[2, 3]].tolist()[::-1], design.count
        (False, 16)
        """
        points = self.ways(begin, end)
        return {name: one.at(points[:, place]) for place, (name, one) in enumerate(self.ranges.items())}

    def ways(self, begin: int, end: int) -> FloatArray:
        """Which part of the way from low to high each parameter of some sets goes, shape (end - begin, n)."""
        if self.kind == "saltelli":
            return self._saltelli(begin, end)
        if self.kind == "sobol":
            return self._sobol(begin, end, len(self.ranges))
        return (self._hypercube if self.kind == "latin-hypercube" else self._morris)[begin:end]

    def _saltelli(self, begin: int, end: int) -> FloatArray:
        size = len(self.ranges)
        each = size + 2
        first = begin // each
        pairs = self._sobol(first, -(-end // each), 2 * size)
        a, b = pairs[:, :size], pairs[:, size:]
        whole = np.repeat(a[:, None, :], each, axis=1)
        whole[:, -1] = b
        for place in range(size):
            whole[:, 1 + place, place] = b[:, place]
        return whole.reshape(-1, size)[begin - first * each : end - first * each]

    def _sobol(self, begin: int, end: int, size: int) -> FloatArray:
        from scipy.stats import qmc

        at, sequence = self._walked.pop(size, (0, None))
        if sequence is None or begin < at:
            at, sequence = 0, qmc.Sobol(size, scramble=True, seed=self.seed)
        if begin > at:
            sequence.fast_forward(begin - at)
        with warnings.catch_warnings():
            # SciPy gets a part and warns that it is no power of two; the whole is one.
            warnings.filterwarnings("ignore", message="The balance properties of Sobol", category=UserWarning)
            points: FloatArray = sequence.random(end - begin)
        self._walked[size] = end, sequence
        return points

    @cached_property
    def _walked(self) -> dict[int, tuple[int, Any]]:
        """Sequences where they were left: to walk to the last of 10^9 points again takes seconds."""
        return {}

    @cached_property
    def _morris(self) -> FloatArray:
        """All of it: no way is known before those before it are drawn."""
        sample = salib("SALib.sample.morris")
        points: FloatArray = sample.sample(morris_problem(self.names), self.base, num_levels=LEVELS, seed=self.seed)
        return points

    @cached_property
    def _hypercube(self) -> FloatArray:
        """All of it: where a slice goes depends on all others."""
        from scipy.stats import qmc

        points: FloatArray = qmc.LatinHypercube(len(self.ranges), seed=self.seed).random(self.base)
        return points


@dataclass(frozen=True, eq=False)
class Table:
    """Parameter sets that somebody wrote down.

    Parameters
    ----------
    columns : mapping of dotted name to float array, shape (n_sets,) [SI]
    """

    columns: Mapping[str, FloatArray]

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that differ between sets."""
        return tuple(self.columns)

    by_number = False

    @property
    def count(self) -> int:
        """How many sets there are."""
        return len(next(iter(self.columns.values())))

    def sets(self, begin: int, end: int) -> dict[str, FloatArray]:
        """The values [SI] of some of the sets, by parameter."""
        return {name: values[begin:end] for name, values in self.columns.items()}


def described(design: Design) -> dict[str, Any]:
    """What makes this design this one, for a digest."""
    if isinstance(design, Sampled):
        ranges = {name: (one.low, one.high, one.log) for name, one in design.ranges.items()}
        return {"kind": design.kind, "base": design.base, "seed": design.seed, "ranges": ranges}
    columns = design.sets(0, design.count)
    return {"kind": "table", "columns": {name: checksum(values) for name, values in columns.items()}}


def drawn_by(design: Design) -> tuple[str, ...]:
    """The version of what draws a design, where it is not SciPy."""
    is_salib = isinstance(design, Sampled) and design.kind == "morris"
    return (version("SALib"),) if is_salib else ()


def checksum(values: FloatArray) -> str:
    """SHA-256 of numbers, digit by digit."""
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()
