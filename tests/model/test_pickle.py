"""An actuator is its fields: whatever was worked out from it, it can be sent to another process."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from ipmclab import Actuator, identify, load_actuator, simulate
from ipmclab.model import library_names, sensitivities
from ipmclab.model.variants import stage_names

VARIANTS = [f"friend-2+leak.cubic+{one}" if one == "leak.slow" else f"friend-2+{one}" for one in stage_names()]
VOLTAGE = 2.5 * np.sin(0.6 * np.arange(60))


def used(name: str) -> Actuator:
    """An actuator that everything was asked of that keeps something with it."""
    actuator = load_actuator(name)
    for hold in ("zero", "zero-before", "first"):
        simulate(actuator, VOLTAGE, duration=1.2, rate=50, hold=hold)
        actuator.simulator(50, hold).block(VOLTAGE)
    sensitivities(actuator, ["coupling.gain"], np.arange(60) / 50, VOLTAGE, "zero")
    return actuator


def assert_same_answers(one: Actuator, other: Actuator) -> None:
    assert (one.name, one.parameter_values, one.sample) == (other.name, other.parameter_values, other.sample)
    for hold in ("zero", "first"):
        runs = [simulate(each, VOLTAGE, duration=1.2, rate=50, hold=hold) for each in (one, other)]
        for output in ("current", "applied_voltage", "displacement", "force"):
            np.testing.assert_array_equal(*(getattr(run, output) for run in runs))
        np.testing.assert_array_equal(*(each.simulator(50, hold).block(VOLTAGE) for each in (one, other)))


@pytest.mark.parametrize("name", [*library_names(), *VARIANTS])
def test_an_actuator_that_was_used_can_be_pickled_and_answers_the_same(name: str) -> None:
    actuator = used(name)
    assert_same_answers(actuator, pickle.loads(pickle.dumps(actuator)))
    assert_same_answers(actuator, copy.deepcopy(actuator))


def test_what_travels_is_no_larger_after_use() -> None:
    fresh = load_actuator("friend-2+leak.exponential")
    assert len(pickle.dumps(used(fresh.name))) == len(pickle.dumps(fresh))


def test_a_fitted_actuator_can_be_pickled() -> None:
    strip = load_actuator("friend-2+leak.cubic")
    run = simulate(strip, "square 2 V 0.5 Hz", duration=4, rate=50)
    start = strip.replace(**{"coupling.gain": 1.1 * strip["coupling.gain"]})
    fit = identify(start, run, free=["coupling.gain"])
    again = pickle.loads(pickle.dumps(fit.actuator))
    assert_same_answers(fit.actuator, again)
    assert again.fit_table == fit.actuator.fit_table
    np.testing.assert_allclose(again["coupling.gain"], strip["coupling.gain"], rtol=1e-6)
