"""The virtual bench at another speed, for a machine that is ten times slower or faster than this one.

``IPMCLAB_BENCH_SPEED=0.1 uv run pytest tests/rig tests/page tests/cli`` holds each of its blocks back for nine times as
long as it took. Faster than it computes no bench can be; at 10 the clock of what looks on goes at a tenth instead, so
that ten times as many rows come between two of its looks. What acts in mid-run at a row does not see the difference.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from ipmclab.rig import virtual
from ipmclab.rig.bench import Block
from ipmclab.rig.experiments import bench_clock, live, requests
from ipmclab.rig.rows import RowSource
from ipmclab.store.journal import journal

_LONGEST = 0.01  # s; a block that took longer was compiled, which is none of its speed


def at_speed(patch: pytest.MonkeyPatch, speed: float) -> None:
    """Let every virtual bench of this process run so many times as fast."""
    if speed < 1.0:
        blocks = virtual.VirtualBench._blocks

        def held_back(self: virtual.VirtualBench, played: RowSource) -> Iterator[Block]:
            begun = time.perf_counter()
            for block in blocks(self, played):
                lasted = min(time.perf_counter() - begun, _LONGEST)
                time.sleep((1.0 / speed - 1.0) * lasted)
                yield block
                begun = time.perf_counter()

        patch.setattr(virtual.VirtualBench, "_blocks", held_back)
    elif speed > 1.0:
        slow = SimpleNamespace(**{**vars(time), "monotonic": lambda: time.monotonic() / speed})
        for module in (bench_clock, live, requests, journal):
            patch.setattr(module, "time", slow)
