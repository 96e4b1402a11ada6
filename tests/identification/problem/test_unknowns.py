"""The unknowns of a fit: what of a record bounds them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, check, load_actuator
from ipmclab.identification.problem.free import parse_free
from ipmclab.identification.problem.record import PreparedRun, prepare
from ipmclab.identification.problem.unknowns import Unknown, unknowns_of
from ipmclab.identification.search.pose import problem_at
from ipmclab.identification.search.starts.start import StartingPoint
from ipmclab.quality.shown_at_rest import AtRest

STRIP = load_actuator("friend-2+relaxation.displacement=2")
SLOPE = 2e-6


def creeping() -> PreparedRun:
    """A strip that moves before its step already."""
    time = np.arange(500) / 25.0
    noise = 1e-6 * np.random.default_rng(20261126).standard_normal(500)
    moved = SLOPE * time + np.where(time > 5.0, 1e-3 * (1.0 - np.exp(5.0 - time)), 0.0) + noise
    run = Run.from_arrays(time=time, voltage=np.where(time > 5.0, 1.0, 0.0), displacement=moved, hold="zero")
    return prepare(run, 0, ["displacement"], check(run))


def drift_of(record: PreparedRun) -> Unknown:
    names = parse_free(STRIP.parameter_values, "relaxation")
    (found,) = [one for one in unknowns_of(names, STRIP.parameters(), [record]) if ".drift." in one.base]
    return found


def test_a_sensor_drifts_no_more_than_a_strip_that_was_not_at_rest_moves() -> None:
    """Beside a starting state of any size nothing else would bound it: it took 60 mm of a record of 3 mm."""
    record = creeping()
    slope, error = record.shown["drift", "displacement"]
    # Least squares of a line through some 120 rows over 4.8 s.
    assert 0.0 < error < 6.0 * 1e-6 / (4.8 * np.sqrt(120.0 / 12.0))
    assert slope == pytest.approx(SLOPE, abs=4.0 * error)
    # From rest the rows at 0 V show the sensor alone: about their slope, as far as chance makes their noise a walk.
    strays = 2.0 * 1e-6**2 / 20.0 / (0.8 * (2.0 / 3.0 - 0.2))  # by means over 20 rows and 0.8 s, of white noise of 1 um
    sensor = drift_of(replace(record, start="shown rest"))
    assert 0.5 * (sensor.lower + sensor.upper) == pytest.approx(slope)
    half = 0.5 * (sensor.upper - sensor.lower)
    assert 3.3 * error <= half < 3.3 * np.hypot(error, 2.0 * np.sqrt(1.2 * strays / 4.8))
    # Nobody knows whether this strip was at rest: what moves is the strip or the sensor.
    both = drift_of(record)
    assert drift_of(replace(record, start="free")) == both
    largest = slope + 3.3 * error
    assert (both.lower, both.upper) == pytest.approx((-largest, largest))
    assert both.prior is not None
    centre, deviation = both.prior
    assert centre == 0.0
    assert deviation * both.scale == pytest.approx(largest / np.sqrt(3.0))  # of a rectangle
    assert both.beforehand is None  # no prior of the user's


def test_a_walk_at_0_v_is_no_slope_and_no_zero_over_the_record() -> None:
    """Nineteen of twenty walks of 120 rows go on from a zero, and by a slope over them, that these limits hold."""
    generator = np.random.default_rng(20261127)
    time = 0.04 * np.arange(120.0)
    held = {"offset": 0, "drift": 0}
    for _ in range(200):
        walk = np.cumsum(generator.standard_normal(120)) + 0.3 * generator.standard_normal(120)
        walk -= walk[0]  # whose zero is 0, and which goes nowhere
        of = np.polyfit(time, walk, 1)
        for what, value in (("offset", walk.mean()), ("drift", of[0])):
            least, most = AtRest(float(value), 0.0).about(what, time, walk, 0.0, 0.0)
            held[what] += least <= 0.0 <= most
    assert min(held.values()) >= 190


def test_a_slope_that_was_freed_by_name_is_not_held() -> None:
    names = parse_free(STRIP.parameter_values, "relaxation,observation.drift.displacement")
    (drift,) = [
        u for u in unknowns_of(names, STRIP.parameters(), [replace(creeping(), start="free")]) if ".drift." in u.base
    ]
    assert (drift.lower, drift.upper) == (-np.inf, np.inf)


def test_a_start_beyond_what_a_parameter_may_be_is_none() -> None:
    """Poles that nearly meet have residues of any size; the user saw 'the value 874.05 is outside the allowed'."""
    record = replace(creeping(), start="free")
    ratios = {f"relaxation.displacement.{mode}.ratio": sign * 5e4 for mode, sign in ((0, 1.0), (1, -1.0))}
    names = parse_free(STRIP.parameter_values, "relaxation")
    noise = {(0, "displacement"): 1e-6}
    problem = problem_at(STRIP, names, [record], StartingPoint(ratios, {}), noise)
    assert sum(unknown.is_start for unknown in problem.unknowns) > 0


@pytest.mark.parametrize("log", [False, True])
def test_many_entries_stand_for_what_each_stands_for(log: bool) -> None:
    unknown = Unknown("x", "x", None, log, scale=4.0, lower=0.5, upper=20.0)
    values = [1.0, 7.0, 20.0]
    entries = np.array([unknown.entry(value) for value in values])
    assert unknown.values(entries) == pytest.approx(values)
    assert unknown.values(entries + 1e3) == pytest.approx([20.0] * 3)
