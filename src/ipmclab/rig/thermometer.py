"""The platinum resistance thermometer."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

# Callendar and Van Dusen's equation with the coefficients of IEC 60751:
# R = R0 (1 + A T + B T^2 + C (T - 100) T^3), the last term below 0 degC only.
_A: Final = 3.9083e-3
_B: Final = -5.775e-7
_C: Final = -4.183e-12


def platinum_resistance(temperature: npt.ArrayLike, at_zero: float = 100.0) -> FloatArray:
    """The resistance of a platinum thermometer (IEC 60751).

    Parameters
    ----------
    temperature : float array [degC]
    at_zero : float [ohm]
        At 0 degC.

    Examples
    --------
    >>> platinum_resistance([-50.0, 0.0, 100.0]).round(2).tolist()
    [80.31, 100.0, 138.51]
    """
    t = np.asarray(temperature, dtype=np.float64)
    below = np.minimum(t, 0.0)
    return np.asarray(at_zero * (1.0 + _A * t + _B * t**2 + _C * (below - 100.0) * below**3))


def platinum_temperature(resistance: npt.ArrayLike, at_zero: float = 100.0) -> FloatArray:
    """The temperature [degC] of a platinum thermometer: the inverse of ``platinum_resistance``.

    Examples
    --------
    >>> platinum_temperature([80.31, 107.79, 138.51]).round(1).tolist()
    [-50.0, 20.0, 100.0]
    """
    ratio = np.asarray(resistance, dtype=np.float64) / at_zero
    t = (-_A + np.sqrt(_A**2 - 4.0 * _B * (1.0 - ratio))) / (2.0 * _B)
    for _ in range(5):  # below 0 degC the quartic differs from the quadratic by little
        t = t - (platinum_resistance(t) / 100.0 - ratio) / (_A + 2.0 * _B * t)
    return np.asarray(t)
