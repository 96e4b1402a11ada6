"""The guardian, with recorders that are really killed, stopped and ended: what it writes and when."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from ipmclab.errors import IpmclabError
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian import Guardian
from tests.priority import granted
from tests.waiting import until

RECORDER = """
import os, sys, time
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian import Guardian

guardian = Guardian(Target("file", sys.argv[1]), log=sys.argv[2])
guardian.arm()
print(guardian.pid, flush=True)
while True:
    guardian.beat()
    time.sleep(0.04)
"""
"""A recorder that does nothing but beat."""

pytestmark = pytest.mark.real_time

LIMIT = 1.0
"""The output must be at 0 V so long [s] after a recorder was killed or stopped."""


class Recorder:
    """A recorder in a process of its own, which can be killed."""

    def __init__(self, folder: Path) -> None:
        self.output, self.log = folder / "output.txt", folder / "guardian.log"
        command = [sys.executable, "-c", RECORDER, str(self.output), str(self.log)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
        assert self.process.stdout is not None
        self.guardian = int(self.process.stdout.readline())

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def zeroed_at(output: Path) -> list[float]:
    """When the output was brought to 0 V, by the clock of the wall."""
    return [float(line.split()[-1]) for line in output.read_text().splitlines()] if output.exists() else []


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # A child of init that nobody has waited for yet is gone as well.
    status = Path(f"/proc/{pid}/stat")
    return not (status.exists() and status.read_text().rsplit(")", 1)[1].split()[0] == "Z")


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP", "SIGTERM", "group"])
def test_the_output_is_at_0_within_a_second_however_the_recorder_ends(tmp_path: Path, name: str) -> None:
    recorder = Recorder(tmp_path)
    try:
        time.sleep(0.6)  # longer than the silence that it would act on
        assert zeroed_at(recorder.output) == []
        ended = time.time()
        if name == "group":  # as a closed terminal does
            os.killpg(recorder.process.pid, getattr(signal, "SIGKILL"))  # noqa: B009  # Unix only
        else:
            recorder.process.send_signal(getattr(signal, name))
        until(lambda: zeroed_at(recorder.output))
        (at,) = zeroed_at(recorder.output)
        assert 0.0 < at - ended < LIMIT
        log = recorder.log.read_text()
        why = "the recorder was silent for 0.5 s" if name == "SIGSTOP" else "the recorder is gone"
        assert f"{why}: bringing the output {recorder.output} to 0 V" in log
        assert all(line[:4].isdigit() and "T" in line[:11] for line in log.splitlines())
    finally:
        recorder.end()
    until(lambda: not is_running(recorder.guardian))
    assert len(zeroed_at(recorder.output)) == 1


def test_a_recorder_that_was_stopped_learns_that_the_output_is_at_0(tmp_path: Path) -> None:
    output = tmp_path / "output.txt"
    with Guardian(Target("file", str(output)), silence=1.0) as guardian:
        guardian.arm()
        until(lambda: guardian.acted)
        until(lambda: guardian.outcome)
        assert guardian.acted == "the recorder was silent for 1 s"
        with pytest.raises(
            IpmclabError, match="the guardian brought the output to 0 V: the recorder was silent"
        ) as told:
            guardian.beat()
        assert told.value.code == "guardian-acted"
        # It only waited: the chassis did not answer, this computer was free.
        assert "the chassis gave no readings for " in told.value.message
        assert "its server answer" in told.value.repair
        guardian.disarm()
        # The next run is watched as this one was.
        guardian.arm()
        guardian.beat()
        until(lambda: len(zeroed_at(output)) == 2)


def test_a_recorder_that_computes_for_too_long_is_told_so(tmp_path: Path) -> None:
    with Guardian(Target("file", str(tmp_path / "output.txt")), silence=0.2) as guardian:
        guardian.arm()
        began = time.thread_time()
        while not guardian.acted or time.thread_time() - began < 0.2:
            pass
        with pytest.raises(IpmclabError, match=r"this computer held the recording up for \d") as told:
            guardian.beat()
        assert told.value.repair.startswith("give this computer less to do")
        guardian.disarm()


def test_it_goes_before_other_programs_where_the_system_grants_it(tmp_path: Path) -> None:
    if not hasattr(os, "getpriority"):
        pytest.skip("this system has no nice")
    with Guardian(Target("file", str(tmp_path / "output.txt"))) as guardian:
        guardian.wait()
        assert os.getpriority(os.PRIO_PROCESS, guardian.pid) == granted()


def test_what_is_not_armed_is_left_alone(tmp_path: Path) -> None:
    output = tmp_path / "output.txt"
    with Guardian(Target("file", str(output)), silence=0.5) as guardian:
        guardian.wait()
        time.sleep(1.0)
        guardian.arm()
        guardian.beat()
        guardian.disarm()
        time.sleep(1.0)
    guardian.close()
    assert not output.exists()
    # One that is armed when it is let go of acts.
    left = Guardian(Target("file", str(output)))
    left.arm()
    left.close()
    assert len(zeroed_at(output)) == 1


def test_blocks_that_are_far_apart_need_no_beats_between_them_but_do_end(tmp_path: Path) -> None:
    output = tmp_path / "output.txt"
    with Guardian(Target("file", str(output)), silence=1.0) as guardian:
        guardian.arm(block_time=1.2)
        for _ in range(3):
            time.sleep(1.2)
            guardian.beat()
        assert not output.exists()
        # No block for three of their times: the recorder hangs, though its process lives.
        until(lambda: zeroed_at(output))


def test_it_may_be_asked_to_wait_a_little(tmp_path: Path) -> None:
    output = tmp_path / "output.txt"
    # A beat every tenth of a second has room in half a second, on a busy machine too.
    with Guardian(Target("file", str(output)), silence=0.5) as guardian:
        guardian.arm()
        guardian.hold(2.0)
        time.sleep(1.2)
        guardian.beat()
        assert not output.exists()
        guardian.hold(0.4)
        until(lambda: len(zeroed_at(output)) == 1)


def test_it_tries_until_it_succeeds_and_says_so_aloud(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    output, log = tmp_path / "not yet" / "output.txt", tmp_path / "guardian.log"
    with Guardian(Target("file", str(output)), log=log, silence=0.2) as guardian:
        guardian.arm()
        until(lambda: log.exists() and "it failed: IpmclabError: " in log.read_text())
        until(lambda: "SWITCH THE AMPLIFIER OFF" in capfd.readouterr().err)
        output.parent.mkdir()
        until(lambda: zeroed_at(output))
        assert "could NOT be brought to 0 V so far" in log.read_text()


def test_a_reset_that_hangs_is_left_behind(tmp_path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no named pipes")
    output, log = tmp_path / "output", tmp_path / "guardian.log"
    os.mkfifo(output)  # opening it hangs, for nobody reads
    with Guardian(Target("file", str(output)), log=log, silence=0.1) as guardian:
        guardian.arm()
        until(lambda: log.exists() and "it failed: no answer within 1.5 s" in log.read_text())
        output.unlink()
        until(lambda: "is at 0 V" in log.read_text())


def test_without_a_guardian_nothing_is_given_out(tmp_path: Path) -> None:
    with Guardian(Target("kiosk", "x")) as guardian:  # type: ignore[arg-type]
        with pytest.raises(IpmclabError, match=r"there is no guardian: .*unknown target 'kiosk'") as told:
            guardian.arm()
        assert told.value.code == "guardian-lost"
    with Guardian(Target("file", str(tmp_path / "output.txt"))) as guardian:
        guardian.arm()
        os.kill(guardian.pid, signal.SIGTERM)  # asked to end while it is armed, it acts first
        with pytest.raises(IpmclabError, match="guardian"):
            until(guardian.beat)
        guardian.disarm()
    assert len(zeroed_at(tmp_path / "output.txt")) == 1


def test_a_guardian_that_hangs_is_noticed(tmp_path: Path) -> None:
    if not hasattr(signal, "SIGSTOP"):
        pytest.skip("this system cannot stop a process")

    def beat() -> None:
        guardian.beat()
        time.sleep(0.02)

    with Guardian(Target("file", str(tmp_path / "output.txt"))) as guardian:
        guardian.arm()
        os.kill(guardian.pid, signal.SIGSTOP)
        try:
            with pytest.raises(IpmclabError, match=r"it has given no sign of life for \d"):
                until(beat)
        finally:
            os.kill(guardian.pid, signal.SIGCONT)
        guardian.disarm()


def test_what_it_guards_goes_to_its_process_whole() -> None:
    target = Target.of(replace(THESIS_RIG, address="127.0.0.1:1", voltage_sensed="electrodes", source_resistance=0.5))
    assert Target.from_json(target.to_json()) == target
    assert ([channel.name for channel in target.channels], target.between) == (["voltage", "current"], 1.5)


CALLER = """
import sys, time
from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian import Guardian

guardian = Guardian(Target("file", sys.argv[1]))
guardian.arm()
print("armed", flush=True)
while True:
    try:
        guardian.beat()
    except IpmclabError as failure:
        print(failure.code, failure, flush=True)
        break
    began = time.monotonic()
    time.sleep(float(sys.argv[2]))  # a call, which has a deadline
    if time.monotonic() - began > 1.0 and sys.argv[3] == "call":
        failure = BenchError("the server of the chassis does not answer", code="bench-frozen", repair="restart it")
        guardian.explain(failure)
        print(failure.code, failure, flush=True)
        break
guardian.disarm()
guardian.close()
"""


@pytest.mark.parametrize(("stopped", "where"), [(2.2, "call"), (3.6, "beat"), (0.0, "call")])
def test_a_recorder_that_was_stopped_does_not_blame_the_server(tmp_path: Path, stopped: float, where: str) -> None:
    if not hasattr(signal, "SIGSTOP"):
        pytest.skip("this system cannot stop a process")
    command = [sys.executable, "-c", CALLER, str(tmp_path / "output.txt"), "0.04" if stopped else "1.5", where]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as caller:
        assert caller.stdout is not None
        assert caller.stdout.readline() == "armed\n"
        began = time.monotonic()
        if stopped:
            time.sleep(0.2)
            caller.send_signal(signal.SIGSTOP)
            time.sleep(stopped)
            caller.send_signal(signal.SIGCONT)
        told = caller.stdout.readline()
        lasted = time.monotonic() - began
    assert len(zeroed_at(tmp_path / "output.txt")) == 1
    if stopped:
        assert told.startswith("guardian-acted guardian: the guardian ")
        held_up = re.search(r"this computer held the recording up for (\d+\.\d) s", told)
        assert held_up, told
        assert stopped - 0.05 <= float(held_up[1]) <= lasted + 0.05
        assert "server" not in told
    else:  # it was free all the time: the server it is
        assert told.startswith("bench-frozen the server of the chassis does not answer; restart it")
