"""What rows at 0 V show of a sensor, where a wire is touched meanwhile and where none is."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.fit.fit import Fit
from ipmclab.identification.noise.at_rest import Resting, is_shown_at_rest
from ipmclab.model.variants import with_stages
from ipmclab.quality.rows_at_rest import without_spikes
from ipmclab.statespace.shape import Shape, drawn
from ipmclab.statespace.terms import Terms
from tests.identification.brief import brief


def test_noise_about_a_slope_stays_as_it_is() -> None:
    generator = np.random.default_rng(20261123)
    time = np.arange(500) / 25.0
    values = 3.0 * time + generator.standard_normal(500)
    assert np.array_equal(without_spikes(time, values, 0.0), values)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_readings_are_no_spikes(count: int) -> None:
    values = np.arange(float(count))
    assert np.array_equal(without_spikes(np.arange(float(count)), values, 0.1), values)


def test_a_touched_wire_is_brought_back_to_where_noise_would_end() -> None:
    generator = np.random.default_rng(20261123)
    time = np.arange(125) / 25.0
    values = 1e-5 * generator.standard_normal(125)
    values[70:73] = 0.04
    kept = without_spikes(time, values, 0.0)
    assert np.abs(kept).max() < 1e-4
    assert np.array_equal(np.delete(kept, [70, 71, 72]), np.delete(values, [70, 71, 72]))


@pytest.mark.parametrize(("drift", "severity"), [(2e-5, "info"), (1e-4, "warning")])
def test_a_drift_that_rows_at_rest_have_is_one_beside_a_wrong_model_too(drift: float, severity: str) -> None:
    # Of three branches two are fitted; the drift is 0.8 mA, or 4 mA, of some 60 mA.
    truth = with_stages(load_actuator("friend-2"), "branches=3").replace(
        **{"circuit.branches.2.resistivity": 150.0, "circuit.branches.2.permittivity": 0.6}
    )
    clean = simulate(truth, "step 1 V delay=10 s", duration=40.0, rate=25.0)
    assert clean.current is not None
    noise = 1e-5 * np.random.default_rng(20261123).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise + drift * clean.time)
    fit = brief(load_actuator("friend-2"), run, free="electrical")
    found = fit.observations[0].drift
    assert found.get("current", 0.0) == pytest.approx(drift, rel=0.1)
    (said,) = [one for one in fit.findings if one.code == "sensor-drift"]
    assert said.severity == severity
    assert said.values["drift"] == found["current"]


@pytest.mark.parametrize(("walk", "order"), [(0.3, 0), (0.3, 1), (0.05, 0)])
def test_the_likelihood_of_a_walk_is_that_of_its_covariance(walk: float, order: int) -> None:
    """Patterson and Thompson's restricted likelihood about a level, from dense matrices."""
    partial, count = 0.4, 60
    entries = np.array([np.arctanh(partial)] * order + [np.log(walk)])
    rows = np.random.default_rng(20261126).standard_normal(count) + 2.0
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    still = partial**apart / (1.0 - partial**2) if order else np.eye(count)
    walks = walk**2 * np.minimum.outer(np.arange(count), np.arange(count))

    def deviance(covariance: np.ndarray) -> float:
        inverse, ones = np.linalg.inv(covariance), np.ones(count)
        level = ones @ inverse @ rows / (ones @ inverse @ ones)
        squares = (rows - level) @ inverse @ (rows - level)
        return float((count - 1) * np.log(squares) + np.linalg.slogdet(covariance)[1] + np.log(ones @ inverse @ ones))

    noise = Shape(Terms(order=order, walk=True), entries, 1.0)
    assert Resting(noise, rows).likelier_with_slow == pytest.approx(deviance(still) - deviance(still + walks), rel=1e-9)


@pytest.mark.parametrize("rows", [np.zeros(0), np.zeros(2), np.full(80, 0.3)])
def test_rows_without_noise_say_nothing_of_a_walk(rows: np.ndarray) -> None:
    assert Resting(Shape(Terms(walk=True), np.zeros(1), 1.0), rows).likelier_with_slow == 0.0


def test_an_autoregression_that_is_slower_than_the_rows_at_rest_has_to_show_there() -> None:
    """What a model lacks over a minute fades over 10 s; beside white noise five seconds at 0 V do not contradict it."""
    generator = np.random.default_rng(20261121)
    slow = Shape(Terms(order=1, white=True), np.array([np.arctanh(0.996), 2.4]), 0.01)
    white = np.sqrt(0.01 * np.exp(2.0 * 2.4)) * generator.standard_normal((3, 125))
    assert [Resting(slow, rows).is_at_rest_too for rows in white] == [True] * 3
    assert is_shown_at_rest([Resting(slow, rows) for rows in white]) is not True
    fast = Shape(Terms(order=1), np.array([np.arctanh(0.9)]), 1.0 - 0.9**2)
    assert is_shown_at_rest([Resting(fast, drawn(fast, np.ones(250, dtype=np.int64), generator))]) is True


def test_a_smaller_noise_at_rest_is_autocorrelated_where_its_rows_are() -> None:
    generator = np.random.default_rng(20261128)
    driven = Shape(Terms(order=1), np.array([np.arctanh(0.9)]), 1.0 - 0.9**2)
    smaller = 0.3 * drawn(driven, np.ones(4000, dtype=np.int64), generator)
    found = Resting(driven, smaller).noise_at_rest(0.0)
    assert found.terms == driven.terms
    assert found.variance == pytest.approx(0.3**2 * driven.variance, rel=0.1)
    white = Resting(driven, 0.3 * generator.standard_normal(4000)).noise_at_rest(0.0)
    assert white.terms.is_white
    assert white.variance == pytest.approx(0.3**2, rel=0.1)
    assert Resting(driven, np.zeros(100)).noise_at_rest(1e-4).variance == 1e-4


def test_a_start_that_takes_up_the_noise_of_the_rows_at_rest_is_none() -> None:
    """Rows at 0 V whose slow noise a start from elsewhere had taken up passed for white: 5 of 40 such fits kept it."""
    generator = np.random.default_rng(6)
    clean = simulate(load_actuator("friend-2"), "step 1 V delay=5 s", duration=45.0, rate=20.0)
    noise = scipy.signal.lfilter([np.sqrt(1.0 - 0.81)], [1.0, -0.9], generator.standard_normal(len(clean)))
    assert clean.current is not None
    run = Run.from_arrays(
        time=clean.time, voltage=clean.voltage, current=clean.current - 5e-3 + 1e-4 * noise, hold="zero"
    )
    fit = identify(load_actuator("friend-2"), run, free="electrical")
    assert fit.observations[0].start.startswith("rest")
    assert fit.observations[0].offset["current"] == pytest.approx(-5e-3, abs=1.5e-4)


def lacking_two_branches(seed: int) -> tuple[Fit, float]:
    """One branch fitted to a strip of three, whose current reads 0.2 mA at 0 V; and what the fit leaves [A]."""
    strip = with_stages(load_actuator("friend-2"), "branches=3").replace(
        **{"circuit.branches.2.resistivity": 60.0, "circuit.branches.2.permittivity": 2.0}
    )
    clean = simulate(strip, "step 1 V delay=5 s", duration=45.0, rate=20.0)
    assert clean.current is not None
    noise = 2e-5 * np.random.default_rng(seed).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + 2e-4 + noise, hold="zero")
    fit = brief(with_stages(load_actuator("friend-2"), "branches=1"), run)
    return fit, float(np.sqrt(np.mean(fit.residuals[0]["current"] ** 2)))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_a_model_lacks_leaves_the_zero_that_rows_at_rest_show(seed: int) -> None:
    """A strip at 0 V draws nothing, whatever it is: what is found under voltage begins with it."""
    fit, left = lacking_two_branches(seed)
    low, high = fit.parameters["observation.offset.current[0]"].interval
    assert low <= 2e-4 <= high
    assert high - low < 2.0 * left
    under = fit.estimate.correlated
    (key,) = under.shapes
    assert under.shapes[key].terms.order
    # A draw has the covariance that the errors are made of.
    generator = np.random.default_rng(seed)
    columns = under.solution.evaluation.jacobian[:, :3]
    covariance = under.covariance_of(columns[under.problem.pieces[key]], key)
    draws = np.array([under.drawn(generator) @ columns for _ in range(2000)])
    np.testing.assert_allclose(np.diag(draws.T @ draws / 2000), np.diag(covariance), rtol=0.15)
