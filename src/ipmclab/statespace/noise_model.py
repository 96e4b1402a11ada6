"""A noise model in SI units: what a fit says of the noise of one output of one run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.statespace.shape import Shape, spread_by
from ipmclab.statespace.terms import Terms, autoregression

FloatArray = npt.NDArray[np.float64]

_LONGEST_PAUSE: Final = 500  # steps between readings of a mean: a grid of all that pass by has no end (a limit)


@dataclass(frozen=True)
class NoiseModel:
    """Noise of one output of one run.

    Parameters
    ----------
    step : float [s]
        Of the autoregression: the usual time between rows.
    driven : float [SI]
        Standard deviation of what is new at each step: of the white noise itself, where there is no autoregression.
    coefficients : tuple of float
        Of the autoregression, e[t] = coefficients[0] e[t-1] + ... + new.
    walk : float [SI/s^0.5]
        Standard deviation of what a random walk gathers in a second.
    white : float [SI]
        Standard deviation of white noise in addition to an autoregression.
    offset, trend : bool
        Whether the run has an unknown level, and a slope; their values stand with the observation.

    Examples
    --------
    >>> noise = NoiseModel(step=0.02, driven=1e-4, coefficients=(0.9,))
    >>> round(1e4 * float(noise.deviation(np.array([0.0, 10.0]))[1]), 3)
    2.294
    """

    step: float
    driven: float
    coefficients: tuple[float, ...] = ()
    walk: float = 0.0
    white: float = 0.0
    offset: bool = False
    trend: bool = False

    @classmethod
    def of(cls, terms: Terms, entries: FloatArray, scale: float, step: float) -> NoiseModel:
        """From the entries of ``terms.state_space``, and the scale [SI]."""
        coefficients, _ = autoregression(np.tanh(entries[: terms.order]))
        walk = scale * math.exp(entries[terms.order]) / math.sqrt(step) if terms.walk else 0.0
        return cls(
            step=step,
            driven=scale,
            coefficients=tuple(float(one) for one in coefficients),
            walk=walk,
            white=scale * math.exp(entries[-1]) if terms.white else 0.0,
            offset=terms.offset,
            trend=terms.trend,
        )

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> NoiseModel:
        """From what ``to_table`` gave."""
        return cls(**{**table, "coefficients": tuple(float(one) for one in table["coefficients"])})

    def to_table(self) -> dict[str, Any]:
        """In the types that TOML has."""
        return {**asdict(self), "coefficients": list(self.coefficients)}

    @property
    def terms(self) -> Terms:
        """Which terms there are."""
        return Terms(len(self.coefficients), self.walk > 0.0, self.white > 0.0, self.offset, self.trend)

    @property
    def entries(self) -> FloatArray:
        """The entries of ``terms.state_space`` that it was made of; its scale is ``driven``."""
        ratios = [self.walk * math.sqrt(self.step)] * (self.walk > 0.0) + [self.white] * (self.white > 0.0)
        partials = np.arctanh(_partials(np.array(self.coefficients)))
        return np.concatenate([partials, np.log(np.array(ratios) / self.driven)])

    @property
    def stationary(self) -> float:
        """Variance without walk, offset and trend [SI^2]."""
        partials = _partials(np.array(self.coefficients))
        return float(self.driven**2 / np.prod(1.0 - partials**2) + self.white**2)

    @property
    def shape(self) -> Shape:
        """The same as a shape [SI]."""
        return Shape(self.terms, self.entries, self.driven**2)

    def deviation(self, time: FloatArray) -> FloatArray:
        """Standard deviation [SI] at times after the start of a run [s], offset and trend being known."""
        return np.asarray(np.sqrt(self.stationary + self.walk**2 * np.maximum(time, 0.0)))

    def variance_of_mean(self, time: FloatArray) -> float:
        """Variance of the mean of readings at some times [SI^2], offset and trend being known.

        Readings within one step of the model count as one, and a pause as no more than 500 steps.

        Parameters
        ----------
        time : float array, shape (n,) [s]
            Ascending.

        Examples
        --------
        >>> noise = NoiseModel(step=0.1, driven=1.0, coefficients=(0.9,))
        >>> long = np.arange(20000) / 10.0
        >>> round(20000 * noise.variance_of_mean(long) * (1.0 - 0.9) ** 2, 2)
        1.0
        """
        steps = np.diff(np.rint((time - time[0]) / self.step).astype(np.int64), prepend=0)
        places = np.cumsum(np.minimum(steps, _LONGEST_PAUSE))
        shares = np.bincount(places) / len(time)
        return float(spread_by(shares[:, None], np.ones(len(shares), dtype=np.int64), self.shape)[0, 0])


def _partials(coefficients: FloatArray) -> FloatArray:
    """Partial autocorrelations of an autoregression: the recursion of ``autoregression`` backwards."""
    found = []
    left = coefficients
    while len(left):
        last, rest = float(left[-1]), left[:-1]
        found.append(last)
        left = (rest + last * rest[::-1]) / (1.0 - last * last)
    return np.array(found[::-1])
