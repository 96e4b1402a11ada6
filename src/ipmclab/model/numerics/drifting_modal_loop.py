"""The compiled loop over six modes whose numbers drift: constant in pieces, with the state of the strip carried on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.modal_loop import BLOCK

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]


class Pieces(NamedTuple):
    """The modes in each piece of a record.

    Parameters
    ----------
    first : int array, shape (n_pieces + 1,)
        The row with which each begins, and the end.
    numbers : float array, shape (n_pieces, 26)
        As ``modal_loop.modal`` has them, without the last six.
    starts : float array, shape (6,)
        By which the first voltage gives the modes at row 0.
    across : float array, shape (n_pieces, 6, 7)
        What makes the modes of a piece where it begins: of those of the piece before, and of the voltage there.
    """

    first: IndexArray
    numbers: FloatArray
    starts: FloatArray
    across: FloatArray


@kernel
def drifting_modal(voltage: FloatArray, pieces: Pieces, outputs: FloatArray) -> None:
    """As ``modal_loop.modal``, each piece with numbers of its own.

    Parameters
    ----------
    voltage : float array, shape (n_time,) [V]
    pieces : Pieces
    outputs : float array, shape (4, n_time)
        Written: current, applied voltage, displacement, force.
    """
    z, new, modes = np.empty(6), np.empty(6), np.empty((6, BLOCK))
    for i in range(6):
        z[i] = pieces.starts[i] * voltage[0]
    for piece in range(pieces.first.shape[0] - 1):
        begin, end = pieces.first[piece], pieces.first[piece + 1]
        if piece > 0:
            for i in range(6):
                total = pieces.across[piece, i, 6] * voltage[begin]
                for j in range(6):
                    total += pieces.across[piece, i, j] * z[j]
                new[i] = total
            for i in range(6):
                z[i] = new[i]
        _stretch(voltage, pieces.numbers[piece], begin, end, z, modes, outputs)


@kernel
def _stretch(
    voltage: FloatArray,
    numbers: FloatArray,
    first: int,
    last: int,
    z: FloatArray,
    modes: FloatArray,
    outputs: FloatArray,
) -> None:
    """The rows of one piece; z goes on."""
    a1, a2 = numbers[0], numbers[1]
    p2, q2, s2 = numbers[2], numbers[3], numbers[4]
    p3, q3, s3 = numbers[5], numbers[6], numbers[7]
    i1, i2, i0 = numbers[8], numbers[9], numbers[10]
    v1, v2, v0 = numbers[11], numbers[12], numbers[13]
    d1, d2, d3, d4, d5, d6, d0 = (
        numbers[14],
        numbers[15],
        numbers[16],
        numbers[17],
        numbers[18],
        numbers[19],
        numbers[20],
    )
    f1, f2, f3, f4, f0 = numbers[21], numbers[22], numbers[23], numbers[24], numbers[25]
    z1, z2, z3, z4, z5, z6 = z[0], z[1], z[2], z[3], z[4], z[5]
    y1, y2, y3, y4, y5, y6 = modes[0], modes[1], modes[2], modes[3], modes[4], modes[5]
    for begin in range(first, last, BLOCK):
        u = voltage[begin : min(begin + BLOCK, last)]
        rows = u.shape[0]
        for k in range(rows):
            y1[k], y2[k], y3[k], y4[k], y5[k], y6[k] = z1, z2, z3, z4, z5, z6
            z1 = a1 * z1 + u[k]
            z2 = a2 * z2 + u[k]
            z3, z4 = p2 * z3 + (q2 * z4 + u[k]), s2 * z4 + z3
            z5, z6 = p3 * z5 + (q3 * z6 + u[k]), s3 * z6 + z5
        current = outputs[0, begin : begin + rows]
        for k in range(rows):
            current[k] = (i1 * y1[k] + i2 * y2[k]) + i0 * u[k]
        applied = outputs[1, begin : begin + rows]
        for k in range(rows):
            applied[k] = (v1 * y1[k] + v2 * y2[k]) + v0 * u[k]
        displacement = outputs[2, begin : begin + rows]
        for k in range(rows):
            displacement[k] = ((d1 * y1[k] + d2 * y2[k]) + (d3 * y3[k] + d4 * y4[k])) + (
                (d5 * y5[k] + d6 * y6[k]) + d0 * u[k]
            )
        force = outputs[3, begin : begin + rows]
        for k in range(rows):
            force[k] = ((f1 * y1[k] + f2 * y2[k]) + (f3 * y3[k] + f4 * y4[k])) + f0 * u[k]
    z[0], z[1], z[2], z[3], z[4], z[5] = z1, z2, z3, z4, z5, z6
