"""Normal equations against least squares on the columns themselves, also where they are singular."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.normal_equations import damped_step, pseudo_inverse

SEED = 20261121


def test_columns_that_are_equal_share_what_one_would_have() -> None:
    generator = np.random.default_rng(SEED)
    alike = generator.standard_normal((30, 3))
    columns = alike * [1.0, 1e-6, 1e5]
    readings = generator.standard_normal(30)
    twice = np.column_stack([columns, 7.0 * columns[:, 1]])
    found = pseudo_inverse(twice.T @ twice) @ twice.T @ readings
    expected = np.linalg.lstsq(alike, readings, rcond=None)[0]
    np.testing.assert_allclose(twice @ found, alike @ expected, rtol=1e-9)
    # The shortest answer at columns of length 1: both carry the same part.
    assert found[1] == pytest.approx(7.0 * found[3], rel=1e-6)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e300])
def test_nothing_finite_makes_them_fail(size: float) -> None:
    matrix = np.full((3, 3), size)
    with np.errstate(all="raise", under="ignore"):
        assert np.isfinite(pseudo_inverse(matrix) @ (matrix @ np.ones(3))).all()


def test_a_damped_step_where_rounding_made_an_eigenvalue_negative() -> None:
    matrix = np.array([[1.0, 1.0], [1.0, 1.0 - 1e-15]])
    step = damped_step(matrix, np.array([1.0, 1.0]), 1e-9, np.ones(2))
    np.testing.assert_allclose(step, [0.5, 0.5], rtol=1e-6)
    # Without singularity it is the step of the damped system itself.
    matrix, right, sizes = np.array([[4.0, 1.0], [1.0, 9.0]]), np.array([1.0, -2.0]), np.array([4.0, 9.0])
    expected = np.linalg.solve(matrix + 0.1 * np.diag(sizes), right)
    np.testing.assert_allclose(damped_step(matrix, right, 0.1, sizes), expected, rtol=1e-12)
