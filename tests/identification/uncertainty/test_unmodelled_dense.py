"""What the readings leave open of missing relaxations, against the formulas of the documentation with full matrices."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Fit, Run, RunMetadata, identify, prediction_bands, simulate
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.solved import Estimate
from ipmclab.model import Actuator
from ipmclab.model.outputs import simulate_outputs
from ipmclab.run import FloatArray
from tests.identification.many import FRIEND, NOISE

RATE = 25.0
KEY = (0, "current")
FREE = ["circuit.dc_resistivity", "circuit.branches.0.permittivity"]
NEW = {
    "as long again": simulate(FRIEND, "step 1 V", duration=24.0, rate=RATE),
    "a sine": simulate(FRIEND, "sine 1 V 0.2 Hz", duration=15.0, rate=RATE),
}


def recorded(autoregression: float, walk: float, rest: float) -> Run:
    """Twelve seconds under voltage, with noise of one kind."""
    generator = np.random.default_rng(20261128)
    clean = simulate(FRIEND, f"step 1 V delay={rest:g} s" if rest else "step 1 V", duration=rest + 12.0, rate=RATE)
    assert clean.current is not None
    noise = generator.standard_normal(len(clean) + 500)
    for row in range(1, len(noise)):
        noise[row] += autoregression * noise[row - 1]
    added = NOISE["current"] * (noise[500:] + walk * np.cumsum(generator.standard_normal(len(clean))))
    about = RunMetadata(signal="step 1 V", starts_from_rest=True)
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + added, metadata=about)


def current(model: Actuator, time: FloatArray, voltage: FloatArray) -> FloatArray:
    return simulate_outputs(model, time, voltage, "zero", outputs=["current"])[0]


def slopes(model: Actuator, time: FloatArray, voltage: FloatArray) -> FloatArray:
    """Derivatives of the current by logarithms of the free parameters, shape (n_time, n_free) [A]."""
    columns = []
    for name in FREE:
        above, below = (model.replace(**{name: model[name] * (1.0 + by)}) for by in (1e-5, -1e-5))
        columns.append((current(above, time, voltage) - current(below, time, voltage)) / 2e-5)
    return np.column_stack(columns)


def behind(time: FloatArray, voltage: FloatArray, constants: FloatArray) -> FloatArray:
    """The voltage behind lags, row after row, shape (n_time, n_lags) [V]."""
    found = np.zeros((len(time), len(constants)))
    for row, step in enumerate(np.diff(time), start=1):
        stays = np.exp(-step / constants)
        found[row] = stays * found[row - 1] + (1.0 - stays) * voltage[row - 1]
    return found


def covariance(correlated: Correlated, rows: int) -> tuple[FloatArray, float, int]:
    """Of all rows over the square of a scale, the scale [A], and how many constants of the sensor are unknown."""
    if KEY not in correlated.shapes:
        return np.eye(rows), 0.0, 0
    shape, places = correlated.shapes[KEY], np.arange(rows)
    terms, entries = shape.terms, list(shape.entries)
    assert terms.order <= 1
    found = np.zeros((rows, rows))
    if terms.order:
        by = np.tanh(entries.pop(0))
        found += by ** np.abs(places[:, None] - places) / (1.0 - by**2)
    if terms.walk:
        found += np.exp(2.0 * entries.pop(0)) * np.minimum.outer(places, places)
    if terms.white or not terms.order:
        found += (np.exp(2.0 * entries.pop(0)) if terms.order else 1.0) * np.eye(rows)
    return found, np.sqrt(shape.variance) * correlated.problem.noise[KEY], terms.offset + terms.trend


def relaxes_by(model: Actuator, step: float, seen: float) -> float:
    """Root mean square, over logarithms of time, of how the current relaxes after a step, as the size counts it."""
    time = np.append(0.0, np.geomspace(step, seen, 400))
    answer = current(model, time, np.ones_like(time))[1:]
    middle = np.sqrt(time[1:-1] * time[2:])
    return float(np.sqrt(np.mean((np.diff(answer) / np.diff(np.log(time[1:]))) ** 2 * middle / seen)))


def dense_bands(fit: Fit, run: Run) -> dict[str, FloatArray]:
    """The part of the band that is of the model, without whitening, projections or factors [A]."""
    assert isinstance(fit.estimate, Estimate)
    model, begins = fit.actuator, int(np.flatnonzero(run.voltage)[0])
    step, seen = 1.0 / RATE, float(run.time[-1] - run.time[begins])
    constants = step * 10.0 ** (0.5 * np.arange(np.ceil(2.0 * np.log10(10.0 * seen / step)) + 1))
    spread = np.sqrt(0.5 * np.log(10.0) * seen / constants)
    noise, scale, unknown = covariance(fit.estimate.correlated, len(run))
    ramp = np.column_stack([np.ones(len(run)), run.time - run.time.mean()])[:, :unknown]
    regressors = np.column_stack([slopes(model, run.time, run.voltage), ramp])
    lags = behind(run.time, run.voltage, constants) * spread
    assert run.current is not None
    missed = run.current - current(model, run.time, run.voltage)
    scale = scale or float(np.sqrt(np.mean(missed**2)))
    regressors, lags, missed = regressors / scale, lags / scale, missed / scale

    most = relaxes_by(model, step, seen)
    grid = np.geomspace(1e-3, 4.0, 60)
    half_normal = np.exp(-0.5 * grid**2) * grid
    beforehand = np.append(1.0, half_normal / half_normal.sum())
    freedom = len(run) - regressors.shape[1]
    logarithms, moments = [], []
    for size in np.append(0.0, most * grid):
        of_all = noise + size**2 * lags @ lags.T
        weighted = np.linalg.solve(of_all, regressors)
        left = np.linalg.inv(of_all) - weighted @ np.linalg.solve(regressors.T @ weighted, weighted.T)
        square = float(missed @ left @ missed)
        determinants = np.linalg.slogdet(of_all)[1] + np.linalg.slogdet(regressors.T @ weighted)[1]
        logarithms.append(-0.5 * (freedom * np.log(square) + determinants))
        mean = size**2 * lags.T @ left @ missed
        prior = size**2 * np.eye(len(constants))
        moments.append(square / freedom * (prior - size**4 * lags.T @ left @ lags) + np.outer(mean, mean))
    share = np.exp(np.array(logarithms) - max(logarithms)) * beforehand
    moment = np.tensordot(share / share.sum(), np.array(moments), axes=1)

    inverse = np.linalg.inv(noise)
    made_up = np.linalg.solve(regressors.T @ inverse @ regressors, regressors.T @ inverse @ lags)[: len(FREE)]
    found = {}
    for name, new in NEW.items():
        off = behind(new.time, new.voltage, constants) * spread - slopes(model, new.time, new.voltage) @ made_up
        found[name] = np.sqrt(np.einsum("ij,jk,ik->i", off, moment, off))
    return found


@pytest.mark.parametrize(
    ("autoregression", "walk", "rest", "is_weighted"),
    [(0.0, 0.0, 0.0, False), (0.9, 0.0, 0.0, False), (0.0, 0.3, 0.0, False), (0.8, 0.0, 10.0, True)],
    ids=["white", "autocorrelated", "a walk", "weighted by its noise"],
)
def test_the_band_is_that_of_full_matrices(autoregression: float, walk: float, rest: float, is_weighted: bool) -> None:
    run = recorded(autoregression, walk, rest)
    fit = identify(FRIEND, run, free=FREE)
    assert isinstance(fit.estimate, Estimate)
    assert fit.estimate.correlated.is_weighted == is_weighted
    assert (KEY in fit.estimate.correlated.shapes) == bool(autoregression or walk)
    for name, dense in dense_bands(fit, run).items():
        found = prediction_bands(fit, NEW[name]).of_model["current"]
        np.testing.assert_allclose(found, dense, rtol=0.03, atol=0.03 * float(np.median(dense)), err_msg=name)
