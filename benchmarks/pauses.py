"""Which tests hang on a machine that runs without a pause?

Run ``python -m benchmarks.pauses [PATH ...] [--pause 2.2] [--gap 0.1 0.9] [--seed 1] [--record]``. Each file of tests
runs while all its processes, those it starts too, are stopped again and again for ``--pause`` seconds, as a virtual
machine or a loaded one stops them; between two stops they go on for a time drawn from ``--gap``. Tests that are marked
``real_time`` are left out: their matter is time. Stopped processes take no processor, so that several calls may go
side by side. Linux only: who is whose child is read off ``/proc``.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from benchmarks.harness import finish

SOURCES = ("src", "tests")
ROOT = Path(__file__).parents[1]


def family(pid: int) -> list[int]:
    """A process and all that it started, directly or not."""
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            children.setdefault(parent, []).append(int(folder.name))
    found = [pid]
    for one in found:
        found += children.get(one, [])
    return found


def is_stopped(pid: int) -> bool:
    """Whether somebody else has stopped it: a test that does goes on with it itself."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "T"
    except OSError:
        return False


def stop_all(pid: int, seconds: float) -> None:
    """Stop a process and all that it started for so long [s]."""
    running = [one for one in family(pid) if not is_stopped(one)]
    try:
        for one in running:
            with suppress(OSError):
                os.kill(one, signal.SIGSTOP)
        time.sleep(seconds)
    finally:
        for one in running:
            with suppress(OSError):
                os.kill(one, signal.SIGCONT)


def run(file: str, pause: float, gap: Sequence[float], seed: int) -> tuple[int, str]:
    """Run a file of tests under pauses: how many passed, and the names of those that failed."""
    command = [sys.executable, "-m", "pytest", "-n0", "-q", "--tb=short", "-m", "not real_time", file]
    drawn = random.Random(f"{seed} {file}")
    with tempfile.TemporaryFile("w+", encoding="utf-8") as out:  # a pipe that is full would stop it for good
        process = subprocess.Popen(command, cwd=ROOT, stdout=out)
        while process.poll() is None:
            with suppress(subprocess.TimeoutExpired):
                process.wait(drawn.uniform(*gap))
                break
            stop_all(process.pid, pause)
        out.seek(0)
        told = out.read()
    failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", told, re.MULTILINE)
    if failed:
        print(told, flush=True)
    passed = re.search(r"(\d+) passed", told)
    return int(passed[1]) if passed else 0, ", ".join(failed)


def files(paths: Sequence[str]) -> list[str]:
    """The files of tests under some paths."""
    found: list[Path] = []
    for path in (ROOT / path for path in paths):
        found += sorted(path.rglob("test_*.py")) if path.is_dir() else [path]
    return [str(path.relative_to(ROOT)) for path in found]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", default=["tests"])
    parser.add_argument("--pause", type=float, default=2.2, help="how long all of them are stopped [s]")
    parser.add_argument("--gap", type=float, nargs=2, default=(0.1, 0.9), help="they go on for so long between [s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/pauses.md")
    parser.add_argument("--gate", action="store_true", help="exit 1 when a test fails")
    options = parser.parse_args()
    rows, broken = [], []
    for file in files(options.paths):
        passed, failed = run(file, options.pause, options.gap, options.seed)
        rows.append(f"| {file} | {passed} | {failed} |")
        print(rows[-1], flush=True)
        broken += [file] if failed else []
    table = "\n".join(["| tests | passed | failed |", "|---|---|---|", *rows])
    about = (
        f"Stopped for {options.pause:g} s after each {options.gap[0]:g} to {options.gap[1]:g} s, seed {options.seed}."
    )
    finish("pauses", "Tests on a machine that pauses", f"{about}\n\n{table}", [], record=options.record, gate=False)
    if options.gate and broken:
        sys.exit(f"failed: {', '.join(broken)}")


if __name__ == "__main__":
    main()
