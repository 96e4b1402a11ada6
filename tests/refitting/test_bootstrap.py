"""The bootstrap against the Cramer-Rao bound, and against intervals that know the noise."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import (
    InputError,
    IpmclabError,
    Run,
    RunMetadata,
    bootstrap,
    identify,
    load_actuator,
    read_fit,
    simulate,
    write_fit,
)
from ipmclab.fit.fit import Fit
from ipmclab.refitting.bootstrap import Bootstrap
from tests.independent.bounds import ELECTRICAL, noisy_current, relative_errors, step_and_sine
from tests.independent.thesis import FRIEND_2

SEED = 20261121
NOISE = 1e-4
FRIEND = load_actuator("friend-2")


def runs() -> list[Run]:
    """A step and a sine of 2,000 rows."""
    generator = np.random.default_rng(SEED)
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


def test_the_scatter_is_the_cramer_rao_bound(fit: Fit) -> None:
    """Of 1,000 draws a standard deviation is known to 2.2 %: 10 % are four and a half of its own."""
    found = bootstrap(fit, 1000)
    bound = relative_errors(FRIEND_2, step_and_sine(), NOISE)
    assert found.failed == 0
    for name in ELECTRICAL:
        assert len(found.samples[name]) == 1000
        assert found.standard_errors[name] / fit.parameters[name].value == pytest.approx(bound[name], rel=0.1), name
        low, high = found.intervals[name]
        assert high - low == pytest.approx(2 * 1.96 * bound[name] * fit.parameters[name].value, rel=0.12), name


def test_under_correlated_noise_it_scatters_as_far_as_the_intervals_say() -> None:
    generator = np.random.default_rng([SEED, 1])
    coloured = []
    for run in runs():
        walk = np.zeros(len(run))
        for row in range(1, len(run)):
            walk[row] = 0.9 * walk[row - 1] + NOISE * generator.standard_normal()
        assert run.current is not None
        coloured.append(replace(run, current=run.current + walk))
    fit = identify(FRIEND, coloured)
    found = bootstrap(fit, 300)
    for name, parameter in fit.parameters.items():
        low, high = parameter.interval
        ends = found.intervals[name]
        # The interval also counts that the noise is not known exactly.
        assert 0.8 < (ends[1] - ends[0]) / (high - low) < 1.15, name


def test_the_same_seed_draws_the_same(fit: Fit) -> None:
    one, other = bootstrap(fit, 50), bootstrap(fit, 50)
    for name in ELECTRICAL:
        np.testing.assert_array_equal(one.samples[name], other.samples[name])
    assert bootstrap(fit, 50, seed=1).samples[ELECTRICAL[0]][0] != one.samples[ELECTRICAL[0]][0]


def test_what_is_open_has_no_interval_here_either() -> None:
    found = bootstrap(identify(FRIEND, runs(), free=["electrical", "circuit.sheet_resistance"]), 40)
    assert set(found.standard_errors.values()) == {np.inf}
    assert set(found.intervals.values()) == {(0.0, np.inf)}


def test_it_is_told_in_a_line_for_each_parameter() -> None:
    intervals = {"circuit.dc_resistivity": (1.0, 2.0), "coupling.gain": (3.0, 4.0)}
    found = Bootstrap({name: np.zeros(40) for name in intervals}, intervals, dict.fromkeys(intervals, 0.1), failed=1)
    assert str(found).splitlines() == [
        "Bootstrap of 40 fits, 1 failed",
        "  circuit.dc_resistivity  1 to 2",
        "  coupling.gain           3 to 4",
    ]


def test_where_an_edge_lies_between_its_rows_errors_are_as_far_off_as_the_fit_says() -> None:
    """What rows confine is off by no more for noise that lasts: the fit said 1.5 times as much as it scatters."""
    fast = "circuit.branches.0.permittivity"
    for later in (8, 16):  # twentieths of a period after the edges
        clean = simulate(FRIEND, "step 1 V delay=1 s", duration=20.1, rate=500.0)
        assert clean.current is not None
        rows = 20 * np.arange(500)
        noise = NOISE * np.random.default_rng([SEED, later]).standard_normal(500)
        record = Run.from_arrays(
            time=0.04 * np.arange(500),
            voltage=clean.voltage[rows],
            current=clean.current[rows + later] + noise,
            hold="unknown",
            metadata=RunMetadata(starts_from_rest=True),
        )
        fit = identify(FRIEND, record, free="electrical")
        assert fit.parameters[fast].standard_error < 1.3 * bootstrap(fit, 60).standard_errors[fast]


def test_too_few_draws_and_a_fit_from_a_file_are_refused(fit: Fit, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="39 draws") as caught:
        bootstrap(fit, 39)
    assert caught.value.code == "out-of-range"
    write_fit(fit, tmp_path / "fit.toml")
    with pytest.raises(InputError, match="identify again"):
        bootstrap(read_fit(tmp_path / "fit.toml"))


def test_what_is_left_of_draws_that_failed_must_be_enough_too(fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 21 fits no 95 % interval is told, as little as of 21 draws."""
    module = importlib.import_module("ipmclab.refitting.bootstrap")
    whole = module.fits_again
    monkeypatch.setattr(module, "fits_again", lambda *given: [*whole(*given)[:21], *19 * [None]])
    with pytest.raises(IpmclabError, match="19 of 40 fits to drawn readings failed, and 21 do not give") as caught:
        bootstrap(fit, 40)
    assert (caught.value.code, caught.value.exit_status) == ("too-few-draws", 1)
