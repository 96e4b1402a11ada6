"""What is shown has room: numbers beside a plot, the columns of the runs, and the run that was asked for."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Sample, load_actuator, simulate, write_run
from tests.page.browser.conftest import BARE, LONG, serious, served

pytest.importorskip("playwright")

RUNS = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with more runs than a table shows at once, all of them with findings."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "runs").mkdir()
    for number in range(RUNS):
        write(folder, number)
    return folder


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with served(folder) as found:
        yield found


def write(folder: Path, number: int) -> None:
    """A run of a day of November, which is clipped."""
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=40.0, rate=50.0)
    assert run.current is not None
    current = run.current.copy()
    current[700:704] = 0.15
    about = replace(run.metadata, origin="measured", recorded_at=f"2026-11-{number + 1:02d}T12:00:00+00:00")
    path = folder / "runs" / f"a_run_of_november_number-{number:02d}_at_80_percent.nc"
    write_run(replace(run, current=current, applied_voltage=None, metadata=about), path)


@pytest.mark.parametrize(("section", "role"), [("runs", "Show"), ("identify", "Fit")])
@pytest.mark.parametrize(("width", "height"), [(820, 1180), (1280, 720)])
def test_runs_have_their_findings_in_sight_and_the_one_that_was_asked_for(
    folder: Path, address: str, open_page, section: str, role: str, width: int, height: int
) -> None:
    there = len(list((folder / "runs").glob("*.nc")))
    oldest = "runs/a_run_of_november_number-00_at_80_percent.nc"
    page = open_page(f"{address}/{section}?run={oldest}", width=width, height=height)
    box = page.locator(".lab-run-table")
    chosen = page.get_by_label(f"{role}: {oldest}")
    chosen.wait_for(timeout=LONG)
    page.get_by_text("clipped").first.wait_for(timeout=LONG)  # a worker has looked at the runs
    page.wait_for_function(IS_IN_SIGHT, arg=chosen.element_handle())
    assert chosen.is_checked()
    frame, heading = box.bounding_box(), page.get_by_role("columnheader", name="Findings").bounding_box()
    assert heading["x"] + heading["width"] <= frame["x"] + frame["width"] + 1
    told = page.get_by_text("runs in view")
    told.wait_for()
    head = page.locator(".lab-run-table th").first.bounding_box()
    rows = [row.bounding_box() for row in page.locator(".lab-run-table tbody tr").all()]
    assert len(rows) == there
    top, bottom = head["y"] + head["height"] - 1, frame["y"] + frame["height"] + 1
    seen = sum(top <= row["y"] and row["y"] + row["height"] <= bottom for row in rows)
    assert 3 <= seen < there
    assert re.match(rf"{seen} of {there} runs in view", told.inner_text())
    assert serious(page) == []
    box.hover()
    page.mouse.wheel(0, -5000)
    page.wait_for_function("document.querySelector('.lab-run-table').scrollTop === 0")
    if section == "runs":  # rows that come anew leave who scrolls alone
        write(folder, there)
        page.get_by_role("button", name="Look again").click()
        page.get_by_text(f"{there + 1} of {there + 1} runs", exact=True).wait_for(timeout=LONG)
        page.wait_for_function(
            "count => document.querySelectorAll('.lab-run-table tbody tr').length === count", arg=there + 1
        )
        assert box.evaluate("one => one.scrollTop") == 0


LONG_NAME = f"begin{290 * 'x'}ending"
"""Of a sample, such as another program may have written."""


@pytest.fixture(scope="module")
def of_long_names(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The page of a folder with one run, of such a sample."""
    folder = tmp_path_factory.mktemp("long")
    (folder / "runs").mkdir()
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=10.0, rate=50.0)
    about = replace(run.metadata, sample=Sample(id=LONG_NAME), mounting_id=f"{LONG_NAME}-2")
    write_run(replace(run, metadata=about), folder / "runs" / "one.nc")
    with served(folder) as found:
        yield found


@pytest.mark.parametrize("width", [820, 1280])
@pytest.mark.parametrize("section", ["runs", "identify"])
def test_long_names_of_samples_leave_room_for_all_else(of_long_names: str, open_page, section: str, width: int) -> None:
    page = open_page(f"{of_long_names}/{section}", width=width)
    page.get_by_text("1 of 1 runs" if section == "runs" else "0 to identify from").wait_for(timeout=LONG)
    table = page.locator(".lab-run-table")
    long = table.get_by_title(LONG_NAME, exact=True)
    long.wait_for(timeout=LONG)
    assert long.inner_text().splitlines()[0] == "beginxxxxx…xxxxxxending"
    page.wait_for_function("document.querySelector('.lab-run-table tbody td.lab-is-findings')")
    frame, row = table.bounding_box(), table.locator("tbody tr").bounding_box()
    assert row["height"] < 120
    assert table.evaluate("one => one.scrollWidth - one.clientWidth") <= (0 if section == "runs" else 1), frame
    assert serious(page) == []
    whole = long.get_by_text(LONG_NAME)
    assert whole.bounding_box()["width"] <= 1
    assert long.bounding_box()["height"] <= row["height"]
    long.focus()
    box = whole.bounding_box()
    assert frame["x"] <= box["x"]
    assert box["x"] + box["width"] <= frame["x"] + frame["width"] + 1
    assert whole.evaluate("one => one.scrollWidth <= one.clientWidth + 1")


@pytest.mark.parametrize("largest", [12345678.0, 1e9, 1.0, 2.5e-7])
def test_the_numbers_beside_a_plot_are_whole_and_where_they_say(address: str, open_page, largest: float) -> None:
    page = open_page(f"{address}/{BARE}")
    drawn = page.evaluate(NUMBERS_BESIDE, largest)
    assert drawn["left"][0] == drawn["left"][1]  # the panels share their x
    for panel in drawn["panels"]:
        numbers = panel["numbers"]
        assert len({one["text"] for one in numbers}) == len(numbers) >= 3
        for one in numbers:
            assert one["room"] >= 0, one
            assert float(one["text"]) == pytest.approx(one["value"], abs=1e-2 * panel["span"])


@pytest.mark.parametrize(
    ("middle", "swing"), [(0.0, 1.0), (1e5, 0.05), (12345678.0, 1e7), (-0.12345, 2e-7), (2e-7, 2e-7)]
)
def test_the_numbers_of_a_saved_figure_are_whole_and_where_they_say(
    address: str, open_page, middle: float, swing: float
) -> None:
    page = open_page(f"{address}/{BARE}")
    page.evaluate(WIDE_FIGURE, [middle, swing])
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the figure as it is shown: wide").click()
    picture = page.context.new_page()
    picture.set_content(f"<body style='margin: 0'>{Path(saved.value.path()).read_text('utf-8')}</body>")
    drawn = picture.evaluate(NUMBERS_OF_FIGURE)
    assert len(drawn["panels"]) == 2
    for (low, high), numbers in zip(((middle - swing, middle + swing), (-1.0, 1.0)), drawn["panels"], strict=True):
        assert len({one["text"] for one in numbers}) == len(numbers) >= 3
        for one in numbers:
            assert drawn["names"] <= one["left"], one  # beside the name of the panel, not over it
            assert low - 0.1 * (high - low) <= float(one["text"]) <= high + 0.1 * (high - low)
        values, heights = ([one[what] for one in numbers] for what in ("text", "y"))
        steps = np.diff([float(value) for value in values]) / np.diff(heights)
        assert np.allclose(steps, steps[0], rtol=0.05)  # numbers stand as far from each other as they say
    assert len(drawn["times"]) >= 5
    for one in drawn["times"]:
        assert 0.0 <= one["left"] < one["right"] <= drawn["width"], one


IS_IN_SIGHT = """(box) => {
  const table = box.closest(".lab-run-table");
  const [row, frame, head] = [box.closest("tr"), table, table.querySelector("th")]
    .map((one) => one.getBoundingClientRect());
  return row.top >= head.bottom - 1 && row.bottom <= frame.bottom + 1;
}"""

WIDE_FIGURE = """([middle, swing]) => {
  const host = document.querySelector("#app").appendChild(document.createElement("div"));
  const series = [{ key: "one", label: "one", colour: 0 }];
  const panels = ["force", "current"].map((key) => ({ key, label: key, unit: "mN", factor: 1, series }));
  const stack = new LabPlot.Stack(host, { name: "wide", panels });
  const time = Float64Array.from({ length: 101 }, (_, k) => 100000 + k / 10);
  stack.show("force", [[time, time.map((_, k) => middle + swing * Math.sin(k / 10))]]);
  stack.show("current", [[time, time.map((_, k) => Math.sin(k / 10))]]);
  stack.draw(100000, 100010);
}"""

NUMBERS_OF_FIGURE = """() => {
  const box = (one) => {
    const { left, right, top, bottom } = one.getBoundingClientRect();
    return { text: one.textContent, left, right, y: (top + bottom) / 2 };
  };
  const of = (place) => [...document.querySelectorAll(place)].map(box);
  const names = of('text[transform]');
  const beside = of('text[text-anchor=end]');
  const away = (one, name) => Math.abs(name.y - one.y);
  const nearest = (one) => names.reduce((best, name) => (away(one, name) < away(one, best) ? name : best));
  return {
    width: document.querySelector("svg").clientWidth,
    names: Math.max(...names.map((one) => one.right)),
    panels: names.map((name) => beside.filter((one) => nearest(one) === name)),
    times: of('text[text-anchor=middle]:not([transform])').filter((one) => !one.text.includes("[")),
  };
}"""
"""Of a figure its numbers, and where the names of its panels end."""

NUMBERS_BESIDE = """async (largest) => {
  const host = document.querySelector("#app").appendChild(document.createElement("div"));
  const series = [{ key: "one", label: "one", colour: 0 }];
  const panels = ["force", "current"].map((key) => ({ key, label: key, unit: "mN", factor: 1, series }));
  const stack = new LabPlot.Stack(host, { name: "large", panels });
  const time = Float64Array.from({ length: 101 }, (_, k) => k / 10);
  stack.show("force", [[time, time.map((t) => largest * (1 + 0.9 * Math.sin(t)))]]);
  stack.show("current", [[time, time.map((t) => Math.sin(t))]]);
  const texts = new Map(stack.plots.map((plot) => [plot, []]));
  for (const plot of stack.plots) {
    const { ctx } = plot;
    const fill = ctx.fillText.bind(ctx);
    ctx.fillText = (text, x, y) => {
      if (ctx.textAlign === "right") texts.get(plot).push({ text, x, y, room: x - ctx.measureText(text).width });
      fill(text, x, y);
    };
  }
  stack.draw(0, 10);
  await new Promise((done) => setTimeout(done, 300));
  texts.forEach((list) => list.splice(0)); // how it stands in the end
  stack.plots.forEach((plot) => plot.redraw(false));
  await new Promise((done) => setTimeout(done, 300));
  return {
    left: stack.plots.map((plot) => plot.bbox.left),
    panels: stack.plots.map((plot) => ({
      span: plot.scales.y.max - plot.scales.y.min,
      numbers: texts.get(plot).map((one) => ({ ...one, value: plot.posToVal(one.y, "y", true) })),
    })),
  };
}"""
"""The texts at the right of which a plot begins, with what [px] is left of them and the value at their height."""
