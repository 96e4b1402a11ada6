"""Poles and eigenvectors of cascades, stage by stage."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ipmclab.model.numerics.eigenvectors import eigenvectors

ENTRY = st.floats(-4.0, 4.0).filter(lambda value: abs(value) > 1e-3)


@given(sizes=st.lists(st.integers(1, 3), min_size=1, max_size=4), draw=st.data())
def test_they_make_the_matrix_again(sizes: list[int], draw: st.DataObject) -> None:
    """Of stages whose poles are decades apart."""
    n, ends = sum(sizes), np.cumsum(sizes).tolist()
    matrix = np.zeros((n, n))
    for stage, (end, size) in enumerate(zip(ends, sizes, strict=True)):
        rows = draw.draw(st.lists(ENTRY, min_size=size * end, max_size=size * end))
        matrix[end - size : end, :end] = np.reshape(rows, (size, end))
        matrix[end - size : end, end - size : end] *= 10.0 ** (2 * stage)
    found = eigenvectors(matrix)
    assume(found is not None and np.linalg.cond(found.right) < 1e3)
    assert found is not None
    left = np.linalg.norm(matrix, axis=1)[:, None]
    assert np.all(np.abs((found.right * found.poles) @ found.left - matrix) <= 1e-9 * left)
    np.testing.assert_allclose(found.left @ found.right, np.eye(n), atol=1e-9)


@pytest.mark.parametrize("slow", [1e-3, 1e-9, 1e-13, 1e-30])
@pytest.mark.parametrize("fast", [1e-2, 3.0, 1e6])
def test_the_slow_pole_of_two_has_all_its_digits(slow: float, fast: float) -> None:
    """As of a coupling: the eigenvalues of the matrix as a whole are known to rounding of the fast one."""
    found = eigenvectors(np.array([[0.0, 1.0], [-slow * fast, -(slow + fast)]]))
    assert found is not None
    np.testing.assert_allclose(np.sort(-found.poles.real), np.sort([slow, fast]), rtol=1e-14)
    assert np.all(found.rounding <= 1e-14 * np.abs(found.poles))
    np.testing.assert_allclose(found.right[1] / found.right[0], found.poles, rtol=1e-14)


def test_two_that_swing() -> None:
    """Poles of x'' = -(2 pi)^2 x - 2 x', from the textbook: -1 and a pair of frequencies about it."""
    found = eigenvectors(np.array([[0.0, 1.0], [-((2.0 * np.pi) ** 2), -2.0]]))
    assert found is not None
    swing = np.sqrt((2.0 * np.pi) ** 2 - 1.0)
    np.testing.assert_allclose(sorted(found.poles, key=lambda pole: pole.imag), [-1 - 1j * swing, -1 + 1j * swing])


def test_where_poles_meet_there_are_none() -> None:
    """A double pole has one eigenvector, in one stage and of two."""
    assert eigenvectors(np.array([[0.0, 1.0], [-4.0, -4.0]])) is None
    assert eigenvectors(np.array([[-1.0, 0.0], [1.0, -1.0]])) is None
