"""Derivatives through a leak, by parameters, initial states and delay, against differences of the outputs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import load_actuator
from ipmclab.model import Actuator, sensitivities, simulate_outputs
from ipmclab.model.numerics.dense import law_parts
from ipmclab.model.numerics.timeline import divided, timeline
from ipmclab.model.ports import OUTPUTS
from ipmclab.model.sensitivity import Kept, Sensitivities
from tests import profiles
from tests.model import leaking

TIME = np.arange(60) / 50.0
VOLTAGE = 3.0 * np.sin(4.0 * TIME) + np.random.default_rng(20261121).normal(scale=0.3, size=60)

STRIPS = {
    "exponential": "friend-2+leak.exponential",
    "cubic": "friend-2+leak.cubic",
    "slow": "friend-2+leak.butler_volmer+leak.slow",
    "clamp": "friend-2+leak.exponential+clamp+relaxation.displacement",
    "segments": "friend-2+leak.cubic+line.segments=3+relaxation.force",
}


def strip(name: str) -> Actuator:
    actuator = load_actuator(STRIPS[name])
    if name == "cubic":  # every term of it at work
        return actuator.replace(**{"leak.cubic.linear": 0.5, "leak.cubic.quadratic": 1.0})
    if name == "clamp":
        return actuator.replace(**{"circuit.contact_resistance": 2.0, "clamp.direct_share": 0.4})
    return actuator


def assert_close(ours: np.ndarray, differences: np.ndarray, size: np.ndarray, what: str, bound: float = 3e-6) -> None:
    """Within a part of the largest derivative, or of the outputs themselves where there is (nearly) none."""
    largest = np.maximum(np.max(np.abs(differences), axis=1), 1e-4 * size)
    worst = np.max(np.abs(ours - differences), axis=1) / largest
    assert np.all(worst < bound), (what, worst)


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("name", sorted(STRIPS))
def test_by_parameters_and_initial_states(name: str, hold: str) -> None:
    actuator = strip(name)
    state = np.random.default_rng(20261121).normal(scale=0.2, size=len(actuator.state_names))
    state[-2:] *= 1e-3
    freed = [
        parameter
        for parameter, about in actuator.parameters().items()
        if about.transform != "count" and not parameter.startswith(("beam.", "coupling."))
    ]
    delay = {"zero": 0.0071, "zero-before": -0.0043, "first": 0.0}[hold]

    def answer(changed: Actuator, begin: np.ndarray = state) -> np.ndarray:
        return simulate_outputs(changed, TIME, VOLTAGE, hold, initial_state=begin, delay=delay)

    found = sensitivities(actuator, freed, TIME, VOLTAGE, hold, initial_state=state, delay=delay)
    assert np.allclose(found.values, answer(actuator), rtol=1e-11, atol=1e-15)
    size = np.max(np.abs(found.values), axis=1)
    for index, parameter in enumerate(freed):
        value = actuator[parameter]
        step = 1e-5 * value or 1e-3
        if value:
            pair = [answer(actuator.replace(**{parameter: value + sign * step})) for sign in (1.0, -1.0)]
            differences = (pair[0] - pair[1]) / (2.0 * step)
        else:
            ahead = [answer(actuator.replace(**{parameter: part * step})) for part in (0.0, 1.0, 2.0)]
            differences = (4.0 * ahead[1] - 3.0 * ahead[0] - ahead[2]) / (2.0 * step)
        assert_close(found.parameters[:, :, index], differences, size / (value or 1.0), parameter)
    for index, state_name in enumerate(actuator.state_names):
        step = 1e-5 * (1e-3 if state_name.startswith("beam.") else 1.0)
        moved = np.zeros(len(state))
        moved[index] = step
        differences = (answer(actuator, state + moved) - answer(actuator, state - moved)) / (2.0 * step)
        assert_close(found.states[:, :, index], differences, size, state_name)


@pytest.mark.parametrize("from_rest", [True, False])
@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("name", ["exponential", "slow", "segments"])
def test_by_the_delay(name: str, hold: str, from_rest: bool) -> None:
    actuator = strip(name)
    state = None if from_rest else np.full(len(actuator.state_names), 1e-3)

    def answer(delay: float) -> np.ndarray:
        return simulate_outputs(actuator, TIME, VOLTAGE, hold, initial_state=state, delay=delay)

    step = 1e-6
    for delay in (0.0071, -0.0043, 0.043):
        found = sensitivities(actuator, [], TIME, VOLTAGE, hold, initial_state=state, delay=delay)
        differences = (answer(delay + step) - answer(delay - step)) / (2.0 * step)
        assert_close(found.delay, differences, np.max(np.abs(found.values), axis=1), f"{delay}", bound=1e-5)
    if hold == "first":
        return
    # An edge on each row: the reading does not jump on the side on which the edge stays before (or behind) its row.
    found = sensitivities(actuator, [], TIME, VOLTAGE, hold, initial_state=state)
    side = -step if hold == "zero" else step
    differences = (4.0 * answer(side) - 3.0 * answer(0.0) - answer(2.0 * side)) / (2.0 * side)
    assert_close(found.delay, differences, np.max(np.abs(found.values), axis=1), "0", bound=1e-5)


def test_long_intervals_are_divided_with_their_derivatives() -> None:
    actuator = strip("exponential")
    time, names = np.cumsum([0.0, 0.3, 0.05, 0.01, 0.4, 0.21]), ["leak.exponential.threshold", "circuit.dc_resistivity"]
    voltage = np.array([3.0, 3.0, -2.0, 1.0, 2.5, 2.5])

    def answer(changed: Actuator, delay: float = 0.02) -> np.ndarray:
        return simulate_outputs(changed, time, voltage, "first", delay=delay)

    found = sensitivities(actuator, names, time, voltage, "first", delay=0.02)
    size = np.max(np.abs(found.values), axis=1)
    for index, name in enumerate(names):
        value, step = actuator[name], 1e-5 * actuator[name]
        pair = [answer(actuator.replace(**{name: value + sign * step})) for sign in (1.0, -1.0)]
        assert_close(found.parameters[:, :, index], (pair[0] - pair[1]) / (2.0 * step), size / value, name)
    differences = (answer(actuator, 0.02 + 1e-6) - answer(actuator, 0.02 - 1e-6)) / 2e-6
    assert_close(found.delay, differences, size, "delay", bound=1e-5)


def test_by_an_amplitude_that_is_zero() -> None:
    """What a search starts from: the derivative by the current density of a leak that is switched off."""
    actuator = load_actuator("friend-2+leak.exponential").replace(**{"leak.exponential.current_density": 0.0})
    name, step = "leak.exponential.current_density", 1e-4
    found = sensitivities(actuator, [name], TIME, VOLTAGE, "zero")
    ahead = [
        simulate_outputs(actuator.replace(**{name: part * step}), TIME, VOLTAGE, "zero") for part in (0.0, 1.0, 2.0)
    ]
    differences = (4.0 * ahead[1] - 3.0 * ahead[0] - ahead[2]) / (2.0 * step)
    assert_close(found.parameters[:, :, 0], differences, np.max(np.abs(found.values), axis=1), name)


def test_only_what_the_chosen_outputs_see_is_carried() -> None:
    """Some outputs alone give what all of them give, with nothing by the states that they do not see."""
    actuator = strip("clamp")
    names = ["leak.exponential.voltage_scale", "coupling.gain", "relaxation.displacement.0.ratio"]
    every = sensitivities(actuator, names, TIME, VOLTAGE, "zero", initial_state=np.zeros(len(actuator.state_names)))
    for outputs, places in ((["current"], [0]), (["force", "applied_voltage"], [3, 1])):
        some: Sensitivities = sensitivities(
            actuator, names, TIME, VOLTAGE, "zero", outputs=outputs, initial_state=np.zeros(len(actuator.state_names))
        )
        for part in ("values", "parameters", "states", "delay"):
            ours, expected = getattr(some, part), getattr(every, part)[places]
            assert ours.shape == expected.shape
            scale = np.max(np.abs(expected), axis=(1), keepdims=True)
            assert np.all(np.abs(ours - expected) <= 1e-11 * scale + 1e-18), (outputs, part)
    beam = [index for index, name in enumerate(actuator.state_names) if name.startswith("beam.")]
    assert not np.any(every.states[0][:, beam])


DRAWN = (
    "friend-2+leak.exponential",
    "friend-2+branches=3+leak.exponential",
    "friend-2+leak.cubic+relaxation.displacement",
    "friend-2+branches=1+leak.butler_volmer+leak.slow",
    "friend-2+leak.exponential+clamp",
    "friend-2+leak.butler_volmer+line.segments=3",
)

UNCHANGED = ("geometry.", "clamp.")


@profiles.costly(4)
@given(data=st.data())
def test_against_the_same_recursion_in_complex_numbers(data: st.DataObject) -> None:
    """Values and derivatives by parameters, to ten digits of the largest."""
    seed = data.draw(st.integers(0, 2**32), label="seed")
    random = np.random.default_rng(seed)
    actuator = load_actuator(data.draw(st.sampled_from(DRAWN), label="strip"))
    names = [name for name, about in actuator.parameters().items() if about.transform != "count"]
    changed = {name: actuator[name] * random.uniform(0.7, 1.3) for name in names if not name.startswith(UNCHANGED)}
    for name in names:  # laws that give much, from a voltage that a node has in a few rows
        if name.endswith(("current_density", ".cubic")):
            changed[name] *= 10.0 ** random.uniform(0.0, 3.0)
        elif name.endswith(".threshold"):
            changed[name] *= random.uniform(0.1, 1.0)
        elif name.endswith((".linear", ".quadratic")):
            changed[name] = random.uniform(0.0, 50.0)
    actuator = actuator.replace(**changed)
    hold = data.draw(st.sampled_from(["zero", "zero-before", "first"]), label="hold")
    delay = data.draw(st.sampled_from([0.0, 0.004, -0.013]), label="delay")
    rate = data.draw(st.sampled_from([25.0, 50.0, 400.0]), label="rate")
    at_rest = data.draw(st.booleans(), label="at rest")
    outputs = data.draw(st.sampled_from([("current",), ("displacement", "current")]), label="outputs")
    rows = 16
    time = (np.arange(rows) + data.draw(st.sampled_from([0.0, 0.2])) * random.uniform(-1.0, 1.0, rows)) / rate
    voltage = np.repeat(random.uniform(-4.0, 4.0, rows), random.integers(1, 4, rows))[:rows]
    count = len(actuator.state_names)
    state = None if at_rest else np.append(random.normal(scale=0.3, size=count - 2), [1e-4, -1e-3])
    found = sensitivities(actuator, names, time, voltage, hold, outputs=outputs, initial_state=state, delay=delay)

    line = timeline(time, voltage, hold, delay=delay, from_rest=at_rest)
    line = divided(line, law_parts(line.durations))
    begin = np.zeros(count) if state is None else state
    places = [OUTPUTS.index(name) for name in outputs]
    values, moved = leaking.outputs(actuator, names, line, begin)
    values, moved = values[places], moved[:, places].transpose(1, 2, 0)
    size = np.max(np.abs(values), axis=1)
    assert np.all(np.max(np.abs(found.values - values), axis=1) < 1e-11 * size)
    scaled = np.array([actuator[name] or 1.0 for name in names])
    largest = np.maximum(np.max(np.abs(moved), axis=1), 1e-2 * size[:, None] / scaled)
    worst = np.max(np.abs(found.parameters - moved), axis=1) / largest
    assert np.all(worst < 1e-10), dict(zip(names, worst.max(axis=0), strict=True))


def test_what_one_record_has_left_is_not_seen_by_the_next() -> None:
    """Rooms that loops write on are kept from record to record, which may be shorter or longer."""
    actuator, kept = strip("segments"), Kept()
    names = ["leak.cubic.cubic", "circuit.dc_resistivity"]
    for rows in (60, 17, 60):
        for outputs in (["current"], ["force", "current"]):
            own = TIME[:rows], VOLTAGE[:rows]
            again = sensitivities(actuator, names, *own, "zero", outputs=outputs, kept=kept)
            alone = sensitivities(actuator, names, *own, "zero", outputs=outputs)
            assert np.array_equal(again.values, alone.values)
            assert np.array_equal(again.parameters, alone.parameters)
