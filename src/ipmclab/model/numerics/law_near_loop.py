"""One law at a port: the equation ``p + q law(p) = r`` near a voltage that is known, by few steps or by a series."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.law_loop import CUBIC, EXPONENTIAL, solve_one
from ipmclab.model.numerics.vectors_loop import stays_apart

FloatArray = npt.NDArray[np.float64]


@kernel
def follow(
    form: int, k0: float, k1: float, k2: float, sharp: float, q: float, r: float, guess: float
) -> tuple[float, float]:
    """The one p and w = law(p) with ``p + q w = r``, by Halley's steps from a guess.

    A step of which at most the 100,000th part of the law's scale is left to go is the last: its error goes with the
    third power. What does not come that far is left to ``solve_one``, which cannot fail.

    Parameters
    ----------
    form : int
    k0, k1, k2 : float
        The coefficients of the law.
    sharp : float [1/V]
        1/k2.
    q, r, guess : float [ohm, V, V]
    """
    sign = 1.0 if r > 0.0 else -1.0
    size = sign * r
    if form != CUBIC and size <= k1:
        return r, 0.0
    p = sign * guess
    least = 0.0 if form == CUBIC else k1
    if p < least:
        p = least
    if p > size:
        p = size
    for _ in range(4):
        if form == CUBIC:
            w = p * (k0 + p * (k1 + p * k2))
            first, second, third = k0 + p * (2.0 * k1 + p * 3.0 * k2), 2.0 * k1 + 6.0 * k2 * p, 6.0 * k2
            scale = p
        elif form == EXPONENTIAL:
            grown = k0 * math.exp((p - k1) * sharp)
            w, first = grown - k0, grown * sharp
            second = first * sharp
            third = second * sharp
            scale = k2
        else:
            grown = math.exp(0.5 * (p - k1) * sharp)
            shrunk = 1.0 / grown
            w, first = k0 * (grown - shrunk), 0.5 * k0 * sharp * (grown + shrunk)
            second, third = 0.25 * sharp * sharp * w, 0.25 * sharp * sharp * first
            scale = k2
        miss, steep = p + q * w - size, 1.0 + q * first
        step = 2.0 * miss * steep / (2.0 * steep * steep - miss * q * second)
        if abs(step) <= 1e-5 * scale:
            w -= step * (first - step * (0.5 * second - step * third * (1.0 / 6.0)))
            return sign * (p - step), sign * w
        p -= step
        if p < least:
            p = least
        if p > size:
            p = size
    return solve_one(form, np.array([k0, k1, k2]), q, r)


@kernel
def expand(
    form: int, k0: float, k1: float, k2: float, sharp: float, q: float, p: float, grown: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """All that the solution of ``p + q law(p) = r`` near a voltage needs and that does not depend on r.

    Parameters
    ----------
    p : float [V]
        Not below the threshold of the law.
    grown : float
        The exponential of ``(p - k1)/k2``, of half of it for Butler-Volmer; the cubic law has none. The others are
        those of ``follow``.

    Returns
    -------
    level, inverse, square, cube : float
        With ``d = (level - r) inverse``, the solution is ``p - d (1 + d (square + d cube))`` but for the fourth power.
    w, first, second, third : float
        The law and its derivatives, divided by 1, 1, 2 and 6.
    """
    if form == CUBIC:
        w = p * (k0 + p * (k1 + p * k2))
        first, second, third = k0 + p * (2.0 * k1 + p * 3.0 * k2), k1 + 3.0 * k2 * p, k2
    elif form == EXPONENTIAL:
        w, first = k0 * grown - k0, k0 * grown * sharp
        second = 0.5 * sharp * first
        third = sharp * second * (1.0 / 3.0)
    else:
        shrunk = 1.0 / grown
        w, first = k0 * (grown - shrunk), 0.5 * k0 * sharp * (grown + shrunk)
        second, third = 0.125 * sharp * sharp * w, sharp * sharp * first * (1.0 / 24.0)
    inverse = 1.0 / (1.0 + q * first)
    bend = q * inverse
    square = bend * second
    return p + q * w, inverse, square, 2.0 * square * square - bend * third, w, first, second, third


@kernel
def reaches(form: int, k1: float, k2: float, p: float, d: float, square: float, cube: float) -> bool:
    """Whether the series of ``expand`` about p reaches a solution at about ``p - d``, to rounding."""
    if form == CUBIC:  # at 0 V the quadratic part has a kink
        return abs(d * square) <= 2e-5 and d * d * abs(cube) <= 1e-9 and (k1 == 0.0 or 2.0 * d < p)
    return abs(d) <= 2e-4 * k2


ANCHOR: Final = 11
"""Numbers of a point about which a law is expanded."""

_P, _LEVEL, _INVERSE, _SQUARE, _CUBE, _FOURTH, _W = range(7)  # then the derivatives of the law

_REACH: Final = 1e-3
"""Part of the scale of an exponential up to which the fifth power, which the series leaves out, is rounding."""

_GUIDES: Final = 0.1
"""Part of the law's scale up to which the series is the better guess."""


@kernel
def _anchored(
    form: int, k0: float, k1: float, k2: float, q: float, r: float, guess: float, anchor: Any
) -> tuple[float, float]:
    """The solution from a guess; the anchor is laid there."""
    stays_apart()
    sign = 1.0 if r > 0.0 else -1.0
    sharp = 1.0 / k2
    p, w = follow(form, k0, k1, k2, sharp, q, r, guess)
    about, grown = sign * p, 0.5 * sign * w / k0
    grown = 1.0 + 2.0 * grown if form == EXPONENTIAL else grown + math.sqrt(1.0 + grown * grown)
    level, inverse, square, cube, w0, w1, w2, w3 = expand(form, k0, k1, k2, sharp, q, about, grown)
    w4, bend = 0.0, q * inverse
    if form != CUBIC:
        w4 = 0.25 * sharp * w3 if form == EXPONENTIAL else sharp * sharp * w2 * (1.0 / 48.0)
    anchor[_P], anchor[_LEVEL], anchor[_INVERSE], anchor[_SQUARE], anchor[_CUBE] = about, level, inverse, square, cube
    anchor[_FOURTH] = 5.0 * square * (square * square - bend * w3) + bend * w4
    anchor[_W], anchor[_W + 1], anchor[_W + 2], anchor[_W + 3], anchor[_W + 4] = w0, w1, w2, w3, w4
    return p, w


@part
def solve_near(form: int, k: Any, q: float, r: float, guess: float, anchor: Any) -> tuple[float, float]:
    """The one p and w = law(p) with ``p + q w = r``, by the series about the anchor, or from a guess.

    Parameters
    ----------
    form : int
    k : begin of float array, shape (3,)
    q, r, guess : float [ohm, V, V]
    anchor : begin of float array, shape (ANCHOR,)
        What earlier calls with this q have left, zeros before the first; written where it does not reach.
    """
    k0, k1, k2 = k[0], k[1], k[2]
    sign = 1.0 if r > 0.0 else -1.0
    size = sign * r
    if form != CUBIC and (size <= k1 or k0 == 0.0):
        return r, 0.0
    about, square, cube = anchor[_P], anchor[_SQUARE], anchor[_CUBE]
    d = (anchor[_LEVEL] - size) * anchor[_INVERSE]
    step = d * (1.0 + d * (square + d * (cube + d * anchor[_FOURTH])))
    if about > 0.0:
        if reaches(form, k1, k2, about, d, square, cube) or (form != CUBIC and abs(d) <= _REACH * k2):
            bent = anchor[_W + 2] - step * (anchor[_W + 3] - step * anchor[_W + 4])
            return sign * (about - step), sign * (anchor[_W] - step * (anchor[_W + 1] - step * bent))
        if abs(d) < _GUIDES * (about if form == CUBIC else k2):
            guess = sign * (about - step)
    return _anchored(form, k0, k1, k2, q, r, guess, anchor)
