"""Profiles of the likelihood, against fits with a parameter fixed and against closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import scipy.optimize

from ipmclab import InputError, Run, RunMetadata, identify, load_actuator, profile, read_fit, simulate, write_fit
from ipmclab.fit.fit import Fit
from ipmclab.refitting.profiles import flat_within
from ipmclab.reporting.figures.profiles import profiles_figure
from tests.independent.bounds import ELECTRICAL, current_of, log_parameters_of, strip_of
from tests.independent.thesis import FRIEND_2

SEED = 20261121
NOISE = 1e-4
FRIEND = load_actuator("friend-2")
SHEET = "circuit.sheet_resistance"
RHO_1 = "circuit.branches.0.resistivity"
DC = "circuit.dc_resistivity"


def record(signal: str = "step 1 V", duration: float = 20.0, rate: float = 50.0) -> Run:
    """The current of friend-2 with 0.1 mA of noise."""
    clean = simulate(FRIEND, signal, duration=duration, rate=rate)
    assert clean.current is not None
    noise = NOISE * np.random.default_rng([SEED, len(signal)]).standard_normal(len(clean))
    rest = RunMetadata(starts_from_rest=True)
    return Run.from_arrays(
        time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="zero", metadata=rest
    )


@pytest.fixture(scope="module")
def fit() -> Fit:
    """The electrical parameters from a step, with all profiles."""
    return profile(identify(FRIEND, record(), free="electrical"))


def least_squares_with(place: int | None, value: float) -> float:
    """The least sum of squares of the step, by another simulation and a plain search; one parameter may be held."""
    run = record()
    assert run.current is not None
    current = run.current
    start = log_parameters_of(FRIEND_2)
    moved = [k for k in range(len(start)) if k != place]

    def residuals(entries: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        point = start.copy()
        point[moved] = entries
        if place is not None:
            point[place] = np.log(value)
        answer = current_of(strip_of(point), run.time, run.voltage)
        return np.asarray((answer - current) / NOISE)

    found = scipy.optimize.least_squares(residuals, start[moved], x_scale="jac", diff_step=1e-6)
    return 2.0 * float(found.cost)


@pytest.mark.parametrize("name", [RHO_1, DC])
def test_a_profile_is_the_excess_of_fits_with_the_parameter_held(fit: Fit, name: str) -> None:
    one = fit.profiles[name]
    least = least_squares_with(None, 0.0)
    variance = least / (1000 - 5)
    for value, excess in list(zip(one.values, one.excess, strict=True))[:: len(one.values) - 1]:
        held = least_squares_with(ELECTRICAL.index(name), value)
        assert excess == pytest.approx((held - least) / variance, rel=0.02)


def test_where_the_likelihood_is_a_parabola_the_profile_gives_the_same_interval(fit: Fit) -> None:
    for name, one in fit.profiles.items():
        low, high = fit.parameters[name].interval
        assert one.interval == pytest.approx((low, high), abs=0.02 * (high - low))
        assert one.is_open == (False, False)
        assert min(one.excess) == 0.0
        assert list(one.values) == sorted(one.values)
        assert one.values[0] < low < high < one.values[-1]


def test_a_series_resistance_is_bounded_by_what_stands_behind_it_and_open_below() -> None:
    """Behind a series resistance of 1/Y(infinity), which current shows, no branch is left; behind less, some are."""
    found = profile(identify(FRIEND, [record(), record("sine 1 V 0.1 Hz")], free=["electrical", SHEET]), [SHEET])
    (one,) = found.profiles.values()
    assert one.is_open == (True, False)
    assert one.interval[0] == 0.0
    length = FRIEND["geometry.free_length"] + FRIEND["geometry.clamped_length"]
    scale = length * FRIEND["geometry.width"] / FRIEND["geometry.thickness"]
    behind = sum(scale / FRIEND[f"circuit.branches.{i}.resistivity"] for i in range(2)) + scale / FRIEND[DC]
    largest = (2.0 * FRIEND[SHEET] * length / FRIEND["geometry.width"] + 1.0 / behind) / (
        2.0 * length / FRIEND["geometry.width"]
    )
    assert one.interval[1] == pytest.approx(largest, rel=2e-3)


def test_what_a_short_fast_run_does_not_show_is_open_on_both_sides_or_one(tmp_path: Path) -> None:
    fit = profile(identify(FRIEND, record("sine 1 V 2 Hz", duration=5.0, rate=100.0), free="electrical"))
    assert any(fit.profiles[DC].is_open)
    assert fit.profiles[DC].interval[1] == np.inf
    write_fit(fit, tmp_path / "fit.toml")
    again = read_fit(tmp_path / "fit.toml")
    assert again.profiles == fit.profiles
    assert again.practical == fit.practical
    with pytest.raises(InputError, match="read from a file") as caught:
        profile(again)
    assert caught.value.code == "fit-without-readings"
    assert caught.value.repair


@pytest.fixture(scope="module")
def slow_rows() -> Fit:
    """Of few and noisy rows: other minima are as good, and nothing is altogether open."""
    clean = simulate(FRIEND, "step 1 V delay=1 s", duration=20.0, rate=5.0)
    assert clean.current is not None
    noise = 1e-3 * np.random.default_rng(3).standard_normal(len(clean))
    rest = RunMetadata(starts_from_rest=True)
    run = Run.from_arrays(
        time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="zero", metadata=rest
    )
    return profile(identify(FRIEND, run, free="electrical"))


def inside(fit: Fit, name: str) -> list[float]:
    """Excess of chi-square at the values of a profile that lie well within the interval, as a part of the threshold."""
    one = fit.profiles[name]
    low, high = fit.parameters[name].interval
    values = zip(one.values, one.excess, strict=True)
    edge = 0.1 * (high - low)
    return [excess / one.threshold for value, excess in values if low + edge < value < high - edge]


def test_other_minima_as_good_do_not_make_every_value_between_as_good(slow_rows: Fit) -> None:
    low, high = slow_rows.parameters[DC].interval
    assert high > 4.0 * low  # from one minimum to the other
    open_ones = [
        name for name, one in slow_rows.parameters.items() if not one.determined and name in slow_rows.profiles
    ]
    assert "circuit.branches.1.permittivity" in open_ones
    assert slow_rows.rank == 5
    assert max(inside(slow_rows, DC)) > 0.25, "halfway the readings are explained noticeably worse"
    assert not any(flat_within(slow_rows, name) for name in (DC, *open_ones))


def test_along_an_open_direction_every_value_within_the_interval_is_as_good() -> None:
    six = profile(identify(FRIEND, [record(), record("sine 1 V 0.1 Hz")], free=["electrical", SHEET]), [SHEET, DC])
    assert flat_within(six, SHEET)
    assert flat_within(six, DC)
    assert max(inside(six, SHEET)) < 0.01


def test_no_interval_and_no_profile_ends_where_only_the_search_does() -> None:
    """What a parameter may at most be for the search (1e9 ohm m) is no number that readings gave."""
    fit = identify(FRIEND, record("sine 1 V 2 Hz", duration=5.0, rate=100.0), free="electrical")
    declared = FRIEND.parameters()
    for fitted in (fit, profile(fit)):
        for name, one in fitted.parameters.items():
            assert not {declared[name].lower, declared[name].upper} & {*one.interval}, name
    assert (0.0, np.inf) in [one.interval for one in fit.parameters.values()]


def test_under_correlated_noise_the_profile_widens_as_the_error_does() -> None:
    clean = record("step 1 V", duration=40.0)
    assert clean.current is not None
    generator = np.random.default_rng([SEED, 2])
    walk = np.zeros(len(clean))
    for row in range(1, len(clean)):
        walk[row] = 0.9 * walk[row - 1] + NOISE * generator.standard_normal()
    fit = profile(identify(FRIEND, replace(clean, current=clean.current + walk), free="electrical"))
    for name, one in fit.profiles.items():
        low, high = fit.parameters[name].interval
        assert one.interval == pytest.approx((low, high), abs=0.05 * (high - low)), name


def test_some_profiles_can_be_asked_for_and_their_progress_heard(fit: Fit) -> None:
    said: list[tuple[str, float]] = []
    some = profile(fit, [DC], progress=lambda sentence, done: said.append((sentence, done)))
    assert list(some.profiles) == [DC]
    assert said[0][0] == f"profile of {DC}"
    assert list(profile(fit, DC).profiles) == [DC]  # one name is no sequence of letters
    with pytest.raises(InputError, match="no parameter of this fit") as caught:
        profile(fit, ["circuit.dc"])
    assert DC in caught.value.repair


def test_the_figure_has_a_panel_for_each_profile(fit: Fit) -> None:
    figure = profiles_figure(fit)
    titles = [panel.get_title(loc="left") for panel in figure.axes if panel.get_visible()]
    assert titles == list(fit.profiles)
    for panel, one in zip(figure.axes, fit.profiles.values(), strict=False):
        low, high = panel.get_xlim()
        factor = FRIEND.parameters()[DC].quantity.to_display(1.0)  # every unit here is shown as it is
        assert factor == 1.0
        assert low < one.interval[0] < one.interval[1] < high
