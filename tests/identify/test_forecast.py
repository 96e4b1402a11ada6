"""Forecasts against Gaussian conditioning, simulated strips whose future is known, and the real records."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from ipmclab import Actuator, InputError, Run, check, forecast, import_run, load_actuator, simulate
from ipmclab.identify import ForecastSettings, with_slow_modes
from ipmclab.identify.forecasting.disturbance import Disturbance
from ipmclab.identify.forecasting.filter_loop import filtered
from ipmclab.identify.forecasting.forecast import prepare

SEED = 20261121
MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
CONTACT = {"step_1V": 133, "step_2V": 516, "step_2V_poor": 420, "step_3V": 690}
RATE = 25.0


@pytest.mark.parametrize(("memory", "seconds"), [(0.3, 0.2), (2.0, 10.0), (50.0, 0.04)])
def test_the_disturbance_is_the_integrated_process(memory: float, seconds: float) -> None:
    # Van Loan: the matrix exponential of [[-A, B B'], [0, A']] holds transition and covariance.
    a, driven = np.array([[0.0, 1.0], [0.0, -1.0 / memory]]), np.diag([0.0, 1.0])
    whole = scipy.linalg.expm(seconds * np.block([[-a, driven], [np.zeros((2, 2)), a.T]]))
    transition = whole[2:, 2:].T
    np.testing.assert_allclose(Disturbance(memory).transition(seconds), transition, rtol=1e-10)
    np.testing.assert_allclose(Disturbance(memory).drive(seconds), transition @ whole[:2, 2:], rtol=1e-6)


def test_the_filter_is_gaussian_conditioning() -> None:
    generator = np.random.default_rng(SEED)
    steps, coefficients, noise, strength = 12, 3, 0.01, 0.5
    disturbance = Disturbance(1.3)
    transition, drive = disturbance.transition(0.2), strength * disturbance.drive(0.2)
    regressors = generator.standard_normal((steps, coefficients))
    readings = generator.standard_normal(steps)
    readings[[3, 7]] = np.nan
    prior_mean, prior = np.array([0.1, 0.2, 1.0, -1.0, 0.5]), np.diag([1.0, 0.3, 0.5, 0.7, 0.9])
    # The same as one linear map of everything that is random: the state at the first step, and each step's noise.
    size = 2 + coefficients
    rows, maps = [], []
    of_state = np.eye(size, size + 2 * (steps - 1))
    step = scipy.linalg.block_diag(transition, np.eye(coefficients))
    for k in range(steps):
        if k:
            of_state = step @ of_state
            of_state[:2, size + 2 * (k - 1) : size + 2 * k] += np.eye(2)
        rows.append(np.concatenate([[1.0, 0.0], regressors[k]]) @ of_state)
        maps.append(of_state.copy())
    random = scipy.linalg.block_diag(prior, *[drive] * (steps - 1))
    mean = np.concatenate([prior_mean, np.zeros(2 * (steps - 1))])
    known = np.isfinite(readings)
    seen = np.array(rows)[known]
    gain = random @ seen.T @ np.linalg.inv(seen @ random @ seen.T + noise * np.eye(known.sum()))
    expected = maps[-1] @ (mean + gain @ (readings[known] - seen @ mean))
    covariance = maps[-1] @ (random - gain @ seen @ random) @ maps[-1].T

    means, covariances = np.empty((steps, size)), np.empty((steps, size, size))
    filtered(readings, regressors, transition, drive, noise, prior_mean.copy(), prior.copy(), means, covariances)
    np.testing.assert_allclose(means[-1], expected, rtol=1e-9)
    np.testing.assert_allclose(covariances[-1], covariance, rtol=1e-9, atol=1e-12)


def wandering(seed: int, *, drift: float = 0.0, strength: float = 4e-10) -> tuple[Actuator, Run]:
    """A strip with two slow modes, a drift, and a disturbance of known strength [m^2/s^3], 20 s at rest before 1 V."""
    generator = np.random.default_rng([SEED, seed])
    truth = load_actuator("friend-2+relaxation.displacement=2").replace(
        **{
            "relaxation.displacement.0.ratio": generator.normal(0.0, 0.5),
            "relaxation.displacement.0.time_constant": 3.0,
            "relaxation.displacement.1.ratio": generator.normal(0.0, 0.5),
            "relaxation.displacement.1.time_constant": 20.0,
        }
    )
    run = simulate(truth, "step 1 V delay=20 s", duration=80.0, rate=RATE)
    assert run.displacement is not None
    disturbance = Disturbance(0.3)
    kicks = np.linalg.cholesky(strength * disturbance.drive(1.0 / RATE))
    state, level = np.zeros(2), []
    for _ in run.time:
        state = disturbance.transition(1.0 / RATE) @ state + kicks @ generator.standard_normal(2)
        level.append(state[0])
    read = run.displacement + np.array(level) + drift * run.time + 2e-7 * generator.standard_normal(len(run))
    return truth, Run.from_arrays(time=run.time, voltage=run.voltage, current=run.current, displacement=read)


def test_bands_hold_what_they_say_and_the_model_helps() -> None:
    inside, ours, hold = [], [], []
    for seed in range(40):
        truth, run = wandering(seed, drift=2e-6)
        assert run.displacement is not None
        unknown = with_slow_modes(truth)
        known = ForecastSettings(amplitude=0.1e-3, curl=1e-6)
        ahead = forecast(unknown, run, origin=40.0, horizon=10.0, settings=known)
        came = run.displacement[1001 : 1001 + len(ahead.time)]
        inside.append(np.mean((came > ahead.lower) & (came < ahead.upper)))
        ours.append(came[-1] - ahead.mean[-1])
        hold.append(came[-1] - run.displacement[1000])
    assert 0.7 <= np.mean(inside) <= 0.9
    assert np.std(ours) < 0.85 * np.sqrt(np.mean(np.square(hold)))


def test_nothing_after_the_origin_is_read() -> None:
    truth, run = wandering(1)
    assert run.displacement is not None
    assert run.current is not None
    other = replace(
        run,
        displacement=np.where(run.time > 40.0, 7e-3, run.displacement),
        current=np.where(run.time > 40.0, 0.05, run.current),
    )
    one, two = (forecast(with_slow_modes(truth), each, origin=40.0) for each in (run, other))
    np.testing.assert_array_equal(one.mean, two.mean)
    np.testing.assert_array_equal(one.upper, two.upper)


def test_the_planned_voltage_is_followed_and_the_end_of_a_run_too() -> None:
    truth = load_actuator("friend-2+relaxation.displacement")
    run = simulate(truth, "square 1 V 0.0125 Hz", duration=80.0, rate=RATE)  # +1 V, from 40 s on -1 V
    assert run.displacement is not None
    ahead = forecast(truth, run, origin=36.0, horizon=10.0)
    np.testing.assert_allclose(ahead.mean, run.displacement[901 : 901 + len(ahead.time)], atol=2e-6)
    late = forecast(truth, run, origin=78.0, horizon=10.0)
    assert late.time[-1] == pytest.approx(88.0, abs=1.0 / RATE)


def test_a_ratio_is_learnt_from_a_clean_record() -> None:
    truth = load_actuator("friend-2+relaxation.displacement").replace(**{"relaxation.displacement.0.ratio": 0.8})
    run = simulate(truth, "step 1 V delay=3 s", duration=60.0, rate=RATE)
    started = truth.replace(**{"relaxation.displacement.0.ratio": 0.0})
    ahead = forecast(started, run, origin=40.0)
    value, error = ahead.coefficients["relaxation.displacement.0.ratio"]
    assert abs(value - 0.8) < 3.0 * error
    assert error < 0.03  # of the prior's half: the rest of what it could be is the disturbance's
    assert set(ahead.coefficients) == {"relaxation.displacement.0.ratio", "curl"}


def test_a_stated_uncertainty_is_the_prior() -> None:
    truth = load_actuator("friend-2+relaxation.displacement")
    _, run = wandering(2)
    sure = replace(truth, standard_uncertainties={"relaxation.displacement.0.ratio": 1e-6})
    value, error = forecast(sure, run, origin=40.0).coefficients["relaxation.displacement.0.ratio"]
    assert value == pytest.approx(0.5, abs=1e-5)
    assert error <= 1e-6


def test_force_and_a_trend_without_a_model() -> None:
    truth = load_actuator("friend-2+relaxation.force")
    run = simulate(truth, "step 1 V", duration=60.0, rate=RATE)
    assert run.force is not None
    ahead = forecast(truth, run, origin=40.0, channel="force")
    np.testing.assert_allclose(ahead.mean, run.force[1001 : 1001 + len(ahead.time)], rtol=1e-3)
    plain = forecast(None, run, origin=40.0, settings=ForecastSettings(memory=1e-3))
    assert run.displacement is not None
    np.testing.assert_allclose(plain.mean, run.displacement[1000], rtol=1e-2)
    assert plain.coefficients == {}


def test_a_contact_that_came_back_starts_the_modes_anew() -> None:
    truth, run = wandering(3)
    assert run.current is not None
    noise = 1e-5 * np.random.default_rng(SEED).standard_normal(len(run))
    open_contact = (run.time >= 30.0) & (run.time < 34.0)
    current = (
        np.where(
            open_contact, 0.0, run.current + 0.02 * np.exp(-np.maximum(run.time - 34.0, 0.0) / 0.5) * (run.time >= 34.0)
        )
        + noise
    )
    found = prepare(with_slow_modes(truth), replace(run, current=current), origin=50.0)
    assert len(found.reopened) == 1
    assert found.reopened[0] == pytest.approx(34.0, abs=0.1)
    before = prepare(with_slow_modes(truth), replace(run, current=current), origin=33.0)
    assert before.reopened == ()
    assert [finding.code for finding in found.findings] == ["contact-lost"]
    assert found.anew.shape == (len(found.response), 9)


def test_a_jump_of_the_rate_is_followed_and_a_spike_in_it_is_not() -> None:
    truth, run = wandering(3, strength=1e-13)
    assert run.displacement is not None
    later = np.maximum(run.time - 45.0, 0.0)
    moved = run.displacement + 0.5e-3 * (1.0 - np.exp(-later / 2.0))
    spiked = moved.copy()
    spiked[1150] += 0.05e-3  # much larger, it would hide the jump from the check
    (jump,) = (f for f in check(replace(run, displacement=spiked)) if f.code == "rate-jump")
    ((start, stop),) = jump.samples
    assert start < 1150 < stop
    found = prepare(with_slow_modes(truth), replace(run, displacement=spiked), origin=60.0)
    assert "rate-jump" in [finding.code for finding in found.findings]
    assert (np.flatnonzero(~np.isfinite(found.readings[start:stop])) + start).tolist() == [1150]
    smooth, with_spike = (
        forecast(with_slow_modes(truth), replace(run, displacement=each), origin=60.0).mean[-1]
        for each in (moved, spiked)
    )
    assert with_spike == pytest.approx(smooth, abs=2e-6)


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        ({"origin": -1.0}, "origin", "0 s to 79.96 s"),
        ({"origin": 90.0}, "origin", "90"),
        ({"origin": float("nan")}, "origin", "nan"),
        ({"origin": 21.0}, "origin", "too soon"),
        ({"origin": "60 s"}, "origin", "give it in s"),
        ({"horizon": 0.0}, "horizon", "0.0"),
        ({"horizon": "10 s"}, "horizon", "give it in s"),
        ({"channel": "current"}, "channel", "displacement, force"),
        ({"channel": "force"}, "force", "no force"),
        ({"level": 1.0}, "level", "between 0 and 1"),
        ({"level": "80 %"}, "level", "between 0 and 1"),
    ],
)
def test_what_cannot_be_forecast_is_refused(change: dict[str, object], where: str, words: str) -> None:
    truth, run = wandering(4)
    given: dict[str, object] = {"origin": 40.0, **change}
    with pytest.raises(InputError) as caught:
        forecast(truth, run, **given)  # type: ignore[arg-type]
    assert caught.value.where == where
    assert words in str(caught.value)


@pytest.mark.parametrize("setting", ["memory", "span", "step"])
def test_bad_settings_are_refused(setting: str) -> None:
    with pytest.raises(InputError, match=setting):
        ForecastSettings(**{setting: 0.0})


def test_the_real_records(real_runs: Path) -> None:
    """With one structure and one set of numbers; the table with settings chosen in turn is a benchmark's."""
    strip = load_actuator("friend-2").replace(
        **{
            "geometry.free_length": 25e-3,
            "geometry.thickness": 0.5e-3,
            "geometry.sensing_length": 15e-3,
            "circuit.sheet_resistance": 56.9 / 12.0,
        }
    )
    model = with_slow_modes(strip)
    chosen = ForecastSettings(amplitude=0.6e-3, curl=1.7e-5, memory=0.3, span=3.0)
    trend = ForecastSettings(memory=2.0, span=3.0)
    inside, widths, ratios = [], [], {}
    for name, contact in CONTACT.items():
        run = import_run(real_runs / f"{name}.csv.gz", MAPS / f"{name}.toml")
        assert run.displacement is not None
        errors, held = [], []
        for since in range(15, 50, 2):
            origin = float(run.time[contact]) + since
            row = contact + 25 * since + 1
            came = run.displacement[row : row + 250]
            ahead = forecast(model, run, origin=origin, settings=chosen)
            plain = forecast(None, run, origin=origin, settings=trend)
            inside.append(np.mean((came > ahead.lower) & (came < ahead.upper)))
            widths.append([np.mean(ahead.upper - ahead.lower), np.mean(plain.upper - plain.lower)])
            errors.append(ahead.mean - came)
            held.append(run.displacement[row - 1] - came)
        ratios[name] = float(np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(held))))
    assert 0.7 <= np.mean(inside) <= 0.9
    assert np.mean(widths, axis=0)[0] <= np.mean(widths, axis=0)[1]
    assert max(ratios[name] for name in ("step_2V", "step_2V_poor", "step_3V")) < 1.0


def test_readings_that_are_hardly_there() -> None:
    truth, run = wandering(5)
    assert run.displacement is not None
    thin = np.where(np.arange(len(run)) % 40 == 0, run.displacement, np.nan)  # one in 1.6 s
    ahead = forecast(with_slow_modes(truth), replace(run, displacement=thin), origin=60.0)
    assert np.isfinite(ahead.mean).all()
    assert (ahead.upper > ahead.lower).all()
    gone = np.where((run.time < 21.0) | (run.time > 59.5), run.displacement, np.nan)
    with pytest.raises(InputError, match="too few readings"):
        forecast(truth, replace(run, displacement=gone), origin=60.0)


def test_a_strip_without_voltage_drifts_on() -> None:
    time = np.arange(2000) / RATE
    read = 5e-6 * time + np.cumsum(1e-8 * np.random.default_rng(SEED).standard_normal(2000))
    run = Run.from_arrays(time=time, voltage=np.zeros(2000), displacement=read)
    ahead = forecast(with_slow_modes(load_actuator("friend-2")), run, origin=60.0)
    np.testing.assert_allclose(ahead.mean, read[1501:1751], rtol=0.02)


@settings(deadline=None, max_examples=25)
@given(
    rate=st.floats(2.0, 50.0),
    signal=st.sampled_from(["step 2 V", "sine 1 V 0.05 Hz", "square 1 V 0.02 Hz", "step 0 V"]),
    origin=st.floats(15.0, 60.0),
    horizon=st.floats(0.1, 30.0),
    stage=st.sampled_from(["relaxation.displacement=2", "leak.exponential", "relaxation.displacement_pair"]),
)
def test_any_forecast_is_a_number_or_a_refusal(
    rate: float, signal: str, origin: float, horizon: float, stage: str
) -> None:
    actuator = load_actuator(f"friend-2+{stage}")
    run = simulate(actuator, signal, duration=61.0, rate=rate)
    try:
        ahead = forecast(actuator, run, origin=origin, horizon=horizon)
    except InputError:
        return
    assert np.isfinite(ahead.mean).all()
    assert (ahead.lower <= ahead.mean).all()
    assert (ahead.mean <= ahead.upper).all()
    assert (ahead.time > ahead.origin).all()
