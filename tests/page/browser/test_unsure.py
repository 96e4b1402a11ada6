"""A chassis that hangs and a recorder that hangs, on the stand-in in real time: what every section says of it."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from benchmarks.kills import RIG
from tests.page.browser.conftest import choose, serious, served, wait_until
from tests.rig.stand_in import Process

pytestmark = pytest.mark.real_time
"""A guardian watches each recorder: it zeroes where other work keeps that from its rows for half a second."""

EXPERIMENT = """
sample = "friend-2"
rig = "rig.toml"
signal = "square 1 V 0.2 Hz"
rate = "100 Hz"
duration = "900 s"
rest_before = "0 s"
zero_time = "0.2 s"
measured = ["current"]
steps = ["apply"]
fingerprint = false
"""

UNSURE = "output may not be at 0 V: switch the amplifier off"


@pytest.fixture
def chassis(tmp_path: Path) -> Iterator[Process]:
    """A stand-in that can be stopped, and an experiment for it."""
    (tmp_path / "square.toml").write_text(EXPERIMENT, encoding="utf-8")
    made = Process(tmp_path)
    (tmp_path / "rig.toml").write_text(RIG.format(address=made.address), encoding="utf-8")
    yield made
    made.end()


def send(process: int, name: str) -> None:
    with suppress(ProcessLookupError):
        os.kill(process, getattr(signal, name))


@contextmanager
def driven(lab: Path, chassis: Process, open_page: Callable) -> Iterator[tuple]:
    """A run that gives a voltage out: the page's address, who records, who looks at another section, the recorder."""
    with served(lab) as address:
        operator = open_page(f"{address}/run")
        choose(operator, "square")
        operator.get_by_role("button", name="Check the plan").click()
        operator.get_by_role("button", name="Start", exact=True).click()
        operator.wait_for_selector(".lab-live[data-drawn]")
        watcher = open_page(f"{address}/simulate", theme="dark", width=820, height=1180)
        wait_until(lambda: chassis.level != 0.0, "a voltage")
        (file,) = (lab / "runs" / "recording").glob("*.recorder")
        process = json.loads(file.read_text("utf-8"))["process"]
        try:
            yield address, operator, watcher, process
        finally:
            send(process, "SIGKILL")


def seen(page, place: str) -> str:
    """What is in sight of an element's words: where they are cut off, that is none of them."""
    return page.locator(place).evaluate(
        """one => {
          const box = one.getBoundingClientRect(), around = one.closest("#lab-bench").getBoundingClientRect();
          const isWhole = one.scrollWidth <= one.clientWidth + 1;
          const isBeside = box.left >= around.left - 1 && box.right <= around.right + 1;
          return isWhole && isBeside && box.bottom <= around.bottom + 1 ? one.textContent : "";
        }"""
    )


def test_a_chassis_that_hangs_is_not_said_to_give_0_v(tmp_path: Path, chassis: Process, open_page) -> None:
    with driven(tmp_path, chassis, open_page) as (address, operator, watcher, _):
        chassis.send("SIGSTOP")
        assert chassis.level != 0.0
        for page in (operator, watcher):  # the other section as well
            page.wait_for_function(
                "words => document.getElementById('lab-bench-word').textContent === words", arg=UNSURE
            )
        operator.wait_for_function("lab.state.bench === 'ended'")
        third = open_page(f"{address}/runs", width=390, height=800)
        operator.reload()
        for page in (operator, watcher, third):
            page.wait_for_function("lab.state?.guard === 'guardian: failed'")
            page.wait_for_function("document.getElementById('lab-guard').textContent === lab.state.guard")
            assert seen(page, ".lab-bench-state") == UNSURE
            assert page.evaluate("getComputedStyle(document.querySelector('.lab-bench-state')).backgroundColor") == (
                "rgb(179, 38, 30)"
            )
            assert "output at 0 V" not in page.locator(".lab-header").inner_text()
        operator.get_by_text("Old: the last readings that came").or_(
            operator.get_by_text("Readings stand here while")
        ).first.wait_for()
        assert serious(operator) == []
        operator.get_by_role("button", name="ZERO").click()
        operator.locator("#lab-said").filter(has_text=UNSURE).wait_for()
        chassis.send("SIGCONT")
        wait_until(lambda: chassis.level == 0.0, "0 V")
        for page in (operator, watcher, third):
            page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'ended'")
            assert page.evaluate("lab.state.text") == "the guardian brought the output to 0 V"


def test_a_recorder_that_hangs_is_not_shown_as_a_run_that_goes_on(tmp_path: Path, chassis: Process, open_page) -> None:
    with driven(tmp_path, chassis, open_page) as (_, operator, watcher, process):
        assert not operator.get_by_text("Old: the last").count()
        send(process, "SIGSTOP")
        wait_until(lambda: chassis.level == 0.0, "0 V")
        told = re.compile(r"^the guardian brought the output to 0 V \(no reading for \d+ s\)$")
        for page in (operator, watcher):
            page.locator("#lab-bench-word").filter(has_text=re.compile("^no readings$")).wait_for()
            page.locator("#lab-bench-text").filter(has_text=told).wait_for()
        operator.get_by_text("Old: the last readings that came").wait_for()
        assert serious(operator) == []
        operator.get_by_role("button", name="ZERO").click()
        operator.locator("#lab-said").filter(has_text="asked of the recorder; the guardian brought").wait_for()
        operator.locator("#lab-bench-text").filter(has_text=told).wait_for()  # and not that it is going to be at 0 V
        assert operator.locator("#lab-bench-word").inner_text() == "no readings"
        send(process, "SIGKILL")
        for page in (operator, watcher):
            page.locator("#lab-bench-word").filter(has_text="recorder lost").wait_for()
            words = page.locator("#lab-bench-text").inner_text()
            assert words.startswith("the guardian brought the output to 0 V; the recorder's process is gone")
        operator.get_by_text("Old: the last readings that came").wait_for()
        before = time.monotonic()
        wait_until(lambda: time.monotonic() - before > 1.0, "a second in which nothing changes")
        assert operator.evaluate("lab.state.alarm") == ""
