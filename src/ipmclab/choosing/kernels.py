"""Compiled loops: residuals whose mean is uncertain along some columns, and sums under a fading correlation."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel

FloatArray = npt.NDArray[np.float64]


@kernel
def filter_covariance(
    normal: FloatArray,
    columns: FloatArray,
    mean: FloatArray,
    root: FloatArray,
    error: FloatArray,
    widened: FloatArray,
) -> float:
    """Log density of white residuals whose mean is uncertain along some columns, less that without the uncertainty.

    One reading after the other sharpens what is known of the coefficients of the columns: recursive least squares on a
    root of their covariance (Potter 1963), which no rounding makes negative however much information a reading has.

    Parameters
    ----------
    normal : float array, shape (n_row,)
        Residuals of unit variance.
    columns : float array, shape (n_row, n_column)
    mean : float array, shape (n_column,)
    root : float array, shape (n_column, n_column)
        What is known of the coefficients: their covariance is ``root @ root.T``. Both are changed.
    error, widened : float array, shape (n_row,)
        Where the error and the variance of the prediction of each row are written.
    """
    count = len(mean)
    gained = 0.0
    turned, observed = np.empty(count), np.empty(count)
    for k in range(len(normal)):
        left, variance = normal[k], 1.0
        for j in range(count):
            turned[j] = 0.0
            for i in range(count):
                turned[j] += root[i, j] * columns[k, i]
            left -= columns[k, j] * mean[j]
            variance += turned[j] * turned[j]
        for i in range(count):
            observed[i] = 0.0
            for j in range(count):
                observed[i] += root[i, j] * turned[j]
        error[k], widened[k] = left, variance
        gained += 0.5 * (normal[k] * normal[k] - left * left / variance - math.log(variance))
        part = variance + math.sqrt(variance)
        for i in range(count):
            mean[i] += observed[i] * left / variance
            for j in range(count):
                root[i, j] -= observed[i] * turned[j] / part
    return gained


@kernel
def correlate(time: FloatArray, values: FloatArray, rate: float, out: FloatArray) -> None:
    """Add exp(-rate |t_k - t_l|) times the values, summed over l, to ``out``: two sweeps, one from each end."""
    reached = 0.0
    for k in range(len(time)):
        if k > 0:
            reached *= math.exp(-rate * (time[k] - time[k - 1]))
        reached += values[k]
        out[k] += reached
    reached = 0.0
    for k in range(len(time) - 2, -1, -1):
        reached = (reached + values[k + 1]) * math.exp(-rate * (time[k + 1] - time[k]))
        out[k] += reached
