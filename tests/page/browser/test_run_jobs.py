"""What an operator does to a run, in a real browser: mark, abort, stop, and all of it without a mouse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.kills import level
from ipmclab import Run, read_run
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.record import read_journal
from tests.page.browser.conftest import choose, opening, serious, served, stand_in, wait_until

pytest.importorskip("playwright")

pytestmark = pytest.mark.real_time
"""A guardian watches each recorder: it zeroes where other work keeps that from its rows for half a second."""

EXPERIMENT = """
title = "{name}"
sample = "friend-2"
rig = "rig.toml"
signal = "square 1 V 0.2 Hz"
rate = "100 Hz"
duration = "900 s"
rest_before = "0 s"
rest_after = "1 s"
zero_time = "0.2 s"
measured = ["current"]
steps = [{steps}]
fingerprint = false
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a rig and two experiments for a stand-in, whose levels stand in a file."""
    folder = tmp_path_factory.mktemp("lab")
    for name, steps in (("at once", '"apply"'), ("by hand", '"hydrate", "apply"')):
        (folder / f"{name}.toml").write_text(EXPERIMENT.format(name=name, steps=steps), encoding="utf-8")
    with stand_in(folder):
        yield folder


@pytest.fixture(scope="module")
def operator(lab: Path, chromium) -> Iterator[object]:
    """One browser, which holds the bench from its first run on."""
    with served(lab) as address, opening(chromium) as new:
        yield new(f"{address}/run")


@pytest.fixture
def page(operator) -> object:
    """The browser at Run, with nothing half written, and nothing that goes on: a test that is repeated left its run."""
    address = operator.url.rpartition("/")[0] + "/run"
    operator.goto(address)
    operator.wait_for_function("lab.state")
    if operator.evaluate("lab.state.bench === 'recording'"):
        operator.evaluate("lab.post('abort')")
        operator.wait_for_function("lab.state.bench === 'ended'")
        operator.goto(address)
    operator.wait_for_selector(".lab-stack:not(.lab-live) canvas")
    return operator


@pytest.fixture
def recorded(lab: Path) -> Callable[[], Run]:
    """The run that the test records."""
    before = {*(lab / "runs" / "runs").rglob("*.nc")}

    def read() -> Run:
        (path,) = {*(lab / "runs" / "runs").rglob("*.nc")} - before
        return read_run(path)

    return read


def begin(page, name: str) -> None:
    choose(page, name)
    page.get_by_role("button", name="Check the plan").click()
    page.get_by_role("button", name="Start", exact=True).click()
    recording(page)


def recording(page) -> None:
    """Wait until a second is on the disk."""
    page.wait_for_function("lab.state?.bench === 'recording' && lab.state.progress?.acknowledged > 100")
    page.wait_for_selector(".lab-live[data-drawn]")


def at_zero(lab: Path) -> None:
    """Wait until the output gives 0 V, by the chassis' own word."""
    wait_until(lambda: level(lab / "levels.json")[0] == 0.0, "0 V")


def ended(page) -> None:
    page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'ended'")
    page.get_by_role("region", name="Recorded").get_by_role("link").wait_for()


def test_a_mark_is_in_the_record_and_an_abort_ends_the_run(page, lab: Path, recorded) -> None:
    begin(page, "at once")
    page.get_by_label("Text of a mark").fill("touched the table — Ω")
    page.get_by_role("button", name="Mark", exact=True).click()
    page.get_by_role("list", name="What happened").get_by_text("touched the table — Ω").wait_for()
    (journal,) = Laboratory.open(lab / "runs").journals()
    wait_until(lambda: "touched the table — Ω" in [one.text for one in read_journal(journal).events], "it on the disk")
    page.get_by_label("Text of a mark").fill("set by Enter")
    page.get_by_label("Text of a mark").press("Enter")
    page.get_by_role("list", name="What happened").get_by_text("set by Enter").wait_for()
    assert serious(page) == []
    page.get_by_role("button", name="Abort", exact=True).click()
    at_zero(lab)
    ended(page)
    assert serious(page) == []
    run = recorded()
    assert run.metadata.state == "aborted"
    assert 50 < len(run) < 80_000
    assert ("touched the table — Ω", "note") in [(one.text, one.kind) for one in run.metadata.marks]
    page.get_by_role("region", name="Recorded").get_by_text("aborted").wait_for()


def test_stop_in_the_header_ends_a_run_that_is_kept_whole(page, lab: Path, recorded) -> None:
    begin(page, "at once")
    page.get_by_role("link", name="Runs", exact=True).click()  # from wherever one is
    page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'recording'")
    page.get_by_role("button", name="STOP", exact=True).click()
    at_zero(lab)
    page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'ended'")
    page.get_by_role("link", name="Run", exact=True).click()
    page.get_by_text("Stopped; what was recorded is kept.").wait_for()
    run = recorded()
    assert run.metadata.state == "complete"
    assert any(one.text.startswith("stopped by the operator") for one in run.metadata.marks)
    assert 50 < len(run) < 80_000


def test_stop_is_heard_when_it_is_pressed_as_the_page_changes(page, lab: Path, recorded) -> None:
    """The old page sends it while it goes."""
    begin(page, "at once")
    page.evaluate(
        """() => {
          const stop = [...document.querySelectorAll("button")].find((one) => one.textContent.trim() === "STOP");
          addEventListener("pagehide", () => stop.click());
          location.assign("/runs");
        }"""
    )
    at_zero(lab)
    page.wait_for_url("**/runs")  # two ways at once would be one too many
    page.goto(page.url.rpartition("/")[0] + "/run")
    page.get_by_text("Stopped; what was recorded is kept.").wait_for()
    assert recorded().metadata.state == "complete"


def test_an_experiment_without_a_mouse(page, lab: Path, recorded) -> None:
    walk(page, "Experiment")
    page.keyboard.press("Enter")
    page.get_by_role("option", name="by hand", exact=True).wait_for()
    for _ in range(10):
        if focused_option(page) == "by hand":
            break
        page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    page.wait_for_function("document.querySelector('[aria-label=\"File name\"]').value === 'by hand'")
    walk(page, "Check the plan")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Start", exact=True).wait_for()
    walk(page, "Start")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="done", exact=True).wait_for()
    walk(page, "done")
    page.keyboard.press("Space")
    recording(page)
    assert page.evaluate("document.activeElement !== document.body")  # what was pressed is gone, the focus is not
    walk(page, "Text of a mark")
    page.keyboard.type("by keys")
    walk(page, "Mark")
    page.keyboard.press("Enter")
    page.get_by_role("list", name="What happened").get_by_text("by keys").wait_for()
    press_access_key(page, "0")
    at_zero(lab)
    ended(page)
    run = recorded()
    assert run.metadata.state == "aborted"
    assert "emergency zero by the operator" in run.metadata.state_reason
    assert "by keys" in [one.text for one in run.metadata.marks]


NAME = """() => {
  const one = document.activeElement, label = one.closest("label")?.innerText ?? "";
  const { outlineWidth, outlineStyle } = getComputedStyle(one);
  const field = one.closest(".q-field");  // marked as a whole, by the line around it
  return {
    name: (one.getAttribute("aria-label") || label || one.innerText || "").trim(),
    seen: (outlineStyle !== "none" && parseFloat(outlineWidth) > 0) || !!field?.classList.contains("q-field--focused"),
    tag: one.tagName,
  };
}"""


def walk(page, name: str) -> None:
    """Tab until something is focused, and see at each step where the focus is."""
    for _ in range(80):
        now = page.evaluate(NAME)
        if now["tag"] != "BODY":
            assert now["seen"], now
        if now["name"].split("\n")[0] == name:
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"no way to {name!r} by Tab")


def press_access_key(page, key: str) -> None:
    """Alt and a key, as a real keyboard sends it: Playwright's own press leaves out what Chromium looks for."""
    browser = page.context.new_cdp_session(page)
    pressed = {"modifiers": 1, "key": key, "unmodifiedText": key, "windowsVirtualKeyCode": ord(key.upper())}
    for kind in ("keyDown", "keyUp"):
        browser.send("Input.dispatchKeyEvent", {"type": kind, **pressed})
    browser.detach()


def focused_option(page) -> str:
    found = page.evaluate("document.querySelector('.q-menu .q-manual-focusable--focused')?.innerText ?? ''")
    return str(found).strip()
