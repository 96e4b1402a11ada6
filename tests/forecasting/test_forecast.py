"""Forecasts against simple ones on the real records, and on simulated strips whose future is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import Actuator, InputError, Run, check, forecast, import_run, load_actuator, simulate
from ipmclab.forecasting.forecast import with_slow_modes
from ipmclab.forecasting.past import read_past
from tests.profiles import costly

SEED = 20261121
MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
CONTACT = {"step_1V": 133, "step_2V": 516, "step_2V_poor": 420, "step_3V": 690}
RATE = 25.0


def wandering(seed: int, *, drift: float = 0.0, strength: float = 6e-6) -> tuple[Actuator, Run]:
    """A strip with two slow modes, a drift and a random walk [m/s^0.5], 20 s at rest before 1 V."""
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
    walk = np.cumsum(strength / np.sqrt(RATE) * generator.standard_normal(len(run)))
    read = run.displacement + walk + drift * run.time + 2e-7 * generator.standard_normal(len(run))
    return truth, Run.from_arrays(time=run.time, voltage=run.voltage, current=run.current, displacement=read)


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


def test_a_forecast_says_of_what_it_is_made() -> None:
    truth, run = wandering(3, strength=1e-7)
    ahead = forecast(truth, run, origin=60.0)
    largest = max(ahead.weights, key=lambda name: ahead.weights[name])
    assert f"({100 * ahead.weights[largest]:.0f} %)" in ahead.made_of
    held = replace(ahead, weights={**dict.fromkeys(ahead.weights, 0.0), "hold": 1.0})
    assert held.made_of.startswith("This forecast only holds the last value (weight 100 %)")


def test_a_jump_of_the_rate_is_followed_and_a_spike_in_it_is_not() -> None:
    truth, run = wandering(3, strength=1e-7)
    assert run.displacement is not None
    later = np.maximum(run.time - 45.0, 0.0)
    moved = run.displacement + 0.5e-3 * (1.0 - np.exp(-later / 2.0))
    spiked = moved.copy()
    spiked[1150] += 0.05e-3  # much larger, it would hide the jump from the check
    (jump,) = (f for f in check(replace(run, displacement=spiked)) if f.code == "rate-jump")
    ((start, stop),) = jump.samples
    assert start < 1150 < stop
    found = read_past(truth, replace(run, displacement=spiked), origin=60.0)
    assert "rate-jump" in [finding.code for finding in found.findings]
    assert np.isfinite(found.readings[found.first :]).all()
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
        ({"origin": "60 s"}, "origin", "give a number in s"),
        ({"horizon": 0.0}, "horizon", "0.0"),
        ({"horizon": 1e9}, "horizon", "allowed are 20000000"),
        ({"horizon": "10 s"}, "horizon", "give a number in s"),
        ({"channel": "current"}, "channel", "displacement, force"),
        ({"channel": "force"}, "force", "no force"),
        ({"level": 1.0}, "level", "between 0 and 1"),
        ({"level": "80 %"}, "level", "not a number"),
    ],
)
def test_what_cannot_be_forecast_is_refused(change: dict[str, object], where: str, words: str) -> None:
    truth, run = wandering(4)
    given: dict[str, object] = {"origin": 40.0, **change}
    with pytest.raises(InputError) as caught:
        forecast(truth, run, **given)  # type: ignore[arg-type]
    assert caught.value.where == where
    assert words in str(caught.value)


@pytest.mark.parametrize(("rate", "step"), [(RATE, 0.2), (0.5, 2.0)])
def test_a_horizon_that_is_too_short_is_told_as_such(rate: float, step: float) -> None:
    """It was said of the origin, at any origin, that it comes too soon."""
    truth, run = wandering(4)
    every = round(RATE / rate)
    thin = Run.from_arrays(time=run.time[::every], voltage=run.voltage[::every], displacement=run.displacement[::every])
    for horizon in (0.001, 0.4 * step, 0.49 * step):
        with pytest.raises(
            InputError, match=f"horizon: the horizon {horizon:g} s is too short.* give {step:g} s or more"
        ):
            forecast(truth, thin, origin=70.0, horizon=horizon)
    ahead = forecast(truth, thin, origin=70.0, horizon=step)
    assert len(ahead.time) == round(step * rate)
    assert (ahead.upper > ahead.lower).all()


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


@costly()
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


def straight(run: Run, row: int, ahead: np.ndarray) -> np.ndarray:
    """The last 5 s as a straight line; row is the last that was seen."""
    assert run.displacement is not None
    time, read = run.time[: row + 1], run.displacement[: row + 1]
    last = (time > time[-1] - 5.0) & np.isfinite(read)
    return np.asarray(np.polyval(np.polyfit(time[last] - time[-1], read[last], 1), ahead - time[-1]))


@pytest.mark.parametrize("with_model", [False, True])
def test_the_real_records(real_runs: Path, with_model: bool) -> None:
    """As any user calls it; the actuator is another strip's, with the dimensions of this one."""
    model = load_actuator("friend-2").replace(
        **{"geometry.free_length": 25e-3, "geometry.thickness": 0.5e-3, "geometry.sensing_length": 15e-3}
    )
    skills, inside = [], []
    for name, contact in CONTACT.items():
        run = import_run(real_runs / f"{name}.csv.gz", MAPS / f"{name}.toml")
        assert run.displacement is not None
        for horizon in (10.0, 30.0):
            errors, held, lines = [], [], []
            for since in (*range(15, 50, 2), 60):
                row = contact + 25 * since
                ahead = forecast(model if with_model else None, run, origin=float(run.time[row]), horizon=horizon)
                came = run.displacement[row + 1 : row + 1 + len(ahead.time)]
                inside.append(np.mean((came > ahead.lower) & (came < ahead.upper)))
                errors.append(ahead.mean - came)
                held.append(run.displacement[row] - came)
                lines.append(straight(run, row, ahead.time) - came)
            own, hold, line = (float(np.sqrt(np.mean(np.square(each)))) for each in (errors, held, lines))
            assert own <= 1.1 * hold, (name, horizon)
            assert own <= 1.1 * line, (name, horizon)
            skills.append((1.0 - own / hold, 1.0 - own / line))
    assert (np.mean(skills, axis=0) > 0.0).all()
    assert 0.7 <= np.mean(inside) <= 0.9


def test_bands_hold_what_they_say_and_slow_modes_are_learnt() -> None:
    inside, ours, hold = [], [], []
    for seed in range(40):
        _, run = wandering(seed, drift=2e-6)
        assert run.displacement is not None
        ahead = forecast(None, run, origin=60.0)
        came = run.displacement[1501 : 1501 + len(ahead.time)]
        inside.append(np.mean((came > ahead.lower) & (came < ahead.upper)))
        ours.append(came[-1] - ahead.mean[-1])
        hold.append(came[-1] - run.displacement[1500])
    assert 0.7 <= np.mean(inside) <= 0.9
    assert np.sqrt(np.mean(np.square(ours))) < 0.85 * np.sqrt(np.mean(np.square(hold)))


def test_an_actuator_of_another_strip_does_no_harm() -> None:
    ours: list[np.ndarray] = []
    without: list[np.ndarray] = []
    wrong = load_actuator("friend-2+relaxation.displacement").replace(
        **{"relaxation.displacement.0.ratio": -3.0, "relaxation.displacement.0.time_constant": 15.0}
    )
    for seed in range(20):
        _, run = wandering(seed, drift=2e-6)
        assert run.displacement is not None
        came = run.displacement[1501:1751]
        for model, errors in ((wrong, ours), (None, without)):
            errors.append(forecast(model, run, origin=60.0).mean - came)
    assert np.sqrt(np.mean(np.square(ours))) < 1.1 * np.sqrt(np.mean(np.square(without)))


def test_the_slow_answer_is_a_sum_of_lags_and_a_drift() -> None:
    """Made by hand from exponentials, so long that the time before the record counts 4 exp(-288 / 40) of a horizon."""
    time = np.arange(0.0, 320.0, 1.0 / RATE)
    since = np.maximum(time - 10.0, 0.0)
    read = 1e-3 * (1.0 - np.exp(-since / 10.0)) - 2e-3 * (1.0 - np.exp(-since / 100.0)) + 3e-5 * time
    run = Run.from_arrays(time=time, voltage=np.where(time >= 10.0, 1.5, 0.0), displacement=read)
    ahead = forecast(None, run, origin=300.0)
    came, held = read[7501 : 7501 + len(ahead.time)], read[7500]
    assert np.ptp(came) > 0.2e-3
    np.testing.assert_allclose(ahead.mean - held, came - held, atol=0.02 * np.ptp(came))
    assert ahead.weights["hold"] < 0.02
    assert sum(ahead.weights.values()) == pytest.approx(1.0)


def test_a_strip_without_voltage_drifts_on() -> None:
    time = np.arange(5000) / RATE
    read = 5e-6 * time + np.cumsum(1e-8 * np.random.default_rng(SEED).standard_normal(5000))
    run = Run.from_arrays(time=time, voltage=np.zeros(5000), displacement=read)
    ahead = forecast(load_actuator("friend-2"), run, origin=180.0)
    np.testing.assert_allclose(ahead.mean, read[4501:4751], atol=2e-6)  # of 50 um


def test_force_is_forecast_too() -> None:
    truth = load_actuator("friend-2+relaxation.force")
    run = simulate(truth, "step 1 V", duration=60.0, rate=RATE)
    assert run.force is not None
    ahead = forecast(truth, run, origin=40.0, channel="force")
    came, held = run.force[1001 : 1001 + len(ahead.time)], run.force[1000]
    assert ahead.weights["hold"] < 0.5
    # Of a clean record all is known but for the share that a short past leaves to holding.
    assert (np.abs(ahead.mean - came) <= ahead.weights["hold"] * np.abs(held - came) + 0.01 * np.ptp(came)).all()


@pytest.mark.parametrize("signal", ["sine 1 V 0.1 Hz", "square 1 V 0.05 Hz", "random 1 V 5 s"])
def test_a_voltage_that_moves_on_is_answered_as_it_was_before(signal: str) -> None:
    """Of a strip with a slow mode, and the actuator of another that has none: it is weighed by what it said before."""
    strip = load_actuator("friend-2+relaxation.displacement").replace(
        **{"relaxation.displacement.0.ratio": 0.6, "relaxation.displacement.0.time_constant": 12.0, "coupling.p1": 12.0}
    )
    clean = simulate(strip, signal, duration=100, rate=10)
    noise = 3e-6 * np.random.default_rng(20261128).standard_normal(len(clean))
    run = replace(clean, displacement=clean.displacement + noise)
    for model in (load_actuator("friend-2"), strip):
        inside = []
        for origin in np.arange(50.0, 90.0, 2.5):
            ahead = forecast(model, run, origin=float(origin), horizon=5.0)
            came = np.interp(ahead.time, run.time, run.displacement)
            inside.append(np.mean((ahead.lower <= came) & (came <= ahead.upper)))
        assert np.mean(inside) > 0.7


def test_the_first_move_of_the_voltage_is_answered_by_the_actuator_in_full() -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V for 60 s then step -0.5 V", duration=80, rate=10)
    plan = forecast(strip, run, origin=59.9, horizon=10.0)
    stays = forecast(strip, simulate(strip, "step 1 V", duration=80, rate=10), origin=59.9, horizon=10.0)
    there = simulate(strip, "step 1 V", duration=80, rate=10).displacement
    assert plan.mean - stays.mean == pytest.approx((run.displacement - there)[600:700], abs=1e-9)


@pytest.mark.parametrize("with_model", [False, True])
@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_a_band_holds_a_plan_that_the_past_does_not_show(delay: float, *, with_model: bool) -> None:
    """Of strips with slow modes that the actuator lacks: 45 % of the readings lay in it, 36 % without an actuator."""
    model = load_actuator("friend-2") if with_model else None
    inside = []
    for seed in range(12):
        truth, _ = wandering(seed)
        generator = np.random.default_rng([SEED, seed, 1])
        after = 1.0 + generator.choice([-1.0, -2.0, 1.0])
        signal = f"step 1 V delay={delay:g} s for 42 s then step {after:g} V"
        clean = simulate(truth, signal, duration=51.0, rate=RATE)
        assert clean.displacement is not None
        walk = np.cumsum(6e-6 / np.sqrt(RATE) * generator.standard_normal(len(clean)))
        run = Run.from_arrays(time=clean.time, voltage=clean.voltage, displacement=clean.displacement + walk)
        assert run.displacement is not None
        ahead = forecast(model, run, origin=40.0, horizon=10.0)
        came = np.interp(ahead.time, run.time, run.displacement)
        inside.append(np.mean((ahead.lower <= came) & (came <= ahead.upper)))
    assert np.mean(inside) > 0.75


def test_a_band_is_as_it_was_where_the_actuator_did_not_miss_the_first_edge() -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V delay=1 s for 41 s then step -0.5 V", duration=60, rate=10)
    assert run.displacement is not None
    stays = simulate(strip, "step 1 V delay=1 s", duration=60, rate=10)
    plan, other = (forecast(strip, one, origin=40.0, horizon=10.0) for one in (run, stays))
    assert plan.upper - plan.mean == pytest.approx(other.upper - other.mean, abs=0.01 * np.ptp(run.displacement))


@pytest.mark.parametrize(("rate", "horizon"), [(10.0, 1.0), (25.0, 2.0), (200.0, 10.0)])
def test_the_band_holds_readings_and_not_only_means_of_them(rate: float, horizon: float) -> None:
    """It was that of means over 0.2 s: of 200 noisy readings per second half of those that came."""
    strip = load_actuator("friend-2+relaxation.displacement")
    clean = simulate(strip, "step 1 V", duration=60.0, rate=rate)
    assert clean.displacement is not None
    held = []
    for seed in range(12):
        noise = 2e-5 * np.random.default_rng([SEED, seed]).standard_normal(len(clean))
        run = Run.from_arrays(time=clean.time, voltage=clean.voltage, displacement=clean.displacement + noise)
        assert run.displacement is not None
        ahead = forecast(strip, run, origin=40.0, horizon=horizon, level=0.8)
        came = run.displacement[np.searchsorted(run.time, ahead.time - 1e-9)]
        held.append(np.mean((ahead.lower < came) & (came < ahead.upper)))
    assert 0.72 < float(np.mean(held)) < 0.97
