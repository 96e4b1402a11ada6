"""A drift beside rows at 0 V: what they say of it counts once, and the zero that they show is that of these rows."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from ipmclab import Run, RunMetadata, identify, load_actuator, simulate
from ipmclab.identification.diagnostics.left import Left
from ipmclab.identification.noise.zeros import DriftingProblem
from ipmclab.identification.solved import solved
from ipmclab.model import Actuator
from tests.identification.brief import brief


def test_errors_beside_a_drift_are_those_of_one_regression() -> None:
    """Written out: parameters, zeros and slopes at once, the prior of a slope a sum of the readings at 0 V."""
    strip, noise = load_actuator("friend-2"), np.random.default_rng(20261124)
    runs = []
    for signal in ("step 1 V delay=5 s", "sine 1 V 0.1 Hz delay=5 s"):
        clean = simulate(strip, signal, duration=45.0, rate=50.0)
        assert clean.current is not None
        current = clean.current + 3e-4 * clean.time / 45.0 + 1e-4 * noise.standard_normal(len(clean))
        about = RunMetadata(starts_from_rest=True)
        runs.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, metadata=about))
    fit = identify(strip, runs, free="electrical")
    assert fit.estimate is not None
    under = fit.estimate.correlated
    assert not under.is_weighted

    sensors, slopes, by_readings = [], [], []
    for key, piece in under.problem.pieces.items():
        run, unit = runs[key[0]], under.problem.noise[key]
        rest, sensor = int(np.argmax(run.voltage != 0.0)), np.column_stack([np.ones(len(run)), run.time])
        error = under.zeros[key].rest.error / unit
        assert np.isfinite(error)
        deviation = np.sqrt(under.shapes[key].variance)
        of_slope = np.zeros(len(run))
        of_slope[:rest] = np.linalg.pinv(sensor[:rest])[1]  # what each reading at 0 V adds to their slope
        sensors.append(sensor)
        slopes.append(np.array([[0.0, 1.0 / error]]))
        by_readings.append((deviation * np.eye(len(run)), deviation * of_slope[None] / error))
        assert piece.stop - piece.start == len(run)
    jacobian = under.plain.jacobian
    known = scipy.linalg.block_diag(*slopes)
    beside = np.hstack([jacobian, scipy.linalg.block_diag(*sensors)])
    columns = np.vstack([beside, np.hstack([np.zeros((len(known), jacobian.shape[1])), known])])
    driven = np.vstack([scipy.linalg.block_diag(*(one[k] for one in by_readings)) for k in (0, 1)])
    moved = np.linalg.norm((np.linalg.pinv(columns) @ driven)[: jacobian.shape[1]], axis=1)
    expected = dict(zip([unknown.name for unknown in under.problem.unknowns], moved, strict=True))
    told = [one.standard_error / one.value for one in fit.parameters.values()]
    np.testing.assert_allclose(told, [expected[name] for name in fit.parameters], rtol=0.03)


def drifting(strip: Actuator) -> list[Run]:
    """A step whose current is read with a drift, behind 1 s at 0 V, and a sine without one; noise of 0.1 mA."""
    noise, runs = np.random.default_rng(20261128), []
    for signal, drift in (("step 1 V delay=1 s", 0.6e-3), ("sine 1 V 0.1 Hz", 0.0)):
        clean = simulate(strip, signal, duration=40.0, rate=50.0)
        assert clean.current is not None
        added = drift * (clean.time / 40.0 - 0.5) + 1e-4 * noise.standard_normal(len(clean))
        runs.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + added))
    return runs


def test_a_zero_that_rows_at_0_v_show_stays_there_under_a_drift() -> None:
    """The drift went through zero at the middle of the record, and took the zero of these rows to its bound."""
    strip = load_actuator("friend-2")
    fit = identify(strip, drifting(strip), free="electrical")
    assert {one.verdict for one in fit.diagnoses} == {"autocorrelated"}  # by the drift alone
    assert "model-incomplete" not in [finding.code for finding in fit.findings]
    zero = fit.parameters["observation.offset.current[0]"]
    assert zero.determined
    assert zero.interval[0] < -0.3e-3 < zero.interval[1]
    assert fit.observations[0].offset["current"] == zero.value
    for residuals in fit.residuals:
        assert np.sqrt(np.mean(residuals["current"] ** 2)) == pytest.approx(1e-4, rel=0.05)
    for name, parameter in fit.parameters.items():
        if name in strip.parameter_values:
            assert abs(parameter.value - strip.parameter_values[name]) < 4.0 * parameter.standard_error, name


def test_what_is_left_without_a_drift_is_held_against_the_noise_that_was_found_with_it() -> None:
    """Each problem has the scatter that it leaves as its unit, and a noise is found in that of one of them."""
    strip = load_actuator("friend-2")
    found = solved(brief(strip, drifting(strip), "circuit.dc_resistivity"))
    left = Left.of(found, "current")
    assert left.problem.noise[0, "current"] > 1.5 * found.problem.noise[0, "current"]
    for key, shape in left.shapes.items():
        assert left.problem.noise[key] * np.sqrt(shape.variance) == pytest.approx(1e-4, rel=0.05)


def test_a_drift_that_one_run_shows_has_a_zero_beside_it_in_the_other() -> None:
    """Through zero at the first reading it left 15 of 60 dc resistivities outside their intervals, and now 5."""
    strip, noise, runs = load_actuator("friend-2"), np.random.default_rng(20261129), []
    for signal, drift in (("step 1 V delay=5 s", 0.6e-3), ("step -1 V delay=2 s", 0.06e-3)):
        clean = simulate(strip, signal, duration=40.0, rate=25.0)
        assert clean.current is not None
        error = 1e-4 * scipy.signal.lfilter([0.8], [1.0, -0.6], noise.standard_normal(len(clean)))
        added = drift * (clean.time / 40.0 - 0.5) + error
        runs.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + added))
    found = solved(brief(strip, runs, "circuit.dc_resistivity", followed=False))
    assert [unknown.name for unknown in found.problem.unknowns][1:] == ["observation.offset.current[0]"]
    constants = [(shape.terms.offset, shape.terms.trend) for shape in found.correlated.shapes.values()]
    assert constants == [(False, True), (True, True)]


@pytest.mark.parametrize("inflation", [1.0, 2e4])
def test_what_is_known_of_a_slope_is_no_part_of_what_is_left(inflation: float) -> None:
    """Squares of rows whose best zero and slope are taken out hold those of the readings and of what was known."""
    strip, noise = load_actuator("friend-2"), np.random.default_rng(20261128)
    clean = simulate(strip, "step 1 V delay=2 s", duration=22.0, rate=25.0)
    assert clean.current is not None
    current = clean.current + 2e-3 * clean.time / 22.0 + 1e-4 * noise.standard_normal(len(clean))
    about = RunMetadata(starts_from_rest=True)
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, metadata=about)
    fit = brief(strip, run, free="electrical")
    assert fit.estimate is not None
    found = fit.estimate.correlated
    (key,) = found.zeros
    zero = replace(found.zeros[key], inflation=inflation)
    assert zero.terms.trend
    problem = DriftingProblem(found.problem.plain, {key: zero})
    plain = problem.plain.evaluate(found.solution.theta).residual[problem.pieces[key]]
    plain = plain + 50.0 * zero.columns[:, -1]  # far from what rows at 0 V say
    expected = problem.projections[key].expected
    taken = problem.whitened(key, (plain + expected)[None])[0]
    left = plain + zero.columns @ problem.constants(key, plain)
    assert problem.squares(key, taken) == pytest.approx(float(left @ left), rel=1e-9)
    assert float(taken @ taken) > 1.1 * problem.squares(key, taken)
