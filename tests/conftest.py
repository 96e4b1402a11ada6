"""What several test folders need."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from tests.witness import Witness

# Small matrices: OpenBLAS threads only wait for each other on a busy machine. NumPy reads this when first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No example is judged by the clock of a busy machine.
settings.register_profile("suite", deadline=None)
settings.load_profile("suite")

REPEATS = 3
"""How often a test in real time is repeated, each time only if the machine paused."""


class RealTime:
    """Repeats a test that is marked ``real_time`` where it failed while the machine itself stood still."""

    def __init__(self) -> None:
        self._witness: Witness | None = None

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Give each its condition."""
        for item in items:
            if item.get_closest_marker("real_time"):
                item.add_marker(pytest.mark.flaky(reruns=REPEATS, condition=self.paused))

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """Ask the witness about this test alone."""
        if item.get_closest_marker("real_time"):
            self._witness = self._witness or Witness()
            self._witness.begin()

    def pytest_unconfigure(self) -> None:
        """Let the witness go."""
        if self._witness is not None:
            self._witness.end()

    def paused(self) -> bool:
        """Whether the machine paused during the test that has just failed."""
        return self._witness is not None and self._witness.saw_a_pause()


def pytest_configure(config: pytest.Config) -> None:
    """Before anything is collected."""
    config.pluginmanager.register(RealTime(), "real-time")


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
