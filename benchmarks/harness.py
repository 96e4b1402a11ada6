"""What every benchmark shares: interleaved rounds, ratios, and a record of the machine."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.sources import LINE, RESULTS, digest

clock = time.process_time
"""Processor time of this process, all its threads together: what other processes take is not in it."""


def interleave(
    candidates: Mapping[str, Callable[[], object]], *, rounds: int, seconds: float = 5e-4
) -> dict[str, npt.NDArray[np.float64]]:
    """Time per call of each candidate in each round [s]; within a round every candidate has its turn.

    Every second round goes backwards, so that each candidate comes as often before its neighbour as after it. A
    turn is as many calls as fit into ``seconds``, at least one: so short that what disturbs a turn disturbs few of
    them, and neighbours meet the same clock rate and the same caches.
    """
    calls: dict[str, int] = {}
    for name, candidate in candidates.items():
        shortest = min(_timed(candidate, 1) for _ in range(5))
        calls[name] = max(1, round(seconds / max(shortest, 1e-7)))
    times: dict[str, list[float]] = {name: [] for name in candidates}
    order = list(candidates)
    for _ in range(rounds):
        for name in order:
            times[name].append(_timed(candidates[name], calls[name]))
        order.reverse()
    return {name: np.array(values) for name, values in times.items()}


def _timed(candidate: Callable[[], object], calls: int) -> float:
    repeats = range(calls)
    candidate()  # whoever ran before filled the caches with its own
    start = clock()
    for _ in repeats:
        candidate()
    return (clock() - start) / calls


@dataclass(frozen=True)
class Ratio:
    """Time of one candidate over another's, as the median over rounds, and what it must keep to.

    Without a bound it is only reported.
    """

    name: str
    rounds: npt.NDArray[np.float64]
    at_most: float = np.inf
    at_least: float = 0.0

    @property
    def median(self) -> float:
        return float(np.median(self.rounds))

    @property
    def holds(self) -> bool:
        return self.at_least <= self.median <= self.at_most

    def __str__(self) -> str:
        low, high = np.quantile(self.rounds, [0.1, 0.9])
        bounds = [f"at least {self.at_least:g}"] if self.at_least > 0.0 else []
        bounds += [f"at most {self.at_most:g}"] if np.isfinite(self.at_most) else []
        verdict = ("holds" if self.holds else "FAILS") if bounds else ""
        return f"| {self.name} | {self.median:.3g} ({low:.3g} to {high:.3g}) | {', '.join(bounds)} | {verdict} |"


RATIO_HEAD = "| ratio of times | median (10 to 90 % of rounds) | gate | |\n|---|---|---|---|"


def machine() -> str:
    """Processor, system, versions, date and load, as lines for a result file."""
    packages = ("numpy", "scipy", "numba", "xarray", "ipmclab")
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in packages)
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return "\n".join(
        [
            f"* {datetime.now().astimezone():%Y-%m-%d %H:%M %Z}, load {load} at the end",
            f"* {_processor()}, {os.cpu_count()} cores, {platform.platform()}",
            f"* Python {platform.python_version()}, {versions}",
            f"* commit {_commit()}",
        ]
    )


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _commit() -> str:
    try:
        result = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--exclude", "*"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return result.stdout.strip()


def finish(name: str, title: str, body: str, ratios: list[Ratio], *, record: bool, gate: bool) -> None:
    """Print the result; write it under ``results/``; with ``gate``, exit 1 when a ratio is missed."""
    table = "\n".join([RATIO_HEAD, *map(str, ratios)]) if ratios else ""
    page = f"# {title}\n\n{machine()}\n{LINE}{digest(name)}\n\n{body}\n\n{table}".strip() + "\n"
    print(page)
    if record:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / f"{name}.md").write_text(page, encoding="utf-8")
    missed = [ratio.name for ratio in ratios if not ratio.holds]
    if gate and missed:
        sys.exit(f"missed: {'; '.join(missed)}")
