"""Recording from the browser, on the stand-in chassis: plan, steps, watching, reload, a lost server, zero."""

from __future__ import annotations

import json
import re
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.kills import level
from ipmclab import read_run
from tests.page.browser.conftest import LONG, choose, serious, served, stand_in, wait_until

pytestmark = pytest.mark.real_time
"""A guardian watches each recorder: it zeroes where other work keeps that from its rows for half a second."""

EXPERIMENT = """
title = "square by hand"
sample = "friend-2"
rig = "rig.toml"
signal = "square 1 V 0.2 Hz"
rate = "100 Hz"
duration = "900 s"
rest_before = "0 s"
zero_time = "0.2 s"
measured = ["current"]
steps = ["hydrate", "clamp", "apply"]
fingerprint = false
"""

TABLET = "Mozilla/5.0 (iPad; CPU OS 16_0 like Mac OS X) AppleWebKit/605.1.15 (KHTML, like Gecko) Mobile/15E148"


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Path]:
    """A folder with a rig and an experiment for a stand-in, whose levels stand in a file."""
    (tmp_path / "square.toml").write_text(EXPERIMENT, encoding="utf-8")
    with stand_in(tmp_path):
        yield tmp_path


def ink(page, panel: int = 0) -> int:
    """How many pixels of a live panel have the colour of its curve: a data model may be full and the canvas blank."""
    return page.evaluate(
        """(panel) => {
          const canvas = document.querySelectorAll(".lab-live canvas")[panel];
          if (!canvas) return 0;
          const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          let count = 0;
          for (let k = 0; k < data.length; k += 4)
            if (data[k] < 60 && data[k + 2] > 120 && data[k + 3] > 100) count++;
          return count;
        }""",
        panel,
    )


def test_a_run_from_its_plan_to_an_emergency_zero(lab: Path, open_page) -> None:
    """One browser records, another watches; a reload and a killed server end nothing; whoever watches may zero."""
    levels = lab / "levels.json"
    with served(lab) as address:
        port = address.rpartition(":")[2]
        operator = open_page(f"{address}/run")
        limit = operator.get_by_label("Current", exact=True)
        operator.get_by_text("Limits of the guard").click()
        limit.wait_for()
        assert limit.input_value() == "190 mA"  # the channel of the virtual rig reads 200 mA
        operator.get_by_label("Rig (bench)").click()
        operator.get_by_role("option", name="rig.toml").wait_for()
        assert serious(operator) == []  # with a list that is open
        operator.get_by_role("option", name="rig.toml").click()
        operator.wait_for_function("field => field.value === ''", arg=limit.element_handle())  # this one reads 1 A
        choose(operator, "square")
        operator.wait_for_function("document.querySelector('.lab-stack:not(.lab-live) canvas')")
        operator.get_by_text("1 run, at least 15 min 5 s").wait_for()
        operator.get_by_role("button", name="Check the plan").click()
        operator.get_by_role("button", name="Start", exact=True).click()
        operator.get_by_role("button", name="done", exact=True).click()  # out of the water
        operator.get_by_role("button", name="kept", exact=True).click()
        wait_until(lambda: level(levels)[0] != 0.0, "a voltage")

        watcher = open_page(f"{address}/run", theme="dark", width=820, height=1180)
        watcher.wait_for_selector(".lab-live[data-drawn]")
        assert watcher.get_by_role("button", name="STOP", exact=True).is_disabled()
        assert watcher.get_by_role("button", name="Stop and keep").is_disabled()
        refused = watcher.evaluate("lab.post('stop')")
        assert not refused["ok"]
        assert "somebody else holds the bench" in refused["message"]
        assert serious(watcher) == []

        operator.reload()
        operator.wait_for_selector(".lab-live[data-drawn]")
        assert operator.get_by_role("button", name="STOP", exact=True).is_enabled()  # it is still theirs
        wait_until(lambda: ink(operator) > 200, "a curve that can be seen")
        assert float(operator.locator(".lab-live").get_attribute("data-drawn")) > 0.5
        assert serious(operator) == []
        operator.evaluate("document.querySelector('.lab-live').style.paddingBottom = '900px'; scrollTo(0, 400)")
        operator.wait_for_function("scrollY === 400")  # as with the curves of six channels
        readings = operator.get_by_role("region", name="Readings").bounding_box()
        assert readings["y"] >= operator.locator(".lab-header").bounding_box()["height"]  # below the header, not away

    # The server is gone: the run is not, and the page says that it is old.
    operator.wait_for_selector("#lab-lost:not([hidden])")
    assert "continues" in operator.locator("#lab-lost").inner_text()
    operator.set_viewport_size({"width": 820, "height": 1180})
    operator.get_by_role("button", name="ZERO").click()
    operator.get_by_text("the page's server does not answer").wait_for()
    banner, said = (operator.locator(place).bounding_box() for place in ("#lab-lost", "#lab-said"))
    assert said["y"] >= banner["y"] + banner["height"]  # neither covers the other
    shown = "getComputedStyle(document.querySelector('.lab-bench-state'), '::before').content"
    assert operator.evaluate(shown) == '"last known: "'
    before = time.monotonic()
    wait_until(lambda: time.monotonic() - before > 1.0 and level(levels)[0] != 0.0, "a voltage without a server")
    for page in (operator, watcher):
        page.evaluate("window.isOld = true")
    with served(lab, "--port", port):
        for page in (operator, watcher):
            page.wait_for_function("!window.isOld && window.lab?.state")  # by itself: nobody reloads it
        operator.wait_for_selector("#lab-lost", state="hidden")
        operator.wait_for_selector(".lab-live[data-drawn]")
        operator.get_by_text("You hold the bench").wait_for()  # again, by itself
        watcher.get_by_text("Somebody else holds the bench").wait_for()
        assert operator.evaluate(shown) == "none"
        operator.get_by_role("button", name="Release").click()
        watcher.get_by_text("Nobody holds the bench").wait_for()
        operator.get_by_text("Nobody holds the bench").wait_for()
        watcher.wait_for_timeout(600)  # some pulses: it is not taken back
        assert watcher.evaluate("lab.state.held") is False
        watcher.wait_for_function("document.getElementById('lab-bench-word')?.textContent === 'recording'")
        # When it is clicked, by the browser: to find the button takes as long as it takes.
        watcher.evaluate("addEventListener('click', () => window.clicked ??= Date.now() / 1000, true)")
        watcher.get_by_role("button", name="ZERO").click()
        wait_until(lambda: level(levels)[0] == 0.0, "0 V")
        assert level(levels)[1] - watcher.evaluate("clicked") < 1.0
        watcher.get_by_text("emergency zero").first.wait_for()
        watcher.wait_for_function("document.getElementById('lab-bench-word').textContent === 'ended'")
    (path,) = (lab / "runs" / "runs").rglob("*.nc")
    run = read_run(path)
    assert run.metadata.state == "aborted"
    assert np.allclose(np.diff(run.time), 0.01)  # not a row is missing
    assert len(run) > 300


def test_three_browsers_one_of_them_stalled_lose_nothing(lab: Path, open_page) -> None:
    text = (lab / "square.toml").read_text("utf-8").replace('"900 s"', '"6 s"').replace('"hydrate", "clamp", ', "")
    (lab / "short.toml").write_text(text, encoding="utf-8")
    with served(lab) as address:
        pages = [open_page(f"{address}/run") for _ in range(3)]
        choose(pages[0], "short")
        pages[0].get_by_role("button", name="Check the plan").click()
        pages[0].get_by_role("button", name="Start", exact=True).click()
        pages[1].wait_for_selector(".lab-live[data-drawn]")
        with pages[1].expect_event("dialog") as stalled:  # until it is answered, its page does nothing
            pages[1].evaluate("setTimeout(() => alert('stalled'), 0)")
        pages[2].wait_for_timeout(4000)
        stalled.value.dismiss()
        pages[2].get_by_text("Done.").wait_for(timeout=3 * LONG)
        pages[2].locator(".lab-live select").select_option("whole")
        pages[2].wait_for_function("Number(document.querySelector('.lab-live').dataset.drawn) > 10.9")
        pages[1].wait_for_function("Number(document.querySelector('.lab-live').dataset.drawn) > 10.9")
        with pages[2].expect_download() as saved:
            pages[2].get_by_role("button", name="Save the data, all rows: Bench").click()
        rows = Path(saved.value.path()).read_text("utf-8").splitlines()
        with pages[2].expect_download() as drawn:
            pages[2].get_by_role("button", name="Save the figure as it is shown: Bench").click()
        assert Path(drawn.value.path()).read_text("utf-8").startswith("<svg")
        recorded = pages[2].get_by_role("region", name="Recorded").get_by_role("link")
        name = recorded.inner_text()
        recorded.click()
        pages[2].get_by_role("button", name=f"Save the data, all rows: {name.removesuffix('.nc')}").wait_for()
        pages[2].locator("tr.lab-chosen", has=pages[2].locator(f'[title$="{name}"]')).wait_for()
    (path,) = (lab / "runs" / "runs").rglob("*.nc")
    run = read_run(path)
    assert run.metadata.state == "complete"
    assert len(run) == 1100
    assert rows[0] == "time [s],voltage [V],current [mA]"
    shown = np.array([[float(cell) for cell in row.split(",")] for row in rows[1:]])
    assert np.allclose(shown, np.column_stack([run.time, run.voltage, 1e3 * run.current]), rtol=1e-8, atol=1e-9)


def test_bad_input_has_its_message_at_the_field(tmp_path: Path, open_page) -> None:
    with served(tmp_path) as address:
        page = open_page(f"{address}/run", agent=TABLET)
        page.get_by_label("Measured", exact=True).click()
        page.get_by_role("option", name="force", exact=True).wait_for()
        assert not page.get_by_role("dialog").count()  # a list covers neither STOP nor ZERO
        page.keyboard.press("Escape")
        wrong = {
            "Sample": ("", None),  # nobody is told off for what was not reached yet
            "Signals, one a line": ("step 1 V\nstep 5 W", "'W'"),
            "Duration of each": ("-3 s", "must be above 0"),
            "Rate": ("50", "has no unit"),
        }
        for label, (text, _) in wrong.items():
            page.get_by_label(label, exact=True).fill(text)
        for label, (_, told) in wrong.items():
            field = page.locator(".q-field", has=page.get_by_label(label, exact=True))
            if told is None:
                assert not field.locator("[role=alert]").count()
            else:
                field.get_by_role("alert").filter(has_text=told).wait_for()
        page.get_by_role("button", name="Check the plan").click()
        page.locator(".q-field", has=page.get_by_label("Sample", exact=True)).get_by_role("alert").wait_for()
        for label, text in {"Sample": "strip-1", "Signals, one a line": "step 5 V", "Duration of each": "40 s"}.items():
            page.get_by_label(label, exact=True).fill(text)
        page.get_by_label("Rate", exact=True).fill("50 Hz")
        field = page.locator(".q-field", has=page.get_by_label("Signals, one a line", exact=True))
        field.get_by_role("alert").filter(has_text="the limit is 3.5 V").wait_for()
        page.get_by_label("Signals, one a line", exact=True).fill("file ../../etc/passwd")
        field.get_by_role("alert").filter(has_text="not in the folder of this page").wait_for()
        assert serious(page) == []
        page.get_by_label("Signals, one a line", exact=True).fill("step 2 V")
        page.get_by_text("above 1.23 V for 40 s").wait_for()  # what to think of
        for name in ("../escape", "a/b", "con:1"):
            page.get_by_label("File name").fill(name)
            page.get_by_role("button", name="Save", exact=True).click()
            named = page.locator(".q-field", has=page.get_by_label("File name"))
            named.get_by_role("alert").filter(has_text="no plain file name").wait_for()
        page.get_by_label("File name").fill("two volts")
        page.get_by_role("button", name="Save", exact=True).click()
        choose(page, "two volts")
        said = page.evaluate("lab.post('zero')")
        assert not said["ok"]
        assert re.search("no recorder .* switch its amplifier off", said["message"])
        told = page.evaluate("lab.post('mark', {text: 'x'})")
        assert not told["ok"]
        assert urllib.request.urlopen(f"{address}/live/readings").read() == b"time [s]\n"
        page.get_by_label("Signals, one a line", exact=True).fill("stp")
        page.get_by_text("It is drawn once the fields that are marked are correct").wait_for()
        page.get_by_label("Signals, one a line", exact=True).fill("step 1 V")
        page.get_by_text("More", exact=True).click()
        field = page.locator(".q-field", has=page.get_by_label("Model of the strip", exact=True))
        page.get_by_label("Model of the strip", exact=True).fill("nobody")
        field.get_by_role("alert").filter(has_text="there is no actuator 'nobody'").wait_for()
        page.get_by_label("Model of the strip", exact=True).fill("friend-2+nothing")  # what the recorder alone can see
        field.get_by_role("alert").wait_for(state="detached")
        page.get_by_label("File name").fill("nobody")
        page.get_by_role("button", name="Check the plan").click()
        field.get_by_role("alert").filter(has_text="no stage is called 'nothing'").wait_for()
    assert json.dumps((tmp_path / "two volts.toml").read_text("utf-8")).count("step 2 V") == 1
    assert not list(tmp_path.parent.glob("escape*"))
