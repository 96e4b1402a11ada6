"""What the rows at 0 V, before a strip is driven, show of a sensor.

They hold its zero, its drift and its noise, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.quality.rows_at_rest import without_spikes
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import CONSTANTS, Columns, constants, steps_between, without
from ipmclab.statespace.long_run import long_run
from ipmclab.statespace.shape import Shape, spread_by, structure
from ipmclab.statespace.terms import Terms

_FEWEST_OF_SLOPE: Final = 20
"""Rows at 0 V from which their slope is taken: fewer do not tell their own scatter."""

FEWEST_OF_NOISE: Final = 50
"""Rows at 0 V that show the noise."""

_LAGS: Final = (50, 10, 4)  # parts of the rows at 0 V
_TIMES: Final = 2.0  # as much as at 0 V, which few rows tell no better than that
_SHOWN: Final = 2.0  # standard errors from which a slope at 0 V is one


class SlopeAtRest(NamedTuple):
    """Slope of the readings at 0 V before the strip is driven.

    Parameters
    ----------
    slope, error : float [SI/s]
        Its standard error, infinite where nothing is known.
    weights : float array, shape (n,) [1/s]
        What each of the first n measured readings adds to the slope: its error is correlated with theirs.
    """

    slope: float
    error: float
    weights: FloatArray

    @property
    def is_shown(self) -> bool:
        """Whether it is more than its error explains."""
        return abs(self.slope) > _SHOWN * self.error


NO_SLOPE: Final = SlopeAtRest(0.0, math.inf, np.zeros(0))
"""Where nothing is known."""


def slope_at_rest(record: PreparedRun, output: str, noise: Shape, unit: float) -> SlopeAtRest:
    """Slope of the readings at 0 V before the strip is driven, and its standard error.

    The error is that of least squares under autocorrelated noise (Newey and West 1987), or under the noise that the
    whole run has where that is more, but no more of it than the rows at 0 V show; a converter whose step is
    larger than the noise hides a slope of one step over the rows. A strip that was not at rest moves too: then the
    slope is no larger than what is seen there. Nothing is known, and the error infinite, where there are few such rows.

    Parameters
    ----------
    record : PreparedRun
    output : str
    noise : Shape
        Of the whole run.
    unit : float [SI]
        In which the noise is.
    """
    reading = record.readings[output]
    rows = np.flatnonzero(reading.exact[: record.resting])
    if len(rows) < _FEWEST_OF_SLOPE:
        return NO_SLOPE
    step = reading.quantum
    time = record.run.time[rows]
    values = without_spikes(time, reading.values[rows], step)
    columns = constants(time)
    half = 0.5 * float(time[-1] - time[0])
    inner = np.linalg.inv(columns.T @ columns)
    answer = inner @ (columns.T @ values)
    middle = long_run(columns, values - columns @ answer)
    own = float((inner @ middle @ inner)[1, 1])
    if noise.terms.order or noise.terms.walk:
        whole = unit**2 * float(spread_by(columns @ inner, steps_between(time, record.step), noise)[1, 1])
        lag = max(len(rows) // 4, 1)
        observed = float(np.mean((values[lag:] - values[:-lag]) ** 2)) / (unit**2 * float(structure(noise, [lag])[0]))
        own = max(own, whole * min(observed, 1.0))
    variance = own / half**2 + (step / (2.0 * half)) ** 2 / 12.0
    if not variance > 0.0:  # readings that are all alike, and no converter's step known: nothing measured
        return NO_SLOPE
    slope = float(answer[1]) / half
    if record.start == "free":
        return NO_SLOPE._replace(error=math.hypot(slope, math.sqrt(variance)))
    return SlopeAtRest(slope, math.sqrt(variance), (columns @ inner)[:, 1] / half)


def slope_inflation(time: FloatArray, step: float, noise: Shape) -> float:
    """How many times the variance of a slope is, under some noise, what white noise of the same size would make it.

    Parameters
    ----------
    time : float array, shape (n,) [s]
    step : float [s]
        Between rows.
    noise : Shape
        In units of the noise of a row.
    """
    columns = constants(time)
    inner = np.linalg.inv(columns.T @ columns)
    found = float(spread_by(columns @ inner, steps_between(time, step), noise)[1, 1])
    return max(found / float(inner[1, 1]), 1.0)


class Resting(NamedTuple):
    """A noise that was found under voltage, and what the fit leaves of the readings at 0 V.

    Parameters
    ----------
    noise : Shape
    left : float array, shape (n_resting,)
        In the unit of the noise, contacts that were touched aside.
    """

    noise: Shape
    left: FloatArray

    @classmethod
    def of(cls, record: PreparedRun, output: str, noise: Shape, left: FloatArray, unit: float) -> Resting:
        """From what a fit leaves of every reading that is measured, in so many SI units, as the noise is."""
        reading = record.readings[output]
        rows = np.flatnonzero(reading.exact)
        count = int(np.searchsorted(rows, record.resting))
        step = reading.quantum / unit
        return cls(noise, without_spikes(record.run.time[rows[:count]], left[:count], step))

    @property
    def is_at_rest_too(self) -> bool | None:
        """Whether the noise is no larger than rows at 0 V show; None where these are few.

        Held against each other are the mean squares of changes over one row, and over parts of the rows at 0 V.
        """
        left, count = self.left, len(self.left)
        if count < FEWEST_OF_NOISE:
            return None
        lags = [1, *(count // part for part in _LAGS)]
        observed = np.array([np.mean((left[lag:] - left[:-lag]) ** 2) for lag in lags])
        return bool((structure(self.noise, lags) <= _TIMES * observed).all())

    def noise_at_rest(self, least: float) -> Shape:
        """The noise of rows at 0 V that is smaller than the one under voltage; a reading has ``least`` as its variance.

        It is autocorrelated as that is, in proportion to the changes over one row, where these rows are likelier so,
        and white else.
        """
        if self.likelier_with_slow > 0.0:
            changes = float(np.mean(np.diff(self.left) ** 2)) / float(structure(self.noise, [1])[0])
            return replace(self.noise, variance=self.noise.variance * changes)
        return Shape(Terms(), np.zeros(0), max(float(np.mean(self.left**2)), least))

    @property
    def likelier_with_slow(self) -> float:
        """By how much the deviance (minus twice the log likelihood) of rows at 0 V is lower with what is slow in it.

        That is its walk; of a noise that does not walk, its autoregression: one that is slower than these rows are long
        is a walk by another name.

        Examples
        --------
        >>> walk = Shape(Terms(walk=True), np.zeros(1), 1.0)
        >>> steps = np.random.default_rng(1).standard_normal((2, 100))
        >>> walked, still = Resting(walk, steps[0] + np.cumsum(steps[1])), Resting(walk, steps[0])
        >>> walked.likelier_with_slow > 0.0, still.likelier_with_slow > 0.0
        (True, False)
        """
        noise, left, count = self.noise, self.left, len(self.left)
        slow = replace(noise.terms, offset=True, trend=False)
        fast = replace(slow, walk=False) if slow.walk else Terms(offset=True)
        if count <= CONSTANTS or not np.ptp(left) > 0.0:
            return 0.0
        matrix = np.column_stack([constants(np.arange(count, dtype=np.float64)), left])
        rows = Columns(matrix, np.ones(count, dtype=np.int64))

        def deviance(terms: Terms, entries: FloatArray) -> float:
            products, logarithm = rows.products(terms, entries)
            squares, of_offset = without(products, terms)
            return (count - 1) * math.log(float(squares[-1, -1])) + logarithm + of_offset

        entries = np.delete(noise.entries, slow.order) if slow.walk else noise.entries[:0]
        return deviance(fast, entries) - deviance(slow, noise.entries)


def is_shown_at_rest(each: Sequence[Resting]) -> bool | None:
    """Whether rows at 0 V show what is slow in a noise, in all runs of an output together; None where they do not say.

    By Bayes's criterion: the sensor of an output is the same in all its runs.
    """
    likelier = sum(one.likelier_with_slow for one in each)
    penalty = math.log(max(sum(len(one.left) for one in each), 1))
    return None if abs(likelier) <= penalty else likelier > 0.0
