"""How well a prediction meets a measurement: the numbers of a validation, on plain arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

LAGS: Final = 25
"""Lags of the residual autocorrelation, as MATLAB's ``resid`` shows by default."""

BAND_95: Final = 1.959963984540054
"""Two-sided 95 % point of the standard normal distribution (derived)."""

ROUNDING: Final = 1e-9
"""A residual below this part of the output's range is arithmetic: what it remembers says nothing of the model
(convention)."""


def fit_in_words(percent: float) -> str:
    """A fit as a percentage, with one decimal; two where it is nearly perfect.

    Examples
    --------
    >>> fit_in_words(98.76), fit_in_words(99.96), fit_in_words(100.0)
    ('98.8 %', '99.96 %', '100.0 %')
    """
    return f"{percent:.{2 if 99.5 <= percent < 99.995 else 1}f} %"


@dataclass(frozen=True)
class Score:
    """One output of one run, or of several runs together, predicted against measured.

    Parameters
    ----------
    output : str
        The channel that was compared.
    samples : int
        Rows compared.
    left_out : int
        Rows that were left out: missing, masked by a finding, or known only as a bound.
    fit_percent : float or None [percent]
        100 (1 - |e| / |y - mean y|): 100 is perfect, 0 is no better than the mean. The
        definition of MATLAB's ``compare``.
    rmse : float or None [SI unit of the output]
        Root of the mean squared error.
    rmse_percent_of_range : float or None [percent]
        RMSE over the largest minus the smallest measured value.
    max_error : float or None [SI unit of the output]
        Largest absolute error.
    max_error_sample : int or None
        The row where it is.
    max_error_time : float or None [s]
    max_error_run : int or None
        The place of its run in the call.
    autocorrelation : float array, shape (n_lags,)
        Of the residual at lags 1, 2, ... rows; empty for scores of several runs, and where the
        residual is rounding alone (below a billionth of the output's range).
    autocorrelation_band : float array, shape (n_lags,)
        95 % of the lags of a white residual lie within plus or minus this.
    reason : str
        Why a score is None; empty otherwise.
    inside_band : float or None
        Share of the readings inside the 95 % band of the prediction; None where no fit gives a band.
    """

    output: str
    samples: int
    left_out: int
    fit_percent: float | None = None
    rmse: float | None = None
    rmse_percent_of_range: float | None = None
    max_error: float | None = None
    max_error_sample: int | None = None
    max_error_time: float | None = None
    max_error_run: int | None = None
    autocorrelation: FloatArray = field(default_factory=lambda: np.empty(0))
    autocorrelation_band: FloatArray = field(default_factory=lambda: np.empty(0))
    reason: str = ""
    inside_band: float | None = None

    @property
    def lags_outside(self) -> float | None:
        """Share of the lags outside the band, 0.05 expected of a white residual; None without lags."""
        if not len(self.autocorrelation):
            return None
        return float(np.mean(np.abs(self.autocorrelation) > self.autocorrelation_band))

    @property
    def fit_text(self) -> str:
        """The fit in words; empty where there is none."""
        return "" if self.fit_percent is None else fit_in_words(self.fit_percent)

    def as_dict(self) -> dict[str, float | int | str | None]:
        """The score as ``--json`` prints it."""
        return {
            "output": self.output,
            "samples": self.samples,
            "left_out": self.left_out,
            "fit_percent": self.fit_percent,
            "rmse": self.rmse,
            "rmse_percent_of_range": self.rmse_percent_of_range,
            "max_error": self.max_error,
            "max_error_sample": self.max_error_sample,
            "max_error_time": self.max_error_time,
            "max_error_run": self.max_error_run,
            "autocorrelation_outside_band": self.lags_outside,
            "inside_band": self.inside_band,
            "reason": self.reason or None,
        }


@dataclass(frozen=True)
class Comparison:
    """Measured and predicted values of one output of one run, on the rows of the run.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    measured, predicted : float array, shape (n_time,) [SI]
    used : bool array, shape (n_time,)
        The rows that count.
    reach : float array, shape (n_time,) [SI], optional
        Half the width of the 95 % band of a reading about the prediction.
    """

    time: FloatArray
    measured: FloatArray
    predicted: FloatArray
    used: BoolArray
    reach: FloatArray | None = None

    @property
    def error(self) -> FloatArray:
        """Measured minus predicted [SI], NaN on the rows that do not count."""
        return np.where(self.used, self.measured - self.predicted, np.nan)


def score(output: str, comparisons: Sequence[Comparison]) -> Score:
    """Score one output over one or several runs.

    Over several runs every sum goes over all rows of all runs, and each run keeps its own
    mean in the fit, so that runs at different levels do not look better together.

    Parameters
    ----------
    output : str
        The name of the output.
    comparisons : sequence of Comparison
        One for each run.

    Returns
    -------
    score : Score
        With None and a reason where a score does not exist.

    Examples
    --------
    >>> time = np.arange(4.0)
    >>> measured, predicted = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0, 2.0, 2.0])
    >>> one = score("force", [Comparison(time, measured, predicted, np.full(4, True))])
    >>> round(one.fit_percent, 3), one.rmse, one.max_error, one.max_error_sample
    (55.279, 0.5, 1.0, 3)
    """
    samples = sum(int(np.count_nonzero(one.used)) for one in comparisons)
    left_out = sum(len(one.used) for one in comparisons) - samples
    if samples == 0:
        return Score(output, 0, left_out, reason="no usable sample of this output")
    worst_run = max(range(len(comparisons)), key=lambda index: _largest(comparisons[index]))
    worst = comparisons[worst_run]
    row = int(np.nanargmax(np.abs(worst.error)))
    used = [one for one in comparisons if one.used.any()]
    squared = sum(float(np.sum(one.error[one.used] ** 2)) for one in used)
    total = sum(float(np.sum((one.measured[one.used] - one.measured[one.used].mean()) ** 2)) for one in used)
    values = np.concatenate([one.measured[one.used] for one in used])
    banded = [np.abs(one.error[one.used]) <= one.reach[one.used] for one in used if one.reach is not None]
    extent = float(np.ptp(values))
    rmse = math.sqrt(squared / samples)
    judged = len(comparisons) == 1 and rmse >= ROUNDING * extent
    correlation, band = autocorrelation(comparisons[0].error) if judged else (np.empty(0), np.empty(0))
    # The deviations of equal readings from their mean are rounding, not a scatter.
    constant = all(np.ptp(one.measured[one.used]) == 0.0 for one in used)
    return Score(
        output,
        samples,
        left_out,
        fit_percent=None if constant else 100.0 * (1.0 - math.sqrt(squared) / math.sqrt(total)),
        rmse=rmse,
        rmse_percent_of_range=None if constant or extent == 0.0 else 100.0 * rmse / extent,
        max_error=abs(float(worst.error[row])),
        max_error_sample=row,
        max_error_time=float(worst.time[row]),
        max_error_run=worst_run,
        autocorrelation=correlation,
        autocorrelation_band=band,
        inside_band=float(np.mean(np.concatenate(banded))) if len(banded) == len(used) else None,
        reason="the measured output is constant: a fit relative to its variation does not exist" if constant else "",
    )


def _largest(one: Comparison) -> float:
    return float(np.nanmax(np.abs(one.error))) if one.used.any() else -1.0


def autocorrelation(error: FloatArray, *, lags: int = LAGS) -> tuple[FloatArray, FloatArray]:
    """Autocorrelation of a residual at lags 1, 2, ..., and its 95 % band.

    r_k is the mean of e_t e_(t+k) over the pairs of rows that both count, over the mean of
    e_t^2. The mean of the residual is not removed: a model that is off by a constant has a
    correlated residual. For white noise r_k has the standard deviation 1/sqrt(pairs).

    Parameters
    ----------
    error : float array, shape (n_time,)
        Residual on consecutive rows, NaN where a row does not count.
    lags : int
        How many lags at most.

    Returns
    -------
    correlation, band : float array, shape (n_lags,)
        Only lags with at least 20 pairs: below that the band means nothing.

    Examples
    --------
    >>> alternating = np.tile([1.0, -1.0], 100)
    >>> autocorrelation(alternating)[0][:2]
    array([-1.,  1.])
    """
    used = np.isfinite(error)
    values = np.where(used, error, 0.0)
    power = float(np.sum(values**2))
    if power == 0.0:
        return np.empty(0), np.empty(0)
    power /= np.count_nonzero(used)
    correlation: list[float] = []
    band: list[float] = []
    for lag in range(1, lags + 1):
        pairs = int(np.count_nonzero(used[:-lag] & used[lag:]))
        if pairs < 20:
            break
        correlation.append(float(values[:-lag] @ values[lag:]) / pairs / power)
        band.append(BAND_95 / math.sqrt(pairs))
    return np.array(correlation), np.array(band)
