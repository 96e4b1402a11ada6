"""A strip that leaks, row by row in plain NumPy, with exact derivatives by complex steps of all parameters at once.

Matrices come from the stages, exponentials from scipy, and each law's equation is solved by Newton's method in complex
numbers, of which the imaginary parts are the derivatives.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import expm

from ipmclab.model import Actuator
from ipmclab.model.numerics.timeline import Timeline

Array = np.ndarray

STEP = 1e-100


def law(form: int, k: Array, p: Array) -> tuple[Array, Array]:
    """Currents of laws (cubic, exponential, Butler-Volmer) and their slopes; k has a last axis of coefficients."""
    sign = np.where(p.real < 0.0, -1.0, 1.0)
    high = sign * p
    k0, k1, k2 = np.moveaxis(k, -1, 0)
    if form == 0:
        return p * (k0 + k1 * high + k2 * high**2), k0 + 2.0 * k1 * high + 3.0 * k2 * high**2
    x = np.where(high.real < k1.real, 0.0, (high - k1) / k2)
    gives = high.real >= k1.real
    if form == 1:
        return sign * k0 * (np.exp(x) - 1.0), gives * k0 / k2 * np.exp(x)
    return sign * 2.0 * k0 * np.sinh(0.5 * x), gives * k0 / k2 * np.cosh(0.5 * x)


def solved(form: int, k: Array, drop: Array, r: Array, p: Array) -> tuple[Array, Array]:
    """p and w with ``p + drop w = r``, from a guess.

    Steps are cut to 0.1 V, so that no exponential overflows. One below 1e-6 V leaves its square, and one after that the
    imaginary parts too: of what is left to rounding they need no more.
    """
    arrived = 0
    for _ in range(300):
        w, slopes = law(form, k, p)
        missing = np.linalg.solve(
            np.eye(p.shape[-1]) + drop * slopes[..., None, :], (r - p - times(drop, w))[..., None]
        )[..., 0]
        far = float(np.max(np.abs(missing.real)))
        p = p + missing * min(1.0, 0.1 / max(far, 0.1))
        arrived += far < 1e-6
        if arrived == 3:
            return p, law(form, k, p)[0]
    raise AssertionError("Newton's steps did not arrive")


def times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def outputs(actuator: Actuator, names: list[str], line: Timeline, state: Array) -> tuple[Array, Array]:
    """What is read along a time line, shape (n_outputs, n_time), and its derivatives, shape (n_names, ..., ...)."""
    values: dict[str, Any] = dict(actuator.parameter_values)
    systems = [actuator.assembled({**values, name: complex(values[name], STEP)}) for name in names]
    ports = [system.law_ports for system in systems]
    (form,) = {law.form for one in ports for law in one.laws}
    k = np.array([[law.coefficients for law in one.laws] for one in ports], dtype=complex)
    a, c, d = (np.array([getattr(one, name) for one in systems], dtype=complex) for name in ("a", "c", "d"))
    drive = np.array([np.hstack([one.b, port.drive]) for one, port in zip(systems, ports, strict=True)], dtype=complex)
    reach, c_law, d_law, loop = (
        np.array([getattr(port, name) for port in ports], dtype=complex) for name in ("reach", "c", "d", "loop")
    )
    sets, n, m = drive.shape
    moves = []
    for duration in line.durations:
        whole = np.zeros((sets, n + 2 * m, n + 2 * m), complex)
        whole[:, :n, :n], whole[:, :n, n : n + m] = a * duration, drive * duration
        whole[:, n : n + m, n + m :] = np.eye(m)
        top = expm(whole)[:, :n]
        moves.append((top[..., :n], top[..., n : n + m], top[..., n + m :]))
    read = np.zeros((sets, c.shape[1], len(line.reading)), complex)
    x, p = np.tile(state.astype(complex), (sets, 1)), np.zeros((sets, m - 1), complex)

    def within(u: float) -> tuple[Array, Array]:
        return solved(form, k, -loop, times(c_law, x) + d_law[..., 0] * u, p)

    for i in range(len(line.row)):
        if line.row[i] >= 0:
            u = line.reading[line.row[i]]
            p, w = within(u)
            read[..., line.row[i]] = times(c, x) + d[..., 0] * u + times(reach, w)
        if i == len(line.interval):
            break
        u, end = line.start[i], line.end[i]
        p, w = within(u)
        move, held, ramped = moves[line.interval[i]]
        # What goes on without the laws' change by the end of the interval, and what that change adds.
        ahead = times(move, x) + held[..., 0] * u + times(held[..., 1:], w)
        ahead += ramped[..., 0] * (end - u) - times(ramped[..., 1:], w)
        drop = -(loop + c_law @ ramped[..., 1:])
        p, w = solved(form, k, drop, times(c_law, ahead) + d_law[..., 0] * end, p)
        x = ahead + times(ramped[..., 1:], w)
    return read[0].real, read.imag / STEP
