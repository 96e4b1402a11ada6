"""What belongs to one run: where its edges lie, how it starts, which readings count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import Finding, InputError, Run, RunMetadata
from ipmclab.identification.problem.record import drive, prepare
from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.model.numerics.timeline import timeline

GENERATOR = np.random.default_rng(20261121)


def run_of(voltage: np.ndarray, hold: str = "unknown", **about: object) -> Run:
    time = 3.0 + np.arange(len(voltage)) / 25.0
    current = 0.05 * voltage + 1e-4 * np.random.default_rng(20261121).standard_normal(len(voltage))
    return Run.from_arrays(time=time, voltage=voltage, current=current, hold=hold, metadata=RunMetadata(**about))  # type: ignore[arg-type]


@given(st.floats(-3, 3), st.booleans(), st.integers(0, 2**32 - 1))
def test_shifted_edges_are_those_of_the_model(rows: float, rest: bool, seed: int) -> None:
    voltage = np.random.default_rng(seed).standard_normal(40)
    record = prepare(run_of(voltage, starts_from_rest=rest), 0, ["current"], ())
    ours = drive(record, rows / 25.0)
    line = timeline(record.run.time, voltage, "zero", delay=rows / 25.0, from_rest=rest)
    theirs = Drive(line.durations, line.interval, line.start, line.end, line.reading, np.flatnonzero(line.row >= 0))
    poles = np.array([-20.0, -0.3])
    for mine, model in zip(responses(ours, poles), responses(theirs, poles), strict=True):
        np.testing.assert_allclose(mine, model, atol=1e-8 * np.max(np.abs(model)) + 1e-12)
    np.testing.assert_allclose(ours.present, line.reading)


def test_rest_is_stated_shown_or_asked() -> None:
    step = np.where(np.arange(200) >= 50, 1.0, 0.0)
    assert prepare(run_of(step, starts_from_rest=True), 0, ["current"], ()).start == "stated rest"
    assert prepare(run_of(step, starts_from_rest=False), 0, ["current"], ()).start == "free"
    assert prepare(run_of(step), 0, ["current"], ()).start == "shown rest"
    assert prepare(run_of(step[50:]), 0, ["current"], ()).start == "rest, which the readings do not contradict"
    charged = replace(run_of(step), current=run_of(step).current + 0.01)  # type: ignore[operator]
    assert prepare(charged, 0, ["current"], ()).start == "rest, which the readings do not contradict"


def test_a_gap_at_constant_voltage_says_nothing_of_where_edges_lie() -> None:
    """Edges were sought within three times the longest step: of a record with a gap of 2.4 s, within 7 s."""
    voltage = np.where(np.arange(200) >= 50, 1.0, 0.0)
    run = run_of(voltage)
    assert run.current is not None

    def period_without(first: int, stop: int) -> float:
        there = np.ones(200, dtype=bool)
        there[first:stop] = False
        part = Run.from_arrays(time=run.time[there], voltage=voltage[there], current=run.current[there], hold="unknown")
        return prepare(part, 0, ["current"], ()).period

    assert period_without(0, 0) == pytest.approx(0.04)
    assert period_without(100, 160) == pytest.approx(0.04)
    assert period_without(45, 55) == pytest.approx(0.44)


def test_findings_take_readings_out_or_make_them_bounds() -> None:
    run = run_of(np.ones(100))
    findings = [
        Finding("spike", "warning", "", channel="current", samples=((3, 5),), effect="mask"),
        Finding("clipped", "warning", "", channel="current", samples=((10, 12),), effect="lower_bound"),
    ]
    reading = prepare(run, 0, ["current"], findings).readings["current"]
    assert np.flatnonzero(~reading.used).tolist() == [3, 4]
    assert np.flatnonzero(reading.side == 1).tolist() == [10, 11]
    assert reading.noise == pytest.approx(1e-4, rel=0.3)


def test_a_strip_without_contact_sees_no_voltage() -> None:
    run = run_of(np.ones(100))
    lost = Finding("contact-missing", "error", "", channel="current", samples=((0, 30),), effect="mask")
    record = prepare(run, 0, ["current"], [lost])
    assert np.all(record.run.voltage[:30] == 0)
    assert np.all(record.run.voltage[30:] == 1)


def test_a_shunt_before_the_strip_needs_its_resistance() -> None:
    known = run_of(np.ones(20), voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    assert prepare(known, 0, ["current"], ()).series_resistance == 1.0
    with pytest.raises(InputError, match=r"shunt whose resistance is not given.*shunt_resistance"):
        prepare(run_of(np.ones(20), voltage_sensed="upstream of shunt"), 0, ["current"], ())
