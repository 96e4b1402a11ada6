"""A page of its own for a test, and a browser to look at it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import pytest

from tests.page.browser.server import LONG
from tests.page.browser.server import served as served

LOOK = 50
"""Milliseconds between two looks at what a test waits for; else a browser draws 60 frames a second to look in each."""

UNTIL = """argument => {
  try {
    const answer = (%s);
    return typeof answer === "function" ? answer(argument) : answer;
  } catch (error) {
    if (document.readyState === "complete") throw error;
    return false;
  }
}"""

SPOKEN = "window.did_handshake !== false"
"""Whether a page has spoken with its server. One that comes to no answer loads itself anew, and fields that were filled
meanwhile are empty again: on a machine with much else to do a test had filled one by then."""

BARE = "nowhere"
"""There is no such address: it gives a page with the script of the plots and no section, at a fifth of the time."""


SPARING = ["--no-sandbox", "--disable-gpu", "--renderer-process-limit=1"]
"""The limit holds within each context: a window is empty at first, and would have a process of its own for that."""


@contextmanager
def launched(require: Callable[[str, object], None]) -> Iterator[object]:
    """The system's Chromium: the build without windows if there is one, which takes a third less processor time."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    require("chromium", program)
    language = {**os.environ, "LC_ALL": "en_US.UTF-8"}  # that of the pages: "C" is none
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=SPARING, env=language)
        yield browser
        browser.close()


_kept = ExitStack()
_browsers: list[object] = []


@pytest.fixture(scope="module")
def chromium(require: Callable[[str, object], None]) -> object:
    """One browser for all tests of this folder that come one after another."""
    if not _browsers:
        _browsers.append(_kept.enter_context(launched(require)))
        _kept.callback(_browsers.clear)
    return _browsers[0]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> Iterator[None]:
    """Close the browser behind the last of them: its event loop runs until then, and others start one of their own."""
    try:
        return (yield)
    finally:  # also where a fixture ends with an error
        if nextitem is None or Path(__file__).parent not in nextitem.path.parents:
            _kept.close()


@contextmanager
def opening(chromium) -> Iterator[Callable[..., object]]:
    """Opens pages, each in a browser of its own; nothing may go wrong in them, and nothing be asked of another host."""
    contexts = []
    faults: list[str] = []

    def watch(page) -> None:
        page.wait_for_function = partial(_wait, page.wait_for_function)
        page.goto = partial(_go, page, page.goto)
        page.on("pageerror", lambda error: faults.append(f"error: {error}"))
        page.on("request", lambda request: _local(request.url) or faults.append(f"asked elsewhere: {request.url}"))

    def new(address: str, *, theme: str = "light", width: int = 1280, height: int = 720, agent: str | None = None):
        viewport = {"width": width, "height": height}
        # axe is put into the page by the test, which its policy would refuse.
        context = chromium.new_context(viewport=viewport, color_scheme=theme, bypass_csp=True, user_agent=agent)
        context.set_default_timeout(LONG)
        # A server without a processor for some seconds is no lost link: a press would not be done.
        patient = f"if (window.lab) lab.patience = {LONG}"  # not on a page of others
        context.add_init_script(f"addEventListener('DOMContentLoaded', () => {{ {patient} }})")
        contexts.append(context)
        page = context.new_page()
        watch(page)
        page.goto(address)
        return page

    yield new
    for context in contexts:
        context.close()
    assert not faults


@pytest.fixture
def open_page(chromium) -> Iterator[Callable[..., object]]:
    """Pages for one test."""
    with opening(chromium) as new:
        yield new


@contextmanager
def stand_in(folder: Path) -> Iterator[None]:
    """A stand-in chassis, its rig in the folder, and a file with the levels of its outputs."""
    from benchmarks.kills import RIG

    command = [sys.executable, "-m", "ipmclab", "rig", "serve", "--levels", str(folder / "levels.json")]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        (folder / "rig.toml").write_text(RIG.format(address=address), encoding="utf-8")
        yield
    finally:
        server.kill()
        server.communicate()


def _go(page, goto: Callable[..., object], address: str, **options: object) -> object:
    """Go to an address, until its page has spoken with its server."""
    answer = goto(address, **options)
    page.wait_for_function(SPOKEN)
    return answer


def _wait(wait_for_function: Callable[..., object], expression: str, **options: object) -> object:
    """Wait for what an expression or a function of JavaScript says of the page, also while the page is loading.

    A click on a link answers before the next page is there: what that page lacks until it is whole has not come yet.
    On a whole page it is a fault of the test.
    """
    return wait_for_function(UNTIL % expression, polling=LOOK, **options)


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Wait for something that no browser shows."""
    end = time.monotonic() + LONG / 1000
    while not condition():
        assert time.monotonic() < end, f"not within {LONG / 1000:g} s: {what}"
        time.sleep(0.02)


def choose(page, name: str) -> None:
    """Choose an experiment of the folder."""
    page.get_by_label("Experiment", exact=True).click()
    page.get_by_role("option", name=name, exact=True).click()


def kept(page, field: str, value: object) -> None:
    """Wait until the browser has kept what was said in a field."""
    page.wait_for_function("([field, value]) => LabDraft.kept().values[field] === value", arg=[field, value])


SERIOUS = """async () => {
  const before = document.documentElement.dataset.theme;
  const ofColours = { runOnly: { type: "rule", values: ["color-contrast", "link-in-text-block"] } };
  const found = [];
  for (const [theme, rules] of [["light", {}], ["dark", ofColours]]) {
    setTheme(theme);
    const { violations } = await axe.run({ resultTypes: ["violations"], preload: false, ...rules });
    for (const { id, impact, nodes } of violations.filter(({ impact }) => ["serious", "critical"].includes(impact)))
      found.push(`${theme}: ${id}: ${nodes.map(({ html }) => html.slice(0, 120))}`);
  }
  setTheme(before);
  return found;
}"""
"""In dark those of axe's rules alone that a theme can break; what all others look at is the same in both.

What it would load beforehand, all rules of all styles at a quarter of its time, is for a page that plays sounds or
holds to one orientation.
"""


def serious(page) -> list[str]:
    """What axe finds in a page that would keep somebody from using it: all rules in light, those of colours in dark."""
    from axe_playwright_python.base import AXE_SCRIPT

    page.add_style_tag(content="* { transition: none !important }")  # else a colour may be seen on its way
    page.evaluate(AXE_SCRIPT)
    return page.evaluate(SERIOUS)


def _local(url: str) -> bool:
    return url.startswith(("http://127.0.0.1:", "data:", "blob:"))
