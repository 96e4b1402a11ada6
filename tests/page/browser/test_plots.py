"""Plots against time in a real browser: curves stand where the axes say, however the numbers beside them grow."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.page.browser.conftest import LONG, served

pytest.importorskip("playwright")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("lab")) as found:
        yield found


@pytest.mark.parametrize("wide", ["force", "current"])
def test_a_curve_stays_at_its_time_where_another_panel_needs_more_room(address: str, open_page, wide: str) -> None:
    page = open_page(f"{address}/simulate")
    page.locator("[data-answers]").wait_for(timeout=LONG)
    for panel in page.evaluate(EDGES, wide):
        assert panel["left"] > 60, "the numbers of one panel need more than the least room"
        assert panel["drawn"] == pytest.approx(panel["due"], abs=2), panel["key"]


EDGES = """async (wide) => {
  const host = document.querySelector(".lab-card").appendChild(document.createElement("div"));
  const series = [{ key: "one", label: "one", colour: 0 }];
  const panels = ["force", "current"].map((key) => ({ key, label: key, unit: "mN", factor: 1, series }));
  const stack = new LabPlot.Stack(host, { name: "edges", panels });
  const time = Float64Array.from({ length: 1001 }, (_, k) => k / 100);
  for (const { key } of panels)
    stack.show(key, [[time, time.map((t) => (t < 5 ? 0 : 1) + (key === wide ? 12345678 : 0))]]);
  stack.draw(0, 10);
  await new Promise((done) => setTimeout(done, 500));
  return stack.plots.map((plot, place) => {
    const { canvas } = plot.ctx;
    const data = plot.ctx.getImageData(0, 0, canvas.width, canvas.height).data;
    const { min, max } = plot.scales.y;
    const row = Math.round(plot.valToPos((min + max) / 2, "y", true));
    const inked = [];
    for (let x = 0; x < canvas.width; x++) {
      const at = 4 * (row * canvas.width + x);
      if (data[at + 3] > 128 && data[at] < 100 && data[at + 2] > 130) inked.push(x);
    }
    return {
      key: panels[place].key,
      left: plot.bbox.left,
      drawn: inked.reduce((sum, x) => sum + x, 0) / inked.length,
      due: plot.valToPos(4.995, "x", true),
    };
  });
}"""
"""Of curves that jump at 5 s: where the jump is drawn half-way up, and where the axis has that time [px]."""
