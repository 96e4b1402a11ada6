"""Compiled loops of poles and residues: what they answer to a drive, and those of a circuit with their derivatives."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel

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
    rows: IndexArray,
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
    rows : int array, shape (n_row,)
        The ends of steps that are wanted, ascending, 0 the begin of the first one; empty where all are.
    state, slope : float array, shape (n_pole, n_row)
        Where the response and its derivative are written.
    """
    weights = np.empty((len(durations), 6))
    every = len(rows) == 0
    wanted = state.shape[1]
    for j in range(len(poles)):
        for m in range(len(durations)):
            decay, first, second, first_slope, second_slope = ramp_weights(durations[m], poles[j])
            weights[m, 0], weights[m, 1], weights[m, 2] = decay, first, second
            weights[m, 3], weights[m, 4], weights[m, 5] = durations[m] * decay, first_slope, second_slope
        x = dx = 0.0
        row = 0
        if every or rows[0] == 0:
            state[j, 0] = slope[j, 0] = 0.0
            row = 1
        for k in range(len(kind)):
            m = kind[k]
            # In this order only one product and one sum wait for the step before.
            dx = weights[m, 0] * dx + (weights[m, 3] * x + (weights[m, 4] * start[k] + weights[m, 5] * end[k]))
            x = weights[m, 0] * x + (weights[m, 1] * start[k] + weights[m, 2] * end[k])
            if row < wanted and (every or rows[row] == k + 1):
                state[j, row] = x
                slope[j, row] = dx
                row += 1


@kernel
def shifted_levels(
    levels: FloatArray, whole: int, first: int, between: bool, kind: IndexArray, level: FloatArray, rows: IndexArray
) -> None:
    """What a voltage that is held over each row is between rows and edges that lie beside them.

    Parameters
    ----------
    levels : float array, shape (n_row + 1,)
        Before the first edge, then since each.
    whole : int
        How many rows the edges lie behind theirs, rounded down.
    first : int
        The row at which the input begins.
    between : bool
        Whether the edges lie between rows: then each row is two steps, before and after its edge, else one.
    kind, level : arrays, shape (n_step,)
        Written.
    rows : int array, shape (n_row,)
        Written: the knot of each row.
    """
    last = len(levels) - 1
    parts = 2 if between else 1
    for k in range(len(kind) // parts):
        before = min(max(first + k - whole, 0), last)
        after = min(max(first + k - whole + 1, 0), last)
        if between:
            kind[2 * k], kind[2 * k + 1] = 0, 1
            level[2 * k], level[2 * k + 1] = levels[before], levels[after]
        else:
            kind[k], level[k] = 0, levels[after]
    for row in range(len(rows)):
        rows[row] = parts * (row - first)


@kernel
def pole_values(
    durations: FloatArray, kind: IndexArray, start: FloatArray, end: FloatArray, poles: FloatArray, state: FloatArray
) -> None:
    """The response of ``pole_response`` without its derivative; all poles side by side, as they are many."""
    decay = np.empty((len(durations), len(poles)))
    first, second = np.empty_like(decay), np.empty_like(decay)
    for m in range(len(durations)):
        for j in range(len(poles)):
            decay[m, j], first[m, j], second[m, j], _, _ = ramp_weights(durations[m], poles[j])
    state[:, 0] = 0.0
    for k in range(len(kind)):
        m = kind[k]
        for j in range(len(poles)):
            state[j, k + 1] = decay[m, j] * state[j, k] + (first[m, j] * start[k] + second[m, j] * end[k])


@kernel
def admittance_slopes(
    series: float,
    leak: float,
    resistances: FloatArray,
    capacitances: FloatArray,
    poles: FloatArray,
    vectors: FloatArray,
    inlets: FloatArray,
    residues: FloatArray,
    slopes: FloatArray,
) -> float:
    """Direct admittance and residues of a circuit, and the derivatives of ``admittance``.

    With w_i = sqrt(C_i) v_i as states the system matrix is M = node b b' - diag(rate), whose poles and residues
    follow from first-order perturbation of its eigenvectors.

    Parameters
    ----------
    series, leak : float [ohm]
    resistances, capacitances : float array, shape (n,) [ohm, F]
    poles : float array, shape (n,) [1/s]
    vectors : float array, shape (n, n)
        Eigenvectors of M, in columns.
    inlets : float array, shape (n,)
        What of the voltage at the terminals enters each mode.
    residues : float array, shape (n,) [S/s]
        Where the residues are written.
    slopes : float array, shape (1 + 2 n, 2 + 2 n)
        Where the derivatives are written: of direct, residues and poles (rows) with respect to the series
        resistance and the logarithms of leak, resistances and capacitances (columns).
    """
    n = len(poles)
    conductance = 1.0 / leak + np.sum(1.0 / resistances)
    divider = 1.0 / (1.0 + series * conductance)
    node = series * divider
    inlet = 1.0 / (resistances * np.sqrt(capacitances))
    seen = inlets / divider  # b in the directions of the modes
    for j in range(n):
        residues[j] = -(inlets[j] ** 2)
    for p in range(2 + 2 * n):
        branch = (p - 2) % n
        d_series = 1.0 if p == 0 else 0.0
        d_conductance = -1.0 / leak if p == 1 else -1.0 / resistances[branch] if 2 <= p < 2 + n else 0.0
        d_inlet = 0.0 if p < 2 else -inlet[branch] if p < 2 + n else -0.5 * inlet[branch]
        d_rate = 0.0 if p < 2 else -1.0 / (resistances[branch] * capacitances[branch])
        d_divider = -divider * divider * (d_series * conductance + series * d_conductance)
        d_node = divider * divider * (d_series - series * series * d_conductance)
        slopes[0, p] = divider * divider * (d_conductance - conductance * conductance * d_series)
        for j in range(n):
            d_seen = vectors[branch, j] * d_inlet
            d_coupling = d_divider * seen[j] + divider * d_seen
            for k in range(n):
                turned = (
                    d_node * seen[j] * seen[k]
                    + node * (d_seen * seen[k] + seen[j] * vectors[branch, k] * d_inlet)
                    - vectors[branch, j] * vectors[branch, k] * d_rate
                )
                if k == j:
                    slopes[1 + n + j, p] = turned
                elif poles[k] != poles[j]:  # of two equal ones one is not seen
                    d_coupling += divider * seen[k] * turned / (poles[j] - poles[k])
            slopes[1 + j, p] = -2.0 * divider * seen[j] * d_coupling
    return float(conductance * divider)


@kernel
def admittances_slopes(
    series: FloatArray,
    leak: FloatArray,
    resistances: FloatArray,
    capacitances: FloatArray,
    poles: FloatArray,
    vectors: FloatArray,
    inlets: FloatArray,
    direct: FloatArray,
    residues: FloatArray,
    slopes: FloatArray,
) -> None:
    """``admittance_slopes`` of many circuits: each array has their axis first, and ``direct`` is written too."""
    for k in range(len(series)):
        direct[k] = admittance_slopes(
            series[k],
            leak[k],
            resistances[k],
            capacitances[k],
            poles[k],
            vectors[k],
            inlets[k],
            residues[k],
            slopes[k],
        )
