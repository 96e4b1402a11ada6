"""What no unbiased estimator can beat: the Cramer-Rao bound of the electrical fit, from ``scipy.signal.lsim``."""

from __future__ import annotations

import numpy as np
import scipy.signal

from tests.independent.thesis import FRIEND_2, Array, Strip, circuit, respond

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


def lsim_current(strip: Strip, time: Array, voltage: Array, *, straight_lines: bool) -> Array:
    a, b, c, d = circuit(strip)
    return scipy.signal.lsim((a, b, c[:1], d[:1]), voltage, time, interp=straight_lines)[1]


def relative_errors(
    strip: Strip, records: list[tuple[Array, Array]], noise: float, *, straight_lines: bool = False
) -> dict[str, float]:
    """Smallest relative standard error of each electrical parameter, all else known."""
    point = log_parameters_of(strip)
    step = 1e-5
    columns = []
    for j in range(len(point)):
        moved = [point.copy(), point.copy()]
        moved[0][j] += step
        moved[1][j] -= step
        up, down = (
            np.concatenate(
                [lsim_current(strip_of(p, like=strip), t, v, straight_lines=straight_lines) for t, v in records]
            )
            for p in moved
        )
        columns.append((up - down) / (2.0 * step))
    jacobian = np.stack(columns, axis=1) / noise
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    return {name: float(np.sqrt(covariance[j, j])) for j, name in enumerate(ELECTRICAL)}


def step_and_sine(rows: int = 2000, rate: float = 50.0) -> list[tuple[Array, Array]]:
    time = np.arange(rows) / rate
    return [(time, np.ones(rows)), (time, np.sin(2 * np.pi * 0.1 * time))]


def noisy_current(strip: Strip, voltage: Array, rate: float, noise: float, generator: np.random.Generator) -> Array:
    return respond(strip, voltage, rate, "zero")["current"] + noise * generator.standard_normal(len(voltage))
