"""A push in a run at 0 V is found with its slope; what only looks like one is not."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, load_actuator, simulate
from ipmclab.consistency.flick import flicks
from ipmclab.consistency.push import push_of, pushes

SEED = 20261121
LASER = 1.25e-6


def at_zero_volts(time, displacement, force) -> Run:
    return Run.from_arrays(time=time, voltage=np.zeros(len(time)), displacement=displacement, force=force)


def drawn_push(rng: np.random.Generator) -> tuple[float, Run]:
    """A push as somebody might do it: its true stiffness [N/m], and what the instruments read."""
    stiffness = math.exp(rng.uniform(math.log(0.3), math.log(5.0)))
    depth, period, cycles, rest = rng.uniform(2e-4, 8e-4), rng.uniform(4.0, 40.0), rng.integers(1, 4), rng.uniform(0, 5)
    time = np.arange(0.0, 2.0 * rest + period * cycles, 1.0 / rng.choice([10.0, 50.0, 200.0]))
    phase = np.clip((time - rest) / period, 0.0, cycles) % 1.0
    travel = depth * (1.0 - np.abs(2.0 * phase - 1.0))
    gap = depth * rng.choice([0.0, rng.uniform(0.0, 0.4)])  # before the cell touches
    force = stiffness * np.maximum(travel - gap, 0.0)
    rise = float(np.max(force))
    force += rise * rng.choice([0.0, rng.uniform(-0.1, 0.1)]) * time / time[-1]  # the cell drifts
    force += (
        rise * rng.choice([0.0, rng.uniform(0.0, 0.05)]) * np.sign(np.gradient(travel)) * (travel > gap)
    )  # friction
    force += rise * rng.uniform(0.002, 0.1) * rng.standard_normal(len(time))
    travel = travel + LASER * rng.standard_normal(len(time))
    scale_x, scale_f = 1.0 + 0.03 * rng.standard_normal(2)
    # Either sign of either channel, and rests that were not taken off.
    displacement = rng.choice([-1.0, 1.0]) * scale_x * travel + rng.choice([0.0, 12e-3])
    return stiffness, at_zero_volts(time, displacement, rng.choice([-1.0, 1.0]) * scale_f * force + 4e-3)


def test_the_slope_of_a_push_lies_within_its_uncertainty() -> None:
    rng = np.random.default_rng(SEED)
    off, rings = [], 0
    for _ in range(200):
        true, run = drawn_push(rng)
        (fact,) = pushes([run]) or (None,)
        if fact is not None:
            off.append((fact.value - true) / fact.uncertainty)
            assert (fact.metric, fact.place) == ("stiffness", 0)
        rings += len(flicks([run])) if len(run) < 500 else 0
    assert len(off) >= 190
    assert rings == 0
    assert np.mean(np.abs(off) < 1.96) >= 0.91
    assert max(np.abs(off)) < 4.0
    assert np.std(off) > 0.7  # and not because it is told too wide


def test_a_loop_and_a_bend_are_told_with_the_push() -> None:
    time = np.arange(0.0, 22.0, 0.02)
    travel = 5e-4 * np.interp(time, [1.0, 11.0, 21.0], [0.0, 1.0, 0.0])
    noise = 2e-6 * np.random.default_rng(SEED).standard_normal(len(time))
    clean = push_of(at_zero_volts(time, travel, 2.0 * travel + noise))
    assert clean is not None
    assert clean[1] == ""
    friction = np.where(time < 11.0, 4e-5, -4e-5) * (travel > 1e-5)
    loop = push_of(at_zero_volts(time, travel, 2.0 * travel + friction + noise))
    assert loop is not None
    assert "in and out differ" in loop[1]


def not_pushes(rng: np.random.Generator) -> dict[str, Run]:
    rate, length = float(rng.choice([10.0, 50.0])), float(rng.uniform(10.0, 100.0))
    time = np.arange(0.0, length, 1.0 / rate)
    rows = len(time)
    laser, cell = LASER * rng.standard_normal(rows), 5e-5 * rng.standard_normal(rows)

    def walk() -> np.ndarray:
        return 1e-3 * np.cumsum(rng.standard_normal(rows)) / math.sqrt(rows)

    fast = np.arange(0.0, 2.0, 1e-3)
    angular, damping = 2.0 * math.pi * rng.uniform(4.0, 40.0), rng.uniform(0.01, 0.1)
    ring = 5e-4 * np.exp(-damping * angular * fast) * np.cos(angular * fast)
    read = LASER * rng.standard_normal(len(fast)), 5e-5 * rng.standard_normal(len(fast))
    inside = (time > length / 3.0) & (time < 2.0 * length / 3.0)
    there_and_back = 5e-4 * np.interp(time, [0.0, length / 2.0, length], [0.0, 1.0, 0.0])
    hum = np.sin(2.0 * math.pi * 0.05 * time)
    return {
        "noise": at_zero_volts(time, laser, cell),
        "the cell touches nothing": at_zero_volts(time, there_and_back + laser, cell),
        "walks": at_zero_volts(time, walk() + laser, walk() + cell),
        "a walk of the strip": at_zero_volts(time, walk() + laser, cell),
        "drifts": at_zero_volts(time, 2e-3 * time / length + laser, 1e-3 * time / length + cell),
        "settling": at_zero_volts(time, 2e-3 * np.exp(-time / 10.0) + laser, 1e-3 * np.exp(-time / 10.0) + cell),
        "hum": at_zero_volts(time, 2e-6 * hum + 0.1 * laser, 1e-5 * hum + 0.05 * cell),
        "a knock and back": at_zero_volts(time, 5e-4 * inside + laser, 5e-4 * inside + cell),
        "a flick": at_zero_volts(fast, ring + read[0], read[1]),
        "a flick on the cell": at_zero_volts(fast, ring + read[0], 0.9 * np.maximum(ring, 0.0) + read[1]),
        "one way": at_zero_volts(time, 5e-4 * time / length + laser, 1e-3 * time / length + 0.1 * cell),
    }


def test_what_is_no_push_has_no_slope() -> None:
    rng = np.random.default_rng(SEED)
    for _ in range(30):
        for name, run in not_pushes(rng).items():
            assert push_of(run) is None, name


def test_runs_of_a_driven_or_blocked_strip_are_no_pushes() -> None:
    strip = load_actuator("friend-2")
    for signal in ("step 1 V", "sine 1 V 0.1 Hz", "square 1 V 0.1 Hz"):
        run = simulate(strip, signal, duration=40.0, rate=50.0)
        assert push_of(run) is None
    # Blocked: the force answers, the strip stands still, and the voltage has gone.
    rng = np.random.default_rng(SEED)
    fallen = simulate(strip, "step 1 V", duration=40.0, rate=50.0).force[::-1].copy()
    assert push_of(at_zero_volts(run.time, LASER * rng.standard_normal(len(fallen)), fallen)) is None


def test_a_stage_that_goes_to_and_fro_does_not_ring() -> None:
    time = np.arange(0.0, 60.0, 0.02)
    travel = 5e-4 * (1.0 - np.abs(2.0 * (time / 10.0 % 1.0) - 1.0))
    noise = LASER * np.random.default_rng(SEED).standard_normal(len(time))
    alone = Run.from_arrays(time=time, voltage=np.zeros(len(time)), displacement=travel + noise)
    assert flicks([alone]) == ()
    assert flicks([at_zero_volts(time, travel + noise, 2.0 * travel)]) == ()
    assert len(pushes([at_zero_volts(time, travel + noise, 2.0 * travel)])) == 1


def test_too_few_readings_and_gaps_are_no_failure() -> None:
    time = np.arange(6.0)
    assert push_of(at_zero_volts(time, 1e-4 * time, 1e-4 * time)) is None
    gone = np.full(6, np.nan)
    assert push_of(at_zero_volts(time, gone, 1e-4 * time)) is None
    true, run = drawn_push(np.random.default_rng(SEED))
    force = run.force.copy()
    force[::7] = np.nan
    fact = pushes([at_zero_volts(run.time, run.displacement, force)])[0]
    assert abs(fact.value - true) < 3.0 * fact.uncertainty


@pytest.mark.parametrize("name", ["step_1V", "step_2V", "step_2V_poor", "step_3V"])
def test_no_part_of_a_real_record_passes_for_a_push(name: str, real_runs: Path) -> None:
    """Drift, back relaxation and a force that is noise, taken for a record at 0 V whole and in parts."""
    with gzip.open(real_runs / f"{name}.csv.gz", "rt") as file:
        columns = np.genfromtxt(file, delimiter=",", names=True)
    laser = np.where(columns["laser_mm"] < -99.0, np.nan, 1e-3 * columns["laser_mm"])
    time = 0.04 * np.arange(len(laser))
    starts = [slice(None), *(slice(start, start + 3000) for start in range(0, len(laser) - 1500, 1500))]
    for part in starts:
        assert push_of(at_zero_volts(time[part], laser[part], columns["force_N"][part])) is None


@pytest.mark.parametrize(("travel", "found"), [(70e-6, 1), (40e-6, 0)])
def test_a_push_goes_fifty_micrometres_or_more(travel: float, found: int) -> None:
    time = np.arange(0.0, 20.0, 0.02)
    way = travel * np.interp(time, [0.0, 10.0, 20.0], [0.0, 1.0, 0.0])
    assert len(pushes([at_zero_volts(time, way, 2.0 * way)])) == found
