"""Derivatives of what a system does over intervals, laid out for the loop that carries them (``tangents_loop``)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.vectors_loop import WIDTH, alike, begin_of, behind, load, on_lines, plus, store

FloatArray = npt.NDArray[np.float64]

FOUR: Final = 4  # rows that are worked out at once


class Matrices(NamedTuple):
    """What a system does over intervals, and what is read of it.

    Parameters
    ----------
    step : float array, shape (n_kinds, n, 2 + n + 2 n_laws)
        Of ``transitions_loop.transitions``.
    outputs : float array, shape (n_outputs, 1 + n + n_laws)
        What is read of voltage, state and laws.
    ports : float array, shape (n_laws, 1 + n + n_laws)
        The voltages that the laws read.
    """

    step: FloatArray
    outputs: FloatArray
    ports: FloatArray


class Moved(NamedTuple):
    """Derivatives of what a system does, each sixteen columns by themselves.

    Of an interval of each kind there are four rows side by side: next states, then what the laws read but for w.

    Parameters
    ----------
    forced : float array, shape (n_kinds, width / WIDTH, n_fours, 2 + n + 2 n_laws, 4, WIDTH)
        What the trace adds to their derivatives.
    carried : float array, shape (n_kinds, n_fours, n + n_laws, 4)
        What the derivatives of state and laws as it begins add.
    drop : float array, shape (n_kinds + 1, n_laws, n_laws) [ohm]
        By how much w at the end lowers p there; in the last place within an instant.
    outputs : float array, shape (width / WIDTH, n_outputs, 1 + n + n_laws, WIDTH)
    ports : float array, shape (width / WIDTH, n_laws, 1 + n + n_laws, WIDTH)
    coefficients : float array, shape (width / WIDTH, n_laws, 3, WIDTH)
    """

    forced: FloatArray
    carried: FloatArray
    drop: FloatArray
    outputs: FloatArray
    ports: FloatArray
    coefficients: FloatArray


def moved_for(kinds: int, states: int, outputs: int, laws: int, width: int) -> Moved:
    """Room for derivatives: zeros."""
    fours, slabs, given = -(-(states + laws) // FOUR), width // WIDTH, states + laws
    return Moved(
        *on_lines(
            (kinds, slabs, fours, 2 + given + laws, FOUR, WIDTH),
            (kinds, fours, given, FOUR),
            (kinds + 1, laws, laws),
            (slabs, outputs, 1 + given, WIDTH),
            (slabs, laws, 1 + given, WIDTH),
            (slabs, laws, 3, WIDTH),
        )
    )


@part
def _apart(matrices: FloatArray, slabs: FloatArray) -> None:
    """Columns of matrices, sixteen by themselves."""
    given, put = begin_of(matrices), begin_of(slabs)
    width, entries = matrices.shape[2], matrices.shape[0] * matrices.shape[1]
    for b in range(0, width, WIDTH):
        for e in range(entries):
            store(put, (b // WIDTH * entries + e) * WIDTH, load(given, e * width + b))


@kernel
def lay_out(at: Matrices, by: Matrices, by_coefficients: FloatArray, moved: Moved) -> None:
    """Put derivatives where ``carry_tangents`` finds them.

    Parameters
    ----------
    at : Matrices
    by : Matrices
        Their derivatives, with an axis of columns behind the others, filled up to whole vectors.
    by_coefficients : float array, shape (n_laws, 3, width)
    moved : Moved
        Of ``moved_for``; written.
    """
    kinds, n, count = at.step.shape
    m, width = at.ports.shape[0], by.ports.shape[2]
    fours, ends, noted = moved.carried.shape[1], 2 + n + m, 1 + n + m
    by_step, by_ports, forced = begin_of(by.step), begin_of(by.ports), begin_of(moved.forced)
    _apart(by.outputs, moved.outputs)
    _apart(by.ports, moved.ports)
    _apart(by_coefficients, moved.coefficients)
    for l in range(m):  # noqa: E741
        for j in range(m):
            moved.drop[kinds, l, j] = -at.ports[l, 1 + n + j]
    for kind in range(kinds):
        for row in range(n + m):
            four, place, l = row // FOUR, row % FOUR, row - n  # noqa: E741
            for c in range(n + m):
                total = 0.0
                if l < 0:
                    total = at.step[kind, row, 2 + c]
                else:
                    for i in range(n):
                        total += at.ports[l, 1 + i] * at.step[kind, i, 2 + c]
                moved.carried[kind, four, c, place] = total
            for j in range(m if l >= 0 else 0):
                total = at.ports[l, 1 + n + j]
                for i in range(n):
                    total += at.ports[l, 1 + i] * at.step[kind, i, ends + j]
                moved.drop[kind, l, j] = -total
            for b in range(0, width, WIDTH):
                target = behind(forced, ((kind * width + b) * fours + four * WIDTH) * count * FOUR + place * WIDTH)
                own = behind(by_ports, max(l, 0) * noted * width + b)
                for e in range(count):
                    total = alike(0.0)
                    if l < 0:
                        total = load(by_step, ((kind * n + row) * count + e) * width + b)
                    elif e < 2:  # of the voltage at the end, of the state there, and of the laws
                        total = load(own, 0)
                    elif e >= ends:
                        total = load(own, (1 + n + e - ends) * width)
                    if l >= 0:
                        for i in range(n):
                            total = plus(total, alike(at.step[kind, i, e]), load(own, (1 + i) * width))
                            there = load(by_step, ((kind * n + i) * count + e) * width + b)
                            total = plus(total, alike(at.ports[l, 1 + i]), there)
                    store(target, e * FOUR * WIDTH, total)
