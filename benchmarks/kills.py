"""Processes that are killed with SIGKILL: ``python -m benchmarks.kills [--kills 500] [--record]``.

Half of them are killed at random moments, half as they enter a system call that is named (by strace): recorders,
their guardians, ``ipmclab recover`` and the finaliser that makes a run file. The last two are in ``kill_points.py``.

A recorder is a whole one, with its journal and its guardian, that drives the stand-in chassis through NI's own client
over gRPC, in real time. It is killed while it applies a voltage, at a random moment up to some seconds
after its first rows (one in ten: after its journal was begun), or before a call of its recording or, where it is told
to stop, of its end. Then it is held against what a client of it had seen:

* the output is at 0 V within 1 s, by the level file of the stand-in;
* after ``recover`` every row that the recorder had told to be on the disk is there, equal to what the client was sent;
* of what the client was sent, at most the last second is lost;
* every earlier run file is as it was, to the byte.

A guardian is killed while it watches, and its recorder then has to end the run with the output at 0 V; or while it
acts, its recorder being killed just before: nobody is left then who could reach the output, and its run must not say
0 V of an output that has a voltage.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import kill_points
from benchmarks.harness import finish
from benchmarks.kill_manners import LATEST, SEED, Manner, Strike, kill_process, manners, other_manners
from ipmclab import read_run
from ipmclab.errors import IpmclabError
from ipmclab.rig.process.client import Recorder, launch
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.recover import recover

SOURCES = ("src/ipmclab/rig", "src/ipmclab/store", "benchmarks/kill_manners.py", "benchmarks/kill_points.py")

RATE = 50.0
WITHIN = 1.0
"""The output is at 0 V so soon after a kill [s], and no more than so much of the record is lost [s]."""

WAIT = 6.0
"""So long [s] a call is waited for before which a victim is to be killed."""

OUTPUT = "cDAQ1Mod2/ao0"

RIG = """
name = "stand-in"
bench = "ni"
address = "{address}"
shunt_resistance = "1 ohm"
voltage_sensed = "upstream of shunt"
[output]
physical = "cDAQ1Mod2/ao0"
range = ["-10 V", "10 V"]
[channels.voltage]
physical = "cDAQ1Mod1/ai3"
range = ["-5 V", "5 V"]
[channels.current]
physical = "cDAQ1Mod1/ai0"
range = ["-1 V", "1 V"]
scale = [["0 V", "0 A"], ["1 V", "1 A"]]
"""

EXPERIMENT = """
sample = "friend-2"
rig = "rig.toml"
folder = "laboratory"
signal = "square 1 V 0.2 Hz"
rate = "50 Hz"
duration = "60 s"
rest_before = "0 s"
zero_time = "0.2 s"
measured = ["current"]
steps = ["apply"]
fingerprint = false
"""


@dataclass(frozen=True)
class Kill:
    """One recorder that was killed, or its guardian.

    Parameters
    ----------
    uuid : str
        Of its run.
    manner : Manner
    energised : bool
        Whether the output was away from 0 V then.
    zero_after : float [s]
        From the kill to 0 V; NaN for a recorder that ended before it was killed.
    acknowledged : int
        Rows that it had told to be on the disk.
    sent : mapping of channel to float array [SI]
        What it had sent to its client.
    """

    uuid: str
    manner: Manner
    energised: bool
    zero_after: float
    acknowledged: int
    sent: dict[str, np.ndarray]


@contextmanager
def stand_in(folder: Path, clock: str = "real") -> Iterator[Path]:
    """A stand-in chassis with a rig file and an experiment for it; gives its level file."""
    levels = folder / "levels.json"
    command = [sys.executable, "-m", "ipmclab", "rig", "serve", "--clock", clock, "--levels", str(levels)]
    with (folder / "stand-in.log").open("w") as log:
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
    assert server.stdout is not None
    with server, server.stdout:
        address = server.stdout.readline().strip()
        (folder / "rig.toml").write_text(RIG.format(address=address), encoding="utf-8")
        (folder / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
        (folder / "process").write_text(str(server.pid), encoding="utf-8")
        try:
            yield levels
        finally:
            server.kill()


def level(levels: Path) -> tuple[float, float]:
    """What the output gives [V], and since when [s since 1970]."""
    told = json.loads(levels.read_text(encoding="utf-8"))[OUTPUT]
    return float(told["volts"]), float(told["since"])


def prepare(folder: Path) -> Recorder:
    """Launch a recorder, which waits for the word to start."""
    job = {"experiment": str(folder / "experiment.toml"), "answers": {}, "yes": True, "interactive": False}
    recorder = launch("ipmclab.cli.recorder", job)
    recorder.request("subscribe", blocks=True)
    return recorder


def start(recorder: Recorder) -> str:
    """Start a recorder and wait until its journal is begun; gives the id of the run."""
    while True:
        message = recorder.next(60.0)
        assert message is not None, "the recorder says nothing"
        assert message.kind != "ended", message.values
        if message.kind == "plan":
            recorder.request("start")
        if message.kind == "begun":
            return str(message["uuid"])


def kill(recorder: Recorder, levels: Path, manner: Manner, meanwhile: Callable[[], None]) -> Kill:
    """Start a recorder, kill in this manner, and see what became of it."""
    uuid = start(recorder)
    meanwhile()
    strike = Strike(recorder, manner)
    until = time.monotonic() + manner.after if manner.early else math.inf
    parts: list[dict[str, np.ndarray]] = []
    acknowledged, energised = 0, False
    try:
        while True:
            if not strike.done and time.monotonic() >= until:
                energised = level(levels)[0] != 0.0
                strike.strike()
            message = recorder.next(1.0 if strike.done else max(0.0, min(0.02, until - time.monotonic())))
            if strike.done and time.monotonic() > strike.done + WAIT:
                kill_process(recorder.process)  # the call never came
            if message is None:
                continue
            if message.kind == "block":
                until = min(until, time.monotonic() + manner.after) if not parts else until
                parts.append(dict(message.arrays))
            if message.kind == "progress":
                acknowledged = int(message["acknowledged"])
    except IpmclabError:
        pass  # its process is gone
    recorder.close()
    killed = strike.when()
    while level(levels)[0] != 0.0 and time.time() < killed + (WITHIN if manner.victim == "both" else 10.0):
        time.sleep(0.01)
    volts, since = level(levels)
    strike.end()
    zero_after = max(0.0, since - killed) if volts == 0.0 else math.inf
    sent = {name: np.concatenate([part[name] for part in parts]) for name in (parts[0] if parts else ())}
    return Kill(uuid, manner, energised, zero_after if killed == killed else math.nan, acknowledged, sent)


def wait_for_end(process: int, patience: float = 30.0) -> None:
    """Until a process is gone; at most so long [s]."""
    until = time.monotonic() + patience
    while time.monotonic() < until:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)


def check(folder: Path, killed: Kill) -> list[str]:
    """What is wrong after a kill, once the folder was recovered."""
    wrong = []
    manner = killed.manner
    if killed.zero_after > WITHIN and manner.victim != "both":
        wrong.append(f"the output was at 0 V after {killed.zero_after:.2f} s")
    seen = len(killed.sent.get("voltage", ()))
    found = list((folder / "laboratory" / "runs").rglob(f"*_{killed.uuid[:8]}.nc"))
    early = math.isnan(killed.zero_after) and manner.point is None
    if not found:
        wrong += ["it ended before it was killed, and no run is there"] * early
        return wrong + [f"no run, and {killed.acknowledged} rows were acknowledged"] * (killed.acknowledged > 0)
    run = read_run(found[0])
    reason = run.metadata.state_reason or ""
    # A recorder that strace or a busy machine holds up for half a second is ended by its guardian, before the kill.
    held_up = "held the recording up" in reason
    if early and not held_up:
        wrong.append("it ended before it was killed")
    if run.metadata.state not in states_of(manner) and not held_up:
        wrong.append(f"its state is {run.metadata.state}: {reason}")
    if "0 V" in reason and "never" not in reason and "NOT" not in reason and math.isinf(killed.zero_after):
        wrong.append(f"its output had a voltage, and it says: {reason}")
    if len(run) < killed.acknowledged:
        wrong.append(f"{killed.acknowledged} rows were acknowledged, {len(run)} are there")
    if seen - len(run) > WITHIN * RATE:
        wrong.append(f"{seen} rows were sent, {len(run)} are there")
    for name, sent in killed.sent.items():
        both = min(len(sent), len(run))
        if not np.array_equal(sent[:both], getattr(run, name)[:both], equal_nan=True):
            wrong.append(f"the {name} is not what was sent")
    return wrong


def states_of(manner: Manner) -> tuple[str, ...]:
    """How the run of one that was killed so may say that it ended."""
    if manner.victim == "guardian":
        return ("aborted", "recovered")  # its recorder ends the run by itself; the call of a guardian may never come
    return ("recovered", "complete", "aborted") if manner.stop else ("recovered",)


def fingerprints(folder: Path) -> dict[str, str]:
    """SHA-256 of every run file."""
    files = (folder / "laboratory" / "runs").rglob("*.nc")
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def run_kills(folder: Path, how: Sequence[Manner], end: float = math.inf) -> tuple[list[Kill], list[str]]:
    """Kill recorders, or their guardians, one after the other until an end [s]; gives them, and what went wrong."""
    done: list[Kill] = []
    wrong: list[str] = []
    earlier: dict[str, str] = {}
    next_one: list[Recorder] = []
    with stand_in(folder) as levels:
        recorder = prepare(folder)
        for number, manner in enumerate(how):
            if time.monotonic() > end:
                break
            # The next one gets ready, and recovers what the last one left, while this one records.
            getting_ready = threading.Thread(target=lambda: next_one.append(prepare(folder)))
            one = kill(recorder, levels, manner, getting_ready.start)
            done.append(one)
            getting_ready.join()
            recorder = next_one.pop()
            now = fingerprints(folder)
            wrong += [f"kill {number}: {name} was changed" for name, sha in earlier.items() if now.get(name) != sha]
            earlier = now
            print(
                f"{number + 1} of {len(how)}, {manner}: 0 V after {one.zero_after:.2f} s", file=sys.stderr, flush=True
            )
        recorder.request("stop")
        recorder.close()
        wait_for_end(recorder.process)  # it may be recovering what the last one left, and then holds its journal
    recover(Laboratory.open(folder / "laboratory"))
    now = fingerprints(folder)
    wrong += [f"at the end: {name} was changed" for name, sha in earlier.items() if now.get(name) != sha]
    for number, one in enumerate(done):
        wrong += [f"kill {number}, {one.manner}: {text}" for text in check(folder, one)]
    return done, wrong


@dataclass(frozen=True)
class Others:
    """Finalisers or recoveries that were killed: how many, of these before a call, of how many; what was wrong."""

    done: int
    points: int
    calls: int
    wrong: list[str]


def kill_others(folder: Path, command: str, journals: int, number: int, end: float) -> Others:
    """Kill so many finalisers or recoveries until an end [s], every second one before a call."""
    rng = np.random.default_rng(SEED + 2)
    make = {"finaliser": kill_points.finaliser, "recover": kill_points.recovery}[command]
    longest = {"finaliser": 1.5, "recover": 4.0}[command]
    alone = folder / f"{command}-alone"
    alone.mkdir()
    for _ in range(journals):
        kill_points.record(alone, 3000, ended=False)
    calls = kill_points.count(make(alone), folder)
    wrong: list[str] = []
    for turn in range(number):
        if time.monotonic() > end:
            number = turn
            break
        root = folder / f"{command}-{turn}"
        root.mkdir()
        where = kill_points.draw(calls, rng) if turn % 2 else float(rng.uniform(0.0, longest))
        found = kill_points.trial(root, make, journals, where, rng)
        shutil.rmtree(root)
        told = str(where) if turn % 2 else f"after {where:.2f} s"
        wrong += [f"{command} {turn}, {told}: {text}" for text in found]
        print(
            f"{command} {turn + 1} of {number}, {told}: {'; '.join(found) or 'all is well'}",
            file=sys.stderr,
            flush=True,
        )
    return Others(number, number // 2, sum(calls.values()), wrong)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which nothing is killed any more")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/kills.md")
    options = parser.parse_args()
    began = time.monotonic()
    # Of ten kills two are of finalisers, one is of recover, one of a guardian: there are fewer moments in these.
    tenth = options.kills // 10
    recorders = options.kills - 4 * tenth
    how = manners(recorders // 2) + other_manners(recorders - recorders // 2, tenth)
    how = [how[place] for place in np.random.default_rng(SEED).permutation(len(how))]
    ends = [began + 60.0 * options.minutes * share for share in (0.7, 0.85, 1.0)]
    with tempfile.TemporaryDirectory() as folder:
        done, wrong = run_kills(Path(folder), how, ends[0])
        finalisers = kill_others(Path(folder), "finaliser", 1, 2 * tenth, ends[1])
        recoveries = kill_others(Path(folder), "recover", 2, tenth, ends[2])
    alone = [one for one in done if one.manner.victim == "recorder"]
    zero = np.array([one.zero_after for one in done if one.energised and one.manner.victim != "both"])
    rows = np.array([one.acknowledged for one in done])
    unsafe = np.array([len(one.sent.get("voltage", ())) - one.acknowledged for one in alone])
    points = sum(one.manner.point is not None for one in done) + finalisers.points + recoveries.points
    faults = wrong + finalisers.wrong + recoveries.wrong
    report = [
        f"* {len(done) + finalisers.done + recoveries.done} kills in {time.monotonic() - began:.0f} s, seed {SEED}: of "
        f"{len(alone)} recorders ({sum(math.isnan(one.zero_after) for one in alone)} ended before the call that was "
        f"drawn), {len(done) - len(alone)} guardians (half of them with their recorder), {finalisers.done} finalisers, "
        f"{recoveries.done} times `ipmclab recover`",
        f"* {points} of them as they entered a call that was drawn: of a recorder in recording and at its end, of a "
        f"guardian that watches and that acts, of the {finalisers.calls} calls of a finaliser and the "
        f"{recoveries.calls} of recover that change something; the others at random moments",
        f"* {len(zero)} recorders or guardians with a voltage on the strip, up to {LATEST:g} s after the first rows: "
        f"output at 0 V after {np.nanmedian(zero):.2f} s (median), {np.nanmax(zero):.2f} s at most; bound {WITHIN:g} s",
        f"* {rows.sum()} rows were acknowledged before the kills, and looked for in the runs that were recovered",
        f"* rows that a client had been sent and that were not yet acknowledged: {np.median(unsafe):.0f} (median), "
        f"{unsafe.max()} at most, of {RATE:g} a second",
        f"* {len(faults)} faults" + "".join(f"\n  * {text}" for text in faults),
    ]
    title = "Recorders, guardians, finalisers and recoveries killed with SIGKILL, on the stand-in chassis in real time"
    finish("kills", title, "\n".join(report), [], record=options.record, gate=False)
    if faults:
        sys.exit(1)


if __name__ == "__main__":
    main()
