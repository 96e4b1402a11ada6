"""Many simulations at once: each is what ``simulate`` and scipy's lsim say of it alone."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, load_actuator, signals, simulate, simulate_many
from ipmclab.model import OUTPUTS, Actuator, many, with_stages
from ipmclab.model.many import Responses
from tests.model.sets import ALONE, LANES, MANY, METRICS, RATE, rough, scattered
from tests.profiles import costly


def of_set(actuator: Actuator, parameters: dict[str, np.ndarray], k: int) -> Actuator:
    return actuator.replace(**{name: float(values[k]) for name, values in parameters.items()})


def assert_same(found: np.ndarray, expected: np.ndarray, within: float = 1e-12, least: float = 0.0) -> None:
    assert np.nanmax(np.abs(found - expected)) <= within * max(np.nanmax(np.abs(expected)), least)
    assert np.array_equal(np.isnan(found), np.isnan(expected))


@pytest.mark.parametrize(
    ("name", "hold"),
    [*((name, "first") for name in (*LANES, *ALONE)), ("friend-2", "zero"), ("friend-2", "zero-before")],
)
def test_each_set_is_simulated_as_if_alone(name: str, hold: str) -> None:
    actuator, sets = load_actuator(name), 5
    parameters = scattered(actuator, sets)
    found = simulate_many(actuator, rough(), parameters, hold=hold, **MANY)
    for k in range(sets):
        run = simulate(of_set(actuator, parameters, k), rough(), hold=hold, **MANY)
        for output in OUTPUTS:
            assert_same(found[output][k], run.channels[output])


def test_the_numbers_are_those_of_lsim() -> None:
    actuator = load_actuator("friend-2")
    parameters, volts = scattered(actuator, 40), rough() - rough()[0]
    found = simulate_many(actuator, volts, parameters, hold="first", **MANY)
    for k in (0, 31, 32, 39):
        _, expected, _ = scipy.signal.lsim(of_set(actuator, parameters, k).to_scipy(), volts, found.time)
        for place, output in enumerate(OUTPUTS):
            assert_same(found[output][k], expected[:, place], within=1e-9)


def test_poles_that_meet_are_poles_like_others() -> None:
    """The coupling's poles, equal but for a part of 0 to 1e-3: a sum over modes would lose digits."""
    actuator = load_actuator("friend-2")
    p1 = 2.0 * np.sqrt(actuator["coupling.p2"]) * (1.0 + np.array([0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3]))
    found = simulate_many(actuator, rough(), {"coupling.p1": p1}, **MANY)
    for k, value in enumerate(p1):
        run = simulate(actuator.replace(**{"coupling.p1": value}), rough(), **MANY)
        assert_same(found["displacement"][k], run.displacement)


@costly(6)
@given(
    sets=st.integers(1, 70),
    rate=st.sampled_from([0.05, 3.0, 200.0, 2_000.0]),
    hold=st.sampled_from(["zero", "zero-before", "first"]),
    by=st.sampled_from([0.0, 1e-6, 0.5]),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_number_of_sets_at_any_rate(sets: int, rate: float, hold: str, by: float, seed: int) -> None:
    actuator, random = load_actuator("friend-2"), np.random.default_rng(seed)
    names = [name for name in actuator.parameter_values if name.startswith(("circuit.", "coupling.", "beam."))]
    parameters = {name: actuator[name] * np.exp(by * random.normal(size=sets)) for name in names}
    volts = random.normal(size=50)
    found = simulate_many(actuator, volts, parameters, duration=50 / rate, rate=rate, hold=hold)
    k = int(random.integers(sets))
    alone = of_set(actuator, parameters, k)
    run = simulate(alone, volts, duration=50 / rate, rate=rate, hold=hold)
    for output in OUTPUTS:
        static = abs(complex(alone.frequency_response([0.0], [output])[0, 0])) * np.abs(volts).max()
        assert_same(found[output][k], run.channels[output], least=static)


def test_what_comes_beside_a_set_does_not_change_its_digits() -> None:
    actuator = load_actuator("friend-2")
    parameters = scattered(actuator, 100)
    whole = simulate_many(actuator, rough(), parameters, reduce=METRICS, **MANY)
    part = simulate_many(actuator, rough(), {n: v[37:40] for n, v in parameters.items()}, reduce=METRICS, **MANY)
    for name in METRICS:
        assert np.array_equal(whole[name][37:40], part[name])


@pytest.mark.parametrize("name", ["friend-2", "friend-2+leak.exponential"])
def test_metrics_are_those_of_the_trajectories(name: str) -> None:
    actuator, sets = load_actuator(name), 40 if name == "friend-2" else 4
    parameters = scattered(actuator, sets)
    found = simulate_many(actuator, rough(), parameters, reduce=METRICS, **MANY)
    kept = simulate_many(actuator, rough(), parameters, **MANY)
    for output in OUTPUTS:
        values = kept[output]
        rows = np.argmax(np.abs(values), axis=1)
        expected = {
            "final": values[:, -1],
            "mean": values.mean(axis=1),
            "rms": np.sqrt((values**2).mean(axis=1)),
            "maximum": values.max(axis=1),
            "minimum": values.min(axis=1),
            "peak": values[np.arange(sets), rows],
            "peak_time": rows / RATE,
        }
        for metric, numbers in expected.items():
            assert_same(found[f"{output}.{metric}"], numbers)


def test_a_function_is_given_blocks_and_no_trajectory_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    actuator = load_actuator("friend-2")
    parameters = scattered(actuator, 100)
    monkeypatch.setattr(many, "_BLOCK", 32)
    monkeypatch.setattr(many, "MOST_KEPT", 10)
    blocks: list[tuple[int, ...]] = []

    def swing(outputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        blocks.append(outputs["displacement"].shape)
        return {"swing": np.ptp(outputs["displacement"], axis=1), "ends": outputs["displacement"][:, [0, -1]]}

    found = simulate_many(actuator, rough(), parameters, outputs=["displacement"], reduce=swing, **MANY)
    named = simulate_many(
        actuator, rough(), parameters, reduce=["displacement.maximum", "displacement.minimum"], **MANY
    )
    assert_same(found["swing"], named["displacement.maximum"] - named["displacement.minimum"])
    assert found["ends"].shape == (100, 2)
    assert [shape[0] for shape in blocks] == [32, 32, 32, 4]
    with pytest.raises(InputError, match="values, 10 are kept at most; reduce them"):
        simulate_many(actuator, rough(), parameters, **MANY)


def test_one_voltage_for_each_set() -> None:
    actuator = load_actuator("friend-2")
    texts = ["step 1 V", "sine 2 V 0.5 Hz", "square 1 V 1 Hz"]
    found = simulate_many(actuator, texts, {"beam.modulus": [1e9, 1.2e9, 1.4e9]}, **MANY)
    for k, text in enumerate(texts):
        run = simulate(actuator.replace(**{"beam.modulus": [1e9, 1.2e9, 1.4e9][k]}), text, **MANY)
        for output in OUTPUTS:
            assert_same(found[output][k], run.channels[output])
    only_voltages = simulate_many(actuator, [signals.parse(text) for text in texts], **MANY)
    arrays = simulate_many(actuator, only_voltages.voltage, **MANY)
    assert len(only_voltages) == len(arrays) == 3
    assert np.array_equal(only_voltages["force"], arrays["force"])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"beam.modulos": [1e9]}, "did you mean 'beam.modulus'"),
        ({"beam.modulus": [1e9, -1.0]}, r"beam.modulus\[1\]: the value -1 Pa is outside"),
        ({"beam.modulus": [1e9, np.nan]}, r"beam.modulus\[1\]: the value nan"),
        ({"beam.modulus": [1e9, 2e9], "coupling.p1": [16.0, 17.0, 18.0]}, "3 values, and there are 2 sets"),
        ({"beam.modulus": []}, "give one number for each set, at least one"),
        ({"beam.modulus": ["stiff"]}, "not an array of numbers"),
        ({"geometry.sensing_length": [0.02, 0.03]}, "set 1: geometry.sensing_length: .*beyond the free length"),
    ],
)
def test_sets_that_cannot_be(parameters: dict[str, list[float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate_many(load_actuator("friend-2"), "step 1 V", parameters, **MANY)


def test_what_is_asked_wrongly_is_named() -> None:
    actuator = load_actuator("friend-2")
    with pytest.raises(InputError, match=r"did you mean 'displacement\.peak'"):
        simulate_many(actuator, "step 1 V", reduce=["displacement.peek"], **MANY)
    with pytest.raises(InputError, match="name each once"):
        simulate_many(actuator, "step 1 V", reduce=[], **MANY)
    with pytest.raises(InputError, match="leave outputs out"):
        simulate_many(actuator, "step 1 V", outputs=["force"], reduce="force.peak", **MANY)
    with pytest.raises(InputError, match=r"signals\[1\]"):
        simulate_many(actuator, ["step 1 V", "stop 1 V"], **MANY)
    with pytest.raises(InputError, match="3 values, and there are 2 sets"):
        simulate_many(actuator, ["step 1 V", "step 2 V"], {"beam.modulus": [1e9, 2e9, 3e9]}, **MANY)
    with pytest.raises(InputError, match="'swing' has shape"):
        simulate_many(actuator, "step 1 V", reduce=lambda outputs: {"swing": [1.0, 2.0]}, **MANY)
    with pytest.raises(InputError, match="returned a ndarray, not arrays by the same names"):
        simulate_many(actuator, "step 1 V", reduce=lambda outputs: outputs["force"].max(axis=1), **MANY)
    with pytest.raises(InputError, match=r"signals\[1\]\.voltage: the array has shape \(2,\)"):
        simulate_many(actuator, [rough(), [1.0, 2.0]], **MANY)
    with pytest.raises(InputError, match="outputs: no output is named"):
        simulate_many(actuator, "step 1 V", outputs=[], **MANY)
    with pytest.raises(InputError, match="unknown parameter 1"):
        simulate_many(actuator, "step 1 V", {1: [1e9]}, **MANY)  # type: ignore[dict-item]
    with pytest.raises(InputError, match="give load_actuator"):
        simulate_many("friend-2", "step 1 V", **MANY)
    found = simulate_many(actuator, "step 1 V", **MANY)
    assert isinstance(found, Responses)
    with pytest.raises(InputError, match="did you mean 'force'"):
        found["forse"]


def test_a_function_gives_the_same_names_for_each_block() -> None:
    names = iter(range(100))
    with pytest.raises(InputError, match=r"returned names \['1'\]"):
        simulate_many(
            load_actuator("friend-2"),
            "step 1 V",
            {"beam.modulus": np.linspace(1e9, 2e9, 2000)},
            reduce=lambda outputs: {str(next(names)): outputs["force"].max(axis=1)},
            **MANY,
        )


def test_sets_with_other_counts_go_one_by_one() -> None:
    strip = with_stages(load_actuator("friend-2"), "line.segments=4")
    found = simulate_many(strip, "step 1 V", {"line.segments": [3, 4, 6]}, duration=2.0, rate=50.0)
    for k, count in enumerate((3, 4, 6)):
        own = simulate(strip.replace(**{"line.segments": count}), "step 1 V", duration=2.0, rate=50.0)
        np.testing.assert_allclose(found["current"][k], own.current, rtol=1e-9)
