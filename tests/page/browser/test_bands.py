"""The band of a fitted actuator on Simulate, in a real browser."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from ipmclab import identify, prediction_bands, read_fit, simulate, write_fit
from tests.identification.many import FRIEND, noisy
from tests.page.browser.conftest import serious, served

pytest.importorskip("playwright")

LONG = 180_000  # ms on a busy machine
SIGNAL = "step 1 V"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a fitted actuator, of readings so bad that its band is wide, and one that was edited."""
    folder = tmp_path_factory.mktemp("fitted")
    generator = np.random.default_rng(20261121)
    run = noisy(generator, SIGNAL, duration=10.0, rate=5.0, mounting="a")
    fit = identify(FRIEND, run, free=["circuit.dc_resistivity", "circuit.branches.1.resistivity"])
    write_fit(fit, folder / "fitted.toml")
    text = (folder / "fitted.toml").read_text("utf-8")
    (folder / "edited.toml").write_text(text.replace('width = "5 mm"', 'width = "6 mm"'), "utf-8")
    return folder


@pytest.fixture(scope="module")
def address(lab: Path) -> Iterator[str]:
    with served(lab) as found:
        yield found


AREA = """() => {
  const canvas = document.querySelectorAll('.lab-stack canvas')[1];
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let soft = 0;
  for (let k = 0; k < data.length; k += 4) if (data[k + 3] > 50 && data[k + 3] < 80) soft++;
  return soft;
}"""
"""Pixels of the plot of the current that are filled softly."""


def saved(page, kind: str) -> str:
    title = {"SVG": "Save the figure as it is shown", "CSV": "Save the data, all rows"}[kind]
    with page.expect_download() as download:
        page.get_by_role("button", name=f"{title}: Simulated response").click()
    return Path(download.value.path()).read_text("utf-8")


def columns(text: str) -> dict[str, np.ndarray]:
    heads, *rows = list(csv.reader(text.splitlines()))
    return dict(zip(heads, np.array(rows, dtype=float).T, strict=True))


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_band_is_drawn_around_what_was_loaded(address: str, open_page, lab: Path, theme: str) -> None:
    page = open_page(f"{address}/simulate?actuator=fitted.toml", theme=theme)
    page.locator("[data-answers]").wait_for(timeout=LONG)
    legend = page.get_by_role("list", name="Curves").first
    legend.get_by_text("95 % of the answer").wait_for(timeout=LONG)
    page.get_by_text("The 95 % intervals hold for mounting a.").wait_for()
    assert page.evaluate(AREA) > 200
    fit = read_fit(lab / "fitted.toml")
    bands = prediction_bands(fit, simulate(fit.actuator, SIGNAL, duration=40.0, rate=50.0))
    low, high = (1e3 * end for end in bands.interval("current", of_readings=False))
    table = columns(saved(page, "CSV"))
    np.testing.assert_allclose(table["current 95 % of the answer, low [mA]"], low, rtol=1e-8)
    np.testing.assert_allclose(table["current 95 % of the answer, high [mA]"], high, rtol=1e-8)
    assert not any("force 95 %" in head for head in table)
    figure = ElementTree.fromstring(saved(page, "SVG"))
    filled = [one for one in figure.iter("{http://www.w3.org/2000/svg}path") if one.get("fill-opacity")]
    assert len(filled) == 1
    assert len((filled[0].get("d") or "").split("L")) == 2 * 2000

    page.locator("[data-parameter='circuit.dc_resistivity']").evaluate(
        "e => { e.value = Number(e.value) + 100; e.dispatchEvent(new Event('input')); }"
    )
    legend.get_by_text("95 % of the answer, as loaded").wait_for()
    page.get_by_text("it does not hold for the sliders").wait_for()
    page.locator(".lab-sureness summary").click()
    assert serious(page) == []
    moved = columns(saved(page, "CSV"))
    np.testing.assert_allclose(moved["current 95 % of the answer, as loaded, low [mA]"], low, rtol=1e-8)
    assert moved["current now [mA]"][-1] < moved["current as loaded [mA]"][-1]

    page.get_by_label("Amplitude").fill("2")  # the values as loaded have not answered this voltage
    page.get_by_text("No band: it holds for the values as loaded alone.").wait_for()
    assert legend.get_by_text("95 %").count() == 0
    page.get_by_role("button", name="Reset all").click()
    legend.get_by_text("95 % of the answer", exact=True).wait_for()
    twice = columns(saved(page, "CSV"))
    np.testing.assert_allclose(twice["current 95 % of the answer, high [mA]"], 2.0 * high, rtol=1e-6)


def test_a_band_is_of_the_file_that_is_answered_by(address: str, open_page, lab: Path) -> None:
    (lab / "mine.toml").write_bytes((lab / "fitted.toml").read_bytes())
    page = open_page(f"{address}/simulate?actuator=mine.toml")
    legend = page.get_by_role("list", name="Curves").first
    legend.get_by_text("95 % of the answer").wait_for(timeout=LONG)
    assert page.get_by_text("Load it again").count() == 0
    (lab / "mine.toml").write_bytes((lab / "edited.toml").read_bytes())
    page.locator("[data-parameter='circuit.dc_resistivity']").evaluate(
        "e => { e.value = Number(e.value) + 100; e.dispatchEvent(new Event('input')); }"
    )
    page.get_by_text("The file of the actuator was changed: Load it again").wait_for()
    assert legend.get_by_text("95 %").count() == 0
    page.get_by_role("button", name="Reset all").click()
    page.get_by_text("No interval: geometry.width is no longer what it was when its fit was made.").wait_for()
    assert legend.get_by_text("95 %").count() == 0
    page.route("**/simulate", lambda route: route.fulfill(status=422, json={"message": "the worker is ill"})
        if '"bands":true' in route.request.post_data else route.continue_())  # fmt: skip
    page.get_by_label("Amplitude").fill("2")
    page.get_by_text("No band: the worker is ill.").wait_for()


def test_no_band_of_an_edited_file(address: str, open_page) -> None:
    page = open_page(f"{address}/simulate?actuator=edited.toml")
    page.locator("[data-answers]").wait_for(timeout=LONG)
    page.get_by_text("No interval: geometry.width is no longer what it was when its fit was made.").wait_for(
        timeout=LONG
    )
    assert page.get_by_text("95 %").count() == 0
    page.goto(f"{address}/simulate?actuator=fitted.toml%2Bleak.cubic")
    page.get_by_text("No interval: the fit in fitted.toml is of the actuator without leak.cubic.").wait_for(
        timeout=LONG
    )
