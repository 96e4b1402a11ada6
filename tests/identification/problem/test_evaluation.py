"""What a step, a rank or a covariance needs of an evaluation, however few its residuals are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ipmclab import Run, load_actuator, simulate
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.free import parse_free
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import ASSUMED_REST, prepare
from ipmclab.identification.search.pose import problem_at
from ipmclab.identification.search.solve import minimise, polish
from ipmclab.identification.search.starts.start import StartingPoint
from ipmclab.identification.search.tangent import entry_errors, null_directions


class _TwoReadingsOfThree:
    """Two readings: of the first unknown, and of the sum of both others."""

    lower, upper = np.full(3, -9.0), np.full(3, 9.0)
    linear = np.zeros(3, dtype=bool)
    added = linear

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


def test_values_whose_squares_overflow_have_a_triangle_all_the_same() -> None:
    """Far out in a search for the leak of a real record at 3 V, where the user saw a RuntimeWarning (here an error)."""
    rows = np.random.default_rng(20261121).standard_normal((3, 20))
    large = Evaluation(1e180 * rows)
    np.testing.assert_allclose(np.abs(large.triangle), 1e180 * np.abs(Evaluation(rows).triangle), rtol=1e-9)
    assert large.cost == np.inf


def test_long_rows_have_the_triangle_of_their_qr() -> None:
    """Their products are taken a stretch at a time."""
    rows = np.random.default_rng(20261121).standard_normal((12, 30_001))
    found = np.linalg.qr(rows.T, mode="r")
    np.testing.assert_allclose(Evaluation(rows).triangle, found * np.sign(found.diagonal())[:, None], atol=1e-10)


def test_a_foreign_run_that_begins_at_rest_after_all_is_read_from_rest() -> None:
    """Its start was free in the fit before; its edges still are, and they may lie before its first row."""
    strip = load_actuator("friend-2")
    clean = simulate(strip, "step 1 V", duration=2.0, rate=20.0)
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, displacement=clean.displacement, hold="unknown")
    names = parse_free(strip.parameter_values, "coupling.gain")
    record = prepare(run, 0, ["displacement"], ())
    point, noise = StartingPoint({}, {0: record.at_its_rows}), {(0, "displacement"): 1e-6}
    free = problem_at(strip, names, [replace(record, start="free")], point, noise)
    resting = [replace(record, start=ASSUMED_REST)]
    after = Problem(free.base, resting, [u for u in free.unknowns if not u.is_start], free.responder, free.noise)
    theta = np.array([u.entry(-0.3 * u.scale if u.base == "observation.delay" else 1e-6) for u in after.unknowns])
    new = problem_at(strip, names, resting, point, noise)
    np.testing.assert_array_equal(after.evaluate(theta).rows, new.evaluate(theta).rows)
