"""The page with half an hour behind it: it keeps up, and neither server nor browser grows.

``python -m benchmarks.page`` looks at it for minutes, and measures how quick it is: this machine may be busy.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.page import CHANNELS, JUMP, measure

MINUTES = 1.0 / 3.0


@pytest.mark.real_time
def test_half_an_hour_and_some_seconds_more(tmp_path: Path, chromium, monkeypatch: pytest.MonkeyPatch) -> None:
    # Eight seconds of a mouse that never rests: how many frames are drawn then, the benchmark looks at.
    monkeypatch.setattr("benchmarks.page._frames_while", lambda *_: math.nan)
    found = measure(tmp_path, MINUTES, chromium, paints=0, others=False)
    assert found.points_behind > 1_000_000
    assert len(CHANNELS) == 6
    assert found.behind < 3.0  # it has not fallen back
    assert len(found.latency) > 0.5 * 60 * MINUTES / JUMP  # what was drawn were the readings
    assert max(found.memory) < 400.0
    cut = len(found.memory) // 4
    assert np.median(found.memory[-cut:]) - np.median(found.memory[:cut]) < 10.0  # the rows themselves are 1 MB
    assert np.median(found.heap[-cut:]) - np.median(found.heap[:cut]) < 10.0
    assert found.imported == []
    assert found.outside == []
