"""One change on trial: in a copied tree, the tests that could notice run one after the other until one fails.

A test that fails without the change, too, or that fails once and then passes, has noticed nothing. One that takes the
whole process with it has noticed.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

from benchmarks.mutation.changes import Change

BATCHES: Final = (3,)
"""How many files the first calls of pytest take: it reads all of a call's files before it runs the first test."""

REAL_TIME: Final = "real_time"
"""Tests that wait for a clock come last: one of them takes as long as a hundred others."""

LIKELIEST: Final = 10
"""Files that are asked: what these do not notice is as good as unnoticed, and the rest takes many minutes."""

SLACK: Final = 20.0
"""What a test may take longer with the change than three times without it, before the change counts as noticed [s]."""

FAILED: Final = (1, 2)
"""What pytest ends with where a test failed, and where a file of tests could not even be read."""

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["numpy", "scipy.signal", "scipy.optimize", "scipy.stats", "numba", "xarray", "h5py"])


@dataclass(frozen=True)
class Verdict:
    """What became of a change."""

    change: Change
    noticed_by: str | None
    seconds: float
    out_of_time: bool = False
    """It survived what the time allowed, not every test."""


class Tree:
    """A copy of the repository's files, with at most one change at a time."""

    def __init__(self, root: Path, folder: Path) -> None:
        listed = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True, check=True).stdout
        for name in listed.splitlines():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(root / name, folder / name)
        self.folder = folder
        self._cache = folder / ".pytest_cache"

    def test(self, arguments: Sequence[str], limit: float) -> _Outcome:
        """Run pytest until something fails or the time is over [s]."""
        shutil.rmtree(self._cache, ignore_errors=True)
        log = self.folder / ".log"
        options = ["-x", "-v", "-n0", "--no-header", "--tb=no", *arguments]
        start = time.monotonic()
        process = _SERVER.Process(target=_run_pytest, args=(self.folder, log, options))
        process.start()
        process.join(limit)
        if process.exitcode is None:
            _end(process)
            return _Outcome(_running(log.read_text(errors="replace")), time.monotonic() - start, over=True)
        if process.exitcode < 0:  # the change reaches beyond an array, say: the process ends with the test
            return _Outcome(_running(log.read_text(errors="replace")), time.monotonic() - start)
        return _Outcome(self._failed() if process.exitcode in FAILED else None, time.monotonic() - start)

    def _failed(self) -> str | None:
        path = self._cache / "v" / "cache" / "lastfailed"
        return next(iter(json.loads(path.read_text())), None) if path.exists() else None


@dataclass(frozen=True)
class _Outcome:
    test: str | None
    """That failed, or that ran when the time was over."""

    seconds: float
    over: bool = False

    @property
    def passed(self) -> bool:
        return self.test is None and not self.over


def _running(log: str) -> str | None:
    lines = [line for line in log.splitlines() if "::" in line]
    if not lines or re.search(r" (PASSED|SKIPPED|XFAIL|RERUN)", lines[-1]):
        return None
    return lines[-1].partition("Fatal Python error")[0].strip()


def _run_pytest(folder: Path, log: Path, options: list[str]) -> None:
    """In a process of its own, which a copied tree's sources are imported into."""
    os.setsid()
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    sys.stdout = sys.stderr = os.fdopen(output, "w", buffering=1)
    os.chdir(folder)
    sys.path.insert(0, str(folder / "src"))
    # What the tests start in their turn; and the same draws of properties each time.
    os.environ.update(PYTHONPATH=str(folder / "src"), PYTHONDONTWRITEBYTECODE="1", CI="true")
    import pytest

    status = int(pytest.main(options))
    sys.stdout.flush()
    os._exit(status)


def _end(process: BaseProcess) -> None:
    """End a pytest and what it started."""
    assert process.pid is not None
    os.killpg(process.pid, signal.SIGTERM)
    process.join(5.0)
    process.kill()
    process.join()


class Trial:
    """Puts changes on trial, one after the other."""

    def __init__(self, root: Path, folder: Path) -> None:
        self._changed = Tree(root, folder / "changed")
        self._unchanged = Tree(root, folder / "unchanged")
        self._deaf: set[str] = set()
        """Tests that fail without any change in this tree."""

    def of(self, change: Change, tests: Sequence[str], limit: float) -> Verdict:
        """Whether one of the tests notices a change within a time [s]."""
        path = self._changed.folder / change.path
        text = path.read_bytes()
        path.write_bytes(change.applied(text))
        start = time.monotonic()
        try:
            noticed = self._noticed_by(tests, start + limit)
        finally:
            path.write_bytes(text)
        took = time.monotonic() - start
        return Verdict(change, noticed, took, out_of_time=noticed is None and took >= limit)

    def _noticed_by(self, tests: Sequence[str], end: float) -> str | None:
        asked = list(tests[:LIKELIEST])
        pending = [*([*batch, f"-m=not {REAL_TIME}"] for batch in _batches(asked)), [*asked, f"-m={REAL_TIME}"]]
        while pending and (left := end - time.monotonic()) > 0.0:
            deselected = [f"--deselect={test}" for test in self._deaf]
            outcome = self._changed.test([*pending[0], *deselected], left)
            if outcome.test is None:
                pending = pending[1:]
            elif self._is_deaf(outcome.test):
                self._deaf.add(outcome.test)
            else:
                return outcome.test
        return None

    def _is_deaf(self, test: str) -> bool:
        """Whether a test that failed or did not end does so without the change, or not a second time with it."""
        only = [test] if "::" in test else ["--collect-only", "-q", test]
        without = self._unchanged.test(only, limit=120.0)
        return not without.passed or self._changed.test(only, 3.0 * without.seconds + SLACK).passed


def _batches(tests: Sequence[str]) -> list[Sequence[str]]:
    edges = [0, *BATCHES]
    return [batch for a, b in zip(edges, [*edges[1:], len(tests)], strict=True) if (batch := tests[a:b])]
