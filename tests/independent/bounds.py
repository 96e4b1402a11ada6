"""What no unbiased estimator can beat: the Cramer-Rao bound of the electrical fit, from ``scipy.signal``."""

from __future__ import annotations

import numpy as np
import scipy.signal

from tests.independent.thesis import FRIEND_2, Array, Strip, circuit

ELECTRICAL = (
    "circuit.branches.0.resistivity",
    "circuit.branches.0.permittivity",
    "circuit.branches.1.resistivity",
    "circuit.branches.1.permittivity",
    "circuit.dc_resistivity",
)


def strip_of(log_parameters: Array, *, like: Strip = FRIEND_2) -> Strip:
    """A strip whose five electrical parameters, in the order of ELECTRICAL, are these."""
    rho1, eps1, rho2, eps2, rho_dc = np.exp(log_parameters)
    return like.changed(
        resistivities=(float(rho1), float(rho2)),
        permittivities=(float(eps1), float(eps2)),
        dc_resistance=float(rho_dc) * like.thickness / (like.total_length * like.width),
    )


def log_parameters_of(strip: Strip) -> Array:
    (rho1, rho2), (eps1, eps2) = strip.resistivities, strip.permittivities
    return np.log([rho1, eps1, rho2, eps2, strip.dc_resistivity])


def current_of(strip: Strip, time: Array, voltage: Array) -> Array:
    """The current from rest, each voltage held until the next row: SciPy's recursion, which is compiled."""
    a, b, c, d = circuit(strip)
    *held, _ = scipy.signal.cont2discrete((a, b, c[:1], d[:1]), time[1] - time[0], method="zoh")
    numerators, denominator = scipy.signal.ss2tf(*held)
    return np.asarray(scipy.signal.lfilter(numerators[0], denominator, voltage))


def relative_errors(strip: Strip, records: list[tuple[Array, Array]], noise: float) -> dict[str, float]:
    """Smallest relative standard error of each electrical parameter, all else known."""
    point = log_parameters_of(strip)
    step = 1e-5
    columns = []
    for j in range(len(point)):
        moved = [point.copy(), point.copy()]
        moved[0][j] += step
        moved[1][j] -= step
        up, down = (np.concatenate([current_of(strip_of(p, like=strip), t, v) for t, v in records]) for p in moved)
        columns.append((up - down) / (2.0 * step))
    jacobian = np.stack(columns, axis=1) / noise
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    return {name: float(np.sqrt(covariance[j, j])) for j, name in enumerate(ELECTRICAL)}


def step_and_sine(rows: int = 2000, rate: float = 50.0) -> list[tuple[Array, Array]]:
    time = np.arange(rows) / rate
    return [(time, np.ones(rows)), (time, np.sin(2 * np.pi * 0.1 * time))]


def noisy_current(strip: Strip, voltage: Array, rate: float, noise: float, generator: np.random.Generator) -> Array:
    time = np.arange(len(voltage)) / rate
    return current_of(strip, time, voltage) + noise * generator.standard_normal(len(voltage))
