"""What the forms of Identify and Simulate say, in a real browser: half typed, and after the page's server was ended."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab import load_actuator, simulate, write_run
from tests.page.browser.conftest import LONG, served

playwright = pytest.importorskip("playwright.sync_api")


def expect(shown):
    """What is to be shown of a place before long."""
    playwright.expect.set_options(timeout=LONG)
    return playwright.expect(shown)


def test_a_field_without_a_number_asks_nothing(tmp_path: Path, open_page) -> None:
    with served(tmp_path) as address:
        page = open_page(f"{address}/simulate")
        page.locator("[data-answers='1']").wait_for(timeout=LONG)
        command = page.get_by_text("ipmclab simulate friend-2 --signal")
        command.wait_for()
        before = command.inner_text()
        assert "'step 1 V' --duration '40 s' --rate '50 Hz'" in before
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url) if "/simulate" in request.url else None)
        for label in ("Amplitude", "Duration", "Rate"):
            number = page.get_by_label(label, exact=True)
            value = number.input_value()
            number.fill("")
            page.locator(".lab-field", has=number).get_by_text("Write a number.").wait_for()
            page.get_by_text("waits for a number").wait_for()
            assert not page.locator(".lab-simulator [role=alert]").filter(visible=True).count()
            page.wait_for_timeout(700)  # the command follows within half a second
            assert command.inner_text() == before
            assert asked == []
            number.fill(value)
            page.get_by_text("answered in").wait_for()
            asked.clear()
        page.get_by_label("Duration", exact=True).fill("-1")
        page.locator(".lab-field", has_text="Duration").get_by_text("it must be a number above 0").wait_for()
        page.wait_for_timeout(700)
        assert command.inner_text() == before  # of the last question that has an answer
        page.get_by_label("Duration", exact=True).fill("20")
        page.get_by_text("--duration '20 s'").wait_for()


def test_what_the_forms_say_outlives_the_server(tmp_path: Path, open_page) -> None:
    (tmp_path / "runs").mkdir()
    for volts, name in enumerate(("one", "two", "three"), start=1):
        run = simulate(load_actuator("friend-2"), f"step {volts} V", duration=10.0, rate=50.0)
        write_run(run, tmp_path / "runs" / f"{name}.nc")
    with served(tmp_path) as address:
        identify = open_page(f"{address}/identify?run=runs/one.nc")
        identify.get_by_label("Fit: runs/two.nc").check()
        identify.get_by_label("Predict: runs/three.nc").check()
        identify.get_by_label("Fit: runs/one.nc").uncheck()
        field(identify, "Actuator, also").fill("friend-2+leak.cubic")
        identify.get_by_label("leak", exact=True).check()
        identify.get_by_label("electrical", exact=True).uncheck()
        identify.get_by_text("One by one").click()
        identify.get_by_label("coupling.zero is", exact=True).select_option("free per run")
        identify.get_by_text("--free leak --per-run coupling.zero").first.wait_for()
        model(identify, "friend-7-measured").check()

        over = identify.context.new_page()
        over.goto(f"{address}/simulate?run=runs/one.nc")
        over.locator("[data-answers]").wait_for(timeout=LONG)
        over.get_by_label("Over a run").select_option("runs/two.nc")

        sliders = identify.context.new_page()
        sliders.goto(f"{address}/simulate")
        sliders.locator("[data-answers]").wait_for(timeout=LONG)
        sliders.get_by_label("Signal", exact=True).select_option("sine")
        sliders.get_by_label("Frequency", exact=True).fill("0.2")
        sliders.get_by_label("Duration", exact=True).fill("30")
        number(sliders, "gain").fill("0.005")
        sliders.get_by_text("'coupling.gain':").wait_for()
    for page in (identify, sliders, over):
        page.wait_for_selector("#lab-lost:not([hidden])")
        page.evaluate("window.isOld = true")
    # Nobody hears it now but the browser.
    field(identify, "Name of the fit").fill("mine")
    identify.get_by_label("Fit: runs/one.nc").check()
    model(identify, "friend-2").check()
    number(sliders, "zero").fill("3")
    field(sliders, "Save changed actuator as").fill("softer")
    sliders.get_by_role("button", name="Load").click()
    sliders.get_by_role("alert").filter(has_text="What the form says stays; press again when it is back").wait_for()

    with served(tmp_path, "--port", address.rpartition(":")[2]):
        for page in (identify, sliders, over):
            page.wait_for_function("!window.isOld && window.lab?.state", timeout=LONG)  # by itself
        identify.get_by_text("2 to identify from, 1 to predict").wait_for()
        identify.get_by_text("--free leak --per-run coupling.zero").first.wait_for()
        for name in ("one", "two", "three"):
            expect(identify.get_by_label(f"Fit: runs/{name}.nc")).to_be_checked(checked=name != "three")
        expect(identify.get_by_label("Predict: runs/three.nc")).to_be_checked()
        expect(field(identify, "Actuator, also")).to_have_value("friend-2+leak.cubic")
        expect(field(identify, "Name of the fit")).to_have_value("mine")
        has_models(identify, "friend-2", "friend-7-measured")

        sliders.get_by_text("'coupling.zero': 3").wait_for(timeout=LONG)
        sliders.get_by_text("sine 1 V 0.2 Hz").first.wait_for()
        for label, value in {"Signal": "sine", "Frequency": "0.2", "Duration": "30"}.items():
            expect(sliders.get_by_label(label, exact=True)).to_have_value(value)
        for name, value in {"gain": "0.005", "zero": "3"}.items():
            expect(number(sliders, name)).to_have_value(value)
        expect(field(sliders, "Save changed actuator as")).to_have_value("softer")
        over.locator("[data-answers]").wait_for(timeout=LONG)
        expect(over.get_by_label("Over a run")).to_have_value("runs/two.nc")

        sliders.get_by_role("link", name="Simulate", exact=True).click()  # who comes anew begins anew
        expect(sliders.get_by_label("Signal", exact=True)).to_have_value("step")
        sliders.get_by_role("link", name="Report", exact=True).click()
        sliders.wait_for_function("document.title.startsWith('Report')")
    sliders.wait_for_selector("#lab-lost:not([hidden])")
    sliders.get_by_role("link", name="Runs", exact=True).click()
    told = sliders.get_by_role("alert").filter(has_text="Not done: the connection is lost. Press again")
    told.wait_for()  # and nothing is promised that the browser does not keep


def test_what_is_said_beside_a_fit_stays_over_a_reload(tmp_path: Path, open_page) -> None:
    """Of a fit that came while nobody looked the box is ticked, as ever; of one that was unticked it is not."""
    (tmp_path / "runs").mkdir()
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=10.0, rate=50.0)
    write_run(run, tmp_path / "runs" / "one.nc")
    with served(tmp_path) as address:
        page = open_page(f"{address}/identify?run=runs/one.nc")
        page.get_by_text("1 to identify from").wait_for()
        page.get_by_role("button", name="Identify").click()
        page.get_by_role("heading", name="fit 1").wait_for(timeout=LONG)
        has_models(page, "fit 1")
        model(page, "friend-2").check()
        model(page, "fit 1").uncheck()
        has_name(page, "fit-1")
        page.get_by_label("Save as an actuator").fill("softer")
        page.reload()
        page.get_by_role("heading", name="fit 1").wait_for(timeout=LONG)
        has_name(page, "softer")
        has_models(page, "friend-2")

        page.get_by_text("1 to identify from").wait_for()
        page.get_by_role("button", name="Identify").click()
        page.locator(".lab-job").filter(has_text="fit 2").wait_for()  # it may be done before "Cancel" is seen
        page.reload()
        page.get_by_text("1 to identify from").wait_for()
        page.locator(".lab-job").filter(has_text="fit 2").get_by_role("button", name="Show").wait_for(timeout=LONG)
        page.reload()
        page.get_by_role("heading", name="fit 2").wait_for(timeout=LONG)
        has_name(page, "fit-2")
        has_models(page, "fit 2", "friend-2")
        page.reload()  # nothing was said since
        page.get_by_role("heading", name="fit 2").wait_for(timeout=LONG)
        has_models(page, "fit 2", "friend-2")
        page.locator(".lab-job").filter(has_text="fit 1").get_by_role("button", name="Show").click()
        page.get_by_role("heading", name="fit 1").wait_for()
        has_name(page, "softer")
        has_models(page, "fit 1", "fit 2", "friend-2")

        page.get_by_role("link", name="Identify", exact=True).click()  # who comes anew begins anew
        page.get_by_role("heading", name="fit 2").wait_for(timeout=LONG)
        has_models(page, "fit 2")


def model(page, name: str):
    """The box of a model that can be put beside a fit."""
    return page.get_by_role("group", name="Models").get_by_label(name, exact=True)


def has_models(page, *names: str) -> None:
    """Wait until these models are chosen, and no other."""
    page.wait_for_function(
        """(names) => {
          const boxes = [...document.querySelectorAll(".lab-checks input:checked")];
          return boxes.map((box) => box.closest("label").innerText.trim()).sort().join() === names.sort().join();
        }""",
        arg=list(names),
    )


def has_name(page, name: str) -> None:
    """Wait until the fit that is shown would be saved by this name."""
    page.wait_for_function(
        "name => document.querySelector('[aria-label=\"Save as an actuator\"]')?.value === name", arg=name
    )


def field(page, label: str):
    """A text field, which may have a list of what could be chosen."""
    return page.get_by_label(label).and_(page.locator("input")).first


def number(page, label: str):
    """The number beside a slider."""
    return page.get_by_label(label, exact=True).and_(page.locator("input[inputmode=decimal]"))


def test_a_click_is_not_undone_by_what_the_server_said_before_it_heard_it(tmp_path: Path, open_page) -> None:
    held: list[object] = []
    with served(tmp_path) as address:
        page = open_page("about:blank")
        server: list[object] = []

        def between(browser) -> None:
            server.append(browser.connect_to_server())
            browser.on_message(lambda text: held.append(text) if "per_run" in str(text) else server[-1].send(text))

        page.route_web_socket("**/socket.io/**", between)
        page.goto(f"{address}/identify")
        coupling, leak = (page.get_by_label(name, exact=True) for name in ("coupling", "leak"))
        coupling.check()
        while not held:
            page.wait_for_timeout(20)
        # Of the click the server has not heard, and says what there is to choose of another actuator.
        field(page, "Actuator, also").fill("friend-2+leak.cubic")
        leak.wait_for()
        assert coupling.is_checked()
        for text in held:
            server[-1].send(text)
        page.get_by_text("--free electrical,coupling").first.wait_for()
        assert coupling.is_checked()
