"""The virtual bench against the strip of the thesis's equations, read through the sensors of its chapter 3."""

from __future__ import annotations

import numpy as np
import pytest

import ipmclab
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.virtual import VirtualBench
from tests.independent.thesis import FRIEND_2, respond

RATE = 50.0
MEASURED = {"force": ("current", "force"), "displacement": ("current", "displacement")}


def bench(strip_changes: dict[str, float] | None = None, seed: int = 20261121) -> VirtualBench:
    actuator = ipmclab.load_actuator("friend-2")
    return VirtualBench(actuator.replace(**(strip_changes or {})), seed=seed)


def expected(signal: str, rows: int) -> dict[str, np.ndarray]:
    """What the strip does behind the 1 ohm shunt when the output changes just after each reading."""
    from ipmclab import signals

    commanded = signals.parse(signal).voltage(np.arange(rows) / RATE)
    held = np.concatenate([[0.0], commanded[:-1]])  # row k is read before the output takes its value
    behind = respond(FRIEND_2.changed(contact_resistance=1.0), held, RATE, "zero-before")
    return {"voltage": held, **behind}


@pytest.mark.parametrize("signal", ["step 1 V", "sine 1 V 0.1 Hz"])
@pytest.mark.parametrize("mechanical", list(MEASURED))
def test_a_record_is_the_strip_behind_its_shunt(signal: str, mechanical: str) -> None:
    run = record(bench(), signal, duration=40.0, rate=RATE, measured=MEASURED[mechanical])
    truth = expected(signal, 2000)
    assert run.hold == "zero-before"
    assert len(run) == 2000
    assert run.metadata.origin == "virtual bench"
    assert run.metadata.shunt_resistance == pytest.approx(1.0)
    upstream = run.metadata.voltage_sensed == "upstream of shunt"
    seen = truth["voltage"] if upstream else truth["voltage"] - 1.0 * truth["current"]
    assert np.max(np.abs(run.voltage - seen)) < 2e-3
    for channel, allowed in (("current", 1e-4), (mechanical, 1e-4 if mechanical == "force" else 5e-6)):
        error = getattr(run, channel) - truth[channel]
        assert abs(np.mean(error)) < 0.1 * allowed, channel
        assert np.std(error) < 1.1 * allowed, channel


def test_force_noise_is_that_of_the_load_cell() -> None:
    run = record(bench(), "step 1 V", duration=40.0, rate=RATE)
    truth = expected("step 1 V", 2000)
    assert np.std(run.force - truth["force"]) == pytest.approx(1e-4, rel=0.1)


def test_the_converter_has_16_bits() -> None:
    run = record(bench(), "sine 1 V 0.1 Hz", duration=40.0, rate=RATE)
    assert run.current is not None
    steps = np.diff(np.unique(np.round(run.current, 12)))
    step = steps[steps > 1e-12].min()
    low, high = run.metadata.ranges["current"]
    assert (high - low) / step == pytest.approx(2**16, rel=0.01)


def test_the_same_seed_gives_the_same_record_and_another_seed_another() -> None:
    one, same, other = (record(bench(seed=seed), "step 1 V", duration=4.0, rate=RATE) for seed in (1, 1, 2))
    assert one.content_sha256 == same.content_sha256
    assert one.content_sha256 != other.content_sha256


def test_a_strong_strip_leaves_the_ranges_and_the_record_says_so() -> None:
    # A hundred times the coupling: some 50 mm and 170 mN, beyond 12.5 mm of laser and 98.07 mN of load cell.
    strong = {"coupling.gain": 100 * FRIEND_2.gain}
    force = record(bench(strong), "step 1 V", duration=20.0, rate=RATE)
    assert force.force is not None
    assert np.nanmax(force.force) < 98.07e-3 * 1.05
    top = np.flatnonzero(expected("step 1 V", 1000)["force"] * 100 > 0.1)
    assert len(top)
    censored = np.zeros(len(force), dtype=bool)
    for finding in ipmclab.check(force):
        if finding.channel == "force" and finding.effect == "lower_bound":
            for first, stop in finding.samples:
                censored[first:stop] = True
    assert np.all(censored[top]), "a load cell at its end tells a lower bound"
    laser = record(bench(strong), "step 1 V", duration=20.0, rate=RATE, measured=MEASURED["displacement"])
    assert laser.displacement is not None
    lost = np.flatnonzero(expected("step 1 V", 1000)["displacement"] * 100 > 14e-3)
    assert np.all(np.isnan(laser.displacement[lost]))
    codes = {finding.code for finding in ipmclab.check(laser)}
    assert "laser-lost" in codes


def test_identification_of_bench_records_gives_friend_2_back() -> None:
    runs = [
        record(bench(seed=seed), signal, duration=40.0, rate=RATE)
        for seed, signal in ((1, "step 1 V"), (2, "sine 1 V 0.1 Hz"))
    ]
    start = ipmclab.load_actuator("friend-2").replace(
        **{f"circuit.branches.{i}.{name}": 1.0 for i in range(2) for name in ("resistivity", "permittivity")}
    )
    found = ipmclab.identify(start, runs, free=["electrical"])
    for name, truth in FRIEND_2.dotted().items():
        if name in found.parameters:
            parameter = found.parameters[name]
            assert abs(parameter.value - truth) < 4.0 * parameter.standard_error, name
            assert parameter.standard_error < 0.02 * parameter.value, name
    # Predicted from rest at the node behind the shunt, the record of another signal is met to its noise.
    square = record(bench(seed=3), "square 1 V 0.1 Hz", duration=40.0, rate=RATE)
    scores = ipmclab.validate(found.actuator, [square]).scores
    assert scores["current"].rmse < 2e-5
    assert scores["force"].rmse < 1.1e-4


@pytest.mark.parametrize(
    ("signal", "options", "word"),
    [
        ("step 1 V", {"measured": ("current", "force", "displacement")}, "displacement"),
        ("step 1 V", {"measured": ("current", "torque")}, "torque"),
        ("step 100 V", {}, "100 V"),
        ("step 1 V", {"rate": -50.0}, "rate"),
    ],
)
def test_requests_that_the_bench_cannot_meet(signal: str, options: dict[str, object], word: str) -> None:
    with pytest.raises(ipmclab.InputError) as caught:
        record(bench(), signal, **{"duration": 2.0, "rate": RATE, **options})  # type: ignore[arg-type]
    assert word in str(caught.value)
