"""What a step, a rank or a covariance needs of an evaluation, however few its residuals are."""

from __future__ import annotations

import numpy as np

from ipmclab.identification.problem.problem import Evaluation
from ipmclab.identification.search.solve import entry_errors, minimise, null_directions, polish


class _TwoReadingsOfThree:
    """Two readings: of the first unknown, and of the sum of both others."""

    lower, upper = np.full(3, -9.0), np.full(3, 9.0)

    def evaluate(self, theta: np.ndarray) -> Evaluation:
        jacobian = np.array([[2.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
        return Evaluation(np.vstack([jacobian.T, jacobian @ theta - np.array([2.0, 4.0])]))


def test_with_fewer_readings_than_unknowns_the_readings_are_met_and_the_rest_is_open() -> None:
    problem = _TwoReadingsOfThree()
    begin = np.array([0.5, 1.0, 1.0])
    for found in (polish(problem, begin), minimise(problem, begin)):
        assert found is not None
        np.testing.assert_allclose(found.theta, [1.0, 2.0, 2.0], atol=1e-6)
        assert found.evaluation.triangle.shape == (4, 4)
        np.testing.assert_allclose(np.abs(null_directions(found.evaluation)), [[0.0, 0.5**0.5, 0.5**0.5]], atol=1e-9)
        np.testing.assert_allclose(entry_errors(found.evaluation), [0.5, np.inf, np.inf])
