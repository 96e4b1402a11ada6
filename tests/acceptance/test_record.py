"""``ipmclab record`` on the stand-in chassis, as a user runs it, ended in every way that a recording can end.

The stand-in runs in real time here, and tells in a file what its output gives and since when: it is watched from
outside, without its protocol.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.kill_manners import manners
from benchmarks.kills import EXPERIMENT, level, prepare, run_kills, stand_in, start
from ipmclab import read_run
from ipmclab.errors import IpmclabError
from ipmclab.rig.process.client import Recorder
from ipmclab.run import Run
from ipmclab.store.journal.record import read_journal
from tests.priority import granted

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="signals and terminals of POSIX"),
    pytest.mark.real_time,
]

ROWS = 25
"""So many of them are half a second of a run."""

ZERO_WITHIN = 1.0
"""The bound of the issue [s]: the output is at 0 V so soon after whatever happened."""


def wait_until(condition: Callable[[], object], seconds: float, what: str) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds:g} s: {what}"
        time.sleep(0.01)


def runs_in(folder: Path) -> list[Path]:
    return sorted((folder / "laboratory" / "runs").rglob("*.nc"))


def newest(folder: Path, uuid: str) -> Run:
    (found,) = [path for path in runs_in(folder) if path.stem.endswith(uuid[:8])]
    return read_run(found)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """A folder with rig and experiment for a stand-in that runs in real time, and its level file."""
    folder = tmp_path_factory.mktemp("stand-in")
    with stand_in(folder) as levels:
        yield folder, levels


@pytest.fixture
def bench(served: tuple[Path, Path], tmp_path: Path) -> Bench:
    """The same stand-in with a laboratory of its own for each test."""
    shared, levels = served
    for name in ("rig.toml", "experiment.toml"):
        (tmp_path / name).write_text((shared / name).read_text())
    return Bench(tmp_path, levels)


class Bench:
    """A folder to record in, and a look at the output from outside."""

    def __init__(self, folder: Path, levels: Path) -> None:
        self.folder = folder
        self.levels = levels

    @property
    def volts(self) -> float:
        return level(self.levels)[0]

    @property
    def rows(self) -> int:
        """Of the runs that are being recorded, as far as they are on the disk."""
        return sum(read_journal(path).n_rows for path in (self.folder / "laboratory" / "recording").glob("*.runj"))

    def wait_for_voltage(self) -> None:
        """And for rows of it: in mid-run."""
        wait_until(lambda: self.volts != 0.0, 60.0, "a voltage on the strip")
        energised = self.rows
        wait_until(lambda: self.rows >= energised + ROWS, 60.0, f"{ROWS} rows of it")

    def zero_after(self, moment: float, seconds: float = ZERO_WITHIN) -> None:
        """The output went to 0 V within the bound, by the clock of the stand-in."""
        wait_until(lambda: self.volts == 0.0, 30.0, "0 V")
        since = level(self.levels)[1]
        assert since - moment <= seconds, f"0 V came {since - moment:.2f} s after"


class Terminal:
    """``ipmclab record`` at a pseudo-terminal."""

    def __init__(self, *words: str, folder: Path) -> None:
        import pty

        self.pid, self.screen = pty.fork()
        if self.pid == 0:
            os.chdir(folder)
            os.environ["COLUMNS"] = "200"
            os.execv(sys.executable, [sys.executable, "-m", "ipmclab", "record", *words])
        self.text = ""

    def read(self, within: float = 0.05) -> bool:
        """Take what is shown; False when it has ended."""
        if not select.select([self.screen], [], [], within)[0]:
            return True
        try:
            shown = os.read(self.screen, 65536)
        except OSError:  # what Linux says when the other side is closed
            return False
        self.text += shown.decode(errors="replace")
        return bool(shown)

    def wait_for(self, pattern: str, seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not re.search(pattern, self.text, re.DOTALL):
            assert self.read(), f"it ended, without {pattern!r}: {self.text[-800:]}"
            assert time.monotonic() < end, f"no {pattern!r} in {self.text[-800:]}"

    def press(self, keys: str) -> None:
        os.write(self.screen, keys.encode())

    def end(self, seconds: float = 60.0) -> int:
        """Its exit status."""
        end = time.monotonic() + seconds
        while self.read():
            assert time.monotonic() < end, self.text[-800:]
        status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        os.close(self.screen)
        return status


def test_a_new_user_records_at_a_terminal(bench: Bench) -> None:
    """Plan, questions, live numbers, a mark, stop: the run is kept and says how it ended."""
    text = EXPERIMENT.replace('steps = ["apply"]', 'steps = ["clamp", "apply"]')
    (bench.folder / "experiment.toml").write_text(text)
    terminal = Terminal("experiment.toml", folder=bench.folder)
    terminal.wait_for(r"begin\?.*\[yes\] $")
    assert "not proven on this hardware" in terminal.text
    assert "60 s" in terminal.text
    assert bench.volts == 0.0
    terminal.press("\r")
    terminal.wait_for(r"clamp: .*\[done\] $")
    assert bench.volts == 0.0
    terminal.press("what?\r")
    terminal.wait_for("is none of done, kept")
    terminal.press("d\r")
    bench.wait_for_voltage()
    terminal.wait_for(r"mA.*rows on disk")
    terminal.press("mfan on\r")
    terminal.wait_for("s: fan on")
    pressed = time.time()
    terminal.press("s")
    assert terminal.end() == 0
    bench.zero_after(pressed)
    (path,) = runs_in(bench.folder)
    run = read_run(path)
    assert run.metadata.state == "complete"
    assert "stopped by the operator" in (run.metadata.state_reason or "")
    assert [mark.text for mark in run.metadata.marks if mark.kind == "note"] == ["fan on"]
    assert run.metadata.mounting_id
    assert run.metadata.rig_proof is not None
    assert "not proven on this hardware" in run.metadata.rig_proof
    assert np.ptp(run.voltage) > 0.9
    assert f"next: ipmclab check {path.relative_to(bench.folder)}" in terminal.text.replace("\r\n", "")
    assert not list((bench.folder / "laboratory" / "recording").iterdir())


@pytest.mark.parametrize(
    ("keys", "status", "state", "reason"),
    [
        ("a", 1, "aborted", "aborted by the operator"),
        ("z", 1, "aborted", "emergency zero"),
        ("\x03", 130, "complete", "stopped by the operator"),
    ],
)
def test_keys_that_end_it(bench: Bench, keys: str, status: int, state: str, reason: str) -> None:
    terminal = Terminal("experiment.toml", "--yes", folder=bench.folder)
    bench.wait_for_voltage()
    pressed = time.time()
    terminal.press(keys)
    assert terminal.end() == status, terminal.text[-800:]
    bench.zero_after(pressed)
    (path,) = runs_in(bench.folder)
    run = read_run(path)
    assert (run.metadata.state, run.metadata.uuid is not None) == (state, True)
    assert reason in (run.metadata.state_reason or "")


def test_a_client_that_dies_leaves_the_run_running_and_another_joins(bench: Bench) -> None:
    """The terminal is killed, then another one is closed: the run goes on; a third one stops it."""
    command = [sys.executable, "-m", "ipmclab", "record", "experiment.toml", "--yes"]
    with subprocess.Popen(command, cwd=bench.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as first:
        bench.wait_for_voltage()
        first.kill()
    closed = Terminal("--attach", "laboratory", folder=bench.folder)
    closed.wait_for(r"rows on disk")
    os.close(closed.screen)  # the window is closed: SIGHUP
    assert os.waitstatus_to_exitcode(os.waitpid(closed.pid, 0)[1]) in (0, -signal.SIGHUP)
    bench.wait_for_voltage()
    third = Terminal("--attach", "laboratory", folder=bench.folder)
    third.wait_for(r"rows on disk")
    assert bench.volts != 0.0  # and its guardian has seen no reason to act
    pressed = time.time()
    third.press("s")
    assert third.end() == 0, third.text[-800:]
    bench.zero_after(pressed)
    (path,) = runs_in(bench.folder)
    run = read_run(path)
    assert run.metadata.state == "complete"
    assert len(run) > 100
    assert not [mark for mark in run.metadata.marks if mark.kind == "gap"]


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_recorder_that_is_told_to_end_by_the_system(bench: Bench, name: str) -> None:
    recorder, uuid = begin(bench.folder)
    bench.wait_for_voltage()
    sent = time.time()
    os.kill(recorder.process, getattr(signal, name))
    last = follow(recorder)
    bench.zero_after(sent)
    assert last["status"] == 1
    run = newest(bench.folder, uuid)
    assert run.metadata.state == "aborted"
    assert name in (run.metadata.state_reason or "")


def test_a_recorder_that_hangs(bench: Bench) -> None:
    """Its guardian acts; when it goes on it finds out, and keeps what it had."""
    recorder, uuid = begin(bench.folder)
    bench.wait_for_voltage()
    assert os.getpriority(os.PRIO_PROCESS, recorder.process) == granted()
    stopped = time.time()
    os.kill(recorder.process, signal.SIGSTOP)
    bench.zero_after(stopped)
    os.kill(recorder.process, signal.SIGCONT)
    last = follow(recorder)
    assert last["status"] == 1
    assert newest(bench.folder, uuid).metadata.state == "aborted"
    assert bench.volts == 0.0


@pytest.mark.parametrize("how", ["freeze", "kill"])
def test_a_server_that_freezes_or_dies(tmp_path: Path, how: str) -> None:
    with stand_in(tmp_path) as levels:
        bench = Bench(tmp_path, levels)
        recorder, uuid = begin(tmp_path)
        bench.wait_for_voltage()
        server = int((tmp_path / "process").read_text())
        happened = time.time()
        os.kill(server, signal.SIGSTOP if how == "freeze" else signal.SIGKILL)  # noqa: TID251
        last = follow(recorder)
        # Noticed after max(1 s, 5 block periods), reported within 2 s more; then its run is kept.
        assert last["told"] - happened < 3.0 + 1.0
        error = last["error"]
        assert error["code"] == {"freeze": "bench-frozen", "kill": "bench-lost"}[how]
        assert error["repair"]
        run = newest(tmp_path, uuid)
        assert run.metadata.state == "aborted"
        assert len(run) > 10
        if how == "freeze":
            thawed = time.time()
            os.kill(server, signal.SIGCONT)
            bench.zero_after(thawed, ZERO_WITHIN + 1.5)  # an attempt of the guardian may just have begun


def test_a_full_disk(bench: Bench, tmp_path: Path, require: Callable[[str, object], None]) -> None:
    disk = bench.folder / "laboratory"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=80m", "tmpfs", str(disk)]
    mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    require("tmpfs", mounted)
    try:
        recorder, uuid = begin(bench.folder)
        bench.wait_for_voltage()
        filled = time.time()
        with contextlib.suppress(OSError), (disk / "filler").open("wb", buffering=0) as filler:
            while True:
                filler.write(bytes(4096))
        last = follow(recorder)
        bench.zero_after(filled, ZERO_WITHIN + 1.0)  # the disk is noticed to be full at the next write
        assert last["error"]["code"] == "disk-full"
        run = newest(bench.folder, uuid)
        assert run.metadata.state == "aborted"
        assert len(run) >= last["acknowledged"] > 0
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_two_rigs_record_into_one_folder_at_once(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> None:
    other = tmp_path_factory.mktemp("other")
    with stand_in(other) as others:
        text = EXPERIMENT.replace('"rig.toml"', f'"{other / "rig.toml"}"')
        (bench.folder / "other.toml").write_text(text)
        first, _ = begin(bench.folder)
        job = [sys.executable, "-m", "ipmclab", "record", "other.toml", "--yes", "--json"]
        with subprocess.Popen(job, cwd=bench.folder, stdout=subprocess.PIPE, text=True) as second:
            wait_until(lambda: level(others)[0] != 0.0, 60.0, "a voltage on the other strip")
            bench.wait_for_voltage()
            first.request("stop")
            assert follow(first)["status"] == 0
            second.send_signal(signal.SIGTERM)  # stops and keeps, as Ctrl-C
            assert second.stdout is not None
            told = json.load(second.stdout)
        assert second.returncode == 130
    assert told["runs"][0]["state"] == "complete"
    assert len(runs_in(bench.folder)) == 2


def test_recorders_killed_at_random_moments(tmp_path: Path) -> None:
    """``python -m benchmarks.kills`` does hundreds, half of them between system calls."""
    killed, wrong = run_kills(tmp_path, manners(4))
    assert not wrong
    assert sum(one.energised for one in killed) >= 2
    assert sum(one.acknowledged for one in killed) > 20


def begin(folder: Path) -> tuple[Recorder, str]:
    """A recorder whose journal is begun, and the id of its run."""
    recorder = prepare(folder)
    return recorder, start(recorder)


def follow(recorder: Recorder) -> dict[str, Any]:
    """The last message, when it came, and how many rows had been acknowledged."""
    acknowledged, told = 0, 0.0
    while True:
        message = recorder.next(60.0)
        assert message is not None
        if message.kind == "progress":
            acknowledged = message["acknowledged"]
        if message.kind == "event" and message["event"] == "bench" and not told:
            told = time.time()
        if message.kind == "ended":
            with contextlib.suppress(IpmclabError):
                recorder.next(10.0)
            recorder.close()
            wait_until(lambda: not is_there(recorder.process), 10.0, "the end of its process")
            return {**message.values, "acknowledged": acknowledged, "told": told or time.time()}


def is_there(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True
