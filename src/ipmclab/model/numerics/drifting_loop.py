"""The compiled loop over samples of a system whose parameters drift, with or without static laws at ports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.dense_laws_loop import AtLaws, LawTable, begin, see, was_seen, write
from ipmclab.model.numerics.kernels import multiply
from ipmclab.model.numerics.law_loop import solve_several

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]


class Knots(NamedTuple):
    """The system at some stations of the way, between two of which its numbers go in straight lines.

    Each as in ``dense_laws_loop``, with one axis more in front: ``step`` (n_knots, n_kinds, n, 2 n_inputs + n +
    n_laws), ``law_end`` (n_knots, n_kinds, n, n_laws), ``drop`` (n_knots, n_kinds + 1, n_laws, n_laws), ``outputs``
    (n_knots, n_outputs, n_inputs + n + n_laws), ``ports`` (n_knots, n_laws, n_inputs + n).
    """

    step: FloatArray
    law_end: FloatArray
    drop: FloatArray
    outputs: FloatArray
    ports: FloatArray


class Way(NamedTuple):
    """Where each interval is.

    Parameters
    ----------
    piece : int array, shape (n_intervals,)
        The piece that it is in.
    knot : int array, shape (n_pieces,)
        The station at which, or after which, each piece is.
    share : float array, shape (n_pieces,)
        How far it is on the way to the next one: 0 to below 1.
    """

    piece: IndexArray
    knot: IndexArray
    share: FloatArray


@kernel
def _blend(knots: FloatArray, knot: int, share: float, result: FloatArray) -> None:
    after = knot if share == 0.0 else knot + 1
    for i in range(result.shape[0]):
        for j in range(result.shape[1]):
            result[i, j] = (1.0 - share) * knots[knot, i, j] + share * knots[after, i, j]


@kernel
def drifting(
    knots: Knots, way: Way, table: LawTable, course: Course, x: FloatArray, outputs: FloatArray, leaked: FloatArray
) -> int:
    """As ``dense_laws_loop.dense_laws``, each interval with the parameters of its place on the way.

    Parameters
    ----------
    x : float array, shape (n,)
        A state that goes on where parameters change: charges, not voltages, where capacitances do.
    leaked : float array, shape (n_intervals,)
        Written: what all laws together give at the end of each interval [A].

    Returns
    -------
    failed : int
        -1, or the interval in which no solution was found (only where numbers overflow).
    """
    interval, start, end, row, reading = course
    forms, coefficients = table
    n, m, given = x.shape[0], forms.shape[0], start.shape[1]
    step = np.empty((1, n, knots.step.shape[3]))
    read = np.empty((knots.outputs.shape[1], knots.outputs.shape[2]))
    law_end, ports = np.empty((n, m)), np.empty((m, given + n))
    drop, within = np.empty((m, m)), np.empty((m, m))
    now = AtLaws(np.empty(m), np.zeros(m), np.zeros(m), np.full(given, np.nan))
    base, from_here = np.empty(n), np.empty(2 * given + n + m)
    piece = kind = -1
    last = knots.drop.shape[1] - 1
    for i in range(row.shape[0]):
        here = min(i, interval.shape[0] - 1)
        if way.piece[here] != piece or interval[here] != kind:
            kind = interval[here]
            knot, share = way.knot[way.piece[here]], way.share[way.piece[here]]
            _blend(knots.step[:, kind], knot, share, step[0])
            _blend(knots.law_end[:, kind], knot, share, law_end)
            _blend(knots.drop[:, kind], knot, share, drop)
            if way.piece[here] != piece:
                piece = way.piece[here]
                _blend(knots.outputs, knot, share, read)
                _blend(knots.ports, knot, share, ports)
                _blend(knots.drop[:, last], knot, share, within)
        k = row[i]
        if k >= 0:
            if m > 0 and not was_seen(reading, k, now):
                see(ports, reading, k, x, now)
                if not solve_several(forms, coefficients, within, now.r, now.p, now.w):
                    return i
            write(read, reading, k, x, now.w, outputs)
        if i == interval.shape[0]:
            break
        if m > 0 and not was_seen(start, i, now):
            see(ports, start, i, x, now)
            if not solve_several(forms, coefficients, within, now.r, now.p, now.w):
                return i
        begin(start, end, i, x, now.w, from_here)
        multiply(step, 0, from_here, base)
        if m > 0:
            see(ports, end, i, base, now)
            if not solve_several(forms, coefficients, drop, now.r, now.p, now.w):
                return i
        leaked[i] = 0.0
        for l in range(m):  # noqa: E741
            leaked[i] += now.w[l]
        for j in range(n):
            total = base[j]
            for l in range(m):  # noqa: E741
                total += law_end[j, l] * now.w[l]
            x[j] = total
    return -1
