"""A half-written experiment in a real browser: it outlives the page's server, a reload and the window."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab.toml_file import parse_table
from tests.page.browser.conftest import LONG, choose, kept, serious, served

pytest.importorskip("playwright")

FILE = """signal = "step 1 V"
rate = "50 Hz"
duration = "40 s"
sample = "strip-1"
steps = ["clamp", "apply"]
"""


def test_what_was_half_written_is_there_again(tmp_path: Path, open_page) -> None:
    (tmp_path / "mine.toml").write_text(FILE, encoding="utf-8")
    with served(tmp_path) as address:
        page = open_page(f"{address}/run")
        choose(page, "mine")
        page.wait_for_function("document.querySelector('[aria-label=\"Sample\"]').value === 'strip-1'")
        page.get_by_label("Sample", exact=True).fill("strip-7")
        page.get_by_text("How it is recorded").click()
        page.get_by_role("switch", name="Both polarities of each signal").click()
        page.get_by_label("Measured", exact=True).click()
        page.get_by_role("option", name="displacement", exact=True).click()
        kept(page, "pair", True)
        kept(page, "measured", "displacement")
    # The server is gone: what is typed now is kept as well, and what only it can do says so.
    page.wait_for_selector("#lab-lost:not([hidden])")
    page.get_by_label("Signals, one a line").fill("sine 2 V 0.1 Hz\nstep 1.5 V")
    page.get_by_label("File name").fill("other")
    for press in (lambda button: button.click(), lambda button: button.press("Enter")):
        press(page.get_by_role("button", name="Save", exact=True))
        page.get_by_role("alert").filter(has_text="Not done: the connection is lost").wait_for()
        page.evaluate("document.getElementById('lab-said').textContent = ''")
    page.get_by_role("link", name="Runs", exact=True).click()
    page.get_by_role("alert").filter(has_text="Not done: the connection is lost").wait_for()
    assert page.url.endswith("/run")  # not at an error of the browser
    kept(page, "name", "other")
    kept(page, "signals", "sine 2 V 0.1 Hz\nstep 1.5 V")

    with served(tmp_path) as again:
        assert again == address  # a folder's page comes back where it was
        page.wait_for_selector("#lab-lost", state="hidden", timeout=LONG)  # nobody reloads it
        page.get_by_text("As you left it, not saved yet").wait_for(timeout=LONG)
        shown(page)
        assert serious(page) == []
        page.reload()
        page.get_by_text("As you left it, not saved yet").wait_for(timeout=LONG)
        shown(page)
        window = page.context.new_page()
        window.goto(f"{address}/run")
        window.get_by_text("As you left it, not saved yet").wait_for(timeout=LONG)
        shown(window)
        window.close()
        page.get_by_role("button", name="Save", exact=True).click()
        page.get_by_text("As you left it, not saved yet").wait_for(state="hidden")
        page.wait_for_function("document.querySelector('[aria-label=\"Experiment\"]').value === 'other'")
        assert (tmp_path / "mine.toml").read_text("utf-8") == FILE  # it was begun from this one
        saved = parse_table((tmp_path / "other.toml").read_text("utf-8"), where="other")
        assert saved["steps"] == ["clamp", "apply"]  # what the form does not show
        assert (saved["sample"], saved["pair"]) == ("strip-7", True)
        assert saved["signals"] == ["sine 2 V 0.1 Hz", "step 1.5 V"]
        assert saved["measured"] == ["displacement"]
        page.get_by_label("File name").fill("mine")
        kept(page, "name", "mine")
        page.reload()
        page.get_by_text("As you left it, not saved yet").wait_for(timeout=LONG)
        page.get_by_role("button", name="Save", exact=True).click()
        page.get_by_role("button", name="Leave it").click()  # never without being asked
        assert (tmp_path / "mine.toml").read_text("utf-8") == FILE
        page.get_by_role("button", name="Drop it").click()
        page.get_by_text("As you left it, not saved yet").wait_for(state="hidden")
        page.wait_for_function("document.querySelector('[aria-label=\"File name\"]').value === 'other'")
        page.reload()
        page.get_by_text("2 runs, at least").or_(page.get_by_text("4 runs, at least")).wait_for(timeout=LONG)
        assert page.get_by_label("File name").input_value() == "other"
        assert not page.get_by_text("As you left it, not saved yet").is_visible()

        page.evaluate(
            "lab.hear = () => {}; lab.patience = 3500"
        )  # a link that is dead and was not closed: it takes seconds to be seen
        page.get_by_role("button", name="Save", exact=True).click()
        page.get_by_role("alert").filter(has_text="lost as you pressed that: it may not have been done").wait_for()


def test_each_window_goes_on_with_the_file_that_it_shows(tmp_path: Path, open_page) -> None:
    (tmp_path / "mine.toml").write_text(FILE, encoding="utf-8")
    with served(tmp_path) as address:
        first = open_page(f"{address}/run")
        first.wait_for_selector(".lab-stack:not(.lab-live) canvas")
        second = first.context.new_page()
        second.goto(f"{address}/run")
        second.wait_for_selector(".lab-stack:not(.lab-live) canvas")
        choose(second, "mine")
        has(second, "Duration of each", "40 s")
        second.wait_for_function("LabDraft.kept().from === 'mine'")
        first.get_by_label("Sample", exact=True).fill("strip-9")
        kept(first, "sample", "strip-9")
        first.get_by_label("Notes", exact=True).evaluate("() => LabDraft.keep('notes', 'half \\ud83d')")
        first.reload()
        first.get_by_text("As you left it, not saved yet.").wait_for()  # half a letter does not keep it
        has(first, "Sample", "strip-9")
        has(first, "Experiment", "a new one")
        has(first, "Notes", "half \ufffd")

        (tmp_path / "mine.toml").write_text(FILE.replace("step 1 V", "step 3 V"), encoding="utf-8")
        second.get_by_label("Operator", exact=True).fill("me")
        kept(second, "operator", "me")
        second.reload()
        second.get_by_text("As you left it, not saved yet; mine.toml was changed since").wait_for()
        has(second, "Signals, one a line", "step 3 V")

        # What is typed before a slow browser has said what it kept stays.
        second.add_init_script("""let draft;
        Object.defineProperty(window, "LabDraft", { get: () => draft, set(made) {
          const { kept } = made;
          made.kept = () => new Promise((resolve) => (window.say = () => resolve(kept())));
          draft = made;
        } })""")
        second.reload()
        second.wait_for_function("Boolean(window.say)")
        second.get_by_label("Sample", exact=True).fill("typed at once")
        second.get_by_text("1 run, at least").wait_for()  # the server has seen it
        second.evaluate("say()")
        second.get_by_label("File name").fill("x")  # answered after what was kept was taken in
        second.get_by_role("button", name="Save", exact=True).click()
        second.wait_for_function("document.querySelector('[aria-label=\"Experiment\"]').value === 'x'")
        has(second, "Sample", "typed at once")


def has(page, label: str, value: str) -> None:
    """Wait until a field shows something."""
    page.wait_for_function(
        "([label, value]) => document.querySelector(`:is(input, textarea)[aria-label='${label}']`).value === value",
        arg=[label, value],
    )


def shown(page) -> None:
    values = {
        "Sample": "strip-7",
        "Signals, one a line": "sine 2 V 0.1 Hz\nstep 1.5 V",
        "Measured": "displacement",
        "Experiment": "mine",
        "File name": "other",
    }
    for label, value in values.items():
        assert page.get_by_label(label, exact=True).and_(page.locator("input, textarea")).input_value() == value, label
