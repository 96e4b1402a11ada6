"""How long 2,000 runs of many campaigns take to be compared: asked of a catalogue, read, compared and drawn.

Run ``python -m benchmarks.compared_runs [--runs 2000] [--gate] [--record]``, on SQLite and, where its programs are
installed, on a PostgreSQL of its own. Runs of 40 s at 50 Hz with current and displacement: strips of two thicknesses
and two loadings, steps and sines, three humidities, two mountings, baselines. Timed is all that a user waits for: the
question to the catalogue, every file, every model and the page with its figures. The gate is the stated figure, 20 s,
of processor time: it is all one thread, and by the clock of a busy machine it hangs on others.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import uuid
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from benchmarks.catalogue import addresses
from benchmarks.harness import Ratio, finish
from ipmclab import load_actuator, simulate, write_run
from ipmclab.comparison.compare import compare
from ipmclab.reporting.comparison import write_comparison
from ipmclab.run import Run
from ipmclab.sample import Sample
from ipmclab.store.catalogue.catalogue import Catalogue

SOURCES = ("src/ipmclab/comparison", "src/ipmclab/store/catalogue", "src/ipmclab/store/run_file.py")

LIMIT = 20.0
"""Of 2,000 runs [s]."""

SIGNALS = ("step 1 V", "step 2 V", "step 3 V", "sine 1 V 0.1 Hz", "sine 1 V 0.5 Hz", "step 0 V")
HUMIDITIES = (60.0, 70.0, 80.0)
NOISE = {"current": 3e-5, "displacement": 2e-6}
SEED = 20261123


def make_files(folder: Path, count: int) -> None:
    """Runs of as many strips as there are runs for, each 36 of all signals and humidities in two mountings."""
    draw = np.random.default_rng(SEED)
    actuator = load_actuator("friend-2")
    ideal = [simulate(actuator, signal, duration=40.0, rate=50.0) for signal in SIGNALS]
    each = 2 * len(HUMIDITIES) * len(SIGNALS)
    for place in range(count):
        strip, inside = divmod(place, each)
        mounting, within = divmod(inside, each // 2)
        humidity, signal = HUMIDITIES[within // len(SIGNALS)], within % len(SIGNALS)
        size = float(np.exp(0.3 * np.sin(7.0 * strip) + 0.01 * (humidity - 70.0) + 0.05 * draw.normal()))
        path = folder / f"campaign-{strip // 8}" / f"{place:05d}.nc"
        path.parent.mkdir(exist_ok=True)
        write_run(_run(ideal[signal], strip, f"{strip}-{mounting}", humidity, size, place, draw), path)


def _run(
    ideal: Run, strip: int, mounting: str, humidity: float, size: float, place: int, draw: np.random.Generator
) -> Run:
    sample = Sample(
        f"strip-{strip}",
        nominal_membrane_thickness=(183e-6, 254e-6)[strip % 2],
        plating_loading=(0.05, 0.1)[strip // 2 % 2],
    )
    about = replace(
        ideal.metadata,
        uuid=str(uuid.UUID(int=place + 1)),
        sample=sample,
        mounting_id=mounting,
        relative_humidity=humidity,
        temperature=20.0,
        recorded_at=(datetime(2026, 1, 1, tzinfo=UTC) + timedelta(minutes=place)).isoformat(),
        state="complete",
    )
    read = {
        name: size * ideal.channels[name] + noise * draw.standard_normal(len(ideal)) for name, noise in NOISE.items()
    }
    return replace(ideal, metadata=about, force=None, **read)


def measured(name: str, folder: Path, address: str | None, count: int) -> tuple[str, list[Ratio]]:
    """A row of the table, and the gate."""
    catalogue = Catalogue(folder, address)
    began = time.perf_counter()
    catalogue.sweep()
    swept = time.perf_counter() - began
    began, worked = time.perf_counter(), time.process_time()
    paths = [folder / row.path for row in catalogue.query() if row.path is not None]
    asked = time.perf_counter() - began
    found = compare(paths)
    read = time.perf_counter() - began
    write_comparison(found, folder / "compared.html", overwrite=True)
    whole, work = time.perf_counter() - began, time.process_time() - worked
    assert len(found.rows) == count
    assert not found.unread
    cells = (swept, asked, read - asked, whole - read, whole, work)
    row = f"| {name} | {count} | " + " | ".join(f"{one:.2f} s" for one in cells) + " |"
    return row, [Ratio(f"processor time over {LIMIT:g} s, {name}", np.array([work / LIMIT]), at_most=1.0)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--gate", action="store_true", help="exit 1 when it takes longer than 20 s of processor time")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/compared_runs.md")
    options = parser.parse_args()
    os.environ.pop("IPMCLAB_CATALOGUE", None)
    lines = [
        "| catalogue | runs | brought up to date, once | question | read and compared | drawn | in all "
        "| processor time |",
        "|---|---|---|---|---|---|---|---|",
    ]
    ratios = []
    with tempfile.TemporaryDirectory() as folder, addresses() as places:
        make_files(Path(folder), options.runs)
        for name, address in places.items():
            line, found = measured(name, Path(folder), address, options.runs)
            lines.append(line)
            ratios += found
    finish("compared_runs", "Runs compared", "\n".join(lines), ratios, record=options.record, gate=options.gate)


if __name__ == "__main__":
    main()
