"""The compiled loop over six modes whose numbers drift: constant in pieces, with the state of the strip carried on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.kernels import stretch
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
        stretch(voltage, pieces.numbers[piece], begin, end, z, modes, outputs)
