"""An order that the last bits of equal sizes cannot change."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.fit.fit import Direction
from ipmclab.identification.undetermined.closed_form import sparse
from ipmclab.identification.undetermined.diagnosis import in_order
from ipmclab.ties import largest_first, names_by_size, upright

SEED = 20261121


def test_equals_stay_as_they_stand_whatever_their_last_bits() -> None:
    sizes = np.array([0.2, np.sqrt(0.5), np.sqrt(0.5), 0.9, 0.2])
    generator = np.random.default_rng(SEED)
    for _ in range(20):
        shaken = sizes * (1.0 + 1e-15 * generator.standard_normal(5))
        assert largest_first(shaken) == [3, 1, 2, 0, 4]
    assert largest_first([]) == []
    assert largest_first([0.0, 0.0]) == [0, 1]


def test_names_go_by_size_without_the_sign() -> None:
    assert names_by_size({"b": 0.1, "z": -3.0, "a": 3.0}) == ["z", "a", "b"]


def test_the_first_of_the_largest_is_positive() -> None:
    half = np.sqrt(0.5)
    np.testing.assert_array_equal(upright(np.array([-half, half * (1 + 1e-15)])), [half, -half * (1 + 1e-15)])


@pytest.mark.parametrize("count", [2, 3])
def test_a_sparse_basis_does_not_hang_on_the_basis_it_was_made_of(count: int) -> None:
    generator = np.random.default_rng([SEED, count])
    basis = np.linalg.qr(generator.standard_normal((6, count)))[0].T
    first = sparse(basis)
    for _ in range(5):
        turn = np.linalg.qr(generator.standard_normal((count, count)))[0]
        np.testing.assert_allclose(sparse(turn @ basis), first, atol=1e-12)
    # Each has a parameter that no other has, and together they span the same.
    assert all(np.count_nonzero(np.abs(first[:, k]) > 1e-9) == 1 for k in np.abs(first).max(axis=0).argsort()[-1:])
    assert np.linalg.matrix_rank(np.vstack([first, basis]), tol=1e-9) == count


def test_directions_of_equal_rank_stand_in_the_order_of_their_parameters() -> None:
    """Two parameters alone, and between them a third against a fifth: sizes that differ by a millionth are no order."""
    names = list("abcde")
    generator = np.random.default_rng(SEED)
    found = []
    for away in (0.0, 1e-5, -1e-5):
        rows = np.zeros((3, 5))
        rows[0, 1], rows[1, 3] = 1.0, 1.0
        rows[2, [2, 4]] = [1.0 + away, -1.0 + away]
        rows[:2] += 1e-3 * np.outer([1.0, -1.0], np.ones(5)) * away
        basis = np.linalg.qr(generator.standard_normal((3, 3)))[0] @ np.linalg.qr(rows.T)[0].T
        nothing = [Direction(dict(zip(names, map(float, row), strict=True)), "", np.inf) for row in sparse(basis)]
        little = Direction({"a": 1.0}, "", 0.5)
        found.append([direction.coefficients for direction in in_order([*nothing, little], names)])
    firsts = [[max(row, key=lambda name: round(abs(row[name]), 3)) for row in rows] for rows in found]
    assert firsts == [["b", "c", "d", "a"]] * 3
