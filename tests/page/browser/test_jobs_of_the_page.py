"""The jobs of the page in a real browser: runs, import, identify, simulate, report; each looked at with axe."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from ipmclab import load_actuator, read_fit, read_run, simulate, write_actuator, write_run
from tests.page.browser.conftest import BARE, LONG, serious, served

pytest.importorskip("playwright")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three runs, one of which was clipped, and a foreign record."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "runs").mkdir()
    rng = np.random.default_rng(20261121)
    for name, signal in (("step", "step 1 V"), ("sine", "sine 1 V 0.1 Hz"), ("square", "square 1 V 0.1 Hz")):
        run = simulate(load_actuator("friend-2"), signal, duration=40.0, rate=50.0)
        assert run.current is not None
        current = run.current + rng.normal(0.0, 2e-4, len(run))
        if name == "square":
            current[700:704] = 0.15
        about = replace(run.metadata, origin="measured")
        write_run(replace(run, current=current, applied_voltage=None, metadata=about), folder / "runs" / f"{name}.nc")
    record = read_run(folder / "runs" / "sine.nc")
    assert record.current is not None
    table = np.column_stack([record.voltage, 1e3 * record.current])
    np.savetxt(folder / "rig.csv", table, delimiter=";", header="Spannung;Strom", comments="", fmt="%.9g")
    return folder


@pytest.fixture(scope="module")
def address(lab: Path) -> Iterator[str]:
    with served(lab) as found:
        yield found


def test_runs_are_found_looked_at_compared_and_taken_along(address: str, open_page, lab: Path) -> None:
    page = open_page(f"{address}/runs")
    page.get_by_text("3 of 3 runs").wait_for()
    page.get_by_label("Search").fill("square")
    page.get_by_text("1 of 3 runs").wait_for()
    page.get_by_role("button", name="runs/square.nc").click()
    page.get_by_text("4 readings cut at 150 mA").wait_for(timeout=LONG)
    # The finding is marked on the plot of its channel; the words may stand before the plots are drawn.
    page.wait_for_function(f"() => {{ const ink = ({COUNT_BANDS})(); return ink.current > ink.displacement; }}")
    page.get_by_text("About this run").wait_for(timeout=LONG)
    assert serious(page) == []
    with page.expect_download() as saved:
        page.get_by_role("link", name="netCDF").click()
    assert Path(saved.value.path()).read_bytes() == (lab / "runs" / "square.nc").read_bytes()
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the data, all rows: square").click()
    assert len(Path(saved.value.path()).read_text().splitlines()) == 2001
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the figure as it is shown: square").click()
    drawn = Path(saved.value.path()).read_text("utf-8")
    ElementTree.fromstring(drawn)
    assert drawn.count("<title>warning: clipped<") == 1, "the finding is marked on the plot of its channel"
    page.get_by_label("Search").fill("")
    page.get_by_text("3 of 3 runs").wait_for()
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".lab-run-table tbody tr:first-child").filter(has_text="sine").wait_for()
    page.get_by_label("Show: runs/step.nc").focus()
    page.keyboard.press("Space")
    page.get_by_role("heading", name="2 runs compared").wait_for()
    assert page.get_by_role("list", name="Curves").inner_text().split() == ["square", "step"]


def test_a_saved_figure_tells_curves_with_long_names_apart(address: str, open_page) -> None:
    page = open_page(f"{address}/{BARE}")
    page.evaluate(COMPARE_LONG)
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the figure as it is shown: strip-1").click()
    assert len(saved.value.suggested_filename) <= 80
    assert saved.value.suggested_filename.startswith("strip-1_sine_1_V")
    assert saved.value.suggested_filename.endswith("run_5.svg")
    picture = page.context.new_page()
    picture.goto("about:blank")
    picture.set_content(Path(saved.value.path()).read_text("utf-8"))
    boxes = picture.evaluate(NAME_BOXES)
    assert len(boxes) == 6
    assert all(above["bottom"] <= below["top"] for above, below in pairwise(boxes))
    assert max(box["right"] for box in boxes) <= picture.evaluate("document.querySelector('svg').clientWidth + 8")


def test_a_foreign_record_is_imported_by_saying_what_its_columns_are(address: str, open_page, lab: Path) -> None:
    page = open_page(f"{address}/runs", theme="dark")
    page.get_by_role("button", name="Import a record").click()
    page.get_by_label("or one of this computer").set_input_files(
        {"name": "Über mich.csv", "mimeType": "text/csv", "buffer": bytes(100)}
    )
    refused = page.get_by_role("alert").filter(has_text="this is no text")
    refused.wait_for(timeout=LONG)
    assert refused.inner_text().startswith("Über mich.csv: ")  # not as the server calls it for itself
    page.get_by_label("or one of this computer").set_input_files(lab / "rig.csv")
    page.get_by_label("What column Strom is").wait_for()
    assert page.get_by_label("What column Strom is").input_value() == "current"
    assert serious(page) == []
    page.get_by_role("button", name="Try").click()
    page.get_by_text("no unit; state the unit").wait_for()
    page.get_by_label("Unit of column Spannung").select_option("V")
    page.get_by_label("Unit of column Strom").select_option("mA")
    page.get_by_role("button", name="Try").click()
    page.get_by_text("neither the map nor the file says when the rows were read").wait_for()
    page.get_by_label("Sampling period, without a time column").fill("20 ms")
    page.get_by_role("button", name="Try").click()
    page.get_by_text("2000 rows, 39.98 s at 50 Hz").wait_for()
    page.get_by_label("Save as").fill("../outside")
    page.get_by_role("button", name="Save the run").click()
    page.get_by_text("is no plain file name").wait_for()
    page.get_by_label("Save as").fill("imported")
    page.get_by_role("button", name="Save the run").click()
    page.get_by_role("button", name="runs/imported.nc").wait_for(timeout=LONG)
    imported, recorded = read_run(lab / "runs" / "imported.nc"), read_run(lab / "runs" / "sine.nc")
    assert imported.current is not None
    assert recorded.current is not None
    np.testing.assert_allclose(imported.current, recorded.current, rtol=1e-8)
    assert 'unit = "mA"' in (lab / "runs" / "imported.map.toml").read_text()


def test_a_strip_is_identified_cancelled_compared_saved_and_reported(address: str, open_page, lab: Path) -> None:
    page = open_page(f"{address}/report")
    page.get_by_text("Shown here once something is chosen").wait_for()
    assert not page.get_by_role("button", name="Copy").count()
    page.goto(f"{address}/identify")
    page.get_by_label("Fit: runs/step.nc").wait_for()
    page.get_by_role("columnheader", name="Mounting").wait_for()
    page.get_by_role("button", name="Identify").click()
    page.get_by_text("Choose a run to identify from").wait_for()
    for name in ("step", "sine"):
        page.get_by_label(f"Fit: runs/{name}.nc").check()
    page.get_by_label("Predict: runs/square.nc").check()
    page.get_by_label("electrical").uncheck()
    page.get_by_role("button", name="Identify").click()
    page.get_by_text("Nothing is free").wait_for()
    page.get_by_text("One by one").click()
    page.get_by_label("coupling.zero is", exact=True).select_option("free")
    page.get_by_role("button", name="Identify").click()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("cancelled", exact=True).wait_for(timeout=2 * LONG)
    page.get_by_label("coupling.zero is", exact=True).select_option("fixed")
    page.get_by_label("circuit.contact_resistance is", exact=True).select_option("free per mounting")
    page.get_by_text("--per-mounting circuit.contact_resistance").first.wait_for()
    page.get_by_text("per_mounting=['circuit.contact_resistance']").first.wait_for()
    page.get_by_text("One by one: circuit.contact_resistance of each mounting").wait_for()
    page.get_by_role("button", name="Identify").click()
    told = page.locator(".lab-free").get_by_role("alert").filter(has_text="this run does not say of which it is")
    told.wait_for(timeout=LONG)
    assert "state its mounting" in told.inner_text()
    page.get_by_label("circuit.contact_resistance is", exact=True).select_option("fixed")
    page.get_by_label("electrical").check()
    page.get_by_text("--free electrical").first.wait_for()
    page.get_by_role("button", name="Identify").click()
    page.get_by_text("All 5 free parameters are determined").wait_for(timeout=LONG)
    page.get_by_text("The value at another mounting cannot be estimated").wait_for()
    page.get_by_role("img", name="Excess of chi-square over the values of 5 parameters").wait_for()
    with page.expect_download() as saved:
        page.locator("#lab-profiles").get_by_role("link", name="SVG").click()
    assert saved.value.suggested_filename.endswith("-profiles.svg")
    assert "var(" not in Path(saved.value.path()).read_text("utf-8")
    with page.expect_download() as saved:
        page.locator("#lab-profiles").get_by_role("link", name="CSV").click()
    table = Path(saved.value.path()).read_text("utf-8").splitlines()
    assert table[0] == "parameter,value [SI],excess of chi-square"
    assert len({line.split(",")[0] for line in table[1:]}) == 5
    page.get_by_role("heading", name="Measured against model").wait_for()
    page.get_by_text("largest error").wait_for(timeout=LONG)
    page.get_by_role("link", name="Compared with other models").click()
    page.wait_for_function("document.getElementById('lab-models').getBoundingClientRect().top < 200")
    page.get_by_label("friend-2", exact=True).check()
    page.get_by_role("button", name="Predict", exact=True).click()
    page.get_by_role("list", name="Curves").get_by_text("friend-2").wait_for(timeout=LONG)
    page.get_by_label("Save as an actuator").fill("mine")
    page.get_by_role("button", name="Save", exact=True).click()
    page.get_by_text("saved as mine.toml").wait_for()
    assert read_fit(lab / "mine.toml").converged
    assert serious(page) == []

    page.get_by_role("link", name="Simulate with it").click()
    page.locator("[data-answers]").wait_for(timeout=LONG)
    page.get_by_text("load_actuator('mine.toml')").wait_for()
    page.go_back()  # a fit belongs to the server
    page.get_by_text("All 5 free parameters are determined").wait_for()
    page.get_by_role("link", name="Report on it").click()
    used = page.locator(".lab-made-from li")
    used.first.wait_for()
    assert used.all_inner_texts() == ["step 1 V\nruns/step.nc", "sine 1 V 0.1 Hz\nruns/sine.nc"]
    page.get_by_label("square 1 V 0.1 Hz runs/square.nc").check()
    page.get_by_role("button", name="Make the report").click()
    page.get_by_text("wrote report.html").wait_for(timeout=LONG)
    assert serious(page) == []
    page.get_by_role("button", name="Make the report").click()
    page.get_by_text("report.html exists already").wait_for()
    with page.expect_download() as saved:
        page.get_by_role("link", name="Download").first.click()
    assert saved.value.suggested_filename == "report.html"
    assert Path(saved.value.path()).read_bytes() == (lab / "report.html").read_bytes()
    with page.context.expect_page() as opened:
        page.get_by_role("link", name="report.html").click()
    opened.value.get_by_text("From its voltage alone the model predicts 1 run that was not given to its fit").wait_for()


def test_sliders_move_the_response_the_strip_and_the_frequency_response(address: str, open_page, lab: Path) -> None:
    strip = load_actuator("friend-2")
    entry = {"name": "coupling.zero", "determined": False, "interval": [105.3, float("inf")]}
    write_actuator(replace(strip, fit_table={"parameters": [entry]}), lab / "half-known.toml", overwrite=True)
    page = open_page(f"{address}/simulate?actuator=half-known.toml", width=768, height=1024)
    view = page.locator("[data-answers]")
    view.wait_for(timeout=LONG)
    page.get_by_text("The fit does not determine zero").wait_for()
    marked = page.get_by_label("zero", exact=True).and_(page.locator("input[type=range]"))
    told = page.locator(f"#{marked.get_attribute('aria-describedby')}").inner_text()
    assert told == "not determined by its fit: above 105\u00a01/s (95 %)"
    caption = page.locator(".lab-strip-says")
    for width in (768, 820, 1024):
        page.set_viewport_size({"width": width, "height": 1024})
        assert caption.evaluate("one => one.scrollWidth <= one.clientWidth"), width
    page.set_viewport_size({"width": 768, "height": 1024})
    before = page.locator(".lab-strip-line").get_attribute("d")
    slider = page.get_by_label("gain", exact=True).and_(page.locator("input[type=range]"))
    slider.focus()
    for _ in range(10):
        page.keyboard.press("PageUp")
    page.get_by_text("'coupling.gain':").wait_for()
    page.wait_for_function("old => document.querySelector('.lab-strip-line').getAttribute('d') !== old", arg=before)
    assert page.get_by_role("list", name="Curves").first.inner_text().split() == ["now", "as", "loaded"]
    page.get_by_role("button", name="Play").click()
    shown = page.get_by_role("img", name="The strip from the side").get_attribute("aria-label")
    page.wait_for_function("old => document.querySelector('.lab-strip').getAttribute('aria-label') !== old", arg=shown)
    page.get_by_role("button", name="Pause").click()
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 768
    page.get_by_label("Duration").fill("-1")
    page.locator(".lab-field", has_text="Duration").get_by_text("it must be a number above 0").wait_for()
    page.get_by_label("Duration").fill("20")
    number = page.get_by_label("modulus", exact=True).and_(page.locator("input[inputmode=decimal]"))
    number.fill("1e99")
    page.locator(".lab-field", has_text="modulus").get_by_text("outside the allowed").wait_for()
    page.get_by_role("button", name="Reset all").click()
    page.get_by_label("Over a run").select_option("runs/square.nc")
    page.get_by_role("list", name="Curves").first.get_by_text("measured").wait_for()
    page.get_by_text("--signal 'file runs/square.nc' --duration '40 s' --rate '50 Hz' --out simulated.nc").wait_for()
    page.get_by_label("Save changed actuator as").fill("softer")
    page.get_by_role("button", name="Save", exact=True).click()
    page.get_by_text("wrote softer.toml").wait_for()
    assert load_actuator(lab / "softer.toml").name == "friend-2"


COUNT_BANDS = """() => {
  const found = {};
  document.querySelectorAll('.lab-stack canvas').forEach((canvas, place) => {
    const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let ink = 0;
    for (let k = 0; k < data.length; k += 4)
      if (data[k + 3] && data[k] > data[k + 2] + 60) ink++;
    found[['voltage', 'current', 'displacement', 'force'][place]] = ink;
  });
  return found;
}"""
"""Pixels of a warm colour on each plot: curves are blue, the mark of a warning is not."""


COMPARE_LONG = """() => {
  const long = (k) => `strip-1 sine 1 V 0.1 Hz after a night at 25 degC and 80 percent, run ${k}`;
  const styles = ["line", "dashed", "points"];
  const names = [0, 1, 2, 3, 4, 5].map(long);
  const series = names.map((label, k) => ({ key: label, label, colour: k, style: styles[k % 3] }));
  const host = document.querySelector("#app").appendChild(document.createElement("div"));
  const panels = ["voltage", "current"].map((key) => ({ key, label: key, unit: "V", factor: 1, series }));
  const bands = [{ begin: 2, end: 3, label: "odd", severity: "warning", channel: "current" }];
  const stack = new LabPlot.Stack(host, { name: names.join(" and "), panels, bands });
  const time = Float64Array.from({ length: 101 }, (_, k) => k / 10);
  for (const { key } of panels) stack.show(key, names.map((_, k) => [time, time.map((t) => Math.sin(t + k))]));
  stack.draw(0, 10);
}"""

NAME_BOXES = """() => [...document.querySelectorAll('text')]
  .filter((one) => one.textContent.startsWith('strip-1'))
  .map((one) => { const { top, bottom, right } = one.getBoundingClientRect(); return { top, bottom, right }; })
"""
