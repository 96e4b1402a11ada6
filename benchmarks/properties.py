"""What the suite says of any input, asked of many that are drawn anew.

Run ``python -m benchmarks.properties [PATH ...] [--draws 50000] [--minutes 60] [--record]``. The suite draws a hundred
examples of each property, in CI the same ones every time. Here every property is drawn in rounds, each from a seed of
its own (20261121 and on), until it has the draws or the time is over: what was really drawn stands in the table. The
first rounds are short, so that all have their turn. A property that says of itself that it is costly has a tenth. What
was drawn is kept under ``build/``: a call that is ended goes on where it was, as long as the sources are the same.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

import pytest
from hypothesis import settings

from benchmarks.harness import finish
from benchmarks.sources import digest

SOURCES = ("src", "tests")
ROOT = Path(__file__).parents[1]
SEED: Final = 20261121
ROUND: Final = 250, 2000
"""Draws of a property in a round, the first and at most: worth the start of a process, and all come round."""

DRAWS: Final = "IPMCLAB_DRAWS"


@pytest.hookimpl(trylast=True)
def pytest_configure() -> None:
    """As a plugin of the pytest that draws: the thorough profile, with the draws of a round."""
    settings.register_profile("round", settings.get_profile("thorough"), max_examples=int(os.environ[DRAWS]))
    settings.load_profile("round")


def properties(paths: Sequence[str]) -> dict[str, list[str]]:
    """The tests that draw, by file."""
    listed = _pytest([*paths, "--collect-only", "-q"], 1)
    found: dict[str, list[str]] = {}
    for line in listed.splitlines():
        file, colons, _ = line.partition("::")
        if colons:
            found.setdefault(file, []).append(line)
    if not found:
        sys.exit(f"no property was found:\n{listed}")
    return found


def rounds(draws: int) -> Iterator[tuple[int, int]]:
    """The seed of each round, and its draws: each has twice those of the one before it, up to the most."""
    done, size = 0, ROUND[0]
    for seed in itertools.count(SEED):
        if done >= draws:
            return
        yield seed, min(size, draws - done)
        done, size = done + size, min(2 * size, ROUND[1])


class Drawn:
    """What is drawn, on disk: one round of a file a line, under the text of all sources."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(exist_ok=True)
        self._path, self._sources = path, digest("properties")
        lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
        self._rounds = {tuple(line["round"]): line for line in lines if line["sources"] == self._sources}

    def turn(self, file: str, draws: int, seed: int, end: float) -> tuple[dict[str, int], dict[str, str]]:
        """What is known of a round of a file, or comes of it now: nothing where the time is over."""
        known = self._rounds.get((file, draws, seed))
        if known is None and time.monotonic() >= end:
            return {}, {}
        if known is not None:
            return known["held"], known["failed"]
        held, failed = draw(file, draws, seed)
        line = {"round": (file, draws, seed), "sources": self._sources, "held": held, "failed": failed}
        with self._path.open("a") as stream:
            stream.write(json.dumps(line) + "\n")
        print(f"{file}, seed {seed}: {held.total()} held, {len(failed)} broken", flush=True)
        return held, failed


def draw(file: str, draws: int, seed: int) -> tuple[Counter[str], dict[str, str]]:
    """How many examples of each property of a file held, and what was said of one that did not."""
    told = _pytest([file, "--hypothesis-show-statistics", f"--hypothesis-seed={seed}", "--tb=short"], draws)
    held: Counter[str] = Counter()
    name = ""
    for line in told.splitlines():
        if re.fullmatch(r"\S.*::.*:", line):
            name = line[:-1]
        elif found := re.search(r"(\d+) passing,", line):
            held[name] += int(found[1])
    failed = {found[1]: found[2] for found in re.finditer(r"^FAILED (\S+::.*?)(?: - (.*))?$", told, re.MULTILINE)}
    for line in failed:
        print(f"{line}, seed {seed}:\n{told}", flush=True)
    return held, failed


def _pytest(arguments: Sequence[str], draws: int) -> str:
    command = [sys.executable, "-m", "pytest", "-p", "benchmarks.properties", "-m", "hypothesis", *arguments]
    environment = {**os.environ, DRAWS: str(draws)}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False).stdout


def page(asked: dict[str, list[str]], held: Counter[str], failed: dict[str, str], draws: int) -> str:
    """Every property with its draws, and what broke."""
    names = [name for file in asked.values() for name in file]
    rows = "\n".join(f"| {name} | {held[name]} | {'FAILS' if name in failed else ''} |" for name in names)
    broken = "\n".join(f"* `{name}`: {text}" for name, text in failed.items()) or "None."
    return (
        f"{len(names)} properties, {held.total()} examples that held; asked were {draws} of each, drawn from "
        f"seed {SEED} and on.\n\n| property | held | |\n|---|---|---|\n{rows}\n\n## Broken\n\n{broken}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", default=["tests"])
    parser.add_argument("--draws", type=int, default=50_000, help="of each property")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="after which no round begins")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/properties.md")
    parser.add_argument("--gate", action="store_true", help="exit 1 when a property breaks")
    options = parser.parse_args()
    end = time.monotonic() + 60.0 * options.minutes
    asked = properties(options.paths)
    held: Counter[str] = Counter()
    failed: dict[str, str] = {}
    drawn = Drawn(ROOT / "build" / "properties.jsonl")
    with ThreadPoolExecutor(options.workers) as pool:
        for seed, draws in rounds(options.draws):
            turns = [pool.submit(drawn.turn, file, draws, seed, end) for file in asked]
            for turn in turns:
                more, broken = turn.result()
                held.update(more)
                failed.update(broken)
    finish(
        "properties",
        "Properties drawn anew",
        page(asked, held, failed, options.draws),
        [],
        record=options.record,
        gate=False,
    )
    if options.gate and failed:
        sys.exit(f"broken: {', '.join(failed)}")


if __name__ == "__main__":
    main()
