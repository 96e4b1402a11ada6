"""From the matrices of a cascade to the numbers of a modal loop, as plain Python.

``kernels`` compiles it. It stands alone, as ``modal_loop`` does, so that a process that simulates one record need not
load a compiler first. It knows real numbers only, each operation rounded by itself: compiled or not, the digits are the
same.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

ZERO, ZERO_BEFORE = 0, 1
"""Holds by number; any other is straight between rows."""

_SERIES: Final = tuple(1.0 / math.factorial(k) for k in range(18, 1, -1))
"""Of phi_2, the last term first; enough for |z| up to 1/2."""


_ROWS: Final = 15


def room_for(sections: int, ports: int, outputs: int) -> tuple[int, int]:
    """The shape of what ``cascade`` works in."""
    return 2 * (ports + outputs) + _ROWS, 2 * sections + 1


def cascade(
    entries: FloatArray,
    wiring: IndexArray,
    sections: int,
    ports: int,
    nearly_meet: float,
    period: float,
    hold: int,
    room: FloatArray,
    numbers: FloatArray,
) -> bool:
    """Poles and residues of a cascade in closed form, and the modal recursion over one period.

    A signal of the cascade is ``direct + sum of residue/(s - pole)`` (``modal.Fractions``). Behind a block with the
    transfer function H it has its old poles, each residue times H there, and those of H, each residue times the signal
    there. Of a pole p over a period T, with a = exp(p T), the state moves by ``x+ = a x + b0 u + b1 u+``. With
    ``z = (x - b1 u)/(b0 + a b1)`` this is ``z+ = a z + u``: the gains fold into the weights of the outputs, and a real
    pole costs one multiplication and one addition.

    Parameters
    ----------
    entries : float array
        a, b, c and d of each block, row by row, one after the other.
    wiring : int array
        Of each block: states (1 or 2), inputs, outputs; then the number of the port of each input (-1 where nothing
        happens at it) and of each output. The port 0 is driven from outside. Last the ports that are read.
    sections : int
        How many blocks there are.
    ports : int
        How many ports.
    nearly_meet : float
        Relative gap between two poles, one behind the other, below which there is no answer.
    period : float [s]
    hold : int
    room : float array, shape ``room_for(sections, ports, outputs)``
        Zeros, and overwritten: what is worked out on the way.
    numbers : float array, shape (3 sections + (outputs + 1) 2 sections + outputs,)
        Written. With two modes for each section (the second does nothing in one of one state): three numbers of how
        the modes of each section move, in the first side by side, else chained (``modal_loop.modal``); the weights of
        all modes in each output; the direct term of each output; the modes at row 0 for 1 V there.

    Returns
    -------
    found : bool
        False where these modes do not fit a loop, or two poles nearly meet.
    """
    poles = 2 * sections
    real, imaginary, direct, rest = room[:ports], room[ports : 2 * ports], room[:ports, poles], room[2 * ports :]
    direct[0] = 1.0
    pole_real, pole_imaginary, count = rest[0], rest[1], rest[2]
    own_real, own_imaginary = rest[3], rest[4]
    # One over the difference of an own pole and an earlier one, and whether there is none.
    over_real, over_imaginary, meets = rest[5:7], rest[7:9], rest[9:11]
    at, wire = 0, 0
    for section in range(sections):
        n, m, p = wiring[wire], wiring[wire + 1], wiring[wire + 2]
        inputs, outputs = wire + 3, wire + 3 + m
        wire = outputs + p
        a, b, c, d = at, at + n * n, at + n * n + n * m, at + n * n + n * m + p * n
        at = d + p * m
        first = 2 * section
        count[section] = n
        a11, a12, a21, a22 = entries[a], 0.0, 0.0, 0.0
        if n == 1:
            pole_real[first] = a11
        else:
            a12, a21, a22 = entries[a + 1], entries[a + 2], entries[a + 3]
            middle, half = 0.5 * (a11 + a22), 0.5 * (a11 - a22)
            square = half * half + a12 * a21
            if square < 0.0:
                root = math.sqrt(-square)
                pole_real[first], pole_imaginary[first] = middle, root
                pole_real[first + 1], pole_imaginary[first + 1] = middle, -root
            else:
                # The larger root by addition, the smaller from the product, so that neither cancels.
                root = math.sqrt(square)
                larger = middle - root if middle < 0.0 else middle + root
                pole_real[first] = larger
                pole_real[first + 1] = (a11 * a22 - a12 * a21) / larger if larger != 0.0 else 0.0
        for j in range(n):
            for i in range(first + j):
                if i < first and i % 2 >= count[i // 2]:
                    continue
                away_real = pole_real[first + j] - pole_real[i]
                away_imaginary = pole_imaginary[first + j] - pole_imaginary[i]
                away = away_real * away_real + away_imaginary * away_imaginary
                one = pole_real[i] * pole_real[i] + pole_imaginary[i] * pole_imaginary[i]
                other = (
                    pole_real[first + j] * pole_real[first + j] + pole_imaginary[first + j] * pole_imaginary[first + j]
                )
                meets[j, i] = away <= nearly_meet * nearly_meet * max(one, other)
                if meets[j, i] and i >= first:
                    return False
                over_real[j, i], over_imaginary[j, i] = 0.0, 0.0
                if not meets[j, i]:
                    over_real[j, i], over_imaginary[j, i] = away_real / away, -away_imaginary / away
        for row in range(p):
            port = wiring[outputs + row]
            sum_direct, sum_real, sum_imaginary = 0.0, real[port], imaginary[port]
            for column in range(m):
                source = wiring[inputs + column]
                if source < 0:
                    continue
                through = entries[d + row * m + column]
                sum_direct += through * direct[source]
                # The block's own residues, from c adj(s - a) b over det(s - a).
                if n == 1:
                    own_real[0], own_imaginary[0] = entries[c + row] * entries[b + column], 0.0
                else:
                    b1, b2 = entries[b + column], entries[b + m + column]
                    c1, c2 = entries[c + 2 * row], entries[c + 2 * row + 1]
                    linear = c1 * b1 + c2 * b2
                    constant = c1 * (a12 * b2 - a22 * b1) + c2 * (a21 * b1 - a11 * b2)
                    if pole_imaginary[first] != 0.0:
                        own_real[0] = own_real[1] = 0.5 * linear
                        own_imaginary[0] = -0.5 * (linear * pole_real[first] + constant) / pole_imaginary[first]
                        own_imaginary[1] = -own_imaginary[0]
                    else:
                        apart = pole_real[first] - pole_real[first + 1]
                        own_real[0] = (linear * pole_real[first] + constant) / apart
                        own_real[1] = -(linear * pole_real[first + 1] + constant) / apart
                        own_imaginary[0] = own_imaginary[1] = 0.0
                for j in range(n):
                    # Side by side poles may meet, one behind the other they may not.
                    for i in range(first):
                        here = real[source, i] != 0.0 or imaginary[source, i] != 0.0
                        if here and meets[j, i] and (own_real[j] != 0.0 or own_imaginary[j] != 0.0):
                            return False
                    there_real, there_imaginary = direct[source], 0.0
                    for i in range(first):
                        there_real += real[source, i] * over_real[j, i] - imaginary[source, i] * over_imaginary[j, i]
                        there_imaginary += (
                            real[source, i] * over_imaginary[j, i] + imaginary[source, i] * over_real[j, i]
                        )
                    sum_real[first + j] += own_real[j] * there_real - own_imaginary[j] * there_imaginary
                    sum_imaginary[first + j] += own_real[j] * there_imaginary + own_imaginary[j] * there_real
                for i in range(first):
                    there_real, there_imaginary = through, 0.0
                    for j in range(n):
                        there_real -= own_real[j] * over_real[j, i] - own_imaginary[j] * over_imaginary[j, i]
                        there_imaginary -= own_real[j] * over_imaginary[j, i] + own_imaginary[j] * over_real[j, i]
                    sum_real[i] += real[source, i] * there_real - imaginary[source, i] * there_imaginary
                    sum_imaginary[i] += real[source, i] * there_imaginary + imaginary[source, i] * there_real
            direct[port] = sum_direct
    if pole_imaginary[0] != 0.0:
        return False

    reads, shown = wire, wiring.shape[0] - wire
    behind = 3 * sections + shown * poles
    weights, directs, starts = (
        numbers[3 * sections : behind],
        numbers[behind : behind + shown],
        numbers[behind + shown :],
    )
    for output in range(shown):
        directs[output] = direct[wiring[reads + output]]
    decay_real, decay_imaginary, start_real, start_imaginary = rest[11], rest[12], rest[13], rest[14]
    gain_real, gain_imaginary = rest[15 : 15 + shown], rest[15 + shown :]
    for section in range(sections):
        first, n = 2 * section, int(count[section])
        decay_real[1] = decay_imaginary[1] = start_real[1] = start_imaginary[1] = 0.0
        gain_real[:, 1] = 0.0
        gain_imaginary[:, 1] = 0.0
        # Slow first: a chain must not carry what is gone within a period.
        turned = n == 2 and pole_imaginary[first] == 0.0 and abs(pole_real[first + 1]) < abs(pole_real[first])
        for j in range(n):
            k = first + (1 - j if turned else j)
            zr, zi = pole_real[k] * period, pole_imaginary[k] * period
            size = math.exp(zr)
            ar, ai = size * math.cos(zi), size * math.sin(zi)
            square = zr * zr + zi * zi
            if square > 0.25:
                # phi_1 = (exp(z) - 1)/z and phi_2 = (phi_1 - 1)/z
                ur, ui = (ar - 1.0) * zr + ai * zi, ai * zr - (ar - 1.0) * zi
                ur, ui = ur / square, ui / square
                vr, vi = (ur - 1.0) * zr + ui * zi, ui * zr - (ur - 1.0) * zi
                vr, vi = vr / square, vi / square
            else:
                vr, vi = 0.0, 0.0
                for weight in _SERIES:
                    vr, vi = (vr * zr - vi * zi) + weight, vr * zi + vi * zr
                ur, ui = 1.0 + (zr * vr - zi * vi), zr * vi + zi * vr
            if hold == ZERO:
                gr, gi, hr, hi, sr, si = period * ur, period * ui, 0.0, 0.0, 0.0, 0.0
            elif hold == ZERO_BEFORE:
                away = ar * ar + ai * ai
                if away < 1e-200:  # gone within a period: it cannot be carried in this form
                    return False
                hr, hi = period * ur, period * ui
                gr, gi = ar * hr - ai * hi, ar * hi + ai * hr
                sr, si = -ar / away, ai / away
            else:
                away = ur * ur + ui * ui
                if away < 1e-6:  # an undamped mode that turns a whole number of times in a period
                    return False
                wr, wi = ur * ur - ui * ui, 2.0 * ur * ui
                gr, gi, hr, hi = period * wr, period * wi, period * vr, period * vi
                sr, si = -(vr * wr + vi * wi) / (away * away), -(vi * wr - vr * wi) / (away * away)
            decay_real[j], decay_imaginary[j], start_real[j], start_imaginary[j] = ar, ai, sr, si
            for output in range(shown):
                port = wiring[reads + output]
                gain_real[output, j] = real[port, k] * gr - imaginary[port, k] * gi
                gain_imaginary[output, j] = real[port, k] * gi + imaginary[port, k] * gr
                directs[output] += real[port, k] * hr - imaginary[port, k] * hi
        pair = n == 2 and pole_imaginary[first] != 0.0
        apart = decay_imaginary[0] if pair and decay_imaginary[0] != 0.0 else decay_real[1] - decay_real[0]
        starts[first] = start_real[0]
        chain = 3 * section
        if section == 0:
            numbers[0], numbers[1], numbers[2] = decay_real[0], 0.0, decay_real[1]
            starts[1] = start_real[1]
            for output in range(shown):
                weights[output * poles], weights[output * poles + 1] = gain_real[output, 0], gain_real[output, 1]
            continue
        if hold != ZERO and abs(apart) < 1e-9:
            return False  # the chained modes at row 0 divide by it
        if decay_imaginary[0] != 0.0:
            numbers[chain], numbers[chain + 1], numbers[chain + 2] = decay_real[0], -(apart * apart), decay_real[0]
            starts[first + 1] = start_imaginary[0] / apart if hold != ZERO else 0.0
            for output in range(shown):
                weights[output * poles + first] = 2.0 * gain_real[output, 0]
                weights[output * poles + first + 1] = -2.0 * gain_imaginary[output, 0] * apart
        else:
            numbers[chain], numbers[chain + 1], numbers[chain + 2] = decay_real[0], 0.0, decay_real[1]
            starts[first + 1] = (start_real[1] - start_real[0]) / apart if hold != ZERO else 0.0
            for output in range(shown):
                weights[output * poles + first] = gain_real[output, 0] + gain_real[output, 1]
                weights[output * poles + first + 1] = gain_real[output, 1] * apart
    return True
