"""A foreign record in a real browser: its layout is corrected without losing what was filled in."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ipmclab import read_run
from tests.page.browser.conftest import LONG, serious, served

pytest.importorskip("playwright")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a record of two columns, whose units stand in no line of their own."""
    folder = tmp_path_factory.mktemp("lab")
    time = np.arange(0.0, 10.0, 0.02)
    table = np.column_stack([np.sin(time), 1e3 * np.cos(time)])
    np.savetxt(folder / "rig.csv", table, delimiter=";", header="Spannung;Strom", comments="", fmt="%.9g")
    return folder


@pytest.fixture(scope="module")
def address(lab: Path) -> Iterator[str]:
    with served(lab) as found:
        yield found


def test_a_layout_is_corrected_and_what_was_filled_in_stays(address: str, open_page, lab: Path) -> None:
    page = open_page(f"{address}/runs")
    page.get_by_role("button", name="Import a record").click()
    page.get_by_label("or one of this computer").set_input_files(lab / "rig.csv")
    page.get_by_text("rig.csv: 500 rows, 2 columns").wait_for(timeout=LONG)
    filled = {
        "Sample": "strip-7",
        "Mounting": "second",
        "Save as": "kept",
        "Sampling period, without a time column": "20 ms",
    }
    for label, words in filled.items():
        page.get_by_label(label, exact=label != "Save as").last.fill(words)
    page.get_by_label("Unit of column Spannung").select_option("V")
    assert "chamber relative humidity" in page.locator("option").all_text_contents()
    at_rest = page.get_by_label("Reading at rest of column Strom")
    assert at_rest.get_attribute("placeholder") == "12.3 mA"  # as currents of strips are
    page.get_by_label("Unit of column Strom").select_option("mA")
    page.get_by_label("Sign of column Strom").select_option("-1")

    def is_kept() -> None:
        for label, words in filled.items():
            assert page.get_by_label(label, exact=label != "Save as").last.input_value() == words
        assert page.get_by_label("Unit of column Spannung").input_value() == "V"
        assert page.get_by_label("Unit of column Strom").input_value() == "mA"
        assert page.get_by_label("Sign of column Strom").input_value() == "-1"

    units = page.get_by_role("switch", name="units in the next line")
    units.click()
    page.get_by_text("rig.csv: 499 rows, 2 columns").wait_for(timeout=LONG)
    is_kept()
    units.click()
    page.get_by_text("rig.csv: 500 rows, 2 columns").wait_for(timeout=LONG)
    lines = page.get_by_label("Lines before the table")
    field = page.locator(".q-field").filter(has=lines)
    for many, told in (("-5", "-5 is no number of lines"), ("1e30", "no rows of numbers come after so many lines")):
        lines.fill(many)
        lines.press("Tab")
        field.get_by_text(told).wait_for(timeout=LONG)
        assert page.get_by_text("skip_lines").count() == 0
        assert float(lines.input_value()) == float(many)
        is_kept()
    assert serious(page) == []
    page.get_by_role("button", name="Try").click()
    field.get_by_text("no rows of numbers come after so many lines").wait_for()
    lines.fill("1")  # the heading is taken for a line before the table: columns are known by their places
    lines.press("Tab")
    page.get_by_text("rig.csv: 499 rows, 2 columns").wait_for(timeout=LONG)
    assert field.get_by_role("alert").count() == 0
    lines.fill("0")
    lines.press("Tab")
    page.get_by_text("rig.csv: 500 rows, 2 columns").wait_for(timeout=LONG)
    is_kept()
    shown, period = page.get_by_text("500 rows, 9.98 s at 50 Hz"), page.get_by_label("Sampling period, without")
    for words, there in (("20 ms", True), ("20", False), ("20 ms", True)):
        period.fill(words)
        page.get_by_role("button", name="Try").click()
        # A curve beside a message would be of what the form said before.
        shown.wait_for(state="visible" if there else "detached", timeout=LONG)
        assert page.get_by_text("'20' has no unit").count() == (not there)
    page.get_by_role("button", name="Save the run").click()
    page.get_by_text("rig.csv is not in the folder of this page").wait_for(timeout=LONG)
    page.get_by_text("wrote runs/kept.nc").or_(page.get_by_text("wrote kept.nc")).wait_for(timeout=LONG)
    (written,) = lab.rglob("kept.nc")
    run = read_run(written)
    assert run.metadata.sample is not None
    assert (run.metadata.sample.id, run.metadata.mounting_id) == ("strip-7", "second")
    assert run.current is not None
    np.testing.assert_allclose(run.current, -np.cos(0.02 * np.arange(500)), atol=1e-8)
    assert tomllib.loads(written.with_suffix(".map.toml").read_text())["file"]["skip_lines"] == 0


def test_a_record_that_was_mended_can_be_chosen_again(address: str, open_page, tmp_path: Path) -> None:
    page = open_page(f"{address}/runs")
    page.get_by_role("button", name="Import a record").click()
    label = "or one of this computer"
    page.get_by_label(label).wait_for()
    session = page.context.new_cdp_session(page)
    for rows in (50, 90):
        table = np.column_stack([np.arange(rows) / 50, np.ones(rows), np.zeros(rows)])
        np.savetxt(tmp_path / "mine.csv", table, delimiter=",", header="t_s,U_V,I_mA", comments="")
        chosen = session.send("Runtime.evaluate", {"expression": "document.querySelector('input[type=file]')"})
        # As a person does: a browser tells of the same file no second time.
        session.send(
            "DOM.setFileInputFiles",
            {"files": [str(tmp_path / "mine.csv")], "objectId": chosen["result"]["objectId"]},
        )
        page.get_by_text(f"mine.csv: {rows} rows, 3 columns").wait_for(timeout=LONG)
    page.locator(".lab-file").get_by_text("mine.csv").wait_for()
    # The input is empty again; it must not say so beside the name.
    assert page.get_by_label(label).evaluate("one => getComputedStyle(one).fontSize") == "0px"
    assert serious(page) == []
