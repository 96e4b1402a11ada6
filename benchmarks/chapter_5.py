"""Chapter 5 of the thesis as a campaign: ``python -m benchmarks.chapter_5 [--of FOLDER] [--page FILE | --record]``.

The whole of ``friend-chapter-5`` at the virtual bench with its report, timed, and every number that the thesis prints
of these runs beside the one that the campaign gives. ``docs/chapter_5.md`` shows what ``--page`` wrote, as CI does with
every change, or else what was recorded.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.harness import Ratio, finish
from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign_file import load_campaign
from ipmclab.campaign.published import Reproduced, reproduced
from ipmclab.campaign.results import by_repeat, read_results
from ipmclab.campaign.state import read_events

SOURCES = (
    "src/ipmclab/campaign/library",
    "src/ipmclab/campaign/published.py",
    "src/ipmclab/campaign/results.py",
    "src/ipmclab/quality/metrics.py",
    "src/ipmclab/rig/virtual.py",
    "src/ipmclab/data",
)

CAMPAIGN = "friend-chapter-5"
HEAD = (
    *("sample", "figure", "measured", "signal", "condition", "number"),
    *("thesis", "campaign", "unit", "difference", "tolerance"),
)

ALLOWED = 180.0
"""Seconds on two cores for all runs, analysis and report."""


def row(one: Reproduced) -> str:
    """One line of the table."""
    number, found = (one.quantity.to_display(value) for value in (one.number, one.mean))
    bound = "> " if one.published.qualifier == "lower_bound" else ""
    return (
        f"| {one.published.sample} | {one.published.figure} | {one.published.measured} | {one.signal} "
        f"| {one.published.conditions} | {one.published.metric.replace('_', ' ')} | {bound}{number:.4g} | {found:.4g} "
        f"| {one.quantity.display_unit} | {100.0 * one.difference:+.1f} % | {100.0 * one.tolerance:.0f} % |"
    )


def _used() -> float:
    """Seconds of a processor that the processes took which this one has started."""
    times = os.times()
    return times.children_user + times.children_system


def carried_out(folder: Path) -> tuple[float, float]:
    """Carry the campaign out: seconds, and seconds of a processor."""
    began, used = time.monotonic(), _used()
    command = [sys.executable, "-m", "ipmclab", "characterise", CAMPAIGN, "--out", str(folder), "--json"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - began, _used() - used


def main() -> None:
    """Run it, time it, and hold it against the thesis."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--of", type=Path, help="a folder in which it was carried out already; no time is told then")
    parser.add_argument("--page", type=Path, help="where the docs look for the table; every number has to be met")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--gate", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = asked.of or Path(name) / "out"
        times = None if asked.of else carried_out(folder)
        recorded = {one["run"]: one for one in read_events(folder) if one["event"] == "recorded"}
        results = read_results(folder, blocks_of(load_campaign(CAMPAIGN)), recorded)
    found = reproduced(by_repeat(results))
    agree = sum(one.agrees for one in found)
    flagged = sum(one.verdict == "flagged" for one in results)
    told = "" if times is None else f" in {times[0]:.0f} s, of which {times[1]:.0f} s of a processor"
    lines = [
        f"{len(results)} runs, their metrics, comparisons and a report{told}; {flagged} runs are flagged.",
        "",
        f"Of {len(found)} printed numbers {agree} are met within the tolerance with which the strips of the library "
        "were identified from them.",
        "",
        f"| {' | '.join(HEAD)} |",
        "|" + "---|" * len(HEAD),
        *(row(one) for one in found),
    ]
    if asked.page is not None:
        asked.page.parent.mkdir(parents=True, exist_ok=True)
        asked.page.write_text("\n".join(lines) + "\n", encoding="utf-8")
        sys.exit(f"{len(found) - agree} printed numbers are not met: see {asked.page}" if agree < len(found) else 0)
    ratios = [Ratio("printed numbers met / all", np.array([agree / len(found)]), at_least=1.0)]
    if times is not None:
        ratios.append(Ratio("seconds of a processor / 180 s", np.array([times[1] / ALLOWED]), at_most=1.0))
    title = "Chapter 5 of the thesis, published and reproduced by a campaign at the virtual bench"
    finish("chapter_5", title, "\n".join(lines), ratios, record=asked.record, gate=asked.gate)


if __name__ == "__main__":
    main()
