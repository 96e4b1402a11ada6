"""How readings scatter, one by one and in what is computed of many: neighbours that are alike say less than they are.

The noise of a channel is taken as white noise and an AR(1) process, of which rows at 0 V and the differences between
two periods hold nothing else. Of an AR(1) process of variance s^2 the covariance at a lag of k rows is s^2 phi^k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.quality.record import GUARD_ROWS, NO_VOLTAGE, Channel, IntArray, Record
from ipmclab.run import FloatArray

_FEWEST: Final = 20  # rows that show how their noise is autocorrelated (convention)
_LAGS: Final = 5  # whose covariances say how fast it fades (convention)
_CREEP: Final = 3  # degree of the polynomial by which a strip at rest may creep (convention)
_SURELY: Final = 2.0  # standard errors (Bartlett) of a correlation of neighbours that is one
_FEW: Final = 7.0  # values of a noise that fades: of fewer the range is taken as of so many (convention)
_SPIKE: Final = 5.0  # standard deviations, beyond which a reading is no noise


@dataclass(frozen=True)
class Scatter:
    """The noise of a channel.

    Parameters
    ----------
    white, slow : float [square of the channel's unit]
        Variances of the white part and of the autocorrelated one.
    follows : float
        The correlation of neighbours of the autocorrelated part, phi.
    """

    white: float
    slow: float = 0.0
    follows: float = 0.0

    @property
    def of_one(self) -> float:
        """Standard deviation of a reading."""
        return math.sqrt(self.white + self.slow)

    def of(self, weights: FloatArray) -> float:
        """Standard deviation of a weighted sum of neighbouring readings.

        Parameters
        ----------
        weights : float array, shape (n,)

        Examples
        --------
        >>> Scatter(1.0, 3.0, 0.5).of(np.array([1.0, 1.0])) ** 2  # 2 (1 + 3) + 2 * 3 * 0.5
        11.0
        """
        squares = float(weights @ weights)
        if not self.slow:
            return math.sqrt(self.white * squares)
        from scipy.signal import lfilter

        before = lfilter([1.0], [1.0, -self.follows], weights) - weights
        together = squares + 2.0 * float(weights @ before)
        return math.sqrt(self.white * squares + self.slow * max(together, 0.0))

    def of_mean(self, rows: int) -> float:
        """Standard error of a mean over so many neighbouring rows."""
        phi, apart = self.follows, 1.0 - self.follows
        together = ((1.0 + phi) / apart - 2.0 * phi * (1.0 - phi**rows) / (rows * apart**2)) / rows
        return math.sqrt(self.white / rows + self.slow * together)

    def clear(self, rows: IntArray, among: IntArray) -> FloatArray:
        """From which size on the change of a reading over some rows is none of the noise.

        Eight standard deviations of what is white. What fades has fewer values than rows, of which the range is hardly
        ever more than 2 (2 ln n)^(1/2) standard deviations (the largest of n normal deviates, to both sides).

        Parameters
        ----------
        rows : int array, shape (n,)
            Between the two readings.
        among : int array, shape (n,)
            How many rows were looked at.
        """
        values = np.log(np.maximum(among * (1.0 - self.follows), _FEW))
        return np.asarray(np.sqrt(64.0 * self.white + 8.0 * values * self.slow * (1.0 - self.follows**rows)))

    def of_wave(self, rows: float) -> float:
        """Standard deviation of the white noise that has as much power at a period of so many rows."""
        phi = self.follows
        power = (1.0 - phi**2) / (1.0 + phi**2 - 2.0 * phi * math.cos(2.0 * math.pi / rows))
        return math.sqrt(self.white + self.slow * power)


def scatter_of(record: Record, channel: Channel, periodic: tuple[float, int] | None = None) -> Scatter:
    """The noise of a channel, by what shows it beside the answer to the voltage.

    That are the rows at 0 V before it first moves, less a cubic, and the differences between the last two
    periods of a periodic voltage; that counts which scatters more in means. Where neither is autocorrelated, the
    noise is white.

    Parameters
    ----------
    record : Record
    channel : Channel
    periodic : (float [s], int), optional
        The period of the voltage, and the row after its last.
    """
    found = Scatter(channel.noise**2)
    for rows, degree in (_at_rest(record, channel), _between_periods(record, channel, periodic)):
        own = _of_rows(rows, degree, channel.noise**2)
        if own is not None and own.of_wave(math.inf) > found.of_wave(math.inf):
            found = own
    return found


def _of_rows(rows: FloatArray, degree: int, white: float) -> Scatter | None:
    """The noise of rows that hold nothing else but a polynomial; None where they do not show it autocorrelated."""
    count = len(rows)
    if count < _FEWEST or not np.isfinite(rows).all():
        return None
    smooth = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), degree + 1))[0]
    left = rows - smooth @ (smooth.T @ rows)
    reach = _SPIKE * 1.4826 * float(np.median(np.abs(left)))
    left = np.clip(left, -reach, reach)
    covariances = np.array([float(left[lag:] @ left[: count - lag]) / count for lag in range(_LAGS + 1)])
    if covariances[1] <= _SURELY * covariances[0] / math.sqrt(count):
        return None
    fades = float(covariances[2:] @ covariances[1:-1]) / float(covariances[1:-1] @ covariances[1:-1])
    fades = max(fades, float(covariances[1] / covariances[0]))
    # What was taken out had its part of the noise, most of what is slow (Kendall 1954; Marriott and Pope 1954).
    follows = min(fades + (degree + 1.0 + (degree + 3.0) * fades) / count, 1.0 - 1.0 / count)
    taken = sum(Scatter(0.0, 1.0, follows).of(one) ** 2 for one in smooth.T) / count
    slow = min(float(covariances[1]) / fades, float(covariances[0])) / max(1.0 - taken, 0.5)
    # From row to row the noise is what neighbouring readings say of the whole record.
    of_rows = slow * (1.0 - follows) / (1.0 + follows)
    return Scatter(max(float(covariances[0]) - slow, white - of_rows, 0.0), slow, follows)


def _at_rest(record: Record, channel: Channel) -> tuple[FloatArray, int]:
    """The rows at 0 V before the voltage first moves, in which a strip may creep, and by which degree."""
    driven = np.flatnonzero(np.abs(record.run.voltage) > NO_VOLTAGE)
    return channel.readings[: max(int(driven[0]) - GUARD_ROWS, 0)] if len(driven) else channel.readings, _CREEP


def _between_periods(record: Record, channel: Channel, periodic: tuple[float, int] | None) -> tuple[FloatArray, int]:
    """The differences between the last two periods, drawn down to the size of the noise of one; and degree 0."""
    period, end = periodic or (0.0, 0)
    count = round(period / record.period)
    if not count or 2 * count > end:
        return channel.readings[:0], 0
    change = channel.readings[end - count : end] - channel.readings[end - 2 * count : end - count]
    return np.asarray(change / math.sqrt(2.0)), 0
