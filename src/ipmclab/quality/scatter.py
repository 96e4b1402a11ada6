"""How readings scatter, one by one and in what is computed of many: neighbours that are alike say less than they are.

The noise of a channel is taken as white noise and an AR(1) process. Rows at 0 V and the differences between periods
hold nothing else but what creeps. Of an AR(1) process of variance s^2 the covariance at a lag of k rows is s^2 phi^k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.quality.record import Channel, IntArray, Record
from ipmclab.run import FloatArray

_FEWEST: Final = 20  # rows that show how their noise is autocorrelated (convention)
_LAGS: Final = 5  # whose covariances say how fast it fades (convention)
_CREEP: Final = 3  # degree of the polynomial by which a strip may creep, at rest or from period to period (convention)
_PERIODS: Final = 50  # after which the voltage is the same again, in whole rows (convention)
_SURELY: Final = 2.0  # standard errors (Bartlett) of a correlation that is one (convention)
_FEW: Final = 7.0  # values of a noise that fades: of fewer the range is taken as of so many (convention)
_SPIKE: Final = 5.0  # standard deviations, beyond which a reading is no noise (convention)


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

    That are the rows at 0 V before it first moves, and the differences between the last periods of a periodic
    voltage, both less a cubic; that counts which scatters more in means. Where neither is autocorrelated, the noise is
    white.

    Parameters
    ----------
    record : Record
    channel : Channel
    periodic : (float [s], int), optional
        The period of the voltage, and the row after its last.
    """
    found = Scatter(channel.noise**2)
    # At rest a strip may creep, as it may from period to period.
    for rows in (channel.readings[: record.resting], _between_periods(record, channel, periodic)):
        own = _of_rows(rows, channel.noise**2)
        if own is not None and own.of_wave(math.inf) > found.of_wave(math.inf):
            found = own
    return found


def _of_rows(rows: FloatArray, white: float) -> Scatter | None:
    """The noise of rows that hold nothing else but a cubic; None where they do not show it autocorrelated."""
    there = np.isfinite(rows)
    count = int(np.count_nonzero(there))
    if count < _FEWEST:
        return None
    smooth = np.zeros((len(rows), _CREEP + 1))
    smooth[there] = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(rows)), _CREEP + 1)[there])[0]
    left = np.where(there, rows, 0.0)
    left -= smooth @ (smooth.T @ left)
    reach = _SPIKE * 1.4826 * float(np.median(np.abs(left[there])))
    left = np.clip(left, -reach, reach)
    before = range(len(rows), len(rows) - _LAGS - 1, -1)
    covariances = np.array([float(left[-stop:] @ left[:stop]) for stop in before])
    covariances /= [max(np.count_nonzero(there[-stop:] & there[:stop]), 1) for stop in before]
    if covariances[1] <= _SURELY * covariances[0] / math.sqrt(count):
        return None
    alike = covariances / covariances[0]
    fades = max(float(alike[2:] @ alike[1:-1]) / float(alike[1:-1] @ alike[1:-1]), float(alike[1]))
    # What was taken out had its part of the noise, most of what is slow (Kendall 1954; Marriott and Pope 1954).
    follows = min(fades + (_CREEP + 1.0 + (_CREEP + 3.0) * fades) / count, 1.0 - 1.0 / count)
    taken = sum(Scatter(0.0, 1.0, follows).of(one) ** 2 for one in smooth.T) / count
    slow = min(float(covariances[1]) / fades, float(covariances[0])) / max(1.0 - taken, 0.5)
    # From row to row the noise is what neighbouring readings say of the whole record.
    of_rows = slow * (1.0 - follows) / (1.0 + follows)
    return Scatter(max(float(covariances[0]) - slow, white - of_rows, 0.0), slow, follows)


def _between_periods(record: Record, channel: Channel, periodic: tuple[float, int] | None) -> FloatArray:
    """The differences between the last two stretches of as many periods, drawn down to the size of the noise of one.

    A period is seldom a whole number of rows, and the voltage may have begun later: they count where the voltage
    differs so little that noise hides what that makes in the answer. None do where that is of no number of periods.
    """
    period, end = periodic or (0.0, 0)
    voltage = record.run.voltage
    for periods in range(1, _PERIODS + 1):
        count = round(periods * period / record.period)
        if not 0 < 2 * count <= end:
            break
        last, before = slice(end - count, end), slice(end - 2 * count, end - count)
        apart = float(np.linalg.norm(voltage[last] - voltage[before])) / math.sqrt(count)
        if apart * channel.span <= channel.noise * float(np.ptp(voltage[last])):
            return np.asarray((channel.readings[last] - channel.readings[before]) / math.sqrt(2.0))
    return channel.readings[:0]
