"""``ipmclab record`` on the stand-in chassis in lock-step, as a user runs it: what hangs on no time.

``test_record.py`` ends recordings in real time; that all 40 s of the thesis's experiment are read as they are at any
speed is in ``tests/rig/test_ni_bench.py``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.kills import EXPERIMENT, stand_in
from ipmclab import read_run

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX end the stand-in")


def test_the_experiment_of_the_thesis_and_the_life_of_its_sample(tmp_path: Path) -> None:
    """With fingerprint and pair, twice: one mounting, every run found by its sample."""
    command = [sys.executable, "-m", "ipmclab"]

    def call(*words: str) -> dict[str, Any]:
        done = subprocess.run([*command, *words, "--json"], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        document: dict[str, Any] = json.loads(done.stdout)
        return document

    with stand_in(tmp_path, "lock-step"):
        text = EXPERIMENT.replace("fingerprint = false", "").replace('["apply"]', '["clamp", "apply"]')
        text = (
            text.replace("60 s", "10 s")
            .replace('before = "0 s"', 'before = "5 s"')
            .replace("square 1 V 0.2 Hz", "step 1 V")
        )
        (tmp_path / "experiment.toml").write_text(text)
        first = call("record", "experiment.toml", "--pair", "--yes", "--answer", "clamp=done")
        second = call("record", "experiment.toml", "--answer", "clamp=kept")
    assert [run["purpose"] for run in first["runs"]] == ["fingerprint", "signal"] * 2
    recorded = [read_run(run["path"]) for run in [*first["runs"], *second["runs"]]]
    assert len({run.metadata.mounting_id for run in recorded}) == 1
    plus, minus, again = (run for run in recorded if run.metadata.purpose == "signal")
    assert plus.metadata.pair_id == minus.metadata.pair_id is not None
    assert again.metadata.pair_id is None
    assert len(again) == 1000
    assert again.raw.keys() >= {"voltage", "current", "output"}
    # The peak of the thesis's tables, behind the shunt of 1 ohm: 1 V over 17.57 ohm.
    assert again.current is not None
    assert plus.current is not None
    assert np.max(plus.current) == pytest.approx(56.9e-3, rel=0.02)
    told = call("runs", "laboratory", "--sample", "friend-2")
    assert len(told["runs"]) == 6
