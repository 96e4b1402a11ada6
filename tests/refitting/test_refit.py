"""Fits to other readings of the same runs: each is what a fit alone says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import InputError, Run, RunMetadata, identify, load_actuator, refit, simulate, simulate_many
from ipmclab.engine import Here
from ipmclab.fit.fit import Fit
from ipmclab.identification.search.solve import Shifted, descend
from ipmclab.refitting.again import Fitted, fits_again, fitted
from ipmclab.refitting.side_by_side import _steps
from tests.independent.bounds import ELECTRICAL, noisy_current, step_and_sine
from tests.independent.thesis import FRIEND_2

SEED, NOISE = 20261123, 1e-4
FRIEND = load_actuator("friend-2")


def runs(seed: int = SEED) -> list[Run]:
    """A step and a sine of 2,000 rows."""
    generator = np.random.default_rng(seed)
    return [
        Run.from_arrays(
            time=time,
            voltage=voltage,
            current=noisy_current(FRIEND_2, voltage, 50.0, NOISE, generator),
            hold="zero",
            metadata=RunMetadata(starts_from_rest=True),
        )
        for time, voltage in step_and_sine()
    ]


@pytest.fixture(scope="module")
def fit() -> Fit:
    """The electrical model."""
    return identify(FRIEND, runs())


def shifts(start: Fitted, count: int) -> np.ndarray:
    noise = np.random.default_rng(3).standard_normal((count, start.here.residual.size))
    return noise - start.here.residual


def alone(start: Fitted, shift: np.ndarray) -> np.ndarray:
    shifted = Shifted(start.problem, shift)
    return descend(shifted, start.theta, shifted.shifted(start.here), tolerance=1e-8).theta


@pytest.mark.parametrize("free", [["electrical"], ["electrical", "observation.offset.current"]])
def test_side_by_side_each_ends_where_it_ends_alone(free: list[str]) -> None:
    """Also where something else is free, and every fit goes alone."""
    start = fitted(identify(FRIEND, runs(), free=free))
    assert (start.beside is not None) == (len(free) == 1)
    given = shifts(start, 70)
    found = fits_again(start, given, len(given), Here())
    for place in (0, 1, 63, 64, 69):
        theta = found[place]
        assert theta is not None
        np.testing.assert_allclose(theta, alone(start, given[place]), rtol=0.0, atol=1e-9)


def test_with_a_leak_of_each_run_they_go_side_by_side_too() -> None:
    start = fitted(identify(FRIEND, runs(), per_run=["circuit.dc_resistivity"]))
    assert start.beside is not None
    given = shifts(start, 3)
    for theta, shift in zip(fits_again(start, given, 3, Here()), given, strict=True):
        assert theta is not None
        np.testing.assert_allclose(theta, alone(start, shift), rtol=0.0, atol=1e-9)


def test_readings_that_lie_far_off_are_searched_alone(fit: Fit) -> None:
    """Gauss-Newton steps lead out of bounds there, and another search goes on."""
    start = fitted(fit)
    beside = start.beside
    assert beside is not None
    far = -start.here.residual + 4000.0 * np.sin(np.arange(start.here.residual.size) / 700.0)
    ended = beside.polished(start.theta, far[None]).ended
    found = fits_again(start, [far], 1, Here())[0]
    if not ended[0] and found is not None:
        np.testing.assert_allclose(found, alone(start, far), rtol=0.0, atol=1e-9)


def test_it_finds_other_strips(fit: Fit) -> None:
    """And, given the readings of the fit itself, the fit."""
    strips = [FRIEND.replace(**{ELECTRICAL[0]: FRIEND[ELECTRICAL[0]] * by}) for by in (0.8, 1.0, 1.3)]
    other = [[simulate(strip, run).current for strip in strips] for run in runs()]
    found = refit(fit, [{"current": np.array(one)} for one in other])
    assert len(found) == 3
    assert found.converged.all()
    for name in ELECTRICAL:
        np.testing.assert_allclose(found[name], [strip[name] for strip in strips], rtol=1e-6)
    same = refit(fit, [{"current": run.current} for run in runs()])
    for name in ELECTRICAL:
        assert same[name][0] == pytest.approx(fit.parameters[name].value, rel=1e-6)


def test_the_slope_of_a_sensor_is_that_of_the_new_readings() -> None:
    """What their rows at 0 V show, not what those of the fit did."""
    signal, rows = "step 1 V delay=4 s", 500
    clean = simulate(FRIEND, signal, duration=50.0, rate=10.0)
    assert clean.current is not None
    drift = 2e-5 * clean.time + NOISE * np.random.default_rng(SEED).standard_normal(rows)
    fit = identify(FRIEND, replace(clean, current=clean.current + drift))
    assert any(zero.terms.trend and zero.rest.error < np.inf for zero in fitted(fit).problem.zeros.values())  # type: ignore[attr-defined]
    leaks = [40.0, 50.0]
    others = simulate_many(FRIEND, signal, {ELECTRICAL[-1]: leaks}, duration=50.0, rate=10.0)["current"]
    others = others + np.array([[0.0], [-5e-5]]) * clean.time
    assert refit(fit, [{"current": others}])[ELECTRICAL[-1]] == pytest.approx(leaks, rel=1e-4)


def test_rows_that_the_fit_did_not_use_may_hold_anything() -> None:
    first, second = runs()
    assert first.current is not None
    gap = np.array(first.current)
    gap[100:140] = np.nan
    fit = identify(FRIEND, [replace(first, current=gap), second])
    found = refit(fit, [{"current": gap}, {"current": second.current}])
    for name in ELECTRICAL:
        assert found[name][0] == pytest.approx(fit.parameters[name].value, rel=1e-6)


def test_of_no_readings_there_is_no_value_of_each_parameter(fit: Fit) -> None:
    none = [{"current": np.zeros((0, len(record.run.time)))} for record in fitted(fit).problem.records]
    assert {name: values.shape for name, values in refit(fit, none).values.items()} == dict.fromkeys(ELECTRICAL, (0,))


def test_a_branch_that_became_the_slower_one_is_called_so() -> None:
    """Where one branch alone is free it has the other's name there, and a fit that calls it otherwise has none."""
    time = 0.1 * np.arange(200)
    fast, slow = "circuit.branches.0.permittivity", "circuit.branches.1.permittivity"
    current = simulate_many(FRIEND, "step 1 V", {fast: [0.12, 60.0]}, duration=20.0, rate=10.0)["current"]
    run = Run.from_arrays(time=time, voltage=np.ones(200), current=current[0])
    found = refit(identify(FRIEND, run, free=fast), [{"current": current}])
    assert found[fast] == pytest.approx([0.12, np.nan], rel=1e-6, nan_ok=True)
    assert found[slow] == pytest.approx([np.nan, 60.0], rel=1e-6, nan_ok=True)


@pytest.mark.parametrize(
    ("readings", "code"),
    [
        ([], "unequal-lengths"),
        ([{"current": np.zeros(2000)}, {}], "missing-readings"),
        ([{"current": np.zeros(2000)}, {"current": np.zeros(1999)}], "unequal-lengths"),
        ([{"current": np.zeros((2, 2000))}, {"current": np.zeros((3, 2000))}], "unequal-lengths"),
        ([{"current": np.full(2000, np.nan)}, {"current": np.zeros(2000)}], "bad-readings"),
    ],
)
def test_readings_that_do_not_belong_to_the_runs_are_refused(fit: Fit, readings: list, code: str) -> None:
    rows = [len(record.run.time) for record in fitted(fit).problem.records]
    given = [{k: _as_long(v, n) for k, v in one.items()} for one, n in zip(readings, rows, strict=False)]
    with pytest.raises(InputError) as caught:
        refit(fit, given)
    assert caught.value.code == code


def _as_long(values: np.ndarray, rows: int) -> np.ndarray:
    """2000 stands for as many rows as the run has."""
    lost = 2000 - values.shape[-1]
    return np.full((*values.shape[:-1], rows - lost), values.flat[0])


def test_a_step_of_each_is_that_of_least_squares() -> None:
    generator = np.random.default_rng(SEED)
    rows = generator.standard_normal((3, 5, 40))  # four derivatives and the residual of each
    steps, expected = _steps(rows @ rows.transpose(0, 2, 1))
    for one, step, gain in zip(rows, steps, expected, strict=True):
        wanted = -np.linalg.lstsq(one[:-1].T, one[-1], rcond=None)[0]
        left = one[-1] + wanted @ one[:-1]
        assert step == pytest.approx(wanted)
        assert gain == pytest.approx(one[-1] @ one[-1] - left @ left)
