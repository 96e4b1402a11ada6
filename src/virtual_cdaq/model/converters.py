"""Converters: volts to steps and back, noise that depends on nothing but the channel and the sample."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from virtual_cdaq.model.modules import Module, Range

Floats = NDArray[np.float64]
Codes = NDArray[np.int32]

ZERO_CELSIUS = 273.15  # K

# Callendar-Van Dusen constants by the DAQmx number of the RTD type (IEC 60751 and the makers' curves).
RTD_CURVES = {
    12481: (3.81e-3, -6.02e-7, -6.0e-12),  # Pt3750
    10071: (3.9083e-3, -5.775e-7, -4.183e-12),  # Pt3851
    12482: (3.9692e-3, -5.8495e-7, -4.233e-12),  # Pt3911
    10069: (3.9739e-3, -5.870e-7, -4.4e-12),  # Pt3916
    10053: (3.9787e-3, -5.8686e-7, -4.167e-12),  # Pt3920
    12483: (3.9888e-3, -5.915e-7, -3.85e-12),  # Pt3928
    10137: (3.9083e-3, -5.775e-7, -4.183e-12),  # custom, until its constants are set
}


def channel_key(seed: int, physical: str, acquisition: int) -> NDArray[np.uint64]:
    """The key of the noise of one acquisition on one channel."""
    digest = hashlib.blake2b(f"{seed}/{physical}/{acquisition}".encode(), digest_size=16).digest()
    return np.frombuffer(digest, dtype=np.uint64)


def noise(key: NDArray[np.uint64], first: int, count: int) -> Floats:
    """Standard normal noise of the samples `first` to `first + count`, however they are cut into pieces.

    Parameters
    ----------
    key : array of uint64, shape (2,)
        From `channel_key`.
    first : int
        Index of the first sample.
    count : int

    Returns
    -------
    array of float, shape (count,)

    Examples
    --------
    >>> key = channel_key(1, "cDAQ1Mod1/ai0", 0)
    >>> whole = noise(key, 0, 10)
    >>> bool((whole == np.concatenate([noise(key, 0, 3), noise(key, 3, 7)])).all())
    True
    """
    if count <= 0:
        return np.empty(0)
    # One 64-bit word a sample; Philox gives four of them a count of its counter.
    generator = np.random.Philox(key=key)
    generator.advance(first // 4)
    skip = first % 4
    words = generator.random_raw(skip + count)[skip:]
    radius = ((words >> np.uint64(32)).astype(np.float64) + 0.5) * 2.0**-32
    angle = (words & np.uint64(0xFFFFFFFF)).astype(np.float64) * (2.0 * np.pi * 2.0**-32)
    normal: Floats = np.sqrt(-2.0 * np.log(radius)) * np.cos(angle)
    return normal


def choose_range(module: Module, low: float, high: float) -> Range | None:
    """The smallest range that holds from `low` to `high`; None if none does."""
    for candidate in module.ranges:
        if candidate.low <= low * (1 - 1e-9) and high * (1 - 1e-9) <= candidate.high:
            return candidate
    return None


def step(module: Module, chosen: Range) -> float:
    """Size of one step of the converter [V, or ohm]."""
    span = chosen.full_scale if module.resistive else 2 * chosen.full_scale
    return float(span / 2**module.bits)


def code_limits(module: Module) -> tuple[int, int]:
    """The lowest and the highest code of a converter."""
    half = 0 if module.resistive else 2 ** (module.bits - 1)
    return -half, 2**module.bits - half - 1


def encode(module: Module, chosen: Range, values: Floats) -> Codes:
    """What the converter makes of `values`, cut at its ends."""
    codes: Codes = np.clip(np.rint(values / step(module, chosen)), *code_limits(module)).astype(np.int32)
    return codes


def decode(module: Module, chosen: Range, codes: Codes) -> Floats:
    """The volts or ohms of `codes`."""
    values: Floats = codes * np.float64(step(module, chosen))
    return values


def rtd_temperature(ohms: Floats, r0: float, curve: tuple[float, float, float]) -> Floats:
    """Temperature of a platinum resistor [degC] (Callendar-Van Dusen).

    Examples
    --------
    >>> rtd_temperature(np.array([80.3063, 138.5055]), 100.0, RTD_CURVES[10071]).round(2).tolist()
    [-50.0, 100.0]
    """
    a, b, c = curve
    ratio = ohms / r0
    # Above 0 degC the curve is a parabola.
    warm = (-a + np.sqrt(np.maximum(a * a - 4 * b * (1 - ratio), 0.0))) / (2 * b)
    result: Floats = warm
    cold = ratio < 1.0
    if cold.any():
        target = ratio[cold]
        guess = warm[cold]
        for _ in range(4):  # Newton; the cubic term is small
            value = 1 + a * guess + b * guess**2 + c * (guess - 100.0) * guess**3
            slope = a + 2 * b * guess + c * (4 * guess**3 - 300.0 * guess**2)
            guess = guess - (value - target) / slope
        result = warm.copy()
        result[cold] = guess
    return result
