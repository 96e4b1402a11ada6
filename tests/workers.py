"""How the suite is shared among workers: one for each core, and one more, because many tests mostly wait.

Tests that are marked ``real_time`` are one group, which one worker does first, one after another. It has its turn on a
core before all others, which are nicer: they take what it leaves. Tests that drive a browser are another such group.
All else is given out a module at a time, so that each module makes its fixtures once.
"""

from __future__ import annotations

import os
import zlib
from functools import partial
from typing import Any

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadGroupScheduling

MOST = 4
"""Cores that are used: with more of them the browser's group would be what the others wait for."""

NICER = 10
"""By so much a worker that is not held to time is nicer than one that is."""

LONG = ("tests/test_docs.py", "tests/acceptance", "tests/identification", "tests/refitting", "tests/independent")
"""Modules that begin so are the longest: they come early, so that all workers end at about the same time."""

FITTING = tuple(
    f"tests/{room}/"
    for room in (
        "identification",
        "refitting",
        "statespace",
        "fit",
        "prediction",
        "consistency",
        "choosing",
        "forecasting",
        "posterior",
        "procedure",
        "independent",
        "model",
        "comparison",
        "planning",
    )
)
"""Tests of these rooms fit, or stand on the same products: some are repeated with another processor's kernels."""

THINNED = 10
"""One in so many of these tests: about a minute of the eleven that all of them take on one core.

Its name alone says whether a test is one of them: another test that comes or goes changes nothing for it.
"""


class Sharing(LoadGroupScheduling):
    """A group, or else a module, is what a worker is given."""

    def _split_scope(self, nodeid: str) -> str:
        group = super()._split_scope(nodeid)
        return group.partition("::")[0]


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Workers for the whole suite; what is named on the command line runs in this process."""
    if config.args_source is pytest.Config.ArgsSource.ARGS:
        return 0
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, MOST) + 1


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Sharing:
    """Whole modules rather than single tests."""
    return Sharing(config, log)


def group_of(item: pytest.Item) -> str | None:
    """The group whose tests are done one after another."""
    if item.get_closest_marker("real_time"):
        return "real-time"
    return "browser" if "chromium" in getattr(item, "fixturenames", ()) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Choose those that are repeated on another processor, and order all as they are to be given out."""
    for item in items:
        if item.nodeid.startswith(FITTING) and zlib.crc32(item.nodeid.encode()) % THINNED == 0:
            item.add_marker(pytest.mark.other_processor)
    items.sort(key=_place)


def _place(item: pytest.Item) -> int:
    group = group_of(item)
    if group:
        return 0 if group == "real-time" else 1
    return 2 if item.nodeid.startswith(LONG) else 3


@pytest.hookimpl(tryfirst=True)
def pytest_collection_finish(session: pytest.Session) -> None:
    """Let a worker tell the groups of its tests behind their names.

    The marker of xdist does so through an attribute that pytest reads no more since 9.2: nothing was grouped, and
    nothing said so. What is held to time ran beside others that are.
    """
    for plugin in session.config.pluginmanager.get_plugins():
        if hasattr(plugin, "sendevent"):  # what speaks for this worker
            plugin.sendevent = partial(_tell, plugin.sendevent, session.items)  # type: ignore[attr-defined]


def _tell(send: Any, items: list[pytest.Item], event: str, **values: Any) -> None:
    if event == "collectionfinish":
        values["ids"] = [f"{item.nodeid}@{group}" if (group := group_of(item)) else item.nodeid for item in items]
    send(event, **values)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """From its first test that is not held to time a worker leaves the cores to the one whose tests are."""
    if "PYTEST_XDIST_WORKER" in os.environ and hasattr(os, "nice") and group_of(item) != "real-time":
        os.nice(max(0, NICER - os.nice(0)))
