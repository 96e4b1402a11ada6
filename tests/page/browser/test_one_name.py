"""One name means one fit, in a real browser: two who identify at once, Back, and names that nothing can have."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from ipmclab import load_actuator, simulate, write_actuator, write_run
from tests.page.browser.conftest import LONG, serious, served, wait_until

pytest.importorskip("playwright")

RESISTIVITIES = {"step": 5.0, "sine": 50.0}
"""Of the strip behind each run [ohm m]."""


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with runs of two strips, and an actuator."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "runs").mkdir()
    for name, signal in (("step", "step 1 V"), ("sine", "sine 1 V 0.1 Hz")):
        strip = load_actuator("friend-2").replace(**{"circuit.dc_resistivity": RESISTIVITIES[name]})
        write_run(simulate(strip, signal, duration=20.0, rate=50.0), folder / "runs" / f"{name}.nc")
    write_actuator(load_actuator("friend-2"), folder / "mine.toml")
    return folder


@pytest.fixture(scope="module")
def address(lab: Path) -> Iterator[str]:
    with served(lab) as found:
        yield found


def test_two_who_identify_at_once_have_each_their_own_fit(address: str, open_page) -> None:
    pages = {name: open_page(f"{address}/identify?run=runs/{name}.nc") for name in ("step", "sine")}
    for page in pages.values():
        page.get_by_text("1 to identify from").wait_for()
        page.get_by_text("--free electrical").first.wait_for()
    assert {page.get_by_label("Name of the fit").input_value() for page in pages.values()} == {"fit 1"}
    for page in pages.values():
        page.get_by_role("button", name="Identify").click()
    names = {}
    for run, page in pages.items():
        page.get_by_text("free parameters are determined").wait_for(timeout=LONG)
        names[run] = page.get_by_role("heading", name=re.compile(r"^fit \d$")).inner_text()
    assert sorted(names.values()) == ["fit 1", "fit 2"]
    for run, page in pages.items():
        page.get_by_role("link", name="Simulate with it").click()
        page.locator("[data-answers]").wait_for(timeout=LONG)
        assert page.get_by_label("Actuator, also with stages").input_value() == names[run]
        number = page.get_by_label("dc resistivity", exact=True).and_(page.locator("input[inputmode=decimal]"))
        assert float(number.input_value()) == pytest.approx(RESISTIVITIES[run], rel=0.01)
        file = f"{names[run].replace(' ', '-')}.toml"
        asked = f"ipmclab identify friend-2 runs/{run}.nc --free electrical --thorough --out {file} &&"
        page.get_by_text(asked).wait_for()
        page.get_by_text(f"“{names[run]}” is not saved").wait_for()


def test_after_back_the_form_shows_what_is_going_to_be_identified(address: str, open_page) -> None:
    page = open_page(f"{address}/identify?run=runs/step.nc")
    page.get_by_text("--free electrical").first.wait_for()
    page.get_by_label("Actuator, also with stages").fill("friend-2+leak.cubic")
    page.get_by_label("leak", exact=True).check()
    asked = "ipmclab identify friend-2+leak.cubic runs/step.nc --free electrical,leak "
    page.get_by_text(asked).first.wait_for()
    page.get_by_role("link", name="Report", exact=True).first.click()
    page.get_by_role("button", name="Make the report").wait_for()
    page.go_back()
    page.get_by_text("1 to identify from, 0 to predict").wait_for()
    page.get_by_text(asked).first.wait_for()
    page.get_by_label("Fit: runs/step.nc").wait_for()
    page.get_by_label("friend-7-measured", exact=True).wait_for()
    page.get_by_text("One by one").click()
    page.get_by_label("leak.cubic.linear is", exact=True).wait_for()
    ticked = [one for one in page.evaluate(TICKED) if not one.startswith("fit ")]  # what is shown of other fits
    assert ticked == ["Fit: runs/step.nc", "electrical", "leak"]
    assert set(page.locator(".lab-free select").evaluate_all("all => all.map((one) => one.value)")) == {"fixed"}


def test_what_cannot_be_is_said_at_its_field(address: str, open_page, lab: Path) -> None:
    page = open_page(f"{address}/identify?run=nope.nc&run=runs/sine.nc", width=820)
    page.get_by_text("there is no run 'nope.nc'").wait_for()
    page.get_by_text("1 to identify from").wait_for()
    assert page.get_by_label("Fit: runs/sine.nc").is_checked()
    name = page.get_by_label("Name of the fit")
    for wrong in ("a" * 300, "../x/y", "x+leak.cubic"):
        name.fill(wrong)
        page.get_by_role("button", name="Identify").click()
        page.locator(".q-field", has=name).get_by_text(
            re.compile(f"'{re.escape(wrong[:40])}…?' is no plain name")
        ).wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= 820
    name.fill("mine")
    page.get_by_role("button", name="Identify").click()
    page.locator(".q-field", has=name).get_by_text("is another actuator's name already").wait_for()
    assert serious(page) == []
    name.fill("W" * 40)
    page.get_by_role("button", name="Identify").click()
    page.get_by_text("free parameters are determined").wait_for(timeout=LONG)
    card = page.locator(".lab-job").filter(has_text="W" * 40).first
    button = card.get_by_role("button", name="Show")
    for width in (1280, 820, 390):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        wait_until(lambda: card.bounding_box() and button.bounding_box(), "the fit is drawn")
        job, show = card.bounding_box(), button.bounding_box()
        assert show["x"] + show["width"] <= job["x"] + job["width"] + 1
    actuator = page.get_by_label("Actuator, also with stages")
    actuator.fill("")
    page.locator(".q-field", has=actuator).get_by_text("no actuator is named; choose one, such as friend-2").wait_for()

    page.goto(f"{address}/simulate?run=nope.nc")
    page.get_by_text("there is no run 'nope.nc'").wait_for()
    page.locator("[data-answers]").wait_for(timeout=LONG)
    saved = page.get_by_label("Save changed actuator as")
    for wrong, words in (("mine", "mine.toml exists already; choose another name"), ("friend-2", "another actuator's")):
        saved.fill(wrong)
        page.get_by_role("button", name="Save", exact=True).click()
        page.locator(".q-field", has=saved).get_by_text(words).wait_for()
    page.goto(f"{address}/simulate?fit=fit:0123abcd")
    page.get_by_text("This fit is no longer kept").wait_for()
    page.goto(f"{address}/report?fit=fit:0123abcd")
    page.get_by_text("This fit is no longer kept").wait_for()
    assert sorted(path.name for path in lab.glob("*.toml")) == ["mine.toml"]


TICKED = """() => [...document.querySelectorAll("input[type=checkbox]")].filter((one) => one.checked)
  .map((one) => one.ariaLabel ?? one.parentElement.innerText.trim())"""
