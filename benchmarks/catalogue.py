"""The catalogue with ten thousand runs: questions, sweeps, a rebuild, and two writers at once.

Run ``python -m benchmarks.catalogue [--runs 10000] [--gate] [--record]``, on SQLite and, where its programs are
installed, on a PostgreSQL of its own. The gate is the stated figure: every question is answered in less than 100 ms of
processor time of this process and 100 ms by the clock at its best of the rounds, which a busy machine changes least.
The answers are held against a loop over what was written before anything is timed.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchmarks.harness import Ratio, finish
from ipmclab.run import Finding, Run
from ipmclab.store.catalogue.catalogue import Catalogue, Range, RunQuery
from ipmclab.store.run_file import write_run
from tests.store.catalogue.postgres import cluster, programs

SOURCES = ("src/ipmclab/store", "src/ipmclab/run")

LIMIT = 0.1
"""Of a question [s]."""

ROWS = 500
WRITERS = 2
TRANSACTIONS = 200

SIGNALS = ("step 1 V", "sine 1 V 0.1 Hz", "step 0 V for 5 s then square 0.5 V 0.1 Hz for 40 s")

WRITER = """
import sys, time, uuid
from ipmclab.run import RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.catalogue.catalogue import Catalogue
folder, address, rig, count = sys.argv[1:5]
catalogue = Catalogue(folder, address or None)
catalogue.begin(str(uuid.uuid4()), RunMetadata(sample=Sample(rig)))
print("ready", flush=True)
sys.stdin.readline()
for k in range(int(count) - 1):
    start = time.perf_counter()
    catalogue.begin(str(uuid.uuid4()), RunMetadata(sample=Sample(rig), signal="step 1 V", relative_humidity=50.0))
    print(time.perf_counter() - start, flush=True)
"""


@dataclass(frozen=True)
class Made:
    """What was written about one run."""

    sample: str
    signal: str
    humidity: float
    moment: datetime


def make_files(folder: Path, count: int) -> list[Made]:
    """Run files that differ in what they say of themselves; their arrays are those of one."""
    generator = np.random.default_rng(20261121)
    times = np.arange(ROWS) / 50.0
    noise = generator.normal(0.0, 1e-4, ROWS)
    run = Run.from_arrays(
        time=times, voltage=np.ones(ROWS), current=0.05 * np.exp(-times) + noise, force=1e-3 * times + noise
    )
    write_run(run, folder / "template.nc")
    template = folder / "template.nc"
    with h5py.File(template) as file:
        document: dict[str, Any] = json.loads(file.attrs["metadata_json"])
    made = []
    for k in range(count):
        one = Made(
            sample=f"S{k % 40}",
            signal=SIGNALS[k % 3],
            humidity=float(generator.uniform(20.0, 95.0)),
            moment=datetime(2026, 1, 1, tzinfo=UTC) + timedelta(minutes=20 * k),
        )
        made.append(one)
        metadata = {
            "uuid": str(uuid.UUID(int=k + 1)),
            "sample": {"id": one.sample, "membrane": "Nafion N117", "counter_ion": "Li+"},
            "mounting_id": f"m{k // 20}",
            "signal": one.signal,
            "state": "complete",
            "purpose": "signal",
            "relative_humidity": one.humidity,
            "recorded_at": one.moment.isoformat(),
            "run_number": k,
        }
        text = json.dumps({**document, "metadata": {**document["metadata"], **metadata}})
        path = folder / f"{k // 1000:02d}" / f"{k:06d}.nc"
        path.parent.mkdir(exist_ok=True)
        shutil.copyfile(template, path)
        with h5py.File(path, "r+") as file:
            file.attrs["metadata_json"] = text
            file.attrs["metadata_sha256"] = hashlib.sha256(text.encode()).hexdigest()
    template.unlink()
    return made


def questions(made: list[Made]) -> dict[str, tuple[RunQuery, int]]:
    """Questions, each with the number of runs that answer it by a loop over what was written."""
    edge = datetime(2026, 3, 1, tzinfo=UTC)
    return {
        "every run": (RunQuery(), len(made)),
        "sample, waveform, amplitude, humidity": (
            RunQuery(sample="S4", signal="sine", amplitude=Range(0.9, 1.1), humidity=Range(60.0, 82.0)),
            sum(one.sample == "S4" and "sine" in one.signal and 60.0 <= one.humidity <= 82.0 for one in made),
        ),
        "a sample's life": (RunQuery(sample="S7"), sum(one.sample == "S7" for one in made)),
        "channel and humidity": (
            RunQuery(measured=("force",), humidity=Range(78.0, 82.0)),
            sum(78.0 <= one.humidity <= 82.0 for one in made),
        ),
        "since a date": (RunQuery(since=edge.timestamp()), sum(one.moment >= edge for one in made)),
        "a finding": (RunQuery(findings=("noted",)), len(made[::100])),
        "state": (RunQuery(state="missing"), 0),
    }


def timed(call: Callable[[], object], rounds: int) -> tuple[float, float, float]:
    """Median and best time by the clock [s], and the best processor time [s]."""
    clock, processor = [], []
    for _ in range(rounds):
        start, spent = time.perf_counter(), time.process_time()
        call()
        clock.append(time.perf_counter() - start)
        processor.append(time.process_time() - spent)
    return float(np.median(clock)), min(clock), min(processor)


def once(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def write_at_once(folder: Path, address: str | None) -> tuple[list[float], int]:
    """Processes that write at the same time: their times [s], and how many rows are missing afterwards."""
    words = [sys.executable, "-c", WRITER, str(folder), address or ""]
    writers = [
        subprocess.Popen(
            [*words, f"rig {k}", str(TRANSACTIONS)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for k in range(WRITERS)
    ]
    for writer in writers:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        assert writer.stdin is not None
        writer.stdin.write("go\n")
        writer.stdin.flush()
    times = [float(line) for writer in writers for line in writer.communicate(timeout=600)[0].split()]
    there = sum(len(Catalogue(folder, address).query(RunQuery(sample=f"rig {k}"))) for k in range(WRITERS))
    return times, WRITERS * TRANSACTIONS - there


def measure(name: str, folder: Path, address: str | None, made: list[Made], rounds: int) -> tuple[str, list[Ratio]]:
    catalogue = Catalogue(folder, address)
    told: list[int] = []
    first = once(lambda: catalogue.sweep(None, lambda done, _: told.append(done)))
    assert told == list(range(1, len(made) + 1)), "progress is told file by file"
    rows = catalogue.query()
    assert [row.sample for row in rows] == [one.sample for one in made]
    catalogue.inspect(rows[::100], lambda _: [Finding("noted", "info", "seen")])
    lines, ratios = [], []
    for text, (query, expected) in questions(made).items():
        found = len(catalogue.query(query))
        if found != expected:
            raise SystemExit(f"{name}, {text}: {found} runs, a loop over them finds {expected}")
        median, best, processor = timed(lambda query=query: catalogue.query(query), rounds)  # type: ignore[misc]
        lines.append(f"| {text} | {found} | {1e3 * median:.1f} | {1e3 * best:.1f} | {1e3 * processor:.1f} |")
        ratios.append(Ratio(f"{name}: {text} / 100 ms", np.array([max(best, processor) / LIMIT]), at_most=1.0))
    unchanged, _, _ = timed(catalogue.sweep, rounds)
    rebuilt = once(catalogue.rebuild)
    assert len(catalogue.query()) == len(made)
    times, lost = write_at_once(folder, address)
    if lost:
        raise SystemExit(f"{name}: {lost} rows lost")
    p50, p99 = np.quantile(times, [0.5, 0.99]) * 1e3
    body = (
        f"## {name}\n\n"
        "| question | runs | median ms | best ms | processor ms |\n|---|---|---|---|---|\n" + "\n".join(lines) + "\n\n"
        f"* first look at {len(made)} files: {first:.1f} s; rebuild: {rebuilt:.1f} s (findings not computed anew)\n"
        f"* look at {len(made)} files that did not change: {unchanged:.2f} s\n"
        f"* {WRITERS} processes, {TRANSACTIONS} transactions each, at once: p50 {p50:.1f} ms, p99 {p99:.1f} ms, "
        f"largest {1e3 * max(times):.0f} ms; no row lost\n"
    )
    return body, ratios


@contextlib.contextmanager
def addresses() -> Iterator[dict[str, str | None]]:
    binaries = programs()
    if binaries is None:
        yield {"SQLite": None}
        return
    with cluster(binaries) as server:
        yield {"SQLite": None, f"PostgreSQL {server.version} (without fsync)": server.new_database()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a question takes longer than 100 ms")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/catalogue.md")
    options = parser.parse_args()
    os.environ.pop("IPMCLAB_CATALOGUE", None)
    bodies, ratios = [], []
    with tempfile.TemporaryDirectory() as folder, addresses() as places:
        made = make_files(Path(folder), options.runs)
        for name, address in places.items():
            body, found = measure(name, Path(folder), address, made, options.rounds)
            bodies.append(body)
            ratios += found
    head = (
        f"{options.runs} run files of {ROWS} rows and three channels. A question is `Catalogue.query`: connect, ask, "
        "and a row of 33 facts for each run.\n\n"
    )
    finish("catalogue", "Catalogue", head + "\n".join(bodies), ratios, record=options.record, gate=options.gate)


if __name__ == "__main__":
    main()
