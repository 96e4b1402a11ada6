"""What several test folders need."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path

import pytest

# Small matrices: OpenBLAS threads only wait for each other on a busy machine. NumPy reads this when first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def real_runs() -> Path:
    """The folder of real records, or a skip that says how to provide it."""
    folder = os.environ.get("IPMCLAB_REAL_RUNS")
    if not folder:
        pytest.skip("IPMCLAB_REAL_RUNS is unset: it names the folder of real records")
    return Path(folder)


@pytest.fixture(scope="session")
def require() -> Callable[[str, object], None]:
    """A function that skips when a system tool is missing, or fails where ``IPMCLAB_REQUIRE`` names it."""

    def check(tool: str, found: object) -> None:
        if found:
            return
        if tool in os.environ.get("IPMCLAB_REQUIRE", "").split(","):
            pytest.fail(f"{tool} is required here (IPMCLAB_REQUIRE) and was not found")
        pytest.skip(f"{tool} was not found")

    return check


@pytest.fixture(scope="module", autouse=True)
def brief_collections() -> None:
    """Let the garbage collector pass over all that was imported: looking at it stops every thread for half a second.

    Chassis, guard and guardian of these tests run in real time in one process with the whole suite; no user's does.
    """
    gc.collect()
    gc.freeze()
