"""Plots against time in a real browser: curves stand where the axes say, however the numbers beside them grow."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.page.browser.conftest import BARE, LONG, served

pytest.importorskip("playwright")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("lab")) as found:
        yield found


@pytest.mark.parametrize("wide", ["force", "current"])
def test_a_curve_stays_at_its_time_where_another_panel_needs_more_room(address: str, open_page, wide: str) -> None:
    page = open_page(f"{address}/{BARE}")
    for panel in page.evaluate(EDGES, wide):
        assert panel["left"] > 60, "the numbers of one panel need more than the least room"
        assert panel["drawn"] == pytest.approx(panel["due"], abs=2), panel["key"]


@pytest.mark.parametrize("source", [False, True])
def test_keys_zoom_around_the_cursor_and_never_out_of_the_curves(address: str, open_page, source: bool) -> None:
    page = open_page(f"{address}/{BARE}")
    page.evaluate(KEYED, source)
    panels = page.get_by_role("img", name="keyed: current")
    panels.focus()

    def shown(*keys: str) -> list[float]:
        for key in keys:
            panels.press(key)
        page.wait_for_timeout(300)  # what is asked of the source has come
        low, high, at = page.evaluate(WHERE)
        assert 2.0 - 1e-9 <= low <= at <= high <= 12.0 + 1e-9
        return [low, high, at]

    assert shown("Home") == pytest.approx([2.0, 12.0, 2.0])
    assert shown("+") == pytest.approx([2.0, 7.0, 2.0])
    assert shown("ArrowRight") == pytest.approx([2.0, 7.0, 2.05])
    assert shown("+") == pytest.approx([2.0, 4.5, 2.05])
    assert shown("End") == pytest.approx([2.0, 4.5, 4.5])
    assert shown("-") == pytest.approx([2.0, 7.0, 4.5])
    assert shown("+") == pytest.approx([3.25, 5.75, 4.5])
    assert shown("ArrowRight") == pytest.approx([3.25, 5.75, 4.525])
    assert shown("0") == pytest.approx([2.0, 12.0, 4.525])
    assert shown("End", "+") == pytest.approx([7.0, 12.0, 12.0])
    assert shown("ArrowLeft") == pytest.approx([7.0, 12.0, 11.95])
    assert shown("-", "-") == pytest.approx([2.0, 12.0, 11.95])
    page.set_viewport_size({"width": 1000, "height": 700})
    assert shown() == pytest.approx([2.0, 12.0, 11.95])
    assert page.get_by_role("button", name="Show all of the time: keyed").is_hidden()
    box = panels.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 3)
    page.wait_for_function("() => Math.abs(keyed.at - 7.0) < 0.5")
    assert shown()[2] == pytest.approx(7.0, abs=0.5)


def test_what_was_fetched_while_it_was_hidden_is_fetched_anew_when_it_is_shown(address: str, open_page) -> None:
    """Else its curve is a polygon: a hidden plot has no width, and asks for the fewest points."""
    page = open_page(f"{address}/{BARE}")
    page.evaluate(HIDDEN)
    page.wait_for_function("asked.length === 1", timeout=LONG)
    page.evaluate("hiddenHost.hidden = false")
    page.wait_for_function("asked.length > 1", timeout=LONG)
    first, *_, last = page.evaluate("asked")
    width = page.evaluate("hiddenPlot.panels.clientWidth")
    assert first < 1.5 * width <= last


def test_a_live_curve_is_drawn_with_what_can_be_seen_of_it(address: str, open_page) -> None:
    """Of 6000 rows: each point costs a browser without a graphics card, and a peak or a gap of one row is news."""
    page = open_page(f"{address}/{BARE}")
    page.evaluate(LIVE)
    drawn = page.evaluate(SEEN)
    assert drawn["curve"] < 4.5 * drawn["width"] < 6000  # two for each half of a pixel
    assert drawn["longest"] <= 110
    assert drawn["peak"] == pytest.approx(drawn["due"], abs=1.0)
    assert drawn["gap"] == 0
    assert drawn["beside"] > 0
    assert drawn["jump"] == 1  # of two levels, as it was: from one row to the next


def test_a_live_curve_rests_for_all_of_the_time_that_it_takes(address: str, open_page) -> None:
    """Three parts of rest for one of work, also where the most of the work comes behind what the page itself does."""
    page = open_page(f"{address}/{BARE}")
    page.evaluate(LIVE)
    took, count = page.evaluate(RESTED)
    assert 2 <= count <= 1 + took / 400


HIDDEN = """() => {
  window.hiddenHost = document.querySelector("#app").appendChild(document.createElement("section"));
  hiddenHost.hidden = true;
  const series = [{ key: "one", label: "one", colour: 0 }];
  const panels = [{ key: "voltage", label: "voltage", unit: "V", factor: 1, series }];
  window.asked = [];
  window.fetch = async (address) => {
    asked.push(Number(new URL(address, location).searchParams.get("points")));
    const text = JSON.stringify({ arrays: [["one.time", 2], ["one.value", 2]], whole: [0, 1] });
    const head = new TextEncoder().encode(text.padEnd(8 * Math.ceil((text.length + 4) / 8) - 4));
    return new Response(new Blob([Uint32Array.of(head.length), head, Float64Array.of(0, 1), Float64Array.of(0, 1)]));
  };
  window.hiddenPlot = new LabPlot.Stack(hiddenHost, { name: "hidden", panels, source: "/nowhere" });
}"""

LIVE = """() => {
  const host = document.querySelector("#app").appendChild(document.createElement("section"));
  host.style.width = "1000px"; // some 900 points for each of the 60 s, which are 6000 rows
  window.liveStack = new LabPlot.Stack(host, { name: "live", panels: [], live: true });
  const series = [{ key: "force", label: "force", colour: 0, style: "line" }];
  const panels = [{ key: "force", label: "force", unit: "mN", factor: 1, small: false, series }];
  window.rows = (first, values) => {
    const time = Float64Array.from(values, (_, k) => (first + k) / 100);
    const told = { kind: "rows", generation: 1, channels: ["force"], panels };
    const head = { ...told, first, count: values.length, now: time.at(-1) };
    liveStack.taken({ head, arrays: new Map([["time", time], ["force", Float64Array.from(values)]]) });
  };
}"""
"""A stack that follows a bench of which ``rows`` tells."""

SEEN = """async () => {
  const wave = Array.from({ length: 6000 }, (_, k) => (k % 2 ? -1 : 1) * (1 + (k % 7) / 10));
  wave[2345] = 5;
  for (let k = 3000; k < 3203; k++) wave[k] = k < 3101 ? 1.5 : -1.5;
  for (let k = 4000; k < 4020; k++) wave[k] = NaN; // 20 ms are 3 pixels
  const lines = [];
  const stroke = CanvasRenderingContext2D.prototype.stroke;
  const lineTo = Path2D.prototype.lineTo;
  const counts = new Map();
  const points = [];
  Path2D.prototype.lineTo = function (...at) {
    counts.set(this, (counts.get(this) ?? 0) + 1);
    points.push(at);
    lineTo.apply(this, at);
  };
  CanvasRenderingContext2D.prototype.stroke = function (...paths) {
    lines.push(...paths);
    stroke.apply(this, paths);
  };
  rows(0, wave);
  while (liveStack.host.dataset.drawn !== "59.99") await new Promise(requestAnimationFrame);
  lines.length = 0;
  counts.clear();
  points.length = 0;
  const [plot] = liveStack.plots;
  plot.redraw(true, true);
  await new Promise(requestAnimationFrame);
  Object.assign(CanvasRenderingContext2D.prototype, { stroke });
  Object.assign(Path2D.prototype, { lineTo });
  const { canvas } = plot.ctx;
  const { data, width } = plot.ctx.getImageData(0, 0, canvas.width, canvas.height);
  const inked = (x, y) => data[4 * (y * width + x) + 3] > 100 && data[4 * (y * width + x)] < 100;
  const row = (value) => Math.round(plot.valToPos(value, "y", true));
  const across = (time) => plot.valToPos(time, "x", true);
  const columns = (begin, end) => Array.from({ length: end - begin }, (_, k) => begin + k);
  const rowsOf = columns(row(0.9), row(-0.9));
  const ink = (x) => rowsOf.filter((y) => inked(x, y)).length;
  const left = Math.floor(plot.bbox.left);
  const peaks = columns(left, left + Math.floor(plot.bbox.width)).filter((x) => inked(x, row(4)));
  const middle = Math.round(across(40.095));
  const curves = lines.map((path) => counts.get(path) ?? 0);
  const from = points.findLastIndex(([x]) => x < across(31.005));
  const jump = Math.round((100 * (points[from + 1][0] - points[from][0]) * 60) / plot.bbox.width);
  return {
    jump, width: plot.bbox.width, curve: curves.reduce((sum, count) => sum + count, 0), longest: Math.max(...curves),
    peak: peaks.reduce((sum, x) => sum + x, 0) / peaks.length, due: across(23.45),
    gap: ink(middle), beside: ink(middle - 8),
  };
}"""
"""How a curve is drawn that goes up and down at each row, with a peak, a jump [rows] and a gap [px]."""

RESTED = """async () => {
  let count = 0;
  const draw = liveStack.draw;
  const work = () => { for (const end = performance.now() + 100; performance.now() < end;); };
  liveStack.draw = function (...ends) {
    count++;
    draw.apply(this, ends);
    queueMicrotask(work); // as a browser does that draws what it was told
  };
  const before = performance.now();
  for (let first = 0; performance.now() - before < 2000; first += 2) {
    rows(first, [first % 3, 1]);
    await new Promise((done) => setTimeout(done, 20));
  }
  return [performance.now() - before, count];
}"""
"""How often a curve is drawn within some time [ms] whose drawing takes 100 ms."""

KEYED = """(source) => {
  const host = document.querySelector("#app").appendChild(document.createElement("section"));
  const series = [{ key: "one", label: "one", colour: 0 }];
  const panels = [{ key: "current", label: "current", unit: "mA", factor: 1, series }];
  const time = Float64Array.from({ length: 1001 }, (_, k) => 2 + k / 100);
  const values = time.map((t) => Math.sin(t));
  window.fetch = async (address) => {
    const asked = new URL(address, location).searchParams;
    const [begin, end] = ["begin", "end"].map((name) => asked.get(name));
    const of = (array) => array.filter((_, k) => begin === null || (time[k] >= begin && time[k] <= end));
    const arrays = [["one.time", of(time)], ["one.value", of(values)]];
    const told = { arrays: arrays.map(([name, array]) => [name, array.length]), whole: [2, 12] };
    const text = JSON.stringify(told);
    const head = new TextEncoder().encode(text.padEnd(8 * Math.ceil((text.length + 4) / 8) - 4));
    return new Response(new Blob([Uint32Array.of(head.length), head, ...arrays.map(([, array]) => array)]));
  };
  window.keyed = new LabPlot.Stack(host, { name: "keyed", panels, source: source ? "/nowhere" : undefined });
  host.scrollIntoView();
  if (source) return;
  keyed.show("current", [[time, values]]);
  keyed.draw(2, 12);
}"""

WHERE = """() => {
  const [plot] = keyed.plots;
  const { min, max } = plot.scales.x;
  if (Math.abs(plot.posToVal(plot.cursor.left, "x") - keyed.at) > 0.02 * (max - min)) throw new Error("astray");
  return [min, max, keyed.at];
}"""
"""What is shown, and where its cursor is."""

EDGES = """async (wide) => {
  const host = document.querySelector("#app").appendChild(document.createElement("div"));
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
