"""Compiled loops of the circuit fit."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.compiled import kernel

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]


@kernel
def ramp_weights(step: float, pole: float) -> tuple[float, float, float, float, float]:
    """Exact weights of one step of dx/dt = pole x + u for a straight line u from its start to its end.

    Returns the decay, the weights of the start and the end of the line, and the derivatives
    of both weights with respect to the pole.
    """
    z = pole * step
    if abs(z) < 0.05:
        # Series of phi1 = (e^z - 1)/z and phi2 = (phi1 - 1)/z and their derivatives: the closed
        # forms lose digits where e^z is nearly 1.
        phi1 = phi2 = slope1 = slope2 = 0.0
        power, factorial = 1.0, 1.0
        for order in range(9):
            factorial *= order + 1.0
            phi1 += power / factorial
            phi2 += power / (factorial * (order + 2.0))
            slope1 += (order + 1.0) * power / (factorial * (order + 2.0))
            slope2 += (order + 1.0) * power / (factorial * (order + 2.0) * (order + 3.0))
            power *= z
    else:
        growth = math.expm1(z)
        phi1 = growth / z
        phi2 = (phi1 - 1.0) / z
        slope1 = (growth + 1.0 - phi1) / z
        slope2 = (slope1 - phi2) / z
    return (
        math.exp(z),
        step * (phi1 - phi2),
        step * phi2,
        step * step * (slope1 - slope2),
        step * step * slope2,
    )


@kernel
def pole_response(
    durations: FloatArray,
    kind: IndexArray,
    start: FloatArray,
    end: FloatArray,
    poles: FloatArray,
    state: FloatArray,
    slope: FloatArray,
) -> None:
    """Response of dx/dt = pole x + u from rest, and its derivative with respect to the pole.

    Parameters
    ----------
    durations : float array, shape (n_kind,) [s]
        The different lengths that steps have.
    kind : int array, shape (n_step,)
        Which of them each step has.
    start, end : float array, shape (n_step,)
        The input at both ends of each step; straight between them.
    poles : float array, shape (n_pole,) [1/s]
    state, slope : float array, shape (n_pole, n_step + 1)
        Where the response and its derivative are written.
    """
    weights = np.empty((len(durations), 6))
    for j in range(len(poles)):
        for m in range(len(durations)):
            decay, first, second, first_slope, second_slope = ramp_weights(durations[m], poles[j])
            weights[m, 0], weights[m, 1], weights[m, 2] = decay, first, second
            weights[m, 3], weights[m, 4], weights[m, 5] = durations[m] * decay, first_slope, second_slope
        x = dx = 0.0
        state[j, 0] = slope[j, 0] = 0.0
        for k in range(len(kind)):
            m = kind[k]
            dx = weights[m, 0] * dx + weights[m, 3] * x + (weights[m, 4] * start[k] + weights[m, 5] * end[k])
            x = weights[m, 0] * x + (weights[m, 1] * start[k] + weights[m, 2] * end[k])
            state[j, k + 1] = x
            slope[j, k + 1] = dx


@kernel
def pole_values(
    durations: FloatArray, kind: IndexArray, start: FloatArray, end: FloatArray, poles: FloatArray, state: FloatArray
) -> None:
    """The response of ``pole_response`` without its derivative."""
    weights = np.empty((len(durations), 3))
    for j in range(len(poles)):
        for m in range(len(durations)):
            decay, first, second, _, _ = ramp_weights(durations[m], poles[j])
            weights[m, 0], weights[m, 1], weights[m, 2] = decay, first, second
        x = 0.0
        state[j, 0] = 0.0
        for k in range(len(kind)):
            m = kind[k]
            x = weights[m, 0] * x + (weights[m, 1] * start[k] + weights[m, 2] * end[k])
            state[j, k + 1] = x
