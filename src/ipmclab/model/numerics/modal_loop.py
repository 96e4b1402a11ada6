"""The modal loop as plain Python, which ``kernels`` compiles.

It stands alone so that a process that simulates one record need not load a compiler first.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

BLOCK: Final = 256
"""Rows whose modes are worked out before their outputs: 12 kB, which stay in the fastest cache."""


def modal(voltage: FloatArray, coefficients: FloatArray, outputs: FloatArray) -> None:
    """Six modes in three sections, from rest.

    Section 1 is two real modes side by side, ``z+ = a z + u``. Sections 2 and 3 are chained pairs,
    ``z3+ = p z3 + q z4 + u``, ``z4+ = z3 + s z4``: two real modes (q = 0) or a complex pair
    (p = s, q < 0) at the same cost. Current and applied voltage read section 1, force sections 1
    and 2, displacement all three.

    A mode needs the row before, an output does not: for a block of rows first the modes go row by row, then
    each output goes over the block in a loop of its own, which a compiler turns into operations on several rows
    at once. Each number is computed as the formula says, whichever way: compiled or not, the digits are the same.

    Parameters
    ----------
    voltage : float array, shape (n_time,) [V]
    coefficients : float array, shape (32,)
        In this order: a1, a2; p, q, s of section 2; p, q, s of section 3; weights and direct term
        of current (3), applied voltage (3), displacement (7) and force (5); the factors by
        which the first voltage gives the six modes at row 0.
    outputs : float array, shape (4, n_time)
        Written: current, applied voltage, displacement, force.
    """
    stretch(voltage, coefficients, 0, voltage.shape[0], coefficients[26:] * voltage[0], np.empty((6, BLOCK)), outputs)


def stretch(
    voltage: FloatArray,
    numbers: FloatArray,
    begin: int,
    end: int,
    z: FloatArray,
    modes: FloatArray,
    outputs: FloatArray,
) -> None:
    """Some rows of ``modal``.

    Parameters
    ----------
    voltage, outputs : float arrays
        As of ``modal``.
    numbers : float array, shape (26,) or more
        As ``coefficients`` of ``modal``, of which the last are not read.
    begin, end : int
        Which rows.
    z : float array, shape (6,)
        The modes at the first of them; on return those at the row behind the last.
    modes : float array, shape (6, BLOCK)
        Written on.
    """
    a1, a2 = numbers[0], numbers[1]
    p2, q2, s2 = numbers[2], numbers[3], numbers[4]
    p3, q3, s3 = numbers[5], numbers[6], numbers[7]
    i1, i2, i0 = numbers[8], numbers[9], numbers[10]
    v1, v2, v0 = numbers[11], numbers[12], numbers[13]
    d1, d2, d3, d4 = numbers[14], numbers[15], numbers[16], numbers[17]
    d5, d6, d0 = numbers[18], numbers[19], numbers[20]
    f1, f2, f3, f4, f0 = numbers[21], numbers[22], numbers[23], numbers[24], numbers[25]
    z1, z2, z3, z4, z5, z6 = z[0], z[1], z[2], z[3], z[4], z[5]
    y1, y2, y3, y4, y5, y6 = modes[0], modes[1], modes[2], modes[3], modes[4], modes[5]
    for first in range(begin, end, BLOCK):
        u = voltage[first : min(first + BLOCK, end)]
        rows = u.shape[0]
        for k in range(rows):
            y1[k], y2[k], y3[k], y4[k], y5[k], y6[k] = z1, z2, z3, z4, z5, z6
            z1 = a1 * z1 + u[k]
            z2 = a2 * z2 + u[k]
            z3, z4 = p2 * z3 + (q2 * z4 + u[k]), s2 * z4 + z3
            z5, z6 = p3 * z5 + (q3 * z6 + u[k]), s3 * z6 + z5
        current = outputs[0, first : first + rows]
        for k in range(rows):
            current[k] = (i1 * y1[k] + i2 * y2[k]) + i0 * u[k]
        applied = outputs[1, first : first + rows]
        for k in range(rows):
            applied[k] = (v1 * y1[k] + v2 * y2[k]) + v0 * u[k]
        displacement = outputs[2, first : first + rows]
        for k in range(rows):
            displacement[k] = ((d1 * y1[k] + d2 * y2[k]) + (d3 * y3[k] + d4 * y4[k])) + (
                (d5 * y5[k] + d6 * y6[k]) + d0 * u[k]
            )
        force = outputs[3, first : first + rows]
        for k in range(rows):
            force[k] = ((f1 * y1[k] + f2 * y2[k]) + (f3 * y3[k] + f4 * y4[k])) + f0 * u[k]
    z[0], z[1], z[2], z[3], z[4], z[5] = z1, z2, z3, z4, z5, z6


def modal_sections(voltage: FloatArray, numbers: FloatArray, sections: int, outputs: FloatArray) -> None:
    """Any number of sections of two modes each, from rest; every output may read every mode.

    The first section is two real modes side by side, the others are chained pairs, as in ``modal``.

    Parameters
    ----------
    voltage : float array, shape (n_time,) [V]
    numbers : float array, shape (13 sections + 4,)
        As ``cascade_loop.cascade`` writes them.
    sections : int
    outputs : float array, shape (4, n_time)
        Written: current, applied voltage, displacement, force.
    """
    count = 2 * sections
    direct = 3 * sections + 4 * count
    state = numbers[direct + 4 : direct + 4 + count] * voltage[0]
    modes = np.empty((count, BLOCK))
    for begin in range(0, voltage.shape[0], BLOCK):
        u = voltage[begin : begin + BLOCK]
        for section in range(sections):
            p, q, s = numbers[3 * section], numbers[3 * section + 1], numbers[3 * section + 2]
            one, other = modes[2 * section], modes[2 * section + 1]
            z1, z2 = state[2 * section], state[2 * section + 1]
            if section == 0:
                for k in range(u.shape[0]):
                    one[k], other[k] = z1, z2
                    z1 = p * z1 + u[k]
                    z2 = s * z2 + u[k]
            else:
                for k in range(u.shape[0]):
                    one[k], other[k] = z1, z2
                    z1, z2 = p * z1 + (q * z2 + u[k]), s * z2 + z1
            state[2 * section], state[2 * section + 1] = z1, z2
        for output in range(4):
            written = outputs[output, begin : begin + BLOCK]
            through = numbers[direct + output]
            for k in range(u.shape[0]):
                written[k] = through * u[k]
            for mode in range(count):
                weight = numbers[3 * sections + output * count + mode]
                if weight != 0.0:
                    own = modes[mode]
                    for k in range(u.shape[0]):
                        written[k] += weight * own[k]
