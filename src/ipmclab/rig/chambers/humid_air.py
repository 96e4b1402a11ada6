"""Water vapour in air."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def saturation_pressure(temperature: npt.ArrayLike) -> FloatArray:
    """The pressure [Pa] of water vapour over water (Buck 1981).

    Parameters
    ----------
    temperature : float array [degC]

    Examples
    --------
    >>> saturation_pressure([20.0, 25.0]).round(1).tolist()
    [2338.3, 3168.5]
    """
    t = np.asarray(temperature, dtype=np.float64)
    return np.asarray(611.21 * np.exp((18.678 - t / 234.5) * t / (257.14 + t)))
