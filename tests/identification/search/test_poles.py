"""Poles and residues from the currents alone, where large residues nearly cancel."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, load_actuator, simulate
from ipmclab.identification.problem.record import prepare
from ipmclab.identification.search import pole_grid
from ipmclab.identification.search.searched_run import SearchedRun
from ipmclab.identification.search.starts import start_circuit
from ipmclab.identification.search.starts.start_circuit import circuit_values, current_series, find_circuit
from ipmclab.identification.search.varpro import search_poles
from ipmclab.model.admittance import Admittance
from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.model.outputs import simulate_outputs

LEAKS = load_actuator("friend-2+leak.cubic").replace(
    **{
        "circuit.sheet_resistance": 2.041,
        "circuit.dc_resistivity": 15.7,
        "circuit.branches.0.resistivity": 0.3756,
        "circuit.branches.0.permittivity": 0.2735,
        "circuit.branches.1.resistivity": 36.53,
        "circuit.branches.1.permittivity": 0.5581,
        "leak.cubic.cubic": 7.66,
    }
)


def a_leaking_strip() -> Run:
    """Ten rows a second, rounded to 0.1 mA, of a strip that two branches do not describe; the hold is not known."""
    clean = simulate(LEAKS, "step 1.829 V delay=5 s", duration=40.0, rate=10.0)
    assert clean.current is not None
    current = np.round(clean.current, 4)
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, hold="unknown")


def test_a_cost_is_that_of_the_residuals_where_residues_cancel() -> None:
    record = prepare(a_leaking_strip(), 0, ["current"], ())
    found = {}
    for quarter in range(-12, 13):
        series = current_series([record], {0: 0.25 * quarter * record.period})
        found[quarter] = search_poles(series, 2, series[0].drive.present[None], tries=1).cost
    # With the edge a row early the answer would have to come before it: only residues of any size imitate that.
    assert max(found[quarter] for quarter in range(-3, 1)) < 1e3
    assert min(cost for quarter, cost in found.items() if quarter < -3 or quarter > 0) > 1e5


def test_the_edge_is_located_within_its_row() -> None:
    record = prepare(a_leaking_strip(), 0, ["current"], ())
    delay = find_circuit([record], 2, None)[1][0]
    assert -0.1 <= delay.value <= 0.0


@pytest.mark.parametrize("signal", ["step 1 V delay=30 s", "sine 1 V 0.2 Hz delay=30 s"])
def test_the_edge_is_located_after_a_long_rest(signal: str) -> None:
    """Rows enough after the first edge are looked at, wherever it is; rest and noise at rest are no edge."""
    clean = simulate(load_actuator("friend-2"), signal, duration=60.0, rate=100.0)
    generator = np.random.default_rng(20261121)
    assert clean.current is not None
    record = prepare(
        Run.from_arrays(
            time=clean.time,
            voltage=clean.voltage + 1e-4 * generator.standard_normal(len(clean)),
            current=clean.current + 1e-4 * generator.standard_normal(len(clean)),
            hold="unknown",
        ),
        0,
        ["current"],
        (),
    )
    delay = find_circuit([record], 2, None)[1][0]
    assert abs(delay.value) < record.period
    assert delay.error < 0.5 * record.period


@pytest.mark.parametrize("late", [-1.4, 0.3, 1.85])
def test_an_edge_is_located_where_it_lies_between_rows(late: float) -> None:
    """Between which two: the range of one row holds it, and no less is said to be known."""
    time = 0.05 * np.arange(300)
    voltage = np.where(time < 1.0, 0.0, np.sin(np.pi * (time - 1.0)))
    strip = load_actuator("friend-2+branches=1")
    clean = np.asarray(simulate_outputs(strip, time, voltage, "zero", outputs=["current"], delay=0.05 * late))[0]
    noise = 1e-4 * np.random.default_rng(20261121).standard_normal(300)
    run = Run.from_arrays(time=time, voltage=voltage, current=clean + noise, hold="unknown")
    delay = find_circuit([prepare(run, 0, ["current"], ())], 1, None)[1][0]
    assert abs(delay.value / 0.05 - late) < 0.5
    assert delay.error == pytest.approx(0.05 / np.sqrt(12.0))


def test_rows_after_the_first_move_are_looked_at_wherever_the_voltage_began(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start_circuit, "_ROWS_AFTER_EDGE", 10)
    time = np.arange(100.0)
    for voltage in (np.where(time < 50.0, 1.0, 1.1), np.where(time < 50.0, 0.0, 1.0), np.where(time < 50.0, -1.0, 0.0)):
        run = Run.from_arrays(time=time, voltage=voltage, current=voltage, hold="unknown")
        short = start_circuit._beginning(prepare(run, 0, ["current"], ()))
        assert len(short.run) == len(short.readings["current"].values) == 59


def test_sets_of_many_poles_are_found_by_exchange() -> None:
    """As good as the best of all sets, of columns as alike as those of neighbouring poles are."""
    generator = np.random.default_rng(20261126)
    time = np.linspace(0.0, 1.0, 400)
    decays = np.exp(-np.outer(np.geomspace(1.0, 300.0, 14), time))
    readings = np.array([3.0, -2.0, 1.5, 1.0]) @ decays[[1, 4, 8, 12]] + 0.01 * generator.standard_normal(400)

    def gains(sets: np.ndarray) -> np.ndarray:
        left = [np.linalg.lstsq(decays[one].T, readings, rcond=None)[1][0] for one in sets]
        return np.asarray(readings @ readings - np.array(left))

    best = gains(np.array(list(itertools.combinations(range(14), 4)))).max()
    found = pole_grid._exchanged(14, 4, gains)
    assert (np.diff(found, axis=1) > 0).all()
    assert readings @ readings - gains(found).max() < 1.05 * (readings @ readings - best)


def test_a_response_of_many_poles_is_searched_in_little_memory() -> None:
    """Fourteen poles of a grid of 32 have half a billion sets."""
    generator = np.random.default_rng(20261126)
    time = np.linspace(0.0, 60.0, 600)
    poles = -np.geomspace(5.0, 0.03, 6)
    drive = Drive(np.array([time[1]]), np.zeros(599, dtype=np.int64), np.ones(599), np.ones(599), np.ones(600))
    clean = np.array([1.0, 0.8, -0.6, 0.5, 0.4, 0.3]) @ responses(drive, poles)[0]
    run = SearchedRun(drive, time, clean + 1e-3 * generator.standard_normal(600), np.full(600, 1e3))
    found = search_poles([run], 14, np.ones((1, 600)), tries=1)
    assert len(found.poles) == 14
    assert found.cost < 1.2 * 600


def _one_step(size: float, seed: int) -> SearchedRun:
    """The current of a strip with two branches, with noise of a size [A]."""
    clean = simulate(load_actuator("friend-2"), "step 1 V delay=1 s", duration=20.0, rate=50.0)
    assert clean.current is not None
    current = clean.current + size * np.random.default_rng(seed).standard_normal(len(clean))
    run = Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=current,
        hold="zero",
        metadata=RunMetadata(starts_from_rest=True),
    )
    return current_series([prepare(run, 0, ["current"], ())], {})[0]


@pytest.mark.parametrize(("count", "seed", "allowed"), [(2, 20261121, 5e-12), (3, 20261121, 0.05), (3, 2, 0.05)])
def test_the_last_bits_of_the_readings_do_not_say_where_poles_are(count: int, seed: int, allowed: float) -> None:
    """Readings are thousands of times their noise; a pole too many meets another, and where they part again is chance.

    Poles nearer than 5 % count as one.
    """
    run = _one_step(1e-5, seed)
    found = search_poles([run], count, run.drive.present[None]).poles
    generator = np.random.default_rng(seed)
    for _ in range(3):
        shaken = replace(run, readings=run.readings * (1.0 + 1e-15 * generator.standard_normal(len(run.readings))))
        again = search_poles([shaken], count, run.drive.present[None]).poles
        np.testing.assert_allclose(again, found, rtol=allowed)


def test_poles_that_met_start_a_search_as_one_in_equal_parts() -> None:
    """What each carries against the other is rounding; what they carry together is not."""
    starts = []
    for apart, carried in [(1e-4, 8.2), (3e-4, -0.7)]:
        poles = np.array([-1.4 * (1.0 + apart), -1.4 * (1.0 - apart), -0.076])
        seen = Admittance(0.044, np.array([carried, -0.108 - carried, -1.5e-3]), poles)
        values, physical = circuit_values(seen, load_actuator("friend-2+branches=3").parameter_values, 2.0)
        assert not physical
        starts.append(values)
    assert starts[0] == pytest.approx(starts[1], rel=1e-6)
