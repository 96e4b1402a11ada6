"""The page with a long run behind it: ``python -m benchmarks.page [--minutes 3] [--record]``.

A recorder that is none (the real hub, with made-up readings) has told 30 minutes of 6 channels at 100 rows a second,
1.08 million points, and goes on in real time. The real server follows it, and real Chromiums look at it, headless and
without a GPU. Measured:

* from sample to pixel: the current jumps every second; the canvas is read at each frame, at the end of its curve, until
  the jump is there. Everything is in it: the block of the recorder (40 ms), the server, the WebSocket, the drawing;
* frames a second while the cursor moves over the whole run, and while it is zoomed;
* processor time and memory of the server's process, with one browser, and with three of which one has stalled;
* the first contentful paint of each section, median of 5, and that nothing is asked of another host.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

SOURCES = ("src/ipmclab/page",)

RATE = 100.0
PREFILLED = 1800.0  # [s]
CHANNELS = ("voltage", "current", "displacement", "force", "temperature", "relative_humidity")
JUMP = 1.0
"""The current changes its sign so often [s]."""

SECTIONS = ("run", "runs", "identify", "simulate", "report")


def readings(first: int, count: int) -> dict[str, np.ndarray]:
    """Made-up readings of some rows [SI]."""
    rng = np.random.default_rng(20261121 + first)
    time_ = (first + np.arange(count)) / RATE
    return {
        "voltage": np.sin(0.2 * math.pi * time_),
        "current": 0.05 * (1 - 2 * (np.floor(time_ / JUMP + 1e-9) % 2)),
        "displacement": 1e-3 * np.sin(0.2 * math.pi * time_ - 0.5) + rng.normal(0, 5e-6, count),
        "force": 2e-3 * np.sin(0.2 * math.pi * time_ - 0.5) + rng.normal(0, 5e-5, count),
        "temperature": 22 + rng.normal(0, 0.02, count),
        "relative_humidity": 45 + rng.normal(0, 0.1, count),
    }


def tell_readings(folder: Path, prefilled: float) -> None:
    """Be the recorder, until killed: prints when row 0 of what comes in real time is sampled [s since 1970]."""
    from ipmclab.rig.process.hub import Hub
    from ipmclab.rig.process.messages import Message

    recording = folder / "runs" / "recording"
    recording.mkdir(parents=True, exist_ok=True)
    hub = Hub(recording, lambda _: None, {"sample": "strip", "rig": "made up", "experiment": "benchmark"})
    limits = {"voltage": "3.5 V for 0.02 s, then zero"}
    plan: dict[str, Any] = {"title": "soak", "sample": "strip", "rig": "made up", "rig_proof": "none", "rate": RATE}
    plan |= {"folder": str(folder), "measured": list(CHANNELS), "steps": [], "seconds": 1e4, "rows": 10**6}
    plan |= {"bytes_needed": 1, "bytes_free": 2}
    hub.tell(Message("plan", {**plan, "limits": limits, "remarks": []}))
    run = {"uuid": "made-up", "signal": "sine 1 V 0.1 Hz", "purpose": "signal", "rate": RATE, "rows": 10**6}
    hub.tell(Message("run", {**run, "place": 1, "of": 1}))
    while not hub.clients:
        time.sleep(0.05)
    time.sleep(0.5)  # it has asked for blocks by then
    row, total = 0, round(prefilled * RATE)
    while row < total:
        count = min(6000, total - row)
        hub.tell(Message("block", {"first_row": row}, readings(row, count)))
        row += count
    began = time.time()
    print(json.dumps({"began": began, "row": row}), flush=True)
    while True:
        due = row + math.floor((time.time() - began) * RATE) - (row - total)
        if due > row:
            hub.tell(Message("block", {"first_row": row}, readings(row, due - row)))
            hub.tell(Message("progress", {"rows": due, "acknowledged": due, "of": 10**6}))
            row = due
        time.sleep(0.04)


@dataclass
class Measured:
    """What was measured; times in s, memory in MB, processor time in percent of one core."""

    latency: list[float] = field(default_factory=list)
    frames_moving: float = 0.0
    frames_zooming: float = 0.0
    frames_window: float = 0.0
    cpu_one: float = 0.0
    cpu_three: float = 0.0
    behind: float = 0.0
    reloads: int = 0
    memory: list[float] = field(default_factory=list)
    heap: list[float] = field(default_factory=list)
    paint: dict[str, float] = field(default_factory=dict)
    outside: list[str] = field(default_factory=list)
    points_behind: int = 0
    imported: list[str] = field(default_factory=list)


@contextmanager
def served(folder: Path) -> Iterator[tuple[str, int]]:
    """The page of a folder: its address and its process."""
    command = [sys.executable, "-m", "ipmclab", "page", str(folder), "--no-open"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http"), "the page did not come up"
        yield address, process.pid
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            raise AssertionError("the server did not end within 10 s") from None
        finally:
            if process.stdout is not None:
                process.stdout.close()


@contextmanager
def recorder(folder: Path, prefilled: float = PREFILLED) -> Iterator[dict[str, float]]:
    """The recorder that is none, in a process of its own; gives when its rows began in real time."""
    command = [sys.executable, "-m", "benchmarks.page", "--tell", str(folder), "--prefilled", str(prefilled)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
    try:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()


# The end of the curve of the current: which half of the panel it reaches there. A jump is a vertical line at first.
_WATCH = """([began, jump]) => {
  const canvas = document.querySelectorAll(".lab-live canvas")[1];
  const context = canvas.getContext("2d", { willReadFrequently: true });
  const wide = Math.round(16 * devicePixelRatio);
  window.jumps = [];
  window.watching = true;
  let before = null;
  const look = () => {
    if (window.watching) requestAnimationFrame(look);
    const { data, width, height } = context.getImageData(canvas.width - wide, 0, wide, canvas.height);
    let above = false, below = false;
    for (let x = width - 1; x >= 0 && !above && !below; x--)
      for (let y = 0; y < height; y++) {
        const at = 4 * (y * width + x);
        const [red, green, blue, opaque] = data.subarray(at, at + 4);
        if (red < 181 || green > 129 || blue > 59 || opaque < 201) continue;
        if (y < 0.45 * height) above = true;
        if (y > 0.72 * height) below = true;
      }
    const jumped = (before === 1 && below) || (before === -1 && above);
    if (jumped) {
      const since = (Date.now() / 1000 - began) / jump;
      const wanted = -before; // the current is positive in the even seconds
      const k = Math.floor(since);
      window.jumps.push((since - k + ((k % 2 === 0 ? 1 : -1) === wanted ? 0 : 1)) * jump);
      before = null;
    } else if (before === null && above !== below) before = above ? 1 : -1;
  };
  requestAnimationFrame(look);
}"""

_FRAMES = """() => new Promise((done) => {
  const begin = performance.now();
  let frames = 0;
  const count = (now) => {
    frames++;
    if (now - begin > 4000) done((1000 * frames) / (now - begin));
    else requestAnimationFrame(count);
  };
  requestAnimationFrame(count);
})"""


def measure(folder: Path, minutes: float, browser: Any, *, paints: int = 5, others: bool = True) -> Measured:
    """Look at the page of a folder for some minutes.

    Parameters
    ----------
    folder : Path
        Empty.
    minutes : float
    browser : playwright Browser
    paints : int
        How often each section is opened for its first paint.
    others : bool
        Whether three browsers look at it in the end, one of them stalled.
    """
    import psutil

    found = Measured()
    with served(folder) as (address, server), recorder(folder) as began:
        process = psutil.Process(server)
        page = browser.new_context(viewport={"width": 1280, "height": 720}, color_scheme="light").new_page()
        page.on("request", lambda one: _is_local(one.url) or found.outside.append(one.url))
        page.goto(f"{address}/run")
        page.wait_for_selector(".lab-live[data-drawn]")
        page.on("load", lambda: _again(page, began, found))
        page.evaluate(_WATCH, [began["began"], JUMP])
        heap = page.context.new_cdp_session(page)
        heap.send("Performance.enable")
        end = time.monotonic() + 60 * minutes
        every = max(5.0, 60 * minutes / 20)
        process.cpu_percent()
        used = []
        while time.monotonic() < end:
            page.wait_for_timeout(1000 * min(every, max(0.1, end - time.monotonic())))
            used.append(process.cpu_percent())
            found.memory.append(process.memory_info().rss / 1e6)
            metrics = heap.send("Performance.getMetrics")["metrics"]
            print(f"{found.memory[-1]:.1f} MB, {used[-1]:.1f} %", file=sys.stderr, flush=True)
            found.heap.append(next(one["value"] for one in metrics if one["name"] == "JSHeapUsedSize") / 1e6)
        found.cpu_one = statistics.mean(used)
        drawn = float(page.locator(".lab-live").get_attribute("data-drawn") or 0.0)
        found.behind = time.time() - began["began"] - (drawn - began["row"] / RATE)
        found.latency = page.evaluate("() => { window.watching = false; return window.jumps ?? []; }")
        found.frames_window = page.evaluate(_FRAMES)
        page.select_option(".lab-live select", "whole")
        page.wait_for_timeout(1500)
        found.points_behind = round((time.time() - began["began"]) * RATE + began["row"]) * len(CHANNELS)
        found.frames_moving = _frames_while(page, _move)
        found.frames_zooming = _frames_while(page, _zoom)
        if others:
            stalled = browser.new_context().new_page()
            stalled.goto(f"{address}/run")
            stalled.wait_for_selector(".lab-live[data-drawn]")
            third = browser.new_context().new_page()
            third.goto(f"{address}/run")
            stalled.evaluate("() => setTimeout(() => { const end = Date.now() + 25000; while (Date.now() < end); }, 0)")
            process.cpu_percent()
            page.wait_for_timeout(20_000)
            found.cpu_three = process.cpu_percent()
            found.memory.append(process.memory_info().rss / 1e6)
        found.imported = sorted({module for module in ("numba", "llvmlite") if _has_loaded(process, module)})
        for section in SECTIONS if paints else ():
            found.paint[section] = statistics.median(_paint(browser, f"{address}/{section}") for _ in range(paints))
    return found


def _again(page: Any, began: dict[str, float], found: Measured) -> None:
    """The page has come back by itself, as it does when its link was lost for long: note it, and watch on."""
    found.reloads += 1
    page.wait_for_selector(".lab-live[data-drawn]")
    page.evaluate(_WATCH, [began["began"], JUMP])


def _is_local(url: str) -> bool:
    return url.startswith(("http://127.0.0.1:", "data:", "blob:"))


def _has_loaded(process: Any, module: str) -> bool:
    """Whether a compiled library of a package is in the memory of a process."""
    return any(f"/{module}/" in mapped.path for mapped in process.memory_maps())


def _frames_while(page: Any, act: Any) -> float:
    """Frames a second while something is done with the plots."""
    page.evaluate(f"window.frames = ({_FRAMES})()")
    box = page.locator(".lab-live .lab-stack-panels").bounding_box()
    until = time.monotonic() + 4.0
    place = 0
    while time.monotonic() < until:
        act(page, box, place)
        place += 1
    return float(page.evaluate("window.frames"))


def _move(page: Any, box: dict[str, float], place: int) -> None:
    page.mouse.move(box["x"] + 80 + (7 * place) % (box["width"] - 120), box["y"] + 60 + place % 80)


def _zoom(page: Any, box: dict[str, float], place: int) -> None:
    if place % 12 == 0:
        page.locator(".lab-live .lab-stack-panels").focus()
        page.keyboard.press("+" if place % 48 else "0")
    _move(page, box, place)


def _paint(browser: Any, address: str) -> float:
    """First contentful paint of a page in a new browser [s]."""
    context = browser.new_context()
    page = context.new_page()
    page.goto(address)
    page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length > 0")
    found = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    context.close()
    return float(found) / 1000


def lines(found: Measured, minutes: float) -> list[str]:
    """What is told of it."""
    latency = np.array(found.latency or [np.nan])
    cut = max(1, len(found.memory) // 5)
    return [
        f"{minutes:g} min in real time after {PREFILLED / 60:g} min of {len(CHANNELS)} channels at {RATE:g} rows/s",
        f"sample to pixel: {1e3 * np.median(latency):.0f} ms (median of {len(latency)} jumps), "
        f"{1e3 * np.quantile(latency, 0.95):.0f} ms (95 %); bound 200 ms",
        f"frames a second: window {found.frames_window:.0f}, whole run, cursor moving {found.frames_moving:.0f}, "
        f"zooming {found.frames_zooming:.0f}; {found.points_behind / 1e6:.2f} million points behind it; bound 60",
        f"at the end {found.behind:.1f} s behind; the page was reloaded {found.reloads} times",
        f"server: {found.cpu_one:.1f} % of a core with one browser, {found.cpu_three:.1f} % with three of which one "
        "has stalled; bound 15",
        f"server memory: {max(found.memory):.0f} MB at most, {np.median(found.memory[:cut]):.0f} MB at first, "
        f"{np.median(found.memory[-cut:]):.0f} MB at last; bound 400",
        f"browser's heap: {np.median(found.heap[:cut]):.0f} MB at first, {np.median(found.heap[-cut:]):.0f} MB at last",
        "first contentful paint: "
        + ", ".join(f"{name} {1e3 * value:.0f} ms" for name, value in found.paint.items())
        + "; bound 1000 ms",
        f"asked of other hosts: {found.outside or 'nothing'}; compiler in the server: {found.imported or 'none'}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=3.0)
    parser.add_argument("--paints", type=int, default=5, help="how often each section is opened")
    parser.add_argument("--alone", action="store_true", help="without the other browsers")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/")
    parser.add_argument("--tell", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--prefilled", type=float, default=PREFILLED, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.tell is not None:
        tell_readings(options.tell, options.prefilled)
        return
    from playwright.sync_api import sync_playwright

    from benchmarks.harness import finish

    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        program = shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        found = measure(Path(folder), options.minutes, browser, paints=options.paints, others=not options.alone)
        browser.close()
    title = "The page, with half an hour of a run behind it"
    report = "\n".join(f"* {line}" for line in lines(found, options.minutes))
    finish("page", title, report, [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
