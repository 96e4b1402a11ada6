"""How many small changes to the code does the suite notice?

Run ``python -m benchmarks.mutants [--changes 200] [--workers 2] [--limit 240] [--again] [--record]``. Changes are drawn
over ``src`` with seed 20261121, a tenth from each of ``rig/safety`` and ``store/journal`` besides their part of the
whole; those of these rooms are tried first. Each is made in a copied tree, where the tests that could notice run until
one fails. What was found is kept under ``build/`` as it is found: a call that is ended goes on where it was, as long as
the changed files are what they were. Tests that were written since are asked with ``--again``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import tempfile
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from benchmarks.harness import finish
from benchmarks.mutation.changes import SEED, STRICT, Change, draw
from benchmarks.mutation.noticing import Imports
from benchmarks.mutation.trial import LIKELIEST, Trial, Verdict

SOURCES = ("src", "tests", "benchmarks/mutation")
ROOT = Path(__file__).parents[1]
NOTICED, NOTICED_STRICT = 0.80, 0.95
"""Of the changes, at least: over the whole house, and in each of the strict rooms."""


class Known:
    """Verdicts on disk, one a line, each under the text of the file that it is about."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(exist_ok=True)
        self._path, self._lock = path, threading.Lock()
        self._verdicts: dict[str, Verdict] = {}
        self._missed: set[str] = set()
        for line in path.read_text().splitlines() if path.exists() else ():
            found = json.loads(line)
            key, change = found.pop("key"), Change(**found.pop("change"))
            self._keep(key, Verdict(change, **found))

    def get(self, change: Change) -> Verdict | None:
        """What is known of a change."""
        return self._verdicts.get(_key(change))

    def is_open(self, change: Change, again: bool) -> bool:
        """Whether it is to be tried: nothing is known of it, or ``again`` and no test noticed it."""
        verdict = self.get(change)
        return verdict is None or (again and verdict.noticed_by is None)

    def was_missed(self, change: Change) -> bool:
        """Whether a trial of it, this one or one before, ended without a test that noticed it."""
        return _key(change) in self._missed

    def _keep(self, key: str, verdict: Verdict) -> None:
        self._verdicts[key] = verdict
        if verdict.noticed_by is None:
            self._missed.add(key)

    def add(self, verdict: Verdict) -> None:
        """Keep it, for good."""
        key = _key(verdict.change)
        with self._lock, self._path.open("a") as file:
            self._keep(key, verdict)
            file.write(json.dumps({"key": key, **asdict(verdict)}) + "\n")


def _key(change: Change) -> str:
    text = (ROOT / change.path).read_bytes()
    return hashlib.sha256(text + repr((change.path, change.begin, change.new)).encode()).hexdigest()


def judge(changes: list[Change], known: Known, workers: int, limit: float) -> None:
    """Put changes on trial."""
    imports = Imports(ROOT)
    pending = sorted(
        changes, key=lambda change: change.room not in STRICT
    )  # what costs a strip or a record comes first
    lock = threading.Lock()

    def work(folder: Path) -> None:
        trial = Trial(ROOT, folder)
        while True:
            with lock:
                if not pending:
                    return
                change = pending.pop(0)
            verdict = trial.of(change, imports.tests_of(change.path), limit)
            known.add(verdict)
            print(
                f"{verdict.seconds:5.0f} s  {_where(change)}: {_what(change)}: {verdict.noticed_by or 'SURVIVED'}",
                flush=True,
            )

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(work, Path(folder) / str(k)) for k in range(workers)]:
            done.result()


def _where(change: Change) -> str:
    return f"{change.path.removeprefix('src/').removeprefix('ipmclab/')}:{change.line}"


def _what(change: Change) -> str:
    old = " ".join(change.old.split())
    short = old if len(old) <= 50 else f"{old[:47]}..."
    return f"`{short}` to `{change.new}`" if change.new else f"`{short}` dropped"


def page(verdicts: list[Verdict], drawn: int, missed: int) -> str:
    """The score by room, and what nobody noticed, today and when it was tried first."""
    tried = Counter(verdict.change.room for verdict in verdicts)
    noticed = Counter(verdict.change.room for verdict in verdicts if verdict.noticed_by)
    late = Counter(verdict.change.room for verdict in verdicts if verdict.out_of_time)
    rows = [(room, tried[room], noticed[room], late[room]) for room in sorted(tried)]
    rows.append(("**all**", tried.total(), noticed.total(), late.total()))
    asked = {**dict.fromkeys(STRICT, NOTICED_STRICT), "**all**": NOTICED}
    table = "\n".join(
        f"| {room} | {n} | {a} | {n - a - b} | {b} | {a / n:.0%} | {f'{asked[room]:.0%}' if room in asked else ''} |"
        for room, n, a, b in rows
    )
    survivors = "\n".join(
        f"| {_where(verdict.change)} | {_what(verdict.change)} |{' the time was over' if verdict.out_of_time else ''} |"
        for verdict in sorted(verdicts, key=lambda verdict: (verdict.change.path, verdict.change.line))
        if not verdict.noticed_by
    )
    return (
        f"{len(verdicts)} of {drawn} changes drawn over `src` (seed {SEED}) were put on trial, each before the "
        f"examples of its module and the {LIKELIEST - 1} test files that are likeliest to notice it, in "
        f"{sum(verdict.seconds for verdict in verdicts) / 3600.0:.1f} hours. At "
        f"their first trial {missed} were not noticed: tests that were written since count here.\n\n"
        "| room | tried | noticed | not noticed | time over | score | at least |\n|---|---|---|---|---|---|---|\n"
        f"{table}\n\n"
        "## Noticed by no test\n\nSome of these change nothing that can be seen: a test cannot notice them.\n\n"
        f"| where | change | |\n|---|---|---|\n{survivors}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--changes", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--limit", type=float, default=240.0, help="for one change [s]")
    parser.add_argument("--again", action="store_true", help="try once more what no test has noticed")
    parser.add_argument("--known", action="store_true", help="report what is known already, try nothing")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/mutants.md")
    options = parser.parse_args()
    if shutil.which("git") is None:
        raise SystemExit("git is not found: the copied tree holds the files that it lists")
    changes = draw(ROOT, options.changes)
    known = Known(ROOT / "build" / "mutants.jsonl")
    if not options.known:
        asked = [change for change in changes if known.is_open(change, options.again)]
        judge(asked, known, options.workers, options.limit)
    verdicts = [verdict for change in changes if (verdict := known.get(change))]
    if not verdicts:
        raise SystemExit("no change was put on trial")
    missed = sum(map(known.was_missed, (verdict.change for verdict in verdicts)))
    finish(
        "mutants", "Small changes noticed", page(verdicts, len(changes), missed), [], record=options.record, gate=False
    )


if __name__ == "__main__":
    main()
