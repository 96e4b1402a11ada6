"""How soon a slider of the page is answered: ``python -m benchmarks.sliders [--changes 60] [--record]``.

The real page in a headless Chromium without a GPU: a slider of Simulate is moved, and the time is taken from its event
until response (2,000 samples), frequency response and strip are drawn. Beside it the processor time that the worker
takes for one answer, in its own process, which other programs do not disturb. ``fitted.toml`` is friend-2 fitted to
current and displacement: the bands around its values as loaded are drawn all the while.
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

SOURCES = ("src/ipmclab/page", "src/ipmclab/model")

_FITTED = "fitted.toml"
_MODELS = ("friend-2", "friend-2+leak.exponential+relaxation.displacement", "friend-2+line.modes=6", _FITTED)


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--changes", type=int, default=60)
    parser.add_argument("--record", action="store_true")
    asked = parser.parse_args()
    rows = ["| model | event to drawn [ms]: median (90 %) | worker [ms of processor] |", "|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder:
        write_fitted(Path(folder) / _FITTED)
        for model in _MODELS:
            whole = in_browser(folder, model, asked.changes)
            low, high = statistics.median(whole), statistics.quantiles(whole, n=10)[-1]
            named = str(Path(folder) / model) if model == _FITTED else model
            rows.append(f"| {model} | {low:.0f} ({high:.0f}) | {in_worker(named, asked.changes):.1f} |")
    body = f"{asked.changes} changes of the sheet resistance each, a step of 1 V, 40 s at 50 Hz.\n\n" + "\n".join(rows)
    finish("sliders", "How soon a slider is answered", body, [], record=asked.record, gate=False)


def write_fitted(path: Path) -> None:
    """A fit of two outputs, with what the page needs for its bands."""
    import numpy as np

    from ipmclab import Run, identify, load_actuator, simulate, write_fit

    strip, noise = load_actuator("friend-2"), np.random.default_rng(20261121)
    clean = simulate(strip, "step 1 V", duration=40.0, rate=25.0)
    assert clean.current is not None
    assert clean.displacement is not None
    run = Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + 1e-4 * noise.standard_normal(len(clean)),
        displacement=clean.displacement + 2e-6 * noise.standard_normal(len(clean)),
    )
    write_fit(identify(strip, run, free=["electrical", "coupling.gain"]), path)


def in_browser(folder: str, model: str, changes: int) -> list[float]:
    """Times from the event of a slider until all is drawn [ms]."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
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
                if model == _FITTED:
                    page.get_by_text("95 % of the answer").first.wait_for(timeout=120_000)
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
