"""Four probes on a sheet, against the printed table, a conductor computed by finite differences, and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from ipmclab import InputError
from ipmclab.model.four_probe import one_face, point_factor, sheet_factor

# Smits, Bell Syst. Tech. J. 37 (1958) 711, table III: rectangles of width d and length a, contacts s apart. The printed
# numbers follow from sums that were cut off early: they differ from the exact ones by up to 0.002.
SMITS = [
    # d/s, a/d = 1, 2, 3, 4
    (1.0, None, None, 0.9988, 0.9994),
    (1.5, None, 1.4788, 1.4893, 1.4893),
    (2.0, None, 1.9454, 1.9475, 1.9475),
    (3.0, 2.4575, 2.7000, 2.7005, 2.7005),
    (5.0, 3.5098, 3.5749, 3.5750, 3.5750),
    (10.0, 4.2209, 4.2357, 4.2357, 4.2357),
    (40.0, 4.5120, 4.5129, 4.5129, 4.5129),
]


@pytest.mark.parametrize(("across", "square", "double", "treble", "long"), SMITS)
def test_the_printed_table(across: float, square: float, double: float, treble: float, long: float) -> None:
    for ratio, printed in zip((1.0, 2.0, 3.0, 4.0), (square, double, treble, long), strict=True):
        if printed is not None:
            assert point_factor(1.0, across, ratio * across) == pytest.approx(printed, abs=2e-3)


def test_an_infinite_sheet_and_an_infinite_strip() -> None:
    assert point_factor(1e-3, 1e4) == pytest.approx(math.pi / math.log(2.0), rel=1e-9)
    assert point_factor(1e-3, 2e-3) == pytest.approx(math.pi / math.log(2.0 * math.cosh(math.pi / 2.0)))
    # Points on a narrow strip are what lines are: R_s = R w/s.
    assert point_factor(10e-3, 1e-3) == pytest.approx(sheet_factor("line", 10e-3, 1e-3), rel=1e-9)


def _conductor(spacing: float, width: float, length: float, cell: float) -> float:
    """V/I [ohm] between the inner two of four points, on a grid of resistors of 1 ohm/sq."""
    rows, columns = round(width / cell), round(length / cell)
    rows += 1 - rows % 2  # a row of nodes along the middle
    number = np.arange(rows * columns).reshape(rows, columns)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    one = np.concatenate([first.ravel() for first, _ in pairs])
    other = np.concatenate([second.ravel() for _, second in pairs])
    ones = np.ones(len(one))
    size = rows * columns
    links = coo_matrix((ones, (one, other)), (size, size))
    matrix = links + links.T
    laplace = coo_matrix((np.asarray(matrix.sum(axis=1)).ravel(), (range(size), range(size))), (size, size)) - matrix
    laplace = laplace.tolil()
    laplace[0, 0] += 1.0  # one node is at 0 V
    at = [number[rows // 2, columns // 2 + round(place * spacing / cell)] for place in (-1.5, -0.5, 0.5, 1.5)]
    current = np.zeros(size)
    current[at[0]], current[at[3]] = 1.0, -1.0
    volts = spsolve(laplace.tocsc(), current)
    return float(volts[at[1]] - volts[at[2]])


@pytest.mark.parametrize(("spacing", "width", "length"), [(4.0, 5.1, 30.1), (4.0, 9.1, 14.1), (2.0, 5.1, 12.1)])
def test_a_conductor_computed_cell_by_cell(spacing: float, width: float, length: float) -> None:
    assert point_factor(spacing, width, length) * _conductor(spacing, width, length, 0.1) == pytest.approx(
        1.0, rel=4e-3
    )


def test_contacts_beside_the_strip() -> None:
    with pytest.raises(InputError, match="four contacts 12 mm apart do not lie on a sheet of 30 mm by 5 mm"):
        point_factor(12e-3, 5e-3, 30e-3)


@pytest.mark.parametrize("transfer", [2.0, 6.0, 20.0, 63.0])
def test_two_faces_as_a_ladder_of_resistors(transfer: float) -> None:
    """Both faces cut into 3000 pieces, with the membrane between them; numbers in mm."""
    count, cell = 3000, 0.01
    along, across = cell, 2.0 * transfer**2 / cell  # r = 1 ohm/mm for each face, 1/g of one piece
    size = 2 * count
    rows, columns, values = [], [], []
    for first, second, ohms in (
        *((k, k + 1, along) for k in range(count - 1)),
        *((count + k, count + k + 1, along) for k in range(count - 1)),
        *((k, count + k, across) for k in range(count)),
    ):
        rows += [first, second, first, second]
        columns += [first, second, second, first]
        values += [1.0 / ohms, 1.0 / ohms, -1.0 / ohms, -1.0 / ohms]
    rows, columns, values = [*rows, 0], [*columns, 0], [*values, 1.0]  # one end is at 0 V
    current = np.zeros(size)
    current[500], current[2500] = 1.0, -1.0  # contacts 20 mm apart on the upper face of 30 mm
    volts = spsolve(coo_matrix((values, (rows, columns)), (size, size)).tocsc(), current)
    read = float(volts[1000] - volts[2000])  # over the inner 10 mm
    assert one_face(10.0, 20.0, 30.0, transfer) == pytest.approx(read / 10.0, rel=2e-3)


def test_a_membrane_that_lets_nothing_through_and_one_that_is_a_short() -> None:
    assert one_face(10e-3, 20e-3, 30e-3, 1e3) == pytest.approx(1.0)
    assert one_face(10e-3, 20e-3, 30e-3, 1e-7) == pytest.approx(0.5)
