"""Records that were cut where the voltage was already on: what they show, and what they do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ipmclab.quality import check, usable
from ipmclab.quality.record import Record
from ipmclab.run import Run

Read = Callable[..., Run]
ROWS = 1500


def settled(current: float, noise: float, **more: object) -> Run:
    """A cut at 25 Hz under 2 V whose current has settled, of which nothing is stated."""
    rng = np.random.default_rng(20261126)
    readings = current + rng.normal(0.0, noise, ROWS)
    run = Run.from_arrays(time=np.arange(ROWS) / 25.0, voltage=np.full(ROWS, 1.974), current=readings, hold="unknown")
    return replace(run, **more)  # type: ignore[arg-type]


def codes(run: Run) -> list[str]:
    return [finding.code for finding in check(run)]


@pytest.mark.parametrize(("current", "noise"), [(2.1e-3, 1.8e-3), (4e-5, 1e-4)])
def test_a_settled_current_in_noise_is_a_current(current: float, noise: float) -> None:
    """It was told as no contact, and 0.04 mA that a dc path of 50 kohm draws as 1000 times too small."""
    run = settled(current, noise)
    (finding,) = check(run)
    assert finding.code == "begins-under-voltage"
    assert "has no edge" in finding.message
    assert usable(run, [finding])["current"].all()


def test_a_cut_without_any_current_says_nothing_of_a_contact() -> None:
    """When the voltage was switched on is not known: the current may have ended."""
    assert sorted(codes(settled(0.0, 1e-4))) == ["begins-under-voltage", "noise-only"]


def test_a_slow_part_of_a_displacement_says_nothing_of_a_sign() -> None:
    time = np.arange(ROWS) / 25.0
    relaxing = -4e-3 - 1e-3 * time / 60.0 + np.random.default_rng(20261126).normal(0.0, 2e-7, ROWS)
    assert codes(settled(2.1e-3, 1.8e-3, displacement=relaxing)) == ["begins-under-voltage"]


def test_a_thousand_times_too_large_is_told_without_an_edge() -> None:
    assert codes(settled(2.1, 1e-2)) == ["unit-off", "begins-under-voltage"]


def test_an_inrush_in_the_first_rows_is_an_edge(read: Read) -> None:
    run = read("step 1 V")
    run = replace(run, metadata=replace(run.metadata, starts_from_rest=None), hold="unknown")
    assert Record.of(run).steps_from_rest
    assert not codes(run)
    later = Run.from_arrays(
        time=run.time[:1000], voltage=run.voltage[1000:], current=run.channels["current"][1000:], hold="unknown"
    )
    assert codes(later) == ["begins-under-voltage"]


def test_a_run_that_states_its_rest_steps_at_row_0() -> None:
    run = settled(0.0, 1e-4)
    stated = replace(run, metadata=replace(run.metadata, starts_from_rest=True))
    assert "contact-missing" in codes(stated)
    (finding,) = [one for one in check(stated) if one.code == "contact-missing"]
    assert "is at 1.974 V at row 0" in finding.message


@pytest.mark.parametrize(("current", "open_circuit"), [(2.1e-3, False), (0.0, True)])
def test_the_mean_after_an_edge_says_whether_a_current_flows(current: float, open_circuit: bool) -> None:
    """Of a current that no single reading shows above its noise; the sensor's zero is off by 1 mA."""
    voltage = np.where(np.arange(ROWS) < 300, 0.0, 1.0)
    readings = 1e-3 + current * voltage + np.random.default_rng(20261126).normal(0.0, 1.8e-3, ROWS)
    run = Run.from_arrays(time=np.arange(ROWS) / 25.0, voltage=voltage, current=readings)
    assert ("contact-missing" in codes(run)) is open_circuit


def test_a_reading_that_never_changes_is_no_current() -> None:
    """Means of equal readings differ by their rounding."""
    voltage = np.where(np.arange(ROWS) < 25, 0.0, 1.0)
    run = Run.from_arrays(time=np.arange(ROWS) / 25.0, voltage=voltage, current=np.full(ROWS, 1e-3))
    assert "contact-missing" in codes(run)


def test_a_current_that_comes_within_a_cut_had_no_contact_before(read: Read) -> None:
    late = read("step 1 V delay=2 s")
    run = Run.from_arrays(time=late.time, voltage=np.ones(len(late)), current=late.current, hold="unknown")
    (finding,) = check(run)
    assert (finding.code, finding.samples) == ("contact-missing", ((0, 100),))


def test_rows_of_a_rise_are_those_of_the_run(read: Read) -> None:
    """Message, values and the mark in a plot named different rows."""
    run = read("step 1 V delay=4 s")
    rise = 4e-3 * (1.0 - np.exp(-np.maximum(run.time - 25.0, 0.0) / 5.0))
    read_current = run.channels["current"] + rise
    (finding,) = check(replace(run, current=read_current))
    low, high = finding.values["low_row"], finding.values["high_row"]
    assert finding.samples == ((low, int(high) + 1),)  # type: ignore[arg-type]
    assert f"row {low} (" in finding.message
    assert f"row {high} (" in finding.message
    # A fortieth of the 1800 rows after the edge has 45: what is told is their mean, and the row is in their middle.
    for name, row in (("low", int(low)), ("high", int(high))):  # type: ignore[arg-type]
        mean = float(read_current[row - 22 : row + 23].mean())
        assert finding.values[name] == pytest.approx(mean, rel=1e-9)


def test_a_smooth_top_of_a_quiet_laser_is_not_cut() -> None:
    """At its top the strip stands still, where the laser is quieter than elsewhere and repeats itself."""
    time = np.arange(1500) / 25.0
    for seed in range(20):
        noise = np.where(np.abs(time - 33.0) < 2.0, 5e-8, 5e-7) * np.random.default_rng(seed).standard_normal(1500)
        top = 3.335e-3 * (1.0 - ((time - 33.0) / 30.0) ** 2) + noise
        run = Run.from_arrays(time=time, voltage=np.where(time < 20, 0.0, 2.0), displacement=np.round(top, 7))
        assert "clipped" not in codes(run), seed


@pytest.mark.parametrize("noise", [3.4e-7, 2e-6])
def test_a_top_that_the_laser_cuts_is_told(noise: float) -> None:
    time = np.arange(1500) / 25.0
    rng = np.random.default_rng(20261126)
    top = 3.335e-3 * (1.0 - ((time - 33.0) / 30.0) ** 2) + rng.normal(0.0, noise, 1500)
    cut = np.minimum(np.round(top, 7), 3.3e-3)
    run = Run.from_arrays(time=time, voltage=np.where(time < 20, 0.0, 2.0), displacement=cut)
    (finding,) = [one for one in check(run) if one.code == "clipped"]
    assert finding.values["count"] == np.count_nonzero(cut == 3.3e-3)
