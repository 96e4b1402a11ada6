"""The compiled loop of the water in a membrane: mean content, temperature, and the first antisymmetric mode."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel

FloatArray = npt.NDArray[np.float64]

# Those of ``sorption`` and ``transport``; a test holds them equal. The cache of kernels knows of changes here only.
_KELVIN = 273.15
_GAS = 8.314462618
_FARADAY = 96485.33212
LEAST = 1e-3


class Membrane(NamedTuple):
    """What the loop has to know of a strip.

    ``sites`` [mol/m^2] of a face over the whole thickness; ``anode`` and ``cathode`` the mass transfer [m/s] of both
    faces while water leaves, ``asymmetry`` how many times less it is while water enters; ``inner`` [mol/(m^2 s)] what
    diffuses to a face for a difference of 1 in the content; ``mixing`` and ``thermal`` time constants [s] of the
    antisymmetric mode and of the temperature; ``drag`` molecules for each charge at a content of 22; s0 to s3 the
    isotherm.
    """

    sites: float
    anode: float
    cathode: float
    asymmetry: float
    inner: float
    mixing: float
    thermal: float
    drag: float
    s0: float
    s1: float
    s2: float
    s3: float


@kernel
def vapour(temperature: float) -> float:
    """Concentration of saturated vapour [mol/m^3] at a temperature [degC] (Buck, 1981)."""
    pressure = 611.21 * math.exp((18.678 - temperature / 234.5) * temperature / (257.14 + temperature))
    return pressure / (_GAS * (temperature + _KELVIN))


@kernel
def outflow(m: Membrane, film: float, content: float, saturated: float, around: float) -> float:
    """What leaves through one face [mol/(m^2 s)]: the film, and diffusion to it, one after the other.

    The activity at the face is where both flows are equal; a face with more water than saturated vapour gives is a
    free surface, of activity 1.
    """
    if film == 0.0:
        return 0.0
    wet = m.s0 + m.s1 + m.s2 + m.s3
    low, high = 0.0, 1.0
    if m.inner * (content - wet) >= film * (saturated - around):
        return film * (saturated - around)
    a = around / saturated
    balance = m.inner * (m.s0 + a * (m.s1 + a * (m.s2 + a * m.s3)) - content)
    if balance > 0.0:  # drier than the air: water enters
        film = film / m.asymmetry
    for _ in range(60):
        at_face = m.s0 + a * (m.s1 + a * (m.s2 + a * m.s3))
        value = m.inner * (at_face - content) + film * (a * saturated - around)
        if value > 0.0:
            high = a
        else:
            low = a
        slope = m.inner * (m.s1 + a * (2.0 * m.s2 + a * 3.0 * m.s3)) + film * saturated
        step = a - value / slope
        if step < low or step > high:
            step = 0.5 * (low + high)
        if abs(step - a) <= 1e-14:
            a = step
            break
        a = step
    return film * (a * saturated - around)


@kernel
def outflows(m: Membrane, content: float, saturated: float, around: float) -> tuple[float, float]:
    """What leaves through the anode's and the cathode's face; found once where these are alike."""
    anode = outflow(m, m.anode, content, saturated, around)
    return anode, anode if m.cathode == m.anode else outflow(m, m.cathode, content, saturated, around)


@kernel
def rate(m: Membrane, content: float, temperature: float, around: float, leak: float) -> float:
    """Rate of the mean content [1/s] where ``leak`` [A/m^2] takes one molecule for two electrons."""
    saturated = vapour(temperature)
    anode, cathode = outflows(m, content, saturated, around)
    out = anode + cathode
    if content <= LEAST:
        return max(0.0, -out / m.sites)
    return -(out + abs(leak) / (2.0 * _FARADAY)) / m.sites


@kernel
def lagged(begin: float, first: float, last: float, part: float, length: float, lag: float) -> float:
    """What follows a straight line from ``first`` to ``last`` over a length with a lag, after a part of it."""
    if lag <= 0.0:
        return first + (last - first) * part
    slope = (last - first) / length
    time = part * length
    return first + slope * (time - lag) + (begin - first + slope * lag) * math.exp(-time / lag)


@kernel
def advance(
    m: Membrane,
    time: FloatArray,
    air: FloatArray,
    i: int,
    lost: float,
    flowed: float,
    most: float,
    content: float,
    warm: float,
    mode: float,
) -> tuple[float, float, float]:
    """Content, temperature [degC] and antisymmetric mode at the end of interval i, from those at its begin.

    ``lost`` and ``flowed`` [A/m^2] are the mean of what leaks, without and with its sign: both directions split water,
    and each at its own face. The other parameters are those of ``follow``.
    """
    length = time[i + 1] - time[i]
    steps = max(1, math.ceil(length / most))
    h, begun = length / steps, warm
    for k in range(steps):
        t0, t1 = k / steps, (k + 1) / steps
        middle = 0.5 * (t0 + t1)
        warms = (
            warm,
            lagged(begun, air[0, i], air[0, i + 1], middle, length, m.thermal),
            lagged(begun, air[0, i], air[0, i + 1], t1, length, m.thermal),
        )
        arounds = (
            vapour_around(air, i, t0),
            vapour_around(air, i, middle),
            vapour_around(air, i, t1),
        )
        r1 = rate(m, content, warms[0], arounds[0], lost)
        r2 = rate(m, content + 0.5 * h * r1, warms[1], arounds[1], lost)
        r3 = rate(m, content + 0.5 * h * r2, warms[1], arounds[1], lost)
        r4 = rate(m, content + h * r3, warms[2], arounds[2], lost)
        half = content + 0.5 * h * r2
        content = max(content + h * (r1 + 2.0 * (r2 + r3) + r4) / 6.0, LEAST)
        warm = warms[2]
        saturated = vapour(warms[1])
        anode, cathode = outflows(m, half, saturated, arounds[1])
        apart = cathode - anode
        apart -= flowed / (2.0 * _FARADAY)  # water is split at the anode, whichever face that is
        apart -= 2.0 * m.drag * half / 22.0 * flowed / _FARADAY
        source = 2.0 * apart / m.sites
        decayed = math.exp(-h / m.mixing)
        mode = mode * decayed + source * m.mixing * (1.0 - decayed)
    return content, warm, mode


@kernel
def follow(
    m: Membrane,
    time: FloatArray,
    air: FloatArray,
    leak: FloatArray,
    most: float,
    start: FloatArray,
    result: FloatArray,
) -> None:
    """The water along a time line, by fourth-order Runge-Kutta steps in which all that is linear is exact.

    Parameters
    ----------
    m : Membrane
    time : float array, shape (n,) [s]
    air : float array, shape (2, n)
        Temperature [degC] and activity of the air; straight lines in between.
    leak : float array, shape (n - 1,) [A/m^2]
        Mean current density that leaks in each interval, with its sign.
    most : float [s]
        Longest step.
    start : float array, shape (3,)
        Mean content, temperature [degC], and antisymmetric mode.
    result : float array, shape (4, n)
        Written: those three, and the rate of the content [1/s].
    """
    content, warm, mode = start[0], start[1], start[2]
    for i in range(time.shape[0]):
        j = leak[min(i, leak.shape[0] - 1)] if leak.shape[0] else 0.0
        around = air[1, i] * vapour(air[0, i])
        result[0, i], result[1, i], result[2, i] = content, warm, mode
        result[3, i] = rate(m, content, warm, around, j)
        if i + 1 == time.shape[0]:
            break
        content, warm, mode = advance(m, time, air, i, j, j, most, content, warm, mode)


@kernel
def vapour_around(air: FloatArray, i: int, part: float) -> float:
    """Concentration of vapour in the air [mol/m^3] within an interval."""
    temperature = air[0, i] + (air[0, i + 1] - air[0, i]) * part
    return float(air[1, i] + (air[1, i + 1] - air[1, i]) * part) * vapour(temperature)
