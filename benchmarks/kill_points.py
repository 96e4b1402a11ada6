"""Processes killed between two system calls that are named, or at a random moment, and what must hold afterwards.

The finaliser makes a run file of a journal, ``ipmclab recover`` deals with two journals and the catalogue. strace
kills a process as it enters the N-th call of a name: what came before is done, that call and what follows is not. Its
calls are first counted in a run that is left alone, so that every N is one that comes.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from uuid import uuid4

import numpy as np

from ipmclab import read_run
from ipmclab.platform import python_child
from ipmclab.run import RunMetadata
from ipmclab.store.catalogue.catalogue import Catalogue
from ipmclab.store.journal.finalise import finalise
from ipmclab.store.journal.journal import Journal, JournalHeader
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.recover import recover

COLUMNS: Final = ("voltage", "current", "current_raw")
SLOWEST: Final = 60.0
"""A process that is to be killed may take so long [s]."""

CHANGING: Final = (
    "write",
    "pwrite64",
    "fsync",
    "fdatasync",
    "rename",
    "unlink",
    "chmod",
    "mkdir",
    "flock",
    "ftruncate",
)
"""Between these a finaliser or a recovery is killed: all that changes a file, a name or a lock."""


@dataclass(frozen=True)
class Point:
    """Where a process is killed: as it enters the ``number``-th call of this name."""

    call: str
    number: int

    def __str__(self) -> str:
        return f"before {self.call} {self.number}"

    @property
    def options(self) -> list[str]:
        """For strace."""
        inject = f"inject={self.call}:signal=KILL:when={self.number}"
        return ["-qq", "-e", f"trace={self.call}", "-e", inject, "-o", "/dev/null"]


def attach(process: int, point: Point) -> subprocess.Popen[bytes]:
    """strace at all threads that a process has; its children are left alone."""
    threads = [word for task in Path(f"/proc/{process}/task").iterdir() for word in ("-p", task.name)]
    return subprocess.Popen(["strace", *point.options, *threads], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def count(command: list[str], folder: Path) -> Counter[str]:
    """How often a command that is left alone makes each call."""
    log = folder / "calls"
    traced = ["strace", "-qq", "-e", f"trace={','.join(CHANGING)}", "-o", str(log), *command]
    subprocess.run(traced, check=True, capture_output=True, timeout=SLOWEST)
    return Counter(re.findall(r"^(\w+)\(", log.read_text(encoding="utf-8", errors="replace"), re.MULTILINE))


def draw(calls: Counter[str], rng: np.random.Generator) -> Point:
    """A name, each as likely as another, and one of its calls."""
    call = str(rng.choice(sorted(calls)))
    return Point(call, int(rng.integers(1, calls[call] + 1)))


def record(root: Path, rows: int, *, ended: bool) -> str:
    """A journal of so many rows, each of which tells its number; gives the id of its run."""
    uuid = str(uuid4())
    journal = Journal.create(root, JournalHeader(uuid, 1000.0, COLUMNS, metadata=RunMetadata(signal="step 1 V")))
    for first in range(0, rows, 100):
        block = np.arange(first, min(first + 100, rows))
        journal.append(first, np.multiply.outer(block, [1.0, 0.5, 0.25]))
        journal.event("environment", first / 1000.0, temperature=22.0)
    if ended:
        journal.end("complete")
    else:
        journal.close()
    return uuid


def kill_one(command: list[str], where: Point | float) -> None:
    """Run a command until it is killed, at a point or after a time [s]; one that ends before is left."""
    if isinstance(where, Point):
        traced = ["strace", *where.options, *command]
        subprocess.run(traced, check=False, capture_output=True, timeout=SLOWEST)
        return
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        time.sleep(where)
        child.kill()


def finaliser(root: Path) -> list[str]:
    """The command that makes a run file of the one journal of a laboratory."""
    (journal,) = (root / "recording").glob("*.runj")
    return python_child("ipmclab.store.journal.finalise", str(journal), str(root))


def recovery(root: Path) -> list[str]:
    """``ipmclab recover``."""
    return [sys.executable, "-P", "-m", "ipmclab", "recover", str(root)]


def finish(root: Path) -> None:
    """Recover what a kill left, also where a finaliser of the one that was killed goes on alone."""
    until = time.monotonic() + SLOWEST
    while (root / "recording").is_dir() and list((root / "recording").glob("*.runj")):
        told = recover(root)
        assert not told.failed, told.failed
        assert time.monotonic() < until, "a journal stays in use"
        time.sleep(0.05)
    recover(root)


def wrong_rows(root: Path, uuid: str, rows: int, *, ended: bool) -> list[str]:
    """What is wrong with the run of a journal."""
    found = list((root / "runs").rglob(f"*_{uuid[:8]}.nc"))
    if len(found) != 1:
        return [f"{len(found)} run files of {uuid[:8]}"]
    run = read_run(found[0])
    numbers = np.arange(rows)
    wrong = []
    if len(run) != rows:
        wrong.append(f"{rows} rows were acknowledged, {len(run)} are there")
    elif not (np.array_equal(run.voltage, numbers) and np.array_equal(run.channels["current"], 0.5 * numbers)):
        wrong.append("the rows are not what was written")
    state = "complete" if ended else "recovered"
    if run.metadata.state != state:
        wrong.append(f"its state is {run.metadata.state}, not {state}")
    return wrong


def trial(
    root: Path, command: Callable[[Path], list[str]], journals: int, where: Point | float, rng: np.random.Generator
) -> list[str]:
    """Journals that end in all ways, one process that is killed over them, and what is wrong once all is recovered."""
    first = record(root, 50, ended=True)
    finalise(Laboratory.open(root).journal(first), root)
    (earlier,) = (root / "runs").rglob("*.nc")
    before = earlier.read_bytes()
    made = {}
    for _ in range(journals):
        rows, ended = int(rng.integers(2, 4000)), bool(rng.integers(2))
        made[record(root, rows, ended=ended)] = (rows, ended)
    kill_one(command(root), where)
    finish(root)
    wrong = [text for uuid, (rows, ended) in made.items() for text in wrong_rows(root, uuid, rows, ended=ended)]
    if earlier.read_bytes() != before:
        wrong.append("an earlier run was changed")
    left = [path.name for path in root.rglob("*") if path.suffix in (".part", ".ballast", ".runj")]
    if len(left) != journals + 1:  # the archive has one of each
        wrong.append(f"files that nobody needs stay: {', '.join(left)}")
    catalogue = Catalogue(root)
    catalogue.sweep()
    if (listed := len(catalogue.query())) != journals + 1:
        wrong.append(f"the catalogue has {listed} runs of {journals + 1}")
    return wrong
