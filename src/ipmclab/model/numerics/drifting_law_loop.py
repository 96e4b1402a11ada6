"""The compiled loop over the modes of a strip with one static law at the node, whose parameters drift in pieces.

Each piece is rows of ``law_modal_loop``. Between two of them the strip goes on, and its modes are new: what a mode is
of the charges, of the coupling and of the beam changes with the parameters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment.path import Panel
from ipmclab.model.environment.track_loop import Track, expect, go_on, look, no_lines, numbers_there, stay
from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.kernels import multiply
from ipmclab.model.numerics.law_modal_loop import BLOCK, law_stretch
from ipmclab.model.numerics.law_near_loop import follow

FloatArray = npt.NDArray[np.float64]

NUMBERS = 88
"""Numbers of one state: circuit (8), mechanical (16), weights (28), and what each state is of the modes (36)."""

_OF_MODES = 52

_LONG = 8
"""Rows of a piece in which one more makes little difference."""


class Driven(NamedTuple):
    """What does not drift.

    Parameters
    ----------
    voltage : float array, shape (n_time,) [V]
    begin, period : float [s]
    jumps, form : int
    k : float array, shape (3,)
        These three as for ``law_modal_loop.law_modal``.
    area : float [m^2]
        Through which the law leaks.
    """

    voltage: FloatArray
    begin: float
    period: float
    jumps: int
    form: int
    k: FloatArray
    area: float


class Knots(NamedTuple):
    """The numbers of a strip at the states of a panel.

    Parameters
    ----------
    modes : float array, shape (n_states, NUMBERS)
    step : float array, shape (n_states, n (n + 2)) or (n_states, 0)
        Of a motion that is richer than that of the modes, its matrix flattened; it has n charges.
    read : float array, shape (n_states, 2 (n + 1)) or (n_states, 0)
        Displacement and force of it, likewise.
    """

    modes: FloatArray
    step: FloatArray
    read: FloatArray

    @property
    def charges(self) -> int:
        """How many charges a richer motion has; 0 where there is none."""
        return max(0, int(self.read.shape[1]) // 2 - 1)


class March(NamedTuple):
    """What goes along from row to row.

    Parameters
    ----------
    state : float array, shape (STATE,)
        Of ``law_modal_loop.law_stretch``.
    numbers : float array, shape (2, NUMBERS)
        Of the piece, and of the one before.
    walk : float array, shape (WALK,)
        Where the water is.
    moving : float array, shape (n,)
        Charges of a richer motion.
    """

    state: FloatArray
    numbers: FloatArray
    walk: FloatArray
    moving: FloatArray


@kernel
def drifting_law(
    driven: Driven,
    track: Track,
    panel: Panel,
    knots: Knots,
    first: int,
    march: March,
    course: FloatArray,
    outputs: FloatArray,
    fronts: FloatArray,
) -> int:
    """Write the outputs from a row on, as far as a panel reaches.

    Parameters
    ----------
    knots : Knots
    first : int
        The row.
    march : March
        Written.
    course : float array, shape (4, n)
        The water's (``track_loop.set_out``); written.
    outputs : float array, shape (4, n_time)
        Written.
    fronts : float array, shape (3, n_time) or (3, 0)
        As for ``law_modal_loop.law_modal``.

    Returns
    -------
    row : int
        Up to which all is written; the next one needs another panel unless it is the end.
    """
    voltage, walk, count, state = driven.voltage, march.walk, driven.voltage.shape[0], march.state
    numbers, before = march.numbers[0], march.numbers[1]
    circuit, mechanical, weights = numbers[:8], numbers[8:24].reshape(2, 8), numbers[24:52].reshape(4, 7)
    store, n, of_time = np.empty((11, BLOCK)), march.moving.shape[0], driven.period / driven.area
    step, read, new = np.empty((1, n, n + 2)), np.empty((2, n + 1)), np.empty(n)
    lines, steps, reads = no_lines(1, NUMBERS), no_lines(1, step.size), no_lines(1, read.size)
    row = first
    while row < count:
        last = _rows_to(driven, row, stay(track, panel, walk))
        if not look(track, panel, walk, driven.begin + 0.5 * (row + last) * driven.period):
            return row
        before[:] = numbers
        numbers_there(panel, knots.modes, walk, lines, 0, numbers)
        if row > 0:
            _cross(driven, before, numbers, state)
        expected, room = expect(track, panel, walk)
        last, lost, flowed = law_stretch(
            *(voltage, row, last, driven.jumps, circuit, mechanical, weights, driven.form, driven.k),
            *(state, store, expected * driven.area, room / of_time, outputs, fronts),
        )
        if n > 0:
            numbers_there(panel, knots.step, walk, steps, 0, step.reshape(-1))
            numbers_there(panel, knots.read, walk, reads, 0, read.reshape(-1))
            _move(step, read, fronts, row, last, march.moving, new, outputs)
        go_on(track, walk, driven.begin + last * driven.period, lost * of_time, flowed * of_time, course)
        row = last
    return row


@kernel
def _move(
    step: FloatArray,
    read: FloatArray,
    fronts: FloatArray,
    first: int,
    last: int,
    charges: FloatArray,
    new: FloatArray,
    outputs: FloatArray,
) -> None:
    """Displacement and force of a richer motion at some rows; the charges are those of the row before, and go on."""
    n = charges.shape[0]
    from_here = np.empty(n + 2)
    for row in range(first, last):
        if row > 0:
            from_here[0], from_here[1] = fronts[0, row], fronts[1, row] - fronts[0, row]
            from_here[2:] = charges
            multiply(step, 0, from_here, new)
            charges[:] = new
        for output in range(2):
            total = read[output, 0] * fronts[2, row]
            for j in range(n):
                total += read[output, 1 + j] * charges[j]
            outputs[2 + output, row] = total


@kernel
def _rows_to(driven: Driven, row: int, length: float) -> int:
    """The row after the last of a piece that begins with a row and should not be longer [s].

    A long piece has one row more, so that it ends behind the time of the water that it was made for.
    """
    left, most = driven.voltage.shape[0] - row, length / driven.period + 1e-6
    rows: int = left
    if most < left:
        rows = min(left, max(1, int(most) + (1 if most >= _LONG else 0)))
    return row + rows


@kernel
def _cross(driven: Driven, before: FloatArray, numbers: FloatArray, state: FloatArray) -> None:
    """The modes of a piece from those of the piece before, where no charge can jump.

    The circuit's modes are those of this row, the others those of the row before, where the circuit's were y.
    """
    old, new = before[_OF_MODES:].reshape(6, 6), numbers[_OF_MODES:].reshape(6, 6)
    x1, x2 = state[0] + before[2] * state[9], state[1] + before[5] * state[9]
    y1, y2 = state[25], state[26]
    z3, z4, z5, z6 = state[2], state[3], state[4], state[5]
    c1, c2 = _solved(new, 0, old[0, 0] * x1 + old[0, 1] * x2, old[1, 0] * x1 + old[1, 1] * x2)
    n1, n2 = _solved(new, 0, old[0, 0] * y1 + old[0, 1] * y2, old[1, 0] * y1 + old[1, 1] * y2)
    s3 = old[2, 0] * y1 + old[2, 1] * y2 + old[2, 2] * z3 + old[2, 3] * z4 - new[2, 0] * n1 - new[2, 1] * n2
    s4 = old[3, 0] * y1 + old[3, 1] * y2 + old[3, 2] * z3 + old[3, 3] * z4 - new[3, 0] * n1 - new[3, 1] * n2
    n3, n4 = _solved(new, 2, s3, s4)
    s5 = old[4, 0] * y1 + old[4, 1] * y2 + old[4, 2] * z3 + old[4, 3] * z4 + old[4, 4] * z5 + old[4, 5] * z6
    s6 = old[5, 0] * y1 + old[5, 1] * y2 + old[5, 2] * z3 + old[5, 3] * z4 + old[5, 4] * z5 + old[5, 5] * z6
    s5 -= new[4, 0] * n1 + new[4, 1] * n2 + new[4, 2] * n3 + new[4, 3] * n4
    s6 -= new[5, 0] * n1 + new[5, 1] * n2 + new[5, 2] * n3 + new[5, 3] * n4
    state[2], state[3] = n3, n4
    state[4], state[5] = _solved(new, 4, s5, s6)
    # Behind the new resistances the same voltage u leaks anew.
    u, series, v1, v2, v0 = state[6], numbers[6], numbers[31], numbers[32], numbers[7]
    k, r = driven.k, v1 * c1 + v2 * c2 + v0 * u
    p, w = follow(driven.form, k[0], k[1], k[2], 1.0 / k[2], series * v0, r, state[12])
    e = u - series * w
    state[0], state[1] = c1 - numbers[2] * e, c2 - numbers[5] * e
    state[7], state[9], state[10], state[11], state[12] = e, e, 0.0, w, p
    state[25], state[26] = n1, n2


@kernel
def _solved(of_modes: FloatArray, place: int, first: float, second: float) -> tuple[float, float]:
    """The two modes of a section from its two states."""
    a, b = of_modes[place, place], of_modes[place, place + 1]
    c, d = of_modes[place + 1, place], of_modes[place + 1, place + 1]
    scale = 1.0 / (a * d - b * c)
    return (d * first - b * second) * scale, (a * second - c * first) * scale
