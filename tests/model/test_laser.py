"""What a laser at a fixed place reads of a strip of uniform curvature, against its shape."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Actuator, load_actuator
from ipmclab.model import sensitivities, simulate, simulate_outputs
from ipmclab.model.shape import shape
from ipmclab.model.stages.laser import Laser

STRIP = load_actuator("friend-2+laser").replace(**{"laser.range": 0.5}).parameter_values
LASER = Laser()


@pytest.mark.parametrize("laser_at", [0.021, 0.018, 0.012])
def test_the_reading_is_the_height_of_the_shape(laser_at: float) -> None:
    values = {**STRIP, "geometry.sensing_length": laser_at}
    length = values["geometry.free_length"]
    curvature = np.linspace(-1.3 / laser_at, 1.3 / laser_at, 53)
    read = LASER.reading(0.5 * curvature * laser_at**2, values)
    lost = LASER.lost(read.values, values)
    heights = np.array([shape([one] * 200, length).height_at(laser_at) for one in curvature])
    np.testing.assert_array_equal(lost, np.isnan(heights))
    np.testing.assert_allclose(read.values[~lost], heights[~lost], rtol=1e-9, atol=1e-15)
    assert np.all(np.diff(read.values) > 0)


def test_small_bending_reads_the_displacement() -> None:
    read = LASER.reading([0.0, 1e-6, -2e-5], STRIP)
    np.testing.assert_allclose(read.values, [0.0, 1e-6, -2e-5], rtol=1e-6)
    assert read.by_displacement[0] == 1.0


def test_a_laser_reads_no_further_than_its_range() -> None:
    values = {**STRIP, "laser.range": 4e-3}
    read = LASER.reading(np.linspace(0.0, 9e-3, 91), values).values
    lost = LASER.lost(read, values)
    assert LASER.last_reading(values) == pytest.approx(4e-3, rel=1e-12)
    np.testing.assert_array_equal(lost, read > 4e-3)
    assert read[~lost].max() > 3.9e-3


def test_derivatives() -> None:
    displacement = np.linspace(-12e-3, 12e-3, 41)
    step = 1e-8
    found = LASER.reading(displacement, STRIP)
    for name, slope in (("displacement", found.by_displacement), ("length", found.by_sensing_length)):
        if name == "displacement":
            ends = [LASER.reading(displacement + by, STRIP).values for by in (-step, step)]
        else:
            at = STRIP["geometry.sensing_length"]
            ends = [
                LASER.reading(displacement, {**STRIP, "geometry.sensing_length": at + by}).values
                for by in (-step, step)
            ]
        by_difference = (ends[1] - ends[0]) / (2.0 * step)
        inside = ~LASER.lost(found.values, STRIP) | (name == "displacement")
        np.testing.assert_allclose(slope[inside], by_difference[inside], rtol=1e-6, atol=1e-7)


def bends_far(stages: str = "laser") -> Actuator:
    """friend-2 with ten times the coupling: 6.25 mm at 1 V, and up to 9.4 mm at 1.5 V, which leaves the laser."""
    strip = load_actuator(f"friend-2+{stages}")
    return strip.replace(**{"coupling.gain": 10.0 * strip["coupling.gain"], "laser.range": 0.5})


@pytest.mark.parametrize("stages", ["laser", "leak.cubic+laser", "relaxation.displacement+laser"])
def test_a_run_holds_no_reading_where_the_strip_has_left_the_laser(stages: str) -> None:
    strip = bends_far(stages)
    bent = load_actuator("+".join(["friend-2", *stages.split("+")[:-1]]))
    bent = bent.replace(**{name: strip[name] for name in bent.parameter_values})
    signal = "square 2.4 V 0.05 Hz"
    run, small = (simulate(each, signal, duration=30.0, rate=20.0) for each in (strip, bent))
    assert run.displacement is not None
    assert small.displacement is not None
    length, laser_at = strip["geometry.free_length"], strip["geometry.sensing_length"]
    heights = [shape([2.0 * one / laser_at**2] * 60, length).height_at(laser_at) for one in small.displacement[::7]]
    np.testing.assert_array_equal(np.isnan(run.displacement[::7]), np.isnan(heights))
    np.testing.assert_allclose(run.displacement[::7], heights, rtol=1e-9)
    assert 10 < np.isnan(run.displacement).sum() < len(run) - 10
    for name in ("current", "applied_voltage", "force"):
        np.testing.assert_array_equal(run.channels[name], small.channels[name])
    stepped = strip.simulator(20.0)
    blocks = np.hstack([stepped.block(run.voltage[:123]), stepped.block(run.voltage[123:])])
    np.testing.assert_allclose(blocks[2], run.displacement, rtol=0, atol=1e-12)


def test_what_a_search_follows_is_finite_and_has_exact_derivatives() -> None:
    strip = bends_far()
    names = ["coupling.gain", "geometry.sensing_length", "circuit.dc_resistivity"]
    time = np.arange(0.0, 12.0, 0.2)
    volts = np.full_like(time, 2.4)
    found = sensitivities(strip, names, time, volts, "zero", outputs=["force", "displacement"], delay=0.05)
    values = simulate_outputs(strip, time, volts, "zero", outputs=["displacement"], delay=0.05)
    np.testing.assert_allclose(found.values[1], values[0], rtol=1e-12, atol=1e-18)
    assert np.all(np.isfinite(values))
    kept = ~LASER.lost(values[0], strip.parameter_values)
    assert 5 < kept.sum() < len(time) - 5
    for place, name in enumerate(names):
        step = 1e-6 * strip[name]
        ends = [
            simulate_outputs(strip.replace(**{name: strip[name] + by}), time, volts, "zero", delay=0.05)[2]
            for by in (-step, step)
        ]
        slope = (ends[1] - ends[0]) / (2.0 * step)
        rows = kept if name == "geometry.sensing_length" else np.ones_like(kept)
        np.testing.assert_allclose(
            found.parameters[1, rows, place], slope[rows], rtol=1e-6, atol=1e-6 * np.abs(slope).max()
        )
    ends = [simulate_outputs(strip, time, volts, "zero", delay=0.05 + by)[2] for by in (-1e-6, 1e-6)]
    np.testing.assert_allclose(found.delay[1], (ends[1] - ends[0]) / 2e-6, rtol=1e-5, atol=1e-10)


@pytest.mark.parametrize("part", [0.3, 0.501, 0.57, 0.636])
def test_a_laser_below_two_over_pi_of_the_length_sees_the_strip_up_to_the_right_angle(part: float) -> None:
    """A strip that is a quarter of a circle still stands 2/pi of its length away from the clamp."""
    values = {**STRIP, "geometry.sensing_length": part * STRIP["geometry.free_length"]}
    assert LASER.last_sine(values) == pytest.approx(1.0, abs=2e-6)


@pytest.mark.parametrize("angle", [0.2, 1.0, 1.5])
def test_a_laser_beyond_loses_it_where_its_end_comes_back(angle: float) -> None:
    length = STRIP["geometry.free_length"]
    values = {**STRIP, "geometry.sensing_length": length * np.sin(angle) / angle}
    assert LASER.last_sine(values) == pytest.approx(np.sin(angle))
