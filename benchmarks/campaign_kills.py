"""Campaigns killed with SIGKILL and gone on with: ``python -m benchmarks.campaign_kills [--kills 20] [--record]``.

A campaign at the virtual bench is killed some time after a sitting of it began, again and again, and started anew with
the same command; then ``friend-chapter-5``, at random moments from its start to its report (``--short`` leaves it out).
At the end it must be the campaign that nobody disturbed: every run there, none twice, each with the same readings to
the last bit, the same verdicts, the same facts of each strip, the same models and the same tables.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.harness import finish
from ipmclab import read_fit, read_run
from ipmclab.campaign.state import FILE, MODELS, read_events
from ipmclab.cli.characterise import REPEATS

SOURCES = ("src/ipmclab/campaign", "src/ipmclab/cli/characterise.py", "src/ipmclab/cli/sitting.py")

SEED = 20261123
LATEST = 1.2
"""A kill comes up to so many seconds after a sitting began: a short run is over then, and the next one begun."""

PATIENCE = 120.0

CHAPTER_5 = "friend-chapter-5"

STARTS = 3.0
"""A command takes so many seconds, at the least, before it goes on with anything."""

SPREAD: Final = 1.6
"""Kills come eight tenths of the way on the average: nearly all of them meet the campaign at work."""

CAMPAIGN = """
title = "killed"
seed = 7
order = "randomised"
measure = ["mass", "stiffness"]
[method]
rate = "50 Hz"
duration = "2 s"
rest_before = "1 s"
rest_after = "0 s"
zero_time = "0.5 s"
fingerprint = false
[[samples]]
id = "friend-1"
actuator = "friend-1-measured"
[[samples]]
id = "friend-3"
actuator = "friend-3-measured"
[[experiments]]
name = "displacement"
measured = ["current", "displacement"]
signals = ["step 1 V", "sine 1 V 2 Hz"]
repeats = {repeats}
"""


def command(campaign: Path | str, folder: Path) -> list[str]:
    """What starts a campaign, and what goes on with it."""
    return [sys.executable, "-m", "ipmclab", "characterise", str(campaign), "--out", str(folder)]


def result(folder: Path) -> dict[str, object]:
    """What a campaign gave: of each run its verdict and its readings, the facts, and the models.

    Raises
    ------
    AssertionError
        A run was kept twice, or a whole run file belongs to none.
    """
    events = read_events(folder)
    kept = [one for one in events if one["event"] == "recorded" and one["verdict"] in ("kept", "flagged")]
    names = [one["run"] for one in kept]
    assert len(names) == len(set(names)), f"kept twice: {sorted(names)}"
    used = {folder / one["path"] for one in events if one["event"] == "recorded"}
    there = {path for path in (folder / "runs").rglob("*.nc") if read_run(path).metadata.state == "complete"}
    assert there <= used, f"belongs to no run: {there - used}"
    found: dict[str, object] = {
        f"{one['sample']} {one['name']}": one["value"] for one in events if one["event"] == "fact"
    }
    for one in kept:
        run = read_run(folder / one["path"])
        readings = b"".join(values.tobytes() for _, values in sorted(run.channels.items()))
        found[one["run"]] = (one["verdict"], hashlib.sha256(readings).hexdigest())
    for path in sorted((folder / MODELS).glob("*.toml")):
        found[path.name] = {name: one.value for name, one in read_fit(path).parameters.items()}
    return found


def undisturbed(campaign: Path | str, folder: Path) -> dict[str, object]:
    """The campaign from its first run to its last."""
    subprocess.run(command(campaign, folder), check=True, capture_output=True)
    return result(folder)


def disturbed(campaign: Path, folder: Path, delays: Sequence[float]) -> tuple[dict[str, object], int]:
    """The same, killed so long [s] after a sitting began, once for each delay; with how many kills met it at work."""
    met = 0
    for delay in delays:
        met += killed(campaign, folder, delay)
    subprocess.run(command(campaign, folder), check=True, capture_output=True)
    return result(folder), met


def killed(campaign: Path, folder: Path, delay: float) -> bool:
    """Start it, and kill it; False where it was over before."""
    log, until = folder / FILE, time.monotonic() + PATIENCE
    before = log.read_bytes().count(b'"sitting"') if log.exists() else 0
    process = subprocess.Popen(command(campaign, folder), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None and time.monotonic() < until:
        if log.exists() and log.read_bytes().count(b'"sitting"') > before:
            time.sleep(delay)
            break
        time.sleep(0.01)
    met = process.poll() is None
    process.kill()
    process.wait()
    return met


def struck(campaign: str, folder: Path, moments: Sequence[float]) -> int:
    """Start a campaign and kill it so long [s] after, once for each moment; how many kills met it at work."""
    met = 0
    for moment in moments:
        process = subprocess.Popen(command(campaign, folder), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            met += 1
        process.kill()
        process.wait()
    return met


def chapter_5(kills: int, draw: random.Random, folder: Path) -> str:
    """The thesis's campaign, killed at moments that are spread over all of its time."""
    began = time.monotonic()
    expected = undisturbed(CHAPTER_5, folder / "whole")
    took = time.monotonic() - began
    moments = [draw.uniform(STARTS, STARTS + SPREAD * took / kills) for _ in range(kills)]
    met = struck(CHAPTER_5, folder / "killed", moments)
    found = undisturbed(CHAPTER_5, folder / "killed")
    assert found == expected
    tables = [(folder / name / REPEATS).read_bytes() for name in ("whole", "killed")]
    assert tables[0] == tables[1]
    models = sum(name.endswith(".toml") for name in found)
    return (
        f"`{CHAPTER_5}`, killed at random moments from its start to its report: {met} of {kills} kills met it at work. "
        f"All {len(found)} results, of which {models} are models of samples with each parameter, are the same to the "
        "last bit, and so is the table of means, scatter and intervals; no run is there twice."
    )


def main() -> None:
    """Kill, go on, compare, and say what came of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--short", action="store_true", help="without the campaign of chapter 5")
    parser.add_argument("--record", action="store_true")
    asked = parser.parse_args()
    draw = random.Random(SEED)
    delays = [draw.uniform(0.0, LATEST) for _ in range(asked.kills)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        campaign = folder / "campaign.toml"
        campaign.write_text(CAMPAIGN.format(repeats=max(2, asked.kills // 2)))
        expected = undisturbed(campaign, folder / "whole")
        found, met = disturbed(campaign, folder / "killed", delays)
        interrupted = sum(one.get("verdict") == "interrupted" for one in read_events(folder / "killed"))
        assert found == expected
        (folder / CHAPTER_5).mkdir()
        thesis = "" if asked.short else chapter_5(asked.kills, draw, folder / CHAPTER_5)
    lines = [
        f"{met} of {asked.kills} kills met the campaign at work, each up to {LATEST:g} s after a sitting began. "
        f"{interrupted} runs were cut off, kept as such and recorded again.",
        "",
        f"All {len(found)} results (runs with their readings and verdicts, facts of the strips, models) are those of "
        "the campaign that nobody disturbed; no run is there twice.",
        *(["", thesis] if thesis else []),
    ]
    title = "A campaign at the virtual bench, killed and gone on with"
    finish("campaign_kills", title, "\n".join(lines), [], record=asked.record, gate=False)


if __name__ == "__main__":
    main()
