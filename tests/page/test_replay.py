"""What a strip does over a run, as a command and as Python: both do what the page does, or the command is not there."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, load_actuator, read_run, simulate, write_run
from ipmclab.cli.app import run as run_command
from ipmclab.page.commands import in_order, simulate_step
from ipmclab.page.jobs.tasks.simulate import answered
from ipmclab.page.replay import Replay
from ipmclab.run import Hold

FILE = "runs/a run.nc"


@pytest.fixture
def measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run whose voltage is no signal of which there is a text."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    run = simulate(load_actuator("friend-2"), "sine 1 V 0.3 Hz", duration=12.0, rate=100.0 / 3.0)
    noise = np.random.default_rng(20261122).normal(0.0, 0.01, len(run))
    return replace(run, voltage=run.voltage + noise, applied_voltage=None)


def written(run: Run) -> Replay:
    write_run(run, FILE)
    return Replay.of(FILE, read_run(FILE))


def shown_by_the_page() -> Run:
    return answered({"actuator": "friend-2", "changes": {"beam.modulus": 2e9}, "run": FILE})[0]


def by_python(over: Replay) -> Run:
    exec(simulate_step("friend-2", {"beam.modulus": 2e9}, run=over).python, {})
    made = read_run("simulated.nc")
    Path("simulated.nc").unlink()
    return made


def same(one: Run, other: Run) -> None:
    np.testing.assert_array_equal(one.voltage, other.voltage)
    assert one.hold == other.hold
    for name in ("current", "displacement", "force"):
        largest = np.max(np.abs(other.channels[name]))
        np.testing.assert_allclose(one.channels[name], other.channels[name], rtol=0.0, atol=1e-9 * largest)


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first", "unknown"])
def test_a_command_does_over_a_run_what_the_page_shows(measured: Run, hold: Hold) -> None:
    over = written(replace(measured, hold=hold))
    page = shown_by_the_page()
    assert len(page) == 400
    same(by_python(over), page)
    step = simulate_step("friend-2", {"beam.modulus": 2e9}, run=over)
    assert step.note.startswith("The command takes changed.toml")
    assert run_command(shlex.split(step.command)[1:]) == 0
    same(read_run("simulated.nc"), page)


def test_a_long_run_at_a_rate_without_end_has_a_command() -> None:
    """Its rate with 12 digits would put its last row a hundred nanoseconds off."""
    time = np.arange(2_000_000) / (100.0 / 3.0)
    over = Replay.of(FILE, Run.from_arrays(time=time, voltage=np.zeros(len(time))))
    assert over.why_no_command == ""
    assert round(over.duration * over.rate) == len(time)
    assert (len(time) - 1) / over.rate == pytest.approx(time[-1], abs=1e-9, rel=0.0)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"time": "later"}, "the first row of this run is at 0.5 s"),
        ({"time": "uneven"}, "the rows of this run are not equally spaced"),
        ({"sensed": "upstream of shunt"}, "upstream of a shunt"),
    ],
)
@pytest.mark.parametrize("hold", ["zero", "unknown"])
def test_what_no_command_does_over_a_run_is_said(measured: Run, changes: dict[str, str], why: str, hold: Hold) -> None:
    """A command gives rows from 0 s on at a rate, straight to the strip."""
    time = measured.time + 0.5 if changes.get("time") == "later" else measured.time.copy()
    if changes.get("time") == "uneven":
        time[100:] += 0.01
    about = measured.metadata
    if "sensed" in changes:
        about = replace(about, voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    over = written(replace(measured, time=time, hold=hold, metadata=about))
    step = simulate_step("friend-2", {}, run=over)
    assert step.command == ""
    assert step.note.startswith("No command does this: ")
    assert why in step.note
    same(by_python(over), shown_by_the_page())


def test_the_python_of_several_steps_runs(measured: Run) -> None:
    over = written(replace(measured, hold="unknown"))
    first = simulate_step("friend-2", {}, signal="step 1 V", duration=1.0, rate=50.0)
    both = in_order([first, simulate_step("friend-2", {}, run=over)], note="")
    exec(both.python, {})
    assert (len(read_run("run.nc")), len(read_run("simulated.nc"))) == (50, 400)
    assert both.python.count("import ipmclab") == 1
