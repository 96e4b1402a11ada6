"""Which rows are held out together: blocks of time, and the folds that hold them out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.quality.record import Record

FloatArray = npt.NDArray[np.float64]

_SURELY: Final = 4.0  # standard deviations of the noise that count as a movement


@dataclass(frozen=True)
class Block:
    """Consecutive rows of one run, held out in one fold.

    Parameters
    ----------
    run : int
        Place of the run in the call.
    start, stop : int
        Its rows, the last exclusive.
    fold : int
    """

    run: int
    start: int
    stop: int
    fold: int


def time_blocks(records: Sequence[PreparedRun], count: int, folds: int) -> list[Block]:
    """Blocks of every run, held out in turn: block 0 in fold 0, block 1 in fold 1, and so on round.

    What lies on both sides of a held-out block stays with the fit, and no fold loses a whole part of a record.
    """
    found: list[Block] = []
    each = max(2 * folds, -(-count // len(records)))
    for record in records:
        edges = boundaries(record, each)
        for start, stop in pairwise(edges):
            found.append(Block(record.place, start, stop, len(found) % folds))
    return found


def run_blocks(records: Sequence[PreparedRun], count: int, folds: int) -> list[Block]:
    """Whole runs are held out in turn; what is compared between models are still blocks of them."""
    each = max(4, -(-count // len(records)))
    return [
        Block(record.place, start, stop, record.place % folds)
        for record in records
        for edges in [boundaries(record, each)]
        for start, stop in pairwise(edges)
    ]


def boundaries(record: PreparedRun, count: int) -> list[int]:
    """Edges of at most ``count`` blocks that hold equal parts of the readings, their movement and their settling.

    A block's share is the mean of three: the number of its usable readings; how far they move from row to row beyond
    their noise; and the logarithm of the time since the last edge of the voltage. An answer to an edge is a sum of
    exponentials whose time constants may lie anywhere from a row to the whole record: each octave of time says as much
    of it. A block with all of the first seconds would leave nothing from which a fit could know the fast ones.

    Returns
    -------
    edges : list of int
        From 0 to the number of rows; every block has a usable reading.
    """
    rows = len(record.run)
    used = np.any([reading.exact for reading in record.readings.values()], axis=0)
    shares = [used.astype(np.float64), _movement(record, count), _settling(record, used)]
    reached = np.cumsum(np.sum([one / one.sum() for one in shares if one.any()] or [np.ones(rows)], axis=0))
    inner = np.searchsorted(reached, reached[-1] * np.arange(1, count) / count) + 1
    edges = [0]
    held = np.concatenate([[0], np.cumsum(used)])
    for edge in np.unique(inner):
        if held[edge] > held[edges[-1]] and held[-1] > held[edge]:
            edges.append(int(edge))
    return [*edges, rows]


def _movement(record: PreparedRun, count: int) -> FloatArray:
    """How far the readings move from row to row beyond their noise; each output counts alike."""
    moved = np.zeros(len(record.run))
    for reading in record.readings.values():
        own = np.zeros(len(moved))
        places = np.flatnonzero(reading.exact)
        steps = np.abs(np.diff(reading.values[places])) - _SURELY * reading.noise
        own[places[1:]] = np.maximum(steps, 0.0)
        if own.any():
            # One jump is one event, however high: it must not take the movement of a whole record.
            own = np.minimum(own, own.sum() / count)
            moved += own / own.sum()
    return moved


def _settling(record: PreparedRun, used: npt.NDArray[np.bool_]) -> FloatArray:
    """By how much each usable row lengthens the logarithm of the time since the last edge."""
    grown = np.zeros(len(used))
    own = Record.of(record.run)
    for start, stop in zip(own.edges.tolist(), own.ends.tolist(), strict=True):
        grown[start:stop] = 1.0 / np.arange(1, stop - start + 1)
    return grown * used
