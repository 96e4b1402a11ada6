"""The recorder on the stand-in chassis, through NI's client: reaction in real time, real failures, real kills."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ipmclab import check
from ipmclab.rig.ni import NiBench
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.recording import Outcome
from ipmclab.rig.safety.guardian import Guardian
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from tests.rig.captured import captured
from tests.rig.stand_in import Process, StandIn, happen, serve
from tests.waiting import HANGS, AtRow, until

pytestmark = pytest.mark.real_time

REACTION = 0.1
"""From a reading beyond its limit to an output at 0 V [s]."""

WITHIN = 1.0
"""From the end of a recorder to an output at 0 V [s]."""


@pytest.fixture
def chassis() -> Iterator[StandIn]:
    """A stand-in in real time."""
    with serve("real") as stand_in:
        yield stand_in


def reaction(outcome: Outcome, rate: float) -> float:
    """From the row at which the alarm acted to the first row whose voltage is read as 0 V [s]."""
    assert outcome.run is not None
    assert outcome.alarm is not None
    after = outcome.run.voltage[outcome.alarm.row :]
    return float(np.flatnonzero(np.abs(after) < 0.05)[0]) / rate


@pytest.mark.parametrize("rate", [50.0, 1000.0, 10_000.0])
def test_a_limit_brings_the_output_to_0_within_100_ms(chassis: StandIn, rate: float) -> None:
    # 2 V draw 114 mA at first: beyond 60 mA from the edge on, for 20 ms.
    limits = Limits(current=Limit(0.06, 0.02))
    outcome = captured(
        NiBench(chassis.rig), "step 2 V delay=0.5 s", duration=30.0, rate=rate, measured=("current",),
        limits=limits, zero_time=0.5, zero_after=0.0, discharge=0.6,
    )  # fmt: skip
    assert (outcome.state, outcome.error) == ("aborted", None)
    assert outcome.alarm is not None
    # The reading of the row after the edge is the first beyond it; the limit acts 20 ms later, in rows.
    assert outcome.alarm.time == pytest.approx(0.52 + 1.0 / rate, abs=1.01 / rate)
    assert reaction(outcome, rate) < REACTION
    assert chassis.level == 0.0
    run = outcome.run
    assert run is not None
    # What the output was told is what was read, but around the zero, whose row a bench learns a little later than it
    # happens; the discharge was recorded, and did not act again.
    differ = np.flatnonzero(np.abs(run.voltage - run.raw["output"]) > 5e-3)
    assert np.all((differ > outcome.alarm.row) & (differ <= outcome.alarm.row + 3.0 * REACTION * rate))
    assert run.current is not None
    assert run.current[-1] < -1e-3
    assert [mark.kind for mark in run.metadata.marks] == ["limit"]


@pytest.mark.parametrize("how", ["stop", "abort", "zero"])
def test_requests_end_a_run_on_the_chassis(chassis: StandIn, how: str) -> None:
    control = Control()
    outcome = captured(
        NiBench(chassis.rig), "step 1 V", duration=30.0, rate=1000.0, measured=("current",), control=control,
        on_block=AtRow(560, getattr(control, how)), zero_time=0.2, zero_after=0.0,
        rest_after=1.0, discharge=1.2,
    )  # fmt: skip
    assert outcome.error is None
    assert outcome.state == ("complete" if how == "stop" else "aborted")
    assert chassis.level == 0.0
    run = outcome.run
    assert run is not None
    longest = {"stop": 1.0, "abort": 0.0, "zero": 1.2}[how]
    assert len(run) / 1000.0 == pytest.approx(0.58 + longest, abs=0.06)
    assert np.all(run.raw["output"][:500][1:] == 1.0)
    if how != "abort":
        assert np.abs(run.voltage[-100:]).max() < 5e-3


def test_a_chassis_that_freezes_leaves_the_run_aborted(chassis: StandIn) -> None:
    on_block = AtRow(440, lambda: happen(chassis, "freeze", duration=4.0))
    outcome = captured(
        NiBench(chassis.rig), "step 1 V", duration=30.0, rate=1000.0, measured=("current",), zero_time=0.2,
        on_block=on_block,
    )  # fmt: skip
    assert outcome.state == "aborted"
    assert outcome.error is not None
    assert outcome.error.code in ("bench-frozen", "bench-lost")
    assert outcome.error.repair
    assert outcome.reason.startswith(outcome.error.where)
    run = outcome.run
    assert run is not None
    assert 0.4 < len(run) / 1000.0 < 0.6
    assert (run.metadata.state, run.metadata.marks[-1].kind) == ("aborted", "bench")


def test_an_output_that_is_stuck_is_told_and_the_guardian_stays_armed(chassis: StandIn) -> None:
    control = Control()
    on_block = AtRow(440, lambda: (happen(chassis, "stuck"), control.abort("enough")))
    with Guardian(chassis.rig) as guardian:
        outcome = captured(
            NiBench(chassis.rig), "step 1 V", duration=30.0, rate=1000.0, measured=("current",), zero_time=0.2,
            on_block=on_block, control=control, heartbeat=guardian,
        )  # fmt: skip
        assert outcome.error is not None
        assert outcome.error.code in ("output-stuck", "output-not-zero")
        assert "switch" in outcome.error.repair or "take the strip off" in str(outcome.error)
        until(lambda: guardian.acted)
        assert guardian.acted == "the recorder was silent for 0.5 s"
    # It would try for ten minutes, and reset the chassis of whichever test has the same port by then.
    guardian._process.kill()
    guardian._process.wait()


def test_what_flows_beyond_the_range_ends_by_its_mean(chassis: StandIn) -> None:
    # Its channel ends at 200 mA: a limit of 250 mA is never seen to be passed, the mean over 1 s is.
    limits = Limits(current=Limit(0.25), mean_current=Limit(0.1))
    outcome = captured(
        NiBench(chassis.rig), "step 3 V", duration=30.0, rate=1000.0, measured=("current",), limits=limits,
        zero_time=0.2, zero_after=0.0, discharge=0.2,
    )  # fmt: skip
    assert outcome.alarm is not None
    assert outcome.alarm.limit == "mean_current"
    assert 0.5 < outcome.alarm.time < 1.0
    assert "nothing shows when it is exceeded" in outcome.metadata.limits["current"]


RECORDER = """
import sys
from dataclasses import replace
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.safety.guardian import Guardian
from ipmclab.rig.ni import NiBench
from ipmclab.rig.recording.recorder import capture
from ipmclab.rig.recording.run_request import Listeners, RunRequest

rig = replace(THESIS_RIG, bench="ni", address=sys.argv[1])
told = []
def on_block(rows):
    if rows.first_row > 200 and not told:
        told.append(print("recording", flush=True))
guardian = Guardian(rig, log=sys.argv[2])
request = RunRequest(source="step 1 V", duration=600.0, rate=1000.0, zero_time=0.2)
capture(NiBench(rig), request, heartbeat=guardian, listeners=Listeners(on_block=on_block))
"""


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    """A stand-in in real time and in a process of its own: the kill of a recorder must be seen from outside."""
    process = Process(tmp_path_factory.mktemp("chassis"))
    yield process
    process.end()


@contextmanager
def recording(address: str, log: Path) -> Iterator[subprocess.Popen[str]]:
    """A recorder with its guardian, in a process of its own, which applies 1 V by now."""
    command = [sys.executable, "-c", RECORDER, address, str(log)]
    recorder = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert recorder.stdout is not None
    try:
        assert recorder.stdout.readline() == "recording\n"
        yield recorder
    finally:
        recorder.kill()
        recorder.wait()
        recorder.stdout.close()


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP", "SIGTERM"])
def test_a_recorder_that_ends_leaves_0_v_on_the_chassis(process: Process, tmp_path: Path, name: str) -> None:
    log = tmp_path / "guardian.log"
    with recording(process.address, log) as recorder:
        assert process.level == pytest.approx(1.0, abs=1e-3)
        recorder.send_signal(getattr(signal, name))
        ended = time.monotonic()
        while process.level != 0.0 and time.monotonic() - ended < 10.0:
            time.sleep(0.005)
        assert time.monotonic() - ended < WITHIN
        # It is the guardian where the recorder can do nothing, and the recorder itself where it can.
        if name == "SIGTERM":
            recorder.wait(HANGS)
            assert "is at 0 V" not in log.read_text()
        else:
            until(lambda: "is at 0 V" in log.read_text())
        assert process.level == 0.0


def test_a_killed_recorder_s_output_that_is_stuck_is_not_called_0_v(tmp_path: Path) -> None:
    log = tmp_path / "guardian.log"
    with serve("real") as chassis, recording(chassis.address, log) as recorder:
        happen(chassis, "stuck")
        recorder.kill()
        until(lambda: "it was reset, but 1 V are still read" in log.read_text())
        until(lambda: "SWITCH THE AMPLIFIER OFF" in log.read_text())
        assert "is at 0 V" not in log.read_text()
        happen(chassis, "stuck", duration=0.0)  # it moves again
        until(lambda: "is at 0 V" in log.read_text())
        assert chassis.level == 0.0


def test_rows_that_the_chassis_lost_are_a_finding(chassis: StandIn) -> None:
    """Whatever a drop does, an error or a gap, it is not silent."""
    on_block = AtRow(440, lambda: happen(chassis, "overrun"))
    outcome = captured(
        NiBench(chassis.rig), "step 1 V", duration=1.0, rate=1000.0, measured=("current",), zero_time=0.2,
        zero_after=0.0, on_block=on_block,
    )  # fmt: skip
    assert outcome.run is not None
    if outcome.error is None:
        assert "rows-missing" in {finding.code for finding in check(outcome.run)}
    else:
        assert (outcome.state, outcome.error.repair != "") == ("aborted", True)
    assert chassis.level == 0.0


class Nowhere:
    """A journal that keeps nothing."""

    def append(self, first_row: int, columns: object) -> None:
        """Forget them."""

    def event(self, kind: str, time: float, text: str = "", **values: object) -> None:
        """Forget it."""

    def end(self, state: str, reason: str = "", metadata: object = None) -> None:
        """Nothing to end."""


@pytest.mark.parametrize(
    ("signal", "rate", "duration"),
    [("sine 1 V 0.1 Hz", 10_000.0, 3600.0), ("multisine 1 V 0.1 Hz 100 Hz", 5000.0, 40.0)],
    ids=["hours", "a thousand tones"],
)
def test_a_long_or_rich_signal_starts_and_runs_on_under_the_guardian(
    tmp_path: Path, signal: str, rate: float, duration: float
) -> None:
    chassis, control = Process(tmp_path), Control()
    try:
        with Guardian(chassis.rig) as guardian:
            outcome = captured(
                # Fed so far ahead that a busy machine which runs this for the others too does not run dry.
                NiBench(chassis.rig, ahead=3.0), signal, duration=duration, rate=rate, measured=("current",),
                zero_time=0.2, zero_after=0.0, heartbeat=guardian, control=control, journal=lambda header: Nowhere(),
                on_block=AtRow(round(1.5 * rate), lambda: control.abort("enough")),
            )  # fmt: skip
            assert (outcome.state, outcome.reason) == ("aborted", "enough")
            assert outcome.rows >= 1.5 * rate
            assert guardian.acted == ""
    finally:
        chassis.end()
