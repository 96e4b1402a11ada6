"""How soon a slider of the page is answered: ``python -m benchmarks.sliders [--changes 60] [--record]``.

The real page in a headless Chromium without a GPU: a slider of Simulate is moved, and the time is taken from its event
until response (2,000 samples), frequency response and strip are drawn. Beside it the processor time that the worker
takes for one answer, in its own process, which other programs do not disturb.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.harness import finish

_MODELS = ("friend-2", "friend-2+leak.exponential+relaxation.displacement", "friend-2+line.modes=6")


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--changes", type=int, default=60)
    parser.add_argument("--record", action="store_true")
    asked = parser.parse_args()
    rows = ["| model | event to drawn [ms]: median (90 %) | worker [ms of processor] |", "|---|---|---|"]
    for model in _MODELS:
        whole = in_browser(model, asked.changes)
        low, high = statistics.median(whole), statistics.quantiles(whole, n=10)[-1]
        rows.append(f"| {model} | {low:.0f} ({high:.0f}) | {in_worker(model, asked.changes):.1f} |")
    body = f"{asked.changes} changes of the sheet resistance each, a step of 1 V, 40 s at 50 Hz.\n\n" + "\n".join(rows)
    finish("sliders", "How soon a slider is answered", body, [], record=asked.record, gate=False)


def in_browser(model: str, changes: int) -> list[float]:
    """Times from the event of a slider until all is drawn [ms]."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        command = [sys.executable, "-m", "ipmclab", "page", folder, "--no-open"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                address = process.stdout.readline().strip()
                program = shutil.which("chromium")
                browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
                page = browser.new_page(viewport={"width": 1280, "height": 720})
                page.goto(f"{address}/simulate?actuator={model.replace('+', '%2B')}")
                page.wait_for_selector("[data-answers]", timeout=120_000)
                found = []
                for place in range(changes):
                    before = page.locator("[data-answers]").get_attribute("data-answers")
                    slider = page.locator("[data-parameter='circuit.sheet_resistance']")
                    slider.evaluate(f"e => {{ e.value = {300 + 5 * place}; e.dispatchEvent(new Event('input')); }}")
                    page.wait_for_function(
                        "old => document.querySelector('[data-answers]').dataset.answers !== old", arg=before
                    )
                    time.sleep(0.1)
                    found.append(float(page.locator("[data-took]").get_attribute("data-took") or "nan"))
                browser.close()
            finally:
                process.terminate()
        return found[5:]  # the first load what the browser has not compiled yet


def in_worker(model: str, changes: int) -> float:
    """Processor time of one answer [ms], the median."""
    from ipmclab.page.jobs.tasks.simulate import run

    found = []
    for place in range(changes):
        changed = {"circuit.sheet_resistance": 1.0 + 0.01 * place}
        arguments = {"actuator": model, "changes": changed, "signal": "step 1 V", "duration": 40.0, "rate": 50.0}
        began = time.process_time()
        run(arguments, lambda *_: None)
        found.append(1e3 * (time.process_time() - began))
    return statistics.median(found[2:])


if __name__ == "__main__":
    assert Path("benchmarks").is_dir(), "run it in the root of the repository"
    main()
