"""Where the time of a command goes: until its first word, until its end, and what is imported meanwhile.

Run ``python -m benchmarks.first_words [--rounds 3] [--record]``. Each command is a whole process at a terminal, and has
run once before. Its processor time is told, for a busy machine takes none of it away; the shares of imports are of the
clock of one more run (``-X importtime``). Then the time from ``ipmclab record`` to the first volt on the stand-in
chassis, by the clock: the recorder, its guardian and NI's client are processes of their own. Linux only.
"""

from __future__ import annotations

import argparse
import os
import pty
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np

import ipmclab
from benchmarks.harness import finish
from benchmarks.kills import level, stand_in

SOURCES = ("src/ipmclab",)
WANTED: Final = 1.0
"""Seconds in which an answer begins."""

TICK: Final = os.sysconf("SC_CLK_TCK")
SHARE: Final = 0.05
"""A package whose import takes less of a command is not named."""

COMMANDS: Final = (
    "--help",
    "simulate friend-2 --signal 'step 1 V' --duration '40 s' --rate '50 Hz' --out {new}.nc",
    "check step.nc",
    "rig check thesis",
    "identify friend-2 step.nc --free electrical --out {new}.toml",
    "validate fitted.toml sine.nc",
    "forecast fitted.toml step.nc --origin '15 s'",
    "profile fitted.toml step.nc",
    "posterior fitted.toml step.nc --out {new}.nc",
    "next fitted.toml --minutes 15",
    "compare step.nc sine.nc --out {new}.html",
    "report fitted.toml --runs step.nc --validation sine.nc --out {new}.html",
    "characterise friend-chapter-5 --plan",
    "choose step.nc sine.nc --models branches=1,branches=2 --actuator friend-2",
)


def make_files(folder: Path) -> None:
    """Two records of a strip, 750 rows each, and a fit of the first."""
    strip = ipmclab.load_actuator("friend-2")
    generator = np.random.default_rng(20261123)
    for name, signal in (("step", "step 1 V delay=1 s"), ("sine", "sine 1 V 0.2 Hz delay=1 s")):
        clean = ipmclab.simulate(strip, signal, duration=30.0, rate=25.0)
        read = {
            channel: clean.channels[channel] + noise * generator.standard_normal(len(clean))
            for channel, noise in (("current", 1e-4), ("displacement", 2e-6))
        }
        run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, **read)
        ipmclab.write_run(run, folder / f"{name}.nc")
    fit = ipmclab.identify(strip, ipmclab.read_run(folder / "step.nc"), free="electrical,coupling")
    ipmclab.write_fit(fit, folder / "fitted.toml")


def words_of(command: str, turn: int) -> list[str]:
    """The words of a command, whose output has a name of its own in each turn."""
    text = command.format(new=f"{command.split()[0]}-{turn}")
    return [quoted or bare for quoted, bare in re.findall(r"'([^']*)'|(\S+)", text)]


def at_terminal(words: Sequence[str], folder: Path) -> tuple[float, float]:
    """Processor time [s] of a command until its first word and until its end."""
    screen, terminal = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "ipmclab", *words],
        cwd=folder, stdin=subprocess.DEVNULL, stdout=terminal, stderr=terminal,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
    )  # fmt: skip
    os.close(terminal)
    said, first = b"", np.nan
    with suppress(OSError):  # the end of what a terminal gives
        while piece := os.read(screen, 65536):
            said += piece
            if np.isnan(first) and re.search(rb"\w", re.sub(rb"\x1b\[[?\d;]*[A-Za-z]", b"", said)):
                told = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
                first = (int(told[11]) + int(told[12])) / TICK
    os.close(screen)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(words)} failed:\n{said.decode(errors='replace')}")
    return first, used.ru_utime + used.ru_stime


def imports(words: Sequence[str], folder: Path) -> str:
    """The packages that take most of a command to import, each with its share of the time."""
    began = time.perf_counter()
    command = [sys.executable, "-X", "importtime", "-m", "ipmclab", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", check=True)
    whole = time.perf_counter() - began
    took: Counter[str] = Counter()
    for micros, name in re.findall(r"import time:\s+(\d+) \|\s+\d+ \|\s+([\w.]+)", done.stderr):
        took[name.partition(".")[0]] += int(micros)
    most = [f"{name} {100e-6 * one / whole:.0f} %" for name, one in took.most_common(4) if 1e-6 * one > SHARE * whole]
    return f"{100e-6 * took.total() / whole:.0f} %" + (f": {', '.join(most)}" if most else "")


def first_volt(folder: Path, rounds: int) -> list[float]:
    """Seconds of the clock from ``ipmclab record`` to a voltage on the stand-in."""
    took = []
    with stand_in(folder) as levels:
        experiment = folder / "experiment.toml"
        text = experiment.read_text(encoding="utf-8").replace('"60 s"', '"2 s"')
        experiment.write_text(text.replace("square 1 V 0.2 Hz", "step 1 V"), encoding="utf-8")
        for _ in range(rounds + 1):
            began = time.time()
            command = [sys.executable, "-m", "ipmclab", "record", str(experiment), "--yes"]
            with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
                while level(levels)[0] == 0.0:
                    time.sleep(0.005)
                    if process.poll() is not None:
                        raise SystemExit("no voltage came")
                took.append(level(levels)[1] - began)
    return took[1:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/first_words.md")
    options = parser.parse_args()
    rows, late = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_files(folder)
        for command in COMMANDS:
            shares = imports(words_of(command, 0), folder)
            found = [at_terminal(words_of(command, turn), folder) for turn in range(1, options.rounds + 1)]
            first, end = np.median(np.array(found), axis=0)
            rows.append(f"| {command.split(' --')[0].replace(' {new}', '')} | {first:.2f} s | {end:.2f} s | {shares} |")
            late += [command.split()[0]] if first > WANTED else []
            print(rows[-1], file=sys.stderr, flush=True)
        volts = first_volt(folder, options.rounds)
    body = "\n".join(
        [
            f"Processor time, medians of {options.rounds}. Wanted is a first word within {WANTED:g} s"
            + (f"; later: {', '.join(late)}." if late else "; every command keeps to it."),
            "",
            "| command | first word | end | imports, of all of it |",
            "|---|---|---|---|",
            *rows,
            "",
            f"From `ipmclab record` to the first volt on the stand-in, by the clock: {np.median(volts):.1f} s "
            f"(median of {len(volts)}; {min(volts):.1f} to {max(volts):.1f} s).",
        ]
    )
    finish("first_words", "Where the time of a command goes", body, [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
