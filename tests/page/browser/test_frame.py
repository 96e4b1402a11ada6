"""The frame of the page in a real browser: it comes up, and every section opens."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.page.browser.conftest import serious, served, wait_until
from tests.page.test_live import RUN, Recorder

pytest.importorskip("playwright")


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The page of an empty folder, for tests that record nothing."""
    with served(tmp_path_factory.mktemp("quiet")) as address:
        yield address


def test_every_section_opens(quiet: str, open_page) -> None:
    page = open_page(quiet)
    for title in ("Run", "Runs", "Identify", "Simulate", "Report"):
        page.get_by_role("link", name=title, exact=True).click()
        page.wait_for_function(f"document.title.startsWith('{title} ·')")
        assert page.get_by_role("button", name="ZERO").is_enabled()
    assert page.evaluate("document.documentElement.scrollHeight - innerHeight") == 0  # the last one fits: no bar
    page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'idle'")


def test_an_address_that_is_none_leads_back(quiet: str, open_page) -> None:
    page = open_page(f"{quiet}/rusn")
    page.get_by_text("There is no page /rusn").wait_for()
    page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'idle'")  # it is live
    assert serious(page) == []
    page.get_by_role("button", name="ZERO").click()
    page.get_by_text("no recorder is at the bench").wait_for()
    page.get_by_role("link", name="Go to Run").click()
    page.get_by_role("heading", name="Experiment").wait_for()


def test_the_token_is_asked_once_and_opens_the_page(tmp_path: Path, open_page) -> None:
    token = tmp_path / "token.txt"
    token.write_text("a-token-that-nobody-guesses")
    (tmp_path / "lab").mkdir()
    with served(tmp_path / "lab", "--token-file", str(token)) as address:
        page = open_page(address)
        page.get_by_label("The token of this page").fill("another-token-of-no-use")
        page.get_by_role("button", name="Enter").click()
        page.get_by_text("This is not the token.").wait_for()
        page.get_by_label("The token of this page").fill("a-token-that-nobody-guesses")
        page.get_by_role("button", name="Enter").click()
        page.wait_for_function("document.getElementById('lab-bench-word')?.textContent === 'idle'")


def test_who_comes_by_a_foreign_link_keeps_the_bench(quiet: str, open_page) -> None:
    page = open_page(quiet)
    page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'idle'")

    def seats() -> set[str]:
        return {one["value"] for one in page.context.cookies(quiet) if one["name"].startswith("ipmclab-seat")}

    first = seats()
    other = page.context.new_page()
    other.route("http://foreign.test/", lambda route: route.fulfill(
        content_type="text/html", body=f'<a href="{quiet}/run">to the lab</a>'
    ))  # fmt: skip
    other.goto("http://foreign.test/")
    other.get_by_role("link").click()
    other.wait_for_function("document.getElementById('lab-bench-word')?.textContent === 'idle'")
    assert seats() == first


FULL = "Storage.prototype.setItem = () => { throw new DOMException('full', 'QuotaExceededError'); }"
BLOCKED = """for (const name of ['localStorage', 'sessionStorage'])
  Object.defineProperty(window, name, { get() { throw new DOMException('denied', 'SecurityError'); } })"""


@pytest.mark.parametrize("storage", [FULL, BLOCKED], ids=["full", "blocked"])
def test_stop_works_where_a_browser_can_keep_nothing(tmp_path: Path, open_page, storage: str) -> None:
    with served(tmp_path) as address:
        page = open_page(f"{address}/nowhere").context.new_page()
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.add_init_script(storage)
        page.goto(f"{address}/run")
        if storage == FULL:  # NiceGUI, which draws the form, needs a store that can be read
            page.wait_for_selector(".lab-stack:not(.lab-live) canvas")
        recorder = Recorder(tmp_path)
        recorder.tell("run", **RUN)
        page.get_by_role("button", name="STOP", exact=True).click()
        wait_until(lambda: [one.kind for one in recorder.asked] == ["stop"], "the recorder is asked")
        page.wait_for_function("lab.state.mine")
        page.get_by_role("button", name="Dark colours").click()
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"
        assert faults == ([] if storage == FULL else ["denied"])  # NiceGUI's own
        page.route_web_socket("**/live", lambda _: None)  # open, and never anything to hear
        page.reload()
        page.evaluate("lab.patience = 3500")  # no script before the page: whose is the last is not defined
        page.wait_for_function(
            "document.querySelector('[role=alert]:not([hidden])')?.textContent.includes('Connection lost')"
        )
        recorder.hub.close()


def test_every_browser_sees_that_a_run_is_being_ended(tmp_path: Path, open_page) -> None:
    with served(tmp_path) as address:
        pages = [open_page(f"{address}/run") for _ in range(2)]
        recorder = Recorder(tmp_path)
        recorder.tell("run", **RUN)
        recorder.tell("progress", rows=40, acknowledged=30, of=100)
        for page in pages:
            says(page, "recording", "6 s left", "6 s left, 30 of 100 rows on disk")
        pages[0].get_by_role("button", name="STOP", exact=True).click()
        for page in pages:
            says(page, "stopping", "until the recorder has ended", "until the recorder has ended")
        recorder.tell("event", event="stop", time=4.1, text="stopped by the operator at 4.1 s", ending="stop")
        recorder.tell("progress", rows=41, acknowledged=30, of=71)
        pages[0].reload()
        for page in pages:
            says(page, "stopping", "discharging at 0 V, 3 s left", "at 0 V, 3 s left, 30 of 71 rows on disk")
        recorder.tell("ended", how="stop", error=None)
        for page in pages:
            says(page, "ended", "output at 0 V", "")
            assert not page.locator("#lab-progress-bar").is_visible()
        recorder.hub.close()


def test_what_is_left_of_a_run_that_a_limit_ended_is_its_discharge(tmp_path: Path, open_page) -> None:
    with served(tmp_path) as address:
        page = open_page(f"{address}/run")
        recorder = Recorder(tmp_path)
        recorder.tell("run", **RUN)
        recorder.tell("progress", rows=40, acknowledged=30, of=100)
        says(page, "recording", "6 s left", "6 s left, 30 of 100 rows on disk")
        passed = "the current is 300 mA, beyond its limit of 100 mA"
        recorder.tell("event", event="limit", time=4.0, text=passed, ending="limit")
        recorder.tell("progress", rows=44, acknowledged=30, of=94)
        says(page, "limit passed", "discharging at 0 V, 5 s left", "at 0 V, 5 s left, 30 of 94 rows on disk")
        recorder.tell("progress", rows=74, acknowledged=70, of=94)
        says(page, "limit passed", "discharging at 0 V, 2 s left", "at 0 V, 2 s left, 70 of 94 rows on disk")
        recorder.tell("recorded", path="a.nc", state="aborted", signal="step 1 V", purpose="signal", findings=[])
        says(page, "limit passed", "until the recorder has ended", "")
        recorder.tell("ended", how="abort", error=None)
        says(page, "ended", "output at 0 V", "")
        recorder.hub.close()


def says(page, word: str, text: str, line: str) -> None:
    """Wait until the header and the line of a run say something."""
    page.wait_for_function(
        """([word, text, line]) => {
          const told = (place) => document.querySelector(place)?.textContent;
          const run = told("#lab-progress-bar span");
          return told("#lab-bench-word") === word && told("#lab-bench-text").includes(text)
            && (line ? run?.includes(line) : run === "");
        }""",
        arg=[word, text, line],
    )


def test_what_could_not_be_asked_is_not_taken_for_done(tmp_path: Path, open_page) -> None:
    with served(tmp_path) as address:
        page = open_page(f"{address}/simulate")
        page.locator("[data-answers]").wait_for()
        for answer in (lambda route: route.fulfill(status=503, json={}), lambda route: route.abort()):
            page.route("**/bench/release", answer)
            assert page.evaluate("lab.post('release').then(({ ok }) => [ok, keepSeat.isGiven])") == [False, False]
    page.wait_for_selector("#lab-lost:not([hidden])")
    field = page.get_by_role("combobox", name="Actuator, also").or_(page.get_by_label("Actuator, also")).first
    field.fill("friend 3")  # a space is typed
    assert page.evaluate("document.getElementById('lab-said').textContent") == ""
    field.press("Enter")
    page.get_by_role("alert").filter(has_text="Not done: the connection is lost").wait_for()


def test_zero_stays_in_its_corner_and_above_a_dialog(tmp_path: Path, open_page) -> None:
    (tmp_path / "t.toml").write_text('signal = "step 1 V"\nrate = "50 Hz"\n', encoding="utf-8")
    seen = """() => {
      const { right, top, x, y, width, height } = document.getElementById("lab-zero").getBoundingClientRect();
      return [innerWidth - right, top, document.elementFromPoint(x + width / 2, y + height / 2).id];
    }"""
    with served(tmp_path) as address:
        page = open_page(f"{address}/run")
        page.get_by_label("File name").fill("t")
        page.get_by_role("button", name="Save", exact=True).click()
        page.get_by_role("button", name="Replace it").wait_for()
        places = []
        for width in (1280, 1024, 820, 600, 420):
            page.set_viewport_size({"width": width, "height": 720})
            places.append(tuple(page.evaluate(seen)))
        assert len(set(places)) == 1
        assert places[0][2] == "lab-zero"
        assert serious(page) == []
        page.get_by_role("button", name="ZERO", include_hidden=True).focus()
        assert page.evaluate("document.activeElement.id") == "lab-zero"
