"""Simulate in a real browser: what is saved is what the fields say, and a link that was lost is taken up again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ipmclab import load_actuator
from tests.page.browser.conftest import LONG, served

pytest.importorskip("playwright")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lab")


@pytest.fixture(scope="module")
def address(lab: Path) -> Iterator[str]:
    with served(lab) as found:
        yield found


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("", "Write a number."),
        ("1,5", "Write a decimal point and no comma: 1.5."),
        ("1e99", "outside the allowed"),
    ],
)
def test_a_parameter_is_not_saved_while_its_field_says_something_else(
    address: str, open_page, lab: Path, wrong: str, message: str
) -> None:
    file = lab / f"moved{len(wrong)}.toml"
    page = open_page(f"{address}/simulate")
    page.locator("[data-answers]").wait_for(timeout=LONG)
    number = page.get_by_label("modulus", exact=True).and_(page.locator("input[inputmode=decimal]"))
    usual = float(number.input_value())
    number.fill(str(2.0 * usual))
    page.get_by_text("'beam.modulus':").wait_for()
    number.fill("")
    number.press_sequentially(wrong)  # key by key: a field of numbers leaves the comma out, and has 15
    field = page.locator(".lab-parameter").filter(has=number)
    field.get_by_text(message).wait_for()
    before = page.locator("[data-answers]").get_attribute("data-answers")
    page.get_by_label("Save changed actuator as").fill(file.stem)
    page.get_by_role("button", name="Save", exact=True).click()
    name = page.locator(".q-field").filter(has=page.get_by_label("Save changed actuator as"))
    name.get_by_text("there is no number that can be used at: modulus; correct what is marked").wait_for()
    page.wait_for_function(IS_SEEN, arg=field.locator("p.lab-bad").element_handle())
    assert not file.exists()
    if not wrong:  # nothing is asked about what no field shows, whatever else is moved
        gain = page.get_by_label("gain", exact=True).and_(page.locator("input[type=range]"))
        gain.press("PageUp")
        page.get_by_text("waits for a number").wait_for()
        assert field.get_by_text("Write a number.").is_visible()
        assert page.locator("[data-answers]").get_attribute("data-answers") == before
        page.get_by_role("button", name="Reset all").click()
        page.get_by_text("answered in").wait_for()
    number.fill(str(3.0 * usual))
    field.locator("p.lab-bad").wait_for(state="hidden")  # the page has read the number
    page.get_by_role("button", name="Save", exact=True).click()
    page.get_by_text(f"wrote {file.name}").wait_for()
    written = load_actuator(file)["beam.modulus"]
    assert written == pytest.approx(3.0 * load_actuator("friend-2")["beam.modulus"])


def test_a_number_that_is_wrong_is_told_where_it_is_and_in_its_unit(address: str, open_page) -> None:
    """A frequency of 0 was told at the amplitude, a length of -25 mm as -0.025 m; 0x10 passed for 16."""
    page = open_page(f"{address}/simulate")
    page.locator("[data-answers]").wait_for(timeout=LONG)
    page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    page.get_by_label("Signal", exact=True).select_option("sine")
    for label, wrong, told, usual in (
        ("Frequency", "0", "the frequency is 0 Hz, it must be above 0", "0.1"),
        ("Frequency", "1e3", "rows at 50 Hz follow it to 25 Hz", "0.1"),
        ("free length", "-25", "-25 is outside the allowed 0.1 to 1000 mm", "25"),
        ("modulus", "-5", "-5 is outside the allowed 0.001 to 10000000 MPa", "1450"),
        ("modulus", "1,000.5", "Write a decimal point and no comma: 1000.5.", "1450"),
        ("modulus", "1.000,5", "Write a decimal point and no comma: 1000.5.", "1450"),
        ("modulus", "0x10", "Write a number.", "1450"),
        ("modulus", "1.5e3 MPa", "Write the number without a unit: 1.5e3.", "1450"),
    ):
        number = page.get_by_label(label, exact=True).and_(page.locator("input[inputmode=decimal]"))
        field = page.locator(".lab-field").filter(has=number)
        number.fill(wrong)
        field.get_by_text(told).wait_for()
        if wrong == "-5":
            assert field.locator("input[type=range]").input_value() == "0"  # it went to the middle
        number.fill(usual)
        field.locator("p.lab-bad").wait_for(state="hidden")


@pytest.mark.parametrize("how", ["refused", "unanswered"])
def test_what_was_asked_while_the_link_was_lost_is_asked_again(address: str, open_page, how: str) -> None:
    """Over a link that refuses, and over one that only never answers."""
    page = open_page(f"{address}/simulate")
    page.locator("[data-answers]").wait_for(timeout=LONG)
    before = page.locator("[data-answers]").get_attribute("data-answers")
    page.evaluate(LOSE, how)
    page.wait_for_selector("#lab-lost:not([hidden])")
    page.get_by_label("gain", exact=True).and_(page.locator("input[type=range]")).press("PageUp")
    if how == "refused":
        page.get_by_text("it continues when the connection is back").wait_for()
        page.get_by_text("not answered: what is shown is from before").wait_for()
    page.evaluate("Object.assign(window, window.real) && undefined")
    page.wait_for_function(
        "before => document.querySelector('[data-answers]').dataset.answers !== before", arg=before, timeout=LONG
    )
    page.get_by_text("answered in").wait_for()
    assert page.get_by_text("it continues when the connection is back").filter(visible=True).count() == 0


IS_SEEN = """(one) => {
  const at = one.getBoundingClientRect();
  return one.contains(document.elementFromPoint(at.left + 2, at.top + at.height / 2));
}"""

LOSE = """(how) => {
  window.real = { WebSocket, fetch };
  window.fetch = (_, { signal }) => new Promise((_, refuse) => {
    signal?.addEventListener("abort", () => refuse(new Error("aborted")));
    if (how === "refused") refuse(new Error("no link"));
  });
  window.WebSocket = class {
    constructor() { setTimeout(() => this.onclose(), 10); }
    send() {}
    close() {}
  };
  lab.socket.close();
}"""
"""No link can be had any more."""
