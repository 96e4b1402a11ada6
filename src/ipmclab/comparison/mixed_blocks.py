"""The readings of a mixed model in blocks: runs that share a group with each other and with no others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Block:
    """Readings, design and groups in the space of the groups, and sums of what is orthogonal to it."""

    y: FloatArray
    x: FloatArray
    inside: list[FloatArray]
    xx: FloatArray
    xy: FloatArray
    yy: float


def rotated(y: FloatArray, x: FloatArray, groups: list[FloatArray]) -> Block:
    if groups:
        indicators = np.hstack([z[:, z.any(axis=0)] for z in groups])
        q, r, _ = qr(indicators, mode="economic", pivoting=True)
        diagonal = np.abs(np.diag(r))
        q = q[:, : len(diagonal)][:, diagonal > 1e-9 * diagonal[0]]
    else:
        q = np.zeros((len(y), 0))
    y1, x1 = q.T @ y, q.T @ x
    y2, x2 = y - q @ y1, x - q @ x1
    return Block(y1, x1, [q.T @ z for z in groups], x2.T @ x2, x2.T @ y2, float(y2 @ y2))


def blocks_of(count: int, groups: list[FloatArray]) -> list[npt.NDArray[np.intp]]:
    """The rows that share groups, directly or by way of others."""
    if not groups:
        return [np.arange(count)]
    shared = csr_array(np.hstack(groups))
    label = connected_components(shared @ shared.T, directed=False)[1]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def padded(part: FloatArray, rows: int) -> FloatArray:
    return np.vstack([part, np.zeros((rows - len(part), part.shape[1]))])


def turned(blocks: FloatArray) -> FloatArray:
    return np.swapaxes(blocks, -1, -2)
