"""Recorders that are killed at random moments: ``python -m benchmarks.kills [--kills 200] [--record]``.

Each is a whole recorder, with its journal and its guardian, that drives the stand-in chassis through NI's own client
over gRPC, in real time. It is killed with SIGKILL while it applies a voltage, at a random moment up to some seconds
after its first rows (one in ten: after its journal was begun). Then it is held against what a client of it had seen:

* the output is at 0 V within 1 s, by the level file of the stand-in;
* after ``recover`` every row that the recorder had told to be on the disk is there, equal to what the client was sent;
* of what the client was sent, at most the last second is lost;
* every earlier run file is as it was, to the byte.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import finish
from ipmclab import read_run
from ipmclab.errors import IpmclabError
from ipmclab.rig.process.client import Recorder, launch
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.recover import recover

SOURCES = ("src/ipmclab/rig", "src/ipmclab/store")

SEED = 20261121
RATE = 50.0
WITHIN = 1.0
"""The output is at 0 V so soon after a kill [s], and no more than so much of the record is lost [s]."""

LATEST = 3.0
"""A kill comes at most so long after the first rows [s]."""

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
    """One recorder that was killed.

    Parameters
    ----------
    uuid : str
        Of its run.
    after : float [s]
        Since its first rows, or its journal was begun.
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
    after: float
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


def kill(recorder: Recorder, levels: Path, after: float, meanwhile: Callable[[], None], *, early: bool) -> Kill:
    """Start a recorder, and kill it so long after its first rows, or its journal [s]; then see what became of it."""
    uuid = start(recorder)
    meanwhile()
    until = time.monotonic() + after if early else math.inf
    parts: list[dict[str, np.ndarray]] = []
    acknowledged, killed, energised = 0, 0.0, False
    try:
        while True:
            if not killed and time.monotonic() >= until:
                energised = level(levels)[0] != 0.0
                os.kill(recorder.process, signal.SIGKILL)  # noqa: TID251  # the point of it
                killed = time.time()
            message = recorder.next(5.0 if killed else max(0.0, min(0.02, until - time.monotonic())))
            if message is None:
                continue
            if message.kind == "block":
                until = min(until, time.monotonic() + after) if not parts else until
                parts.append(dict(message.arrays))
            if message.kind == "progress":
                acknowledged = int(message["acknowledged"])
    except IpmclabError:
        pass  # its process is gone
    recorder.close()
    while level(levels)[0] != 0.0 and time.time() < killed + 10.0:
        time.sleep(0.01)
    volts, since = level(levels)
    zero_after = max(0.0, since - killed) if volts == 0.0 else float("inf")
    zero_after = zero_after if killed else float("nan")
    sent = {name: np.concatenate([part[name] for part in parts]) for name in (parts[0] if parts else ())}
    return Kill(uuid, after, energised, zero_after, acknowledged, sent)


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
    if math.isnan(killed.zero_after):
        return ["the recorder ended before it was killed"]
    if killed.zero_after > WITHIN:
        wrong.append(f"the output was at 0 V after {killed.zero_after:.2f} s")
    seen = len(killed.sent.get("voltage", ()))
    found = list((folder / "laboratory" / "runs").rglob(f"*_{killed.uuid[:8]}.nc"))
    if not found:
        return wrong + ([f"no run, and {killed.acknowledged} rows were acknowledged"] if killed.acknowledged else [])
    run = read_run(found[0])
    if run.metadata.state != "recovered":
        wrong.append(f"its state is {run.metadata.state}")
    if len(run) < killed.acknowledged:
        wrong.append(f"{killed.acknowledged} rows were acknowledged, {len(run)} are there")
    if seen - len(run) > WITHIN * RATE:
        wrong.append(f"{seen} rows were sent, {len(run)} are there")
    for name, sent in killed.sent.items():
        both = min(len(sent), len(run))
        if not np.array_equal(sent[:both], getattr(run, name)[:both], equal_nan=True):
            wrong.append(f"the {name} is not what was sent")
    return wrong


def fingerprints(folder: Path) -> dict[str, str]:
    """SHA-256 of every run file."""
    files = (folder / "laboratory" / "runs").rglob("*.nc")
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def run_kills(folder: Path, kills: int, seed: int = SEED) -> tuple[list[Kill], list[str]]:
    """Kill so many recorders one after the other; gives them, and what went wrong."""
    rng = np.random.default_rng(seed)
    done: list[Kill] = []
    wrong: list[str] = []
    earlier: dict[str, str] = {}
    next_one: list[Recorder] = []
    with stand_in(folder) as levels:
        recorder = prepare(folder)
        for number in range(kills):
            # The next one gets ready, and recovers what the last one left, while this one records.
            getting_ready = threading.Thread(target=lambda: next_one.append(prepare(folder)))
            after, early = float(rng.uniform(0.0, LATEST)), number % 10 == 0
            one = kill(recorder, levels, after, getting_ready.start, early=early)
            done.append(one)
            getting_ready.join()
            recorder = next_one.pop()
            now = fingerprints(folder)
            wrong += [f"kill {number}: {name} was changed" for name, sha in earlier.items() if now.get(name) != sha]
            earlier = now
            if sys.stderr.isatty():
                print(f"{number + 1} of {kills}: 0 V after {one.zero_after:.2f} s", file=sys.stderr)
        recorder.request("stop")
        recorder.close()
        wait_for_end(recorder.process)  # it may be recovering what the last one left, and then holds its journal
    recover(Laboratory.open(folder / "laboratory"))
    now = fingerprints(folder)
    wrong += [f"at the end: {name} was changed" for name, sha in earlier.items() if now.get(name) != sha]
    for number, one in enumerate(done):
        wrong += [f"kill {number}, after {one.after:.2f} s: {text}" for text in check(folder, one)]
    return done, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/kills.md")
    options = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        done, wrong = run_kills(Path(folder), options.kills)
    zero = np.array([one.zero_after for one in done if one.energised])
    rows = np.array([one.acknowledged for one in done])
    unsafe = np.array([len(one.sent.get("voltage", ())) - one.acknowledged for one in done])
    report = [
        f"* {len(done)} kills, {len(zero)} of them with a voltage on the strip, up to {LATEST:g} s after the first "
        f"rows; {time.monotonic() - began:.0f} s in all; seed {SEED}",
        f"* output at 0 V after {np.median(zero):.2f} s (median), {zero.max():.2f} s at most; bound {WITHIN:g} s",
        f"* {rows.sum()} rows were acknowledged before the kills, every one of them is in a recovered run",
        f"* rows that a client had been sent and that were not yet acknowledged: {np.median(unsafe):.0f} (median), "
        f"{unsafe.max()} at most, of {RATE:g} a second",
        f"* {len(wrong)} faults" + "".join(f"\n  * {text}" for text in wrong),
    ]
    title = "Recorders killed with SIGKILL at random moments, on the stand-in chassis in real time"
    finish("kills", title, "\n".join(report), [], record=options.record, gate=False)
    if wrong:
        sys.exit(1)


if __name__ == "__main__":
    main()
