"""The noise of one output of one run: how it spreads sums of rows, and draws of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ipmclab.run import FloatArray
from ipmclab.statespace.kernels import continued
from ipmclab.statespace.terms import Terms, autoregression


@dataclass(frozen=True, eq=False)
class Shape:
    """The noise of one output of one run, in units of the problem's noise.

    Parameters
    ----------
    terms : Terms
    entries : float array, shape (terms.shapes,)
    variance : float
    """

    terms: Terms
    entries: FloatArray
    variance: float

    def about(self, constants: Terms) -> Shape:
        """The same noise about the constants of some terms too."""
        offset, trend = self.terms.offset or constants.offset, self.terms.trend or constants.trend
        return replace(self, terms=replace(self.terms, offset=offset, trend=trend))

    def with_drift(self) -> Shape:
        """The same noise about an offset and a trend."""
        return replace(self, terms=replace(self.terms, offset=True, trend=True))


def spread_by(columns: FloatArray, steps: npt.NDArray[np.int64], shape: Shape) -> FloatArray:
    """``columns' V columns`` for noise of covariance V.

    Of the stationary part by convolution with its autocovariances; a walk has moved every later reading by each of its
    steps, so that its part is the squares of sums over all later rows.

    Parameters
    ----------
    columns : float array, shape (n_readings, n)
    steps : int array, shape (n_readings,)
        Steps of time since the reading before.
    shape : Shape
        Its offset and trend are constants, no noise.

    Examples
    --------
    >>> from ipmclab.statespace.terms import Terms
    >>> noise = Shape(Terms(order=1), np.array([np.arctanh(0.5)]), 1.0)
    >>> spread_by(np.array([[1.0], [1.0]]), np.array([1, 2]), noise).round(6).tolist()
    [[3.333333]]
    """
    places = np.cumsum(steps) - steps[0]
    count = int(places[-1]) + 1
    size = 1 << (2 * count - 1).bit_length()
    found = _stationary(shape, count)
    around = np.zeros(size)
    around[:count] = found
    around[size - count + 1 :] = found[:0:-1]
    spectrum = np.fft.rfft(around).real
    regular = np.zeros((count, columns.shape[1]))
    regular[places] = columns
    seen = np.fft.irfft(np.fft.rfft(regular, size, axis=0) * spectrum[:, None], size, axis=0)[:count]
    total = regular.T @ seen
    if shape.terms.walk:
        later = np.cumsum(regular[:0:-1], axis=0)
        total = total + np.exp(2.0 * shape.entries[shape.terms.order]) * (later.T @ later)
    return np.asarray(shape.variance * total)


def structure(shape: Shape, lags: Sequence[int]) -> FloatArray:
    """Mean square of the change of a noise over so many steps.

    Examples
    --------
    >>> walk = Shape(Terms(walk=True), np.zeros(1), 1.0)
    >>> structure(walk, [1, 10]).tolist()
    [3.0, 12.0]
    """
    covariances, steps = _stationary(shape, max(lags) + 1), np.array(lags)
    walk = np.exp(2.0 * shape.entries[shape.terms.order]) if shape.terms.walk else 0.0
    return np.asarray(shape.variance * (2.0 * (covariances[0] - covariances[steps]) + walk * steps))


def _stationary(shape: Shape, count: int) -> FloatArray:
    """Autocovariances of what does not walk, of rows 0 to ``count`` - 1 steps apart, over the variance."""
    order = shape.terms.order
    if not order:
        return np.where(np.arange(count) == 0, 1.0, 0.0)
    coefficients, first = autoregression(np.tanh(shape.entries[:order]))
    onward = continued(coefficients, first[::-1], np.zeros(max(count - order, 0)))
    found = np.concatenate([first, onward])[:count]
    found[0] += np.exp(2.0 * shape.entries[-1]) if shape.terms.white else 0.0
    return found


def drawn(shape: Shape, steps: npt.NDArray[np.int64], generator: np.random.Generator) -> FloatArray:
    """A draw of the noise at some readings.

    Parameters
    ----------
    shape : Shape
    steps : int array, shape (n_readings,)
        Steps of time since the reading before.
    generator : numpy.random.Generator

    Returns
    -------
    noise : float array, shape (n_readings,)
    """
    places = np.cumsum(steps) - steps[0]
    count, order = int(places[-1]) + 1, shape.terms.order
    found = generator.standard_normal(count)
    if order:
        coefficients, covariances = autoregression(np.tanh(shape.entries[:order]))
        lags = np.abs(np.arange(order)[:, None] - np.arange(order))
        before = np.linalg.cholesky(covariances[lags]) @ generator.standard_normal(order)
        found = continued(coefficients, before, found)
        if shape.terms.white:
            found = found + np.exp(shape.entries[-1]) * generator.standard_normal(count)
    if shape.terms.walk:
        walked = np.exp(shape.entries[order]) * generator.standard_normal(count)
        walked[0] = 0.0
        found = found + np.cumsum(walked)
    return np.asarray(np.sqrt(shape.variance) * found[places])
