"""What a task costs on a Dask cluster, and what follows for 1,000 workers.

Run ``python -m benchmarks.cluster [--record]``. A scheduler and four workers, all on this machine, which hold each
other up: so what is measured is processor time of scheduler and client, and bytes that the client sends and gets, for
tasks that do nothing; then a sweep as a whole, in this process, in processes of this machine and on the cluster. The
table for more workers is computed from these numbers.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil

from benchmarks.batch import SWEEP
from benchmarks.harness import clock, finish
from ipmclab import read_sweep, run_sweep, simulate_many
from ipmclab.engine import Engine, Pace, in_order, opened
from ipmclab.engine.cluster import cluster
from ipmclab.model import load_actuator
from ipmclab.sweep.chunks import MOST_VALUES, Filling, Measured
from ipmclab.sweep.parts import Parts
from ipmclab.sweep.sweep_file import sweep_from_text

SOURCES = ("benchmarks/batch.py", "src/ipmclab/engine", "src/ipmclab/sweep", "src/ipmclab/model/many.py")

WORKERS: Final = 4
TASKS: Final = 1000
ROUNDS: Final = 5
SETS: Final = 131_072
TOGETHER: Final = 65_536  # sets in a file of a sweep that is worth a cluster

METRICS: Final = ["displacement.peak", "displacement.rms", "force.rms", "current.rms", "current.final"]


class Bytes:
    """What the client sends and gets, counted at Dask's own connection."""

    def __init__(self) -> None:
        import distributed.comm.tcp as tcp

        self.sent = self.got = 0
        write, read = tcp.TCP.write, tcp.from_frames

        async def counted_write(comm: Any, *arguments: Any, **named: Any) -> int:
            size: int = await write(comm, *arguments, **named)
            self.sent += size
            return size

        async def counted_read(frames: Any, *arguments: Any, **named: Any) -> Any:
            self.got += sum(len(frame) for frame in frames)
            return await read(frames, *arguments, **named)

        tcp.TCP.write, tcp.from_frames = counted_write, counted_read  # type: ignore[method-assign]


@contextmanager
def machines(folder: Path) -> Iterator[tuple[str, list[psutil.Process]]]:
    """A scheduler and its workers: its address, and the processes."""
    told = folder / "scheduler.json"

    def start(module: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *words, "--host", "127.0.0.1", "--no-dashboard"]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    started = [start("dask_scheduler", "--port", "0", "--scheduler-file", str(told))]
    try:
        while not (told.is_file() and told.read_text().endswith("}")):
            time.sleep(0.1)
        address = json.loads(told.read_text())["address"]
        words = (address, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
        started += [start("dask_worker", *words) for _ in range(WORKERS)]
        yield address, [psutil.Process(one.pid) for one in started]
    finally:
        for process in started:
            process.kill()
            process.wait()


def spent(process: psutil.Process) -> float:
    """Processor time of a process [s]."""
    times = process.cpu_times()
    return float(times.user + times.system)


def overhead(engine: Engine, scheduler: psutil.Process, count: Bytes) -> dict[str, float]:
    """What one task costs: the least of the rounds, for what else runs here only adds to it."""
    rounds = []
    for _ in range(ROUNDS):
        mine, its, sent, got = clock(), spent(scheduler), count.sent, count.got
        list(engine.map(max, 0, range(TASKS)))
        rounds.append([clock() - mine, spent(scheduler) - its, count.sent - sent, count.got - got])
    return dict(zip(("client", "scheduler", "sent", "got"), np.min(rounds, axis=0) / TASKS, strict=True))


def collecting(folder: Path) -> float:
    """Processor time [s] of the client for each set: its parameters made, its metrics put together and written."""
    sweep = sweep_from_text(SWEEP)
    parts = Parts(folder, SETS, TOGETHER)
    random = np.random.default_rng(20261123)
    metrics = {name: random.standard_normal(SETS) for name in sweep.metrics.names}
    filling, begun = Filling(parts), clock()
    for begin in range(0, SETS, 10_000):
        end = min(begin + 10_000, SETS)
        some = Measured((begin, end), {name: values[begin:end] for name, values in metrics.items()}, 1.0)
        for part, columns in filling.take(some):
            parts.write(part, {**sweep.design.sets(*parts.ends(part)), **columns})
    return (clock() - begun) / SETS


def set_costs() -> dict[str, float]:
    """Processor time [s] of one set of 2,000 samples, five metrics: of a linear strip, and of one with a leak."""
    found = {}
    for name, sets in (("friend-2", 20_000), ("friend-2+leak.exponential", 200)):
        strip = load_actuator(name)
        moduli = {"beam.modulus": np.linspace(0.8e9, 2e9, sets)}
        some = {"beam.modulus": moduli["beam.modulus"][:8]}
        for changes in (some, moduli):
            begun = clock()
            simulate_many(strip, "sine 1 V 0.5 Hz", changes, duration="40 s", rate="50 Hz", reduce=METRICS)
        found[name] = (clock() - begun) / sets
    return found


def swept(folder: Path, engine: Engine | None, others: list[psutil.Process]) -> tuple[float, list[bytes]]:
    """Processor time of all processes [s] for a sweep, and its files."""
    sweep = read_sweep(folder.parent / "sweep.toml")
    mine, theirs = clock(), sum(map(spent, others))
    done = run_sweep(sweep, folder, engine=engine)
    used = clock() - mine + sum(map(spent, others)) - theirs
    return used, [done.parts.path(part).read_bytes() for part in range(done.parts.files)]


def planned(task: dict[str, float], each_set: float, costs: dict[str, float]) -> str:
    """What follows for more workers, as a table."""
    slowest = max(task["client"], task["scheduler"])
    rows = [
        "| strip | workers | sets in a chunk | it lasts | tasks a second | scheduler busy | client busy |",
        "|---|---|---|---|---|---|---|",
    ]
    linear, leak = costs.values()
    for strip, cost in (("linear", linear), ("leak", leak)):
        for workers in (4, 16, 100, 1000):
            pace = Pace(most=MOST_VALUES // len(METRICS))
            pace.learn(1_000_000, 1_000_000 * cost)
            sets = pace.size(10**12, workers)
            rate = workers / (sets * cost)
            busy = workers / cost * each_set + rate * task["client"]
            rows.append(
                f"| {strip} | {workers} | {sets:,} | {sets * cost:.1f} s | {rate:.0f} | "
                f"{100 * rate * task['scheduler']:.0f} % | {100 * busy:.0f} % |"
            )
    most = [cost / each_set for cost in (linear, leak)]
    return (
        "\n".join(rows) + f"\n\nThe slower of the two hands out {1.0 / slowest:.0f} tasks a second at most. One client "
        f"collects {1e-6 / each_set:.1f} million sets a second: it keeps up with {most[0]:.0f} workers on the linear "
        f"strip, and with {most[1]:.0f} where there is a leak. Beyond 100 % further workers gain nothing."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/cluster.md")
    options = parser.parse_args()

    count, costs = Bytes(), set_costs()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sweep.toml").write_text(SWEEP, encoding="utf-8")
        for once in ("first", "again"):  # the first time it loads what it needs
            (folder / once).mkdir()
            each_set = collecting(folder / once)
        rows = [("this process", *swept(folder / "here", None, []))]
        with opened(workers=2) as engine:
            in_order(engine, max, 0, [0, 1])
            children = psutil.Process().children()
            rows.append(("2 processes", *swept(folder / "processes", engine, children)))
        with machines(folder) as (address, processes), cluster(address) as engine:
            while engine.workers < WORKERS:
                time.sleep(0.1)
            list(engine.map(max, 0, range(TASKS)))
            task = overhead(engine, processes[0], count)
            sent, got = count.sent, count.got
            rows.append((f"scheduler and {WORKERS} workers", *swept(folder / "cluster", engine, processes)))
            sent, got = count.sent - sent, count.got - got
    for where, _, files in rows[1:]:
        if files != rows[0][2]:
            raise SystemExit(f"{where}: the files differ from those of this process")
    body = [
        f"Dask on this machine, {WORKERS} workers; {TASKS} tasks that do nothing, least of {ROUNDS} rounds, for each "
        "task:",
        "",
        "| | |",
        "|---|---|",
        f"| processor time of the scheduler | {1e3 * task['scheduler']:.2f} ms |",
        f"| processor time of the client | {1e3 * task['client']:.2f} ms |",
        f"| sent by the client | {task['sent']:.0f} bytes |",
        f"| received by the client | {task['got']:.0f} bytes |",
        "",
        f"Processor time of one set of 2,000 samples and five metrics: {1e6 * costs['friend-2']:.1f} us of a linear "
        f"strip, {1e6 * costs['friend-2+leak.exponential']:.0f} us of one with a leak; of the client for its row in "
        f"the files, {1e6 * each_set:.2f} us.",
        "",
        f"A sweep of {SETS:,} linear strips, all processes together, with what workers load before their first set; "
        "the files are the same to the last bit:",
        "",
        "| where | processor time |",
        "|---|---|",
        *(f"| {where} | {used:.2f} s |" for where, used, _ in rows),
        "",
        f"On the cluster the client sent {sent / 1e3:.0f} kB and got {got / SETS:.1f} bytes for each set, of which 40 "
        "are its five metrics.",
        "",
        "On paper, for more workers, each with a processor for itself; chunks as `ipmclab.engine.pace` makes them:",
        "",
        planned(task, each_set, costs),
    ]
    finish("cluster", "A cluster", "\n".join(body), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
