"""What several test folders need."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests import bytecode, profiles
from tests.collecting import Collecting
from tests.witness import Witness
from tests.workers import pytest_collection_finish as pytest_collection_finish
from tests.workers import pytest_collection_modifyitems as pytest_collection_modifyitems
from tests.workers import pytest_runtest_setup as pytest_runtest_setup
from tests.workers import pytest_xdist_auto_num_workers as pytest_xdist_auto_num_workers
from tests.workers import pytest_xdist_make_scheduler as pytest_xdist_make_scheduler

# Small matrices: OpenBLAS threads only wait for each other on a busy machine. NumPy reads this when first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

profiles.load()

collect_ignore = ["windows_rules"]
"""What a process that a test starts imports by itself."""

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
    bytecode.keep(config)
    # What a shell starts in the background ignores Ctrl-C, and so do its children; tests send it to both.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    config.pluginmanager.register(RealTime(), "real-time")
    # Not hooks of this file, which would see only what lies below it.
    config.pluginmanager.register(Collecting(), "collecting")


@pytest.fixture(scope="session")
def real_runs(require: Callable[..., None]) -> Path:
    """The folder of real records, which ``IPMCLAB_REAL_RUNS`` names."""
    folder = os.environ.get("IPMCLAB_REAL_RUNS", "")
    require("real_runs", folder and Path(folder).is_dir(), hint="; IPMCLAB_REAL_RUNS names the folder of real records")
    return Path(folder)


@pytest.fixture(scope="session")
def require() -> Callable[..., None]:
    """A function that skips when something of the machine is missing, or fails where ``IPMCLAB_REQUIRE`` names it."""

    def check(tool: str, found: object, hint: str = "") -> None:
        if found:
            return
        if tool in os.environ.get("IPMCLAB_REQUIRE", "").split(","):
            pytest.fail(f"{tool} is required here (IPMCLAB_REQUIRE) and was not found{hint}")
        pytest.skip(f"{tool} was not found{hint}")

    return check


@pytest.fixture(scope="module")
def finished_here() -> Iterator[None]:
    """Run files are made in this process: one of its own for each takes half a second of a processor to start.

    That a run file comes from a process of its own, which may crash, is for the tests of ``tests/store`` and of the
    recorder.
    """
    from ipmclab.store.journal import finalise, recover

    def finish(journal: str | os.PathLike[str], laboratory: str | os.PathLike[str]) -> object:
        return finalise.finish_here(Path(journal), finalise.Laboratory.open(laboratory))

    with pytest.MonkeyPatch.context() as patch:
        for module in (finalise, recover):
            patch.setattr(module, "finish", finish)
        yield


@pytest.fixture(scope="module", autouse=True)
def brief_collections() -> None:
    """Let the garbage collector pass over all that was imported: looking at it stops every thread for half a second.

    Chassis, guard and guardian of these tests run in real time in one process with the whole suite; no user's does.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def bench_speed() -> Iterator[None]:
    """The virtual bench at the speed that ``IPMCLAB_BENCH_SPEED`` names."""
    speed = float(os.environ.get("IPMCLAB_BENCH_SPEED", "1"))
    with pytest.MonkeyPatch.context() as patch:
        if speed != 1.0:  # what it changes takes long to import, and most tests have no bench
            from tests.bench_speed import at_speed

            at_speed(patch, speed)
        yield
