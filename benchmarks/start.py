"""What a user of the command line feels: whole processes, from start to end, with their peak memory.

Run ``python -m benchmarks.start [--rounds 3] [--gate] [--record]``. Times and memory are printed and recorded;
what is gated is only what a slower machine cannot change: the time of ``--help`` over that of
``python -c "import numpy"``, that of a warm ``simulate`` over that of importing its libraries, and memory.
Peak memory is the largest of a child's own (Linux and macOS; left out on Windows).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ipmclab
from benchmarks.harness import Ratio, finish

SOURCES = ("src/ipmclab/cli", "src/ipmclab/__init__.py", "src/ipmclab/model")

# Runs one command and prints its time [s] and the peak memory [MB] of it and of what it started.
WATCH = """
import subprocess, sys, time
start = time.perf_counter()
status = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
seconds = time.perf_counter() - start
try:
    import resource
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / (1024.0**2 if sys.platform == "darwin" else 1024.0)
except ImportError:
    peak = float("nan")
if status.returncode:
    sys.exit(status.stderr.decode(errors="replace"))
print(seconds, peak)
"""


@dataclass(frozen=True)
class Command:
    """A whole process: its arguments, the time it should keep to [s], and memory [MB]."""

    name: str
    arguments: tuple[str, ...]
    seconds: float | None = None
    megabytes: float | None = None
    fresh_cache: bool = False
    rounds: int | None = None
    """How often, where not as often as the others: the shortest ones need more for a median that stands still."""


def watch(command: Command, folder: Path, turn: int) -> tuple[float, float]:
    """Time [s] and peak memory [MB] of one whole process, in an empty folder of its own."""
    place = folder / f"{command.name.replace(' ', '-').replace(',', '')}-{turn}"
    place.mkdir()
    environment = dict(os.environ)
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OMP_WAIT_POLICY"):
        environment.pop(name, None)  # as a user runs it
    if command.fresh_cache:
        environment["IPMCLAB_CACHE"] = str(place / "cache")
    result = subprocess.run(
        [sys.executable, "-c", WATCH, sys.executable, *command.arguments],
        capture_output=True,
        text=True,
        cwd=place,
        env=environment,
        check=False,
        timeout=300,
    )
    if result.returncode:
        raise SystemExit(f"{command.name} failed:\n{result.stderr}")
    seconds, peak = map(float, result.stdout.split())
    return seconds, peak


def commands(folder: Path) -> list[Command]:
    run = folder / "given.nc"
    ipmclab.write_run(ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=40.0, rate=50.0), run)
    simulate = (
        "-m", "ipmclab", "simulate", "friend-2", "--signal", "step 1 V", "--duration", "40 s", "--rate", "50 Hz",
        "--out", "run.nc",
    )  # fmt: skip
    identify = ("-m", "ipmclab", "identify", "friend-2", str(run), "--out", "fitted.toml")
    demo = ("-m", "ipmclab", "demo")
    return [
        Command("import numpy", ("-c", "import numpy"), rounds=15),
        Command("import of numpy, h5py, typer", ("-c", "import numpy, h5py, typer"), rounds=9),
        Command("--help", ("-m", "ipmclab", "--help"), seconds=0.2, rounds=15),
        Command("simulate", simulate, seconds=0.5, megabytes=400.0, rounds=9),
        Command("identify", identify, seconds=0.9, megabytes=400.0, rounds=9),
        Command("demo", demo, seconds=30.0, megabytes=400.0),
        Command("simulate, first run", simulate, megabytes=600.0, fresh_cache=True, rounds=1),
        Command("demo, first run", demo, megabytes=600.0, fresh_cache=True, rounds=1),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio or a memory limit is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/start.md")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        todo = commands(folder)
        times: dict[str, list[float]] = {command.name: [] for command in todo}
        peaks: dict[str, list[float]] = {command.name: [] for command in todo}
        for command in todo:  # the first start reads files from disk and fills the kernel cache
            if not command.fresh_cache:
                watch(command, folder, 0)
        for turn in range(1, max(command.rounds or options.rounds for command in todo) + 1):
            for command in todo:
                if turn > (command.rounds or options.rounds):
                    continue
                seconds, peak = watch(command, folder, turn)
                times[command.name].append(seconds)
                peaks[command.name].append(peak)
    rows = []
    for command in todo:
        seconds, peak = float(np.median(times[command.name])), float(np.max(peaks[command.name]))
        wanted = f"{command.seconds:g} s" if command.seconds else "-"
        limit = f"{command.megabytes:g} MB" if command.megabytes else "-"
        rows.append(f"| {command.name} | {seconds:.3f} s | {wanted} | {peak:.0f} MB | {limit} |")
    body = (
        f"Whole processes, medians of {options.rounds} (more of the shorter ones; first runs: 1); "
        "memory is the largest of the rounds. "
        "A first run starts with an empty kernel cache.\n\n"
        "| command | time | wanted | peak memory | wanted |\n|---|---|---|---|---|\n" + "\n".join(rows)
    )
    ratios = [
        Ratio("--help / import numpy", np.array(times["--help"]) / np.array(times["import numpy"]), at_most=1.0),
        Ratio(
            "simulate / import of numpy, h5py, typer",
            np.array(times["simulate"]) / np.array(times["import of numpy, h5py, typer"]),
            at_most=4.0,
        ),
    ]
    for command in todo:
        if command.megabytes and np.all(np.isfinite(peaks[command.name])):
            ratios.append(
                Ratio(
                    f"memory of {command.name} / {command.megabytes:g} MB",
                    np.array(peaks[command.name]) / command.megabytes,
                    at_most=1.0,
                )
            )
    finish("start", "Start-up, whole commands, memory", body, ratios, record=options.record, gate=options.gate)


if __name__ == "__main__":
    main()
