"""A linear block with named states and ports: what a stage is for one parameter vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

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
    """A block from nested lists; its matrices are float, or complex where an entry is."""
    n, m, p = len(states), len(inputs), len(outputs)
    return Block(
        tuple(states),
        tuple(inputs),
        tuple(outputs),
        np.array(a).reshape(n, n),
        np.array(b).reshape(n, m),
        np.array(c).reshape(p, n),
        np.array(d).reshape(p, m),
    )
