"""The compiled walk of a run through a changing environment: the water goes along, and says how long parameters stay.

Water that leaking charge splits changes what leaks. Both go side by side: what has leaked up to a time counts there at
once, and how the films answer to it is worked out again in each interval of the water's own times.
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
# both at the begin of the interval; how much leaks lately [A/m^2], likewise; logarithm of the content last asked for,
# and the temperature there.
_PLACE, _CONTENT, _WARM, _MODE, _RATE, _NEXT, _NEXT_WARM, _NEXT_MODE, _NEXT_RATE, _EXPECTED, _SLOPE, NOW = range(12)
_LOST, _FLOWED, _LOST_BEFORE, _FLOWED_BEFORE, _LOSING, _FLOWING, WANTED, _WARM_THERE = range(12, 20)
WALK = 20
"""Numbers of a walk."""

_APART = 1e-3
"""Part of a content over which the slope of its rate is taken."""

_SAME_TIME = 1e-6
"""Part of an interval by which a sum of periods may miss its end."""

_OVER = 0.02
"""Part of its width by which a panel may be left without another one."""

_STRAIGHT = 4e-3
"""Part by which a parameter may move while all numbers go in straight lines. These err by an eighth of its square times
what a number bends: some millionths, compared with the 5e-5 of parameters that stay while they move by 1e-4."""

_BACK = -0.25
"""How far a straight line may be gone back, in parts of its length."""


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
    """By how much the content differs from what was expected, after a part of the interval [s] in which so much
    leaked.

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
def look(track: Track, panel: Panel, walk: FloatArray, time: float) -> bool:
    """Where the water is at a time [s] soon, for ``numbers_there``; whether the panel is the one for it."""
    content, warm, _, _ = _around_now(track, walk, time)
    wanted = math.log(content)
    walk[WANTED], walk[_WARM_THERE] = wanted, warm
    over = _OVER * (panel.high - panel.low)
    return panel.low - over <= wanted <= panel.high + over


class Lines(NamedTuple):
    """Numbers that go in straight lines, until a parameter has moved too far.

    Parameters
    ----------
    begin : float array, shape (n_kinds, 2)
        Logarithm of the content and temperature where the lines of each kind of numbers begin; NaN before there are
        any.
    length : float array, shape (n_kinds, 2)
        How far they go, with the sign.
    numbers : float array, shape (n_kinds, 3, n)
        The numbers at the begin, and by how much they change over each length.
    """

    begin: FloatArray
    length: FloatArray
    numbers: FloatArray


@kernel
def no_lines(kinds: int, count: int) -> Lines:
    """Of so many kinds of numbers, none of which has lines yet."""
    return Lines(np.full((kinds, 2), np.nan), np.full((kinds, 2), np.nan), np.zeros((kinds, 3, count)))


@kernel
def numbers_there(
    panel: Panel, knots: FloatArray, walk: FloatArray, lines: Lines, kind: int, result: FloatArray
) -> None:
    """Numbers where the water was last looked for.

    Parameters
    ----------
    knots : float array, shape (n_states, n)
        At all states of the panel, the temperatures of one content side by side.
    lines : Lines
        Of this panel; those of the kind are renewed where they end.
    result : float array, shape (n,)
        Written.
    """
    begin, length, numbers = lines
    wet = (walk[WANTED] - begin[kind, 0]) / length[kind, 0]
    warm = (walk[_WARM_THERE] - begin[kind, 1]) / length[kind, 1]
    if not (_BACK <= wet <= 1.0 and _BACK <= warm <= 1.0):
        _draw(panel, knots, walk, begin[kind], length[kind], numbers[kind])
        wet = warm = 0.0
    for k in range(result.shape[0]):
        result[k] = numbers[kind, 0, k] + wet * numbers[kind, 1, k] + warm * numbers[kind, 2, k]


@kernel
def _draw(
    panel: Panel, knots: FloatArray, walk: FloatArray, begin: FloatArray, length: FloatArray, numbers: FloatArray
) -> None:
    """New lines from here on, in the direction that the water takes."""
    wanted, warm = walk[WANTED], walk[_WARM_THERE]
    length[0] = math.copysign(_STRAIGHT / panel.by_content, wanted - begin[0])
    length[1] = math.copysign(_STRAIGHT / panel.by_temperature, warm - begin[1])
    begin[0], begin[1] = wanted, warm
    _blend(panel, knots, wanted, warm, numbers[0])
    for place in range(2):
        if math.isinf(length[place]):  # nothing depends on it
            continue
        wetter, warmer = (length[0], 0.0) if place == 0 else (0.0, length[1])
        _blend(panel, knots, wanted + wetter, warm + warmer, numbers[1 + place])
        numbers[1 + place] -= numbers[0]


@kernel
def _blend(panel: Panel, knots: FloatArray, wanted: float, warm: float, result: FloatArray) -> None:
    """Numbers at a logarithm of the content and a temperature, by the polynomials through those at all states."""
    wet, count = panel.contents.shape[0], panel.temperatures.shape[0]
    of_content, of_temperature = np.empty(wet), np.empty(count)
    _barycentric(panel.contents, wanted, of_content)
    _barycentric(panel.temperatures, warm, of_temperature)
    result[:] = 0.0
    for state in range(knots.shape[0]):
        weight = of_content[state // count] * of_temperature[state % count]
        of_state = knots[state]
        for k in range(result.shape[0]):
            result[k] += weight * of_state[k]


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
def expect(track: Track, panel: Panel, walk: FloatArray) -> tuple[float, float]:
    """What is expected to leak [A/m^2], and how much more than that may leak [C/m^2] while parameters stay.

    Where more does, a piece ends before its time: what leaks depends on the voltage, which nobody knows beforehand.
    """
    moved = panel.by_content * track.split
    return walk[_LOSING], track.renewed * math.exp(walk[WANTED]) / moved if moved > 0.0 else np.inf


@kernel
def go_on(track: Track, walk: FloatArray, time: float, lost: float, flowed: float, course: FloatArray) -> None:
    """Continue to a time [s].

    Parameters
    ----------
    lost, flowed : float [C/m^2]
        What has leaked since now, without and with its sign.
    course : float array, shape (4, n)
        As for ``set_out``.
    """
    length = time - walk[NOW]
    walk[_LOSING], walk[_FLOWING] = lost / length, flowed / length
    walk[_LOST] += lost
    walk[_FLOWED] += flowed
    walk[NOW] = time
    _keep_up(track, walk, course)
