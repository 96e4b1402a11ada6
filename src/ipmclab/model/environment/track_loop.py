"""The compiled walk of a run through a changing environment: the water goes along, and says how long parameters stay.

Water that leaking charge splits changes what leaks. Both go side by side: what has leaked up to a time counts there at
once, and how the films answer to it is worked out anew in each interval of the water's own times.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment.path import Panel
from ipmclab.model.environment.transport_loop import LEAST, Membrane, advance, lagged, rate, vapour
from ipmclab.model.numerics.compiled import kernel

FloatArray = npt.NDArray[np.float64]


class Track(NamedTuple):
    """What is known of the water before the strip is driven.

    Parameters
    ----------
    membrane : Membrane
    time : float array, shape (n,) [s]
        Where the water is kept: at each corner of the air, and so often that cubics go between.
    air : float array, shape (2, n)
        Temperature [degC] and activity of the air; straight lines in between.
    longest : float [s]
        Step of the solver.
    split : float [m^2/C]
        By how much a charge that leaks through 1 m^2 lowers the water content.
    renewed : float
        Part by which a parameter may move until all are renewed.
    """

    membrane: Membrane
    time: FloatArray
    air: FloatArray
    longest: float
    split: float
    renewed: float


# Entries of a walk: the number of its interval; content, temperature, antisymmetric mode and rate of the content at the
# begin of that; all but the rate and with it at its end, if as much leaks as is expected [A/m^2]; the slope of the rate
# by the content [1/s]; the time [s]; the charge density [C/m^2] that has leaked until then, without and with its sign;
# both at the begin of the interval; how much leaks lately [A/m^2], likewise; logarithm of the content last asked for.
_PLACE, _CONTENT, _WARM, _MODE, _RATE, _NEXT, _NEXT_WARM, _NEXT_MODE, _NEXT_RATE, _EXPECTED, _SLOPE, NOW = range(12)
_LOST, _FLOWED, _LOST_BEFORE, _FLOWED_BEFORE, _LOSING, _FLOWING, WANTED = range(12, 19)
WALK = 19
"""Numbers of a walk."""

_APART = 1e-3
"""Part of a content over which the slope of its rate is taken."""

_SAME_TIME = 1e-6
"""Part of an interval by which a sum of periods may miss its end."""

_OVER = 0.02
"""Part of its width by which a panel may be left without another one."""


@kernel
def set_out(track: Track, start: FloatArray, begin: float, walk: FloatArray, course: FloatArray) -> None:
    """Begin a walk at the first of the water's times, and go to the begin of the record [s].

    Parameters
    ----------
    start : float array, shape (2,)
        Water content and temperature [degC].
    walk : float array, shape (WALK,)
        Written.
    course : float array, shape (4, n)
        Written as far as the walk has come: content, temperature, antisymmetric mode, and rate of the content [1/s].
    """
    walk[:] = 0.0
    walk[_CONTENT] = start[0]
    walk[_WARM] = start[1] if track.membrane.thermal > 0.0 else track.air[0, 0]
    walk[NOW] = track.time[0]
    _open(track, walk, course)
    walk[NOW] = begin
    _keep_up(track, walk, course)


@kernel
def _open(track: Track, walk: FloatArray, course: FloatArray) -> None:
    """Where the water goes in the interval that begins, if as much leaks as in the one before."""
    m, i = track.membrane, int(walk[_PLACE])
    content, warm, mode, expected = walk[_CONTENT], walk[_WARM], walk[_MODE], walk[_EXPECTED]
    around = track.air[1, i] * vapour(track.air[0, i])
    walk[_RATE] = rate(m, content, warm, around, expected)
    course[0, i], course[1, i], course[2, i] = content, warm, mode
    course[3, i] = walk[_RATE] - track.split * (walk[_LOSING] - expected)
    if i + 1 < track.time.shape[0]:
        walk[_SLOPE] = (walk[_RATE] - rate(m, (1.0 - _APART) * content, warm, around, expected)) / (_APART * content)
        content, warm, mode = advance(*(m, track.time, track.air, i, expected, 0.0, track.longest, content, warm, mode))
        around = track.air[1, i + 1] * vapour(track.air[0, i + 1])
        walk[_NEXT], walk[_NEXT_WARM], walk[_NEXT_MODE] = content, warm, mode
        walk[_NEXT_RATE] = rate(m, content, warm, around, expected)


@kernel
def _keep_up(track: Track, walk: FloatArray, course: FloatArray) -> None:
    """Finish every interval that has passed, with what has leaked in it."""
    while walk[_PLACE] + 1 < track.time.shape[0]:
        i = int(walk[_PLACE])
        end = track.time[i + 1]
        length = end - track.time[i]
        if walk[NOW] < end - _SAME_TIME * length:
            break
        lost = walk[_LOST] - walk[_LOSING] * (walk[NOW] - end)
        flowed = walk[_FLOWED] - walk[_FLOWING] * (walk[NOW] - end)
        walk[_MODE] = walk[_NEXT_MODE] + _turned(track, walk, length, flowed - walk[_FLOWED_BEFORE])
        walk[_CONTENT] = max(walk[_NEXT] + _beside(track, walk, length, lost), LEAST)
        walk[_WARM], walk[_EXPECTED] = walk[_NEXT_WARM], (lost - walk[_LOST_BEFORE]) / length
        walk[_LOST_BEFORE], walk[_FLOWED_BEFORE] = lost, flowed
        walk[_PLACE] = i + 1
        _open(track, walk, course)


@kernel
def _beside(track: Track, walk: FloatArray, length: float, lost: float) -> float:
    """By how much the content is beside what was expected, after a part of the interval [s] in which so much leaked.

    What leaks evenly takes water, and a drier strip gives less of it to the air.
    """
    more = lost - walk[_LOST_BEFORE] - walk[_EXPECTED] * length
    given = walk[_SLOPE] * length
    return float(-track.split * more * (math.expm1(given) / given if given != 0.0 else 1.0))


@kernel
def _turned(track: Track, walk: FloatArray, length: float, flowed: float) -> float:
    """By how much a charge [C/m^2] that flows through an interval [s] turns the antisymmetric mode."""
    m = track.membrane
    taken = 2.0 * track.split * (1.0 + 2.0 * m.drag * (walk[_CONTENT] + walk[_NEXT]) / 22.0) * flowed
    return float(-taken * m.mixing / length * (1.0 - math.exp(-length / m.mixing)))


@kernel
def _around_now(track: Track, walk: FloatArray, time: float) -> tuple[float, float, float, float]:
    """Content, temperature, and their rates at a time [s] in the interval of the walk, or a little beyond it."""
    i = min(int(walk[_PLACE]), track.time.shape[0] - 2)
    length = track.time[i + 1] - track.time[i]
    x = (time - track.time[i]) / length
    first, rise = walk[_CONTENT], walk[_NEXT] - walk[_CONTENT]
    begin, end = walk[_RATE] * length - rise, walk[_NEXT_RATE] * length - rise
    content = first + x * (rise + (1.0 - x) * ((1.0 - x) * begin - x * end))
    rising = (rise + begin * (1.0 - x) * (1.0 - 3.0 * x) - end * x * (2.0 - 3.0 * x)) / length
    lost = walk[_LOST] + walk[_LOSING] * (time - walk[NOW])
    content += _beside(track, walk, time - track.time[i], lost)
    rising -= track.split * (walk[_LOSING] - walk[_EXPECTED])
    air = track.air[0, i] + (track.air[0, i + 1] - track.air[0, i]) * x
    lag = track.membrane.thermal
    warm = lagged(walk[_WARM], track.air[0, i], track.air[0, i + 1], x, length, lag)
    warming = (air - warm) / lag if lag > 0.0 else (track.air[0, i + 1] - track.air[0, i]) / length
    return max(content, LEAST), warm, rising, warming


@kernel
def stay(track: Track, panel: Panel, walk: FloatArray) -> float:
    """How long [s] parameters may stay from now on, by the greatest rate that they have until the interval ends."""
    end = track.time[min(int(walk[_PLACE]), track.time.shape[0] - 2) + 1]
    fastest = 0.0  # now, or where the interval ends
    for time in (walk[NOW], end):
        content, _, rising, warming = _around_now(track, walk, time)
        fastest = max(fastest, panel.by_content * abs(rising) / content + panel.by_temperature * abs(warming))
    left = np.inf if walk[_PLACE] + 2 >= track.time.shape[0] else end - walk[NOW]
    return float(min(track.renewed / fastest, left)) if fastest > 0.0 else left


@kernel
def weigh(track: Track, panel: Panel, walk: FloatArray, time: float, weights: FloatArray) -> bool:
    """How much each state of a panel counts at a time [s] soon; whether the panel is the one for it.

    Parameters
    ----------
    weights : float array, shape (n_contents x n_temperatures + n_contents + n_temperatures,)
        Written: first those of the states, the temperatures of one content side by side; what is behind is scratch.
    """
    content, warm, _, _ = _around_now(track, walk, time)
    wanted = math.log(content)
    walk[WANTED] = wanted
    over = _OVER * (panel.high - panel.low)
    if not (panel.low - over <= wanted <= panel.high + over):
        return False
    wet, count = panel.contents.shape[0], panel.temperatures.shape[0]
    of_content, of_temperature = weights[wet * count : wet * count + wet], weights[wet * count + wet :]
    _barycentric(panel.contents, wanted, of_content)
    _barycentric(panel.temperatures, warm, of_temperature)
    for k in range(wet):
        for l in range(count):  # noqa: E741
            weights[k * count + l] = of_content[k] * of_temperature[l]
    return True


@kernel
def _barycentric(nodes: FloatArray, x: float, weights: FloatArray) -> None:
    """What each of Chebyshev's points counts at x in the polynomial through all of them."""
    last, total = nodes.shape[0] - 1, 0.0
    for k in range(last + 1):
        away = x - nodes[k]
        if away == 0.0 or last == 0:
            weights[: last + 1] = 0.0
            weights[k] = 1.0
            return
        weight = (1.0 if k % 2 == 0 else -1.0) / away
        weights[k] = 0.5 * weight if k in (0, last) else weight
        total += weights[k]
    for k in range(last + 1):
        weights[k] /= total


@kernel
def blend(knots: FloatArray, weights: FloatArray, result: FloatArray) -> None:
    """Numbers from those at all states of a panel: ``knots``, shape (n_states, n), into ``result``, shape (n,)."""
    result[:] = 0.0
    for state in range(knots.shape[0]):
        weight = weights[state]
        of_state = knots[state]
        for k in range(result.shape[0]):
            result[k] += weight * of_state[k]


@kernel
def hurried(track: Track, panel: Panel, walk: FloatArray, time: float, lost: float, flowed: float) -> bool:
    """Whether so much more leaked until a time [s] than was expected that parameters should not have stayed.

    If so, it is expected from now on.

    Parameters
    ----------
    lost, flowed : float [C/m^2]
        Since now, without and with its sign.
    """
    length = time - walk[NOW]
    more = lost - walk[_LOSING] * length
    if panel.by_content * track.split * more <= track.renewed * math.exp(walk[WANTED]):
        return False
    walk[_LOSING], walk[_FLOWING] = lost / length, flowed / length
    return True


@kernel
def go_on(track: Track, walk: FloatArray, time: float, lost: float, flowed: float, course: FloatArray) -> None:
    """Go on to a time [s]; the other parameters are those of ``hurried`` and ``set_out``."""
    length = time - walk[NOW]
    walk[_LOSING], walk[_FLOWING] = lost / length, flowed / length
    walk[_LOST] += lost
    walk[_FLOWED] += flowed
    walk[NOW] = time
    _keep_up(track, walk, course)
