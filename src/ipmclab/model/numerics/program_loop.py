"""The compiled loop over the operations of a program (``program.Program``), with derivatives."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.vectors_loop import WIDTH, alike, begin_of, behind, load, plus, store

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

# As in ``terms``; not from there, for a change there would leave the cache of kernels as it is.
ADD, SUBTRACT, MULTIPLY, DIVIDE, _POWER, NEGATE = range(6)


@kernel
def run(
    operations: IndexArray,
    constants: FloatArray,
    places: IndexArray,
    given: FloatArray,
    moved: IndexArray,
    every: FloatArray,
    entries: FloatArray,
    slopes: FloatArray,
) -> None:
    """Do the operations, and write what is asked of them.

    Parameters
    ----------
    operations, constants, places : arrays
        As in ``Program``.
    given : float array, shape (n_parameters,)
    moved : int array, shape (n_columns,)
        The parameter of each column, or a negative number.
    every : float array, shape (n_slots, a multiple of WIDTH)
        Zeros; written: the derivatives of what stands in each slot.
    entries : float array, shape (n_entries,)
        Written.
    slopes : float array, shape (n_entries, as many)
        Written.
    """
    known, width = given.shape[0] + constants.shape[0], slopes.shape[1]
    values = np.empty(known + operations.shape[0])
    for k in range(known):
        values[k] = given[k] if k < given.shape[0] else constants[k - given.shape[0]]
    for column in range(moved.shape[0]):
        if moved[column] >= 0:
            every[moved[column], column] = 1.0
    by, asked = begin_of(every), begin_of(slopes)
    for k in range(operations.shape[0]):
        operation, left, right = operations[k, 0], operations[k, 1], operations[k, 2]
        x, y = values[left], values[right]
        if operation == ADD:
            made, by_x, by_y = x + y, 1.0, 1.0
        elif operation == SUBTRACT:
            made, by_x, by_y = x - y, 1.0, -1.0
        elif operation == MULTIPLY:
            made, by_x, by_y = x * y, y, x
        elif operation == DIVIDE:
            made = x / y
            by_x, by_y = 1.0 / y, -made / y
        elif operation == NEGATE:
            made, by_x, by_y = -x, -1.0, 0.0
        else:  # the exponent is a constant
            made, by_x, by_y = math.pow(x, y), y * math.pow(x, y - 1.0), 0.0
        values[known + k] = made
        one, other, target = behind(by, left * width), behind(by, right * width), behind(by, (known + k) * width)
        for b in range(0, width, WIDTH):
            store(target, b, plus(alike(by_x) * load(one, b), alike(by_y), load(other, b)))
    for k in range(places.shape[0]):
        entries[k] = values[places[k]]
        own = behind(by, places[k] * width)
        for b in range(0, width, WIDTH):
            store(asked, k * width + b, load(own, b))
