"""A linear block with named states and ports: what a stage is for one parameter vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.model.terms import is_zero

Matrix = npt.NDArray[Any]
"""A float or, while a derivative is taken, complex matrix."""


@dataclass(frozen=True, eq=False)
class Block:
    """``x' = a x + b u``, ``y = c x + d u``, in SI units.

    Parameters
    ----------
    states, inputs, outputs : tuple of str
        Dotted names of the states; names of the ports.
    a, b, c, d : matrix
        Shapes (n_states, n_states), (n_states, n_inputs), (n_outputs, n_states), (n_outputs, n_inputs).
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix

    def giving(self, rows: Sequence[int]) -> Block:
        """The same with some of its outputs, and without the inputs that then do nothing."""
        used = [k for k in range(len(self.inputs)) if np.any(self.b[:, k]) or np.any(self.d[rows, k])]
        return Block(
            self.states,
            tuple(self.inputs[k] for k in used),
            tuple(self.outputs[k] for k in rows),
            self.a,
            self.b[:, used],
            self.c[rows],
            self.d[np.ix_(rows, used)],
        )


@dataclass(frozen=True)
class Law:
    """A static, odd and monotone law between two ports: the current that leaks at a voltage.

    Parameters
    ----------
    voltage, current : str
        The port that it reads, and the port that it drives.
    form : int
        Place of its form in ``leak.FORMS``.
    coefficients : tuple of three numbers
        What the form needs, in its order, the area included [A and V].
    """

    voltage: str
    current: str
    form: int
    coefficients: tuple[complex, complex, complex]


def block(
    *,
    states: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
    a: Sequence[Sequence[complex]],
    b: Sequence[Sequence[complex]],
    c: Sequence[Sequence[complex]],
    d: Sequence[Sequence[complex]],
) -> Block:
    """A block from nested lists; its matrices are float, or complex where an entry is.

    Entries may be arrays with one value for each of many parameter sets: the matrices then have that axis first.
    """
    n, m, p = len(states), len(inputs), len(outputs)
    return Block(
        tuple(states),
        tuple(inputs),
        tuple(outputs),
        _matrix(a, n, n),
        _matrix(b, n, m),
        _matrix(c, p, n),
        _matrix(d, p, m),
    )


def _matrix(rows: Sequence[Sequence[Any]], height: int, width: int) -> Matrix:
    entries = [entry for row in rows for entry in row]
    try:
        flat = np.array(entries)
    except ValueError:  # numbers with arrays
        flat = np.empty((0, 0))
    if flat.ndim == 1:
        return flat.reshape(height, width)
    return np.stack(np.broadcast_arrays(*entries), axis=-1).reshape(-1, height, width)


def solve(matrix: Matrix, right: Matrix) -> Matrix:
    """What solves ``matrix x = right``, of numbers or of terms.

    Of terms, by elimination in the order of the rows: what belongs on the diagonal must stand there.
    """
    if matrix.dtype != object:
        return np.linalg.solve(matrix, right)
    left, found = matrix.copy(), right.astype(object)
    every = range(len(left))
    for i in every:
        for j in every:
            factor = left[j, i] / left[i, i]
            if j != i and not is_zero(factor):
                left[j] = left[j] - left[i] * factor
                found[j] = found[j] - found[i] * factor
    solved: Matrix = found / np.diagonal(left)[:, None]
    return solved


def standing_in(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """The blocks, those that read a port which they write too put in the way of it.

    What drove the port before then drives the block, and all others read what the block makes of it.

    Examples
    --------
    >>> twice = dict(outputs=["y"], states=[], a=[], b=[], c=[], d=[[2.0]])
    >>> first, second = standing_in([block(inputs=["u"], **twice), block(inputs=["y"], **twice)])
    >>> first.outputs == second.inputs, second.outputs
    (True, ('y',))
    """
    found = list(blocks)
    for place, own in enumerate(blocks):
        for port in set(own.inputs) & set(own.outputs):
            before = f"{port} before {place}"
            for other in range(place):
                outputs = tuple(before if one == port else one for one in found[other].outputs)
                found[other] = replace(found[other], outputs=outputs)
            inputs = tuple(before if one == port else one for one in found[place].inputs)
            found[place] = replace(found[place], inputs=inputs)
    return tuple(found)
