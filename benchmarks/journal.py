"""The journal and what becomes of it: ``python -m benchmarks.journal [--hours H] [--folder DIR] [--record]``.

How many commits a second the disk takes and how long the slowest take; then an hour of 4 channels with their raw
volts at 10 kS/s: time and peak memory of the process that makes the run file, against a run of a tenth of that.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from uuid import uuid4

import numpy as np

from benchmarks.harness import finish as publish
from ipmclab.store.journal.finalise import finish
from ipmclab.store.journal.frames import EVENT
from ipmclab.store.journal.journal import Journal, JournalHeader, read_journal
from ipmclab.store.journal.journal import _Note as Note
from ipmclab.store.journal.journal import _Rows as Rows

SOURCES = ("src/ipmclab/store",)

CHANNELS = ("voltage", "current", "displacement", "force")
COLUMNS = (*CHANNELS, *(f"{name}_raw" for name in CHANNELS), "output_raw")
RATE = 10e3


def signals(first: int, count: int, random: np.random.Generator) -> np.ndarray:
    """What converters of 16 bits read of slow waves with noise, scaled to SI."""
    time_ = (first + np.arange(count)) / RATE
    volts = np.sin(2 * np.pi * np.multiply.outer(time_, [0.1, 0.3, 0.05, 0.2]))
    step = 10.0 / 2**16
    volts = np.round((volts + random.normal(scale=2e-3, size=volts.shape)) / step) * step
    output = np.sign(np.sin(2 * np.pi * 0.1 * time_))[:, None]
    return np.concatenate([volts * [1.0, 1.0, 2.5e-3, 9.81e-3], volts, output], axis=1)


def commits(folder: Path, rows: int, count: int) -> str:
    """One commit after the other, each one write and one sync."""
    journal = Journal.create(folder, JournalHeader(str(uuid4()), RATE, COLUMNS))
    block = signals(0, rows, np.random.default_rng(20261121))
    times = []
    begin = time.process_time()
    for number in range(count):
        item = Rows(number * rows, block) if rows else Note(EVENT, b'{"kind":"note","time":0.0,"text":"x"}')
        start = time.perf_counter()
        journal._commit([item])
        times.append(time.perf_counter() - start)
    processor = (time.process_time() - begin) / count
    size = journal.path.stat().st_size / count / 1e3
    journal.close()
    journal.path.unlink()
    p50, p99, longest = (1e3 * value for value in np.quantile(times, [0.5, 0.99, 1.0]))
    return (
        f"| {rows or 'an event'} | {size:.1f} | {count / sum(times):.0f} | {p50:.2f} | {p99:.2f} | {longest:.1f} "
        f"| {1e3 * processor:.2f} |"
    )


def recorded(folder: Path, seconds: float) -> tuple[Path, float]:
    """A journal of a long run, and the time [s] that it took."""
    random = np.random.default_rng(20261121)
    journal = Journal.create(folder, JournalHeader(str(uuid4()), RATE, COLUMNS))
    block = int(0.4 * RATE)
    start = time.perf_counter()
    for first in range(0, int(seconds * RATE), block):
        journal._commit([Rows(first, signals(first, block, random))])
    path = journal.end("complete")
    return path, time.perf_counter() - start


def finished(folder: Path, journal: Path) -> tuple[Path, float, float, float]:
    """The run file; the time and processor time [s] and the peak memory [MB] of the process that made it."""
    code = (
        "import sys, resource; from ipmclab.store.journal.finalise import main; status = main(sys.argv[1:]);"
        "used = resource.getrusage(resource.RUSAGE_SELF);"
        "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3, file=sys.stderr); sys.exit(status)"
    )
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code, journal, folder], capture_output=True, text=True, check=True)
    seconds = time.perf_counter() - start
    (path,) = folder.rglob(f"*_{journal.stem[:8]}.nc")
    processor, memory = map(float, done.stderr.split()[-2:])
    return path, seconds, processor, memory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--folder", type=Path, help="on the disk to measure")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/journal.md")
    options = parser.parse_args()
    lines = [
        "A commit is one write and one fsync; 4 channels, their raw volts and the output are 9 columns.",
        "",
        "| rows | kB | commits/s | p50 ms | p99 ms | longest ms | processor ms |",
        "|---|---|---|---|---|---|---|",
    ]
    with tempfile.TemporaryDirectory(dir=options.folder) as temporary:
        folder = Path(temporary)
        lines += [commits(folder, rows, 2000 if rows < 1000 else 500) for rows in (0, 20, 4000, 24000)]
        lines += [
            "",
            f"Long runs at {RATE / 1e3:g} kS/s: 4 channels with raw volts.",
            "",
            "| hours | journal MB | scan s | run file MB | made in s | processor s | peak memory MB |",
            "|---|---|---|---|---|---|---|",
        ]
        for hours in (options.hours / 10, options.hours):
            path, _ = recorded(folder, 3600.0 * hours)
            size = path.stat().st_size / 1e6
            os.sync()
            start = time.perf_counter()
            assert read_journal(path).n_rows == int(3600.0 * hours * RATE)
            scan = time.perf_counter() - start
            run, seconds, processor, memory = finished(folder, path)
            made = run.stat().st_size / 1e6
            lines.append(
                f"| {hours:g} | {size:.0f} | {scan:.1f} | {made:.0f} | {seconds:.1f} | {processor:.1f} | {memory:.0f} |"
            )
        small = Journal.create(folder, JournalHeader(str(uuid4()), 50.0, COLUMNS))
        small.append(0, signals(0, 2500, np.random.default_rng(1)))
        ended = small.end("complete")
        start = time.perf_counter()
        finish(ended, folder)
        lines += ["", f"The 40 s of the thesis at 50 S/s, with its rests: {time.perf_counter() - start:.2f} s in all."]
    publish("journal", "The journal", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
