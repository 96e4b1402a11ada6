"""Slow modes of real displacements: what each mode more leaves, beside three exponentials and a trend.

Run ``python -m benchmarks.slow_modes [--gate] [--record]``; ``IPMCLAB_REAL_RUNS`` names the folder of the records. The
displacement alone of each record, from 5 s before the step to 60 and to 240 s after it, is fitted with one to three
slow modes from no start (``--free coupling,relaxation``). Beside it stands what a user writes in ten lines: a constant,
a trend and three exponentials from the step on, of any size and with any time constants, the best of eight starts.

A search has many minima, and which one it ends in hangs on the rows. So windows are drawn too (seed 20261128): 0.3 to
10 s before the contact to 10 to 200 s after it, every row or every second or fourth, as read or rounded to 1 to 50 um.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import scipy.optimize

import ipmclab
from benchmarks.harness import finish
from benchmarks.real_records import NAMES, StepRecord, cut, records, strip
from ipmclab import Run
from ipmclab.model.variants import with_stages

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "benchmarks/real_records.py",
)

MODES = (1, 2, 3)
MORE = 1.01
"""Times what is left with a mode less, that a mode more may leave."""

BESIDE = 1.05
"""Times what the exponentials leave, that three modes may leave."""

SEED, WINDOWS = 20261128, 16
STEPS = (0.0, 0.0, 1e-6, 1e-5, 5e-5)  # m, to which readings of windows are rounded

Array = npt.NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gate", action="store_true", help="exit 1 where a mode more leaves more")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/slow_modes.md")
    options = parser.parse_args()
    found = records()
    whole, missed = minutes(found)
    parts, too_much = windows(found)
    missed += too_much
    held = (
        "In the first table no mode more leaves more than a mode less (1 %); three modes leave at most 1.05 times what "
        "the exponentials do, in the windows too."
    )
    last = f"missed: {'; '.join(missed)}" if missed else held
    body = "\n\n".join((whole, parts, last))
    finish("slow_modes", "Slow modes of real displacements", body, [], record=options.record, gate=options.gate)
    if options.gate and missed:
        sys.exit(last)


def minutes(found: Mapping[str, StepRecord]) -> tuple[str, list[str]]:
    """The table of the first one and four minutes, and where a mode more leaves more, or three the most."""
    rows, missed = [], []
    for name, record in found.items():
        for last in (60.0, 240.0):
            run = cut(record, -5.0, last, channels=("displacement",))
            left, seconds = zip(*(fitted(run, modes) for modes in MODES), strict=True)
            plain = exponentials(run)
            if any(more > MORE * less for less, more in itertools.pairwise(left)) or left[-1] > BESIDE * plain:
                missed.append(f"{name}, {last:g} s")
            cells = " | ".join(f"{1e3 * one:.4f}" for one in (*left, plain))
            times = ", ".join(f"{one:.1f}" for one in seconds)
            rows.append(f"| {name}, {last:g} s | {cells} | {left[-1] / plain:.2f} | {times} s |")
            print(rows[-1], flush=True)
    head = (
        "Root mean square of what is left of the displacement [mm]; the times are processor time of the whole call.\n\n"
        "| record, after the step | one mode | two | three | three exponentials and a trend | three modes over these "
        "| times |\n|---|---|---|---|---|---|---|\n"
    )
    return head + "\n".join(rows), missed


def windows(found: Mapping[str, StepRecord]) -> tuple[str, list[str]]:
    """The table of drawn windows, and those in which three modes leave too much."""
    generator = np.random.default_rng(SEED)
    rows, missed = [], []
    for _ in range(WINDOWS):
        name = str(generator.choice(NAMES))
        before, every = float(generator.choice([0.3, 1.0, 2.0, 5.0, 10.0])), int(generator.choice([1, 2, 4]))
        last, step = float(np.exp(generator.uniform(*np.log([10.0, 200.0])))), float(generator.choice(STEPS))
        record = found[name]
        whole = cut(record, -before, last, channels=("displacement",))
        assert whole.displacement is not None
        readings = np.round(whole.displacement / step) * step if step else whole.displacement
        # The contact is a row of each: of other rows the voltage would jump where nobody read.
        kept = slice((record.contact - record.rows(-before, last).start) % every, None, every)
        run = Run.from_arrays(
            time=whole.time[kept], voltage=whole.voltage[kept], hold="unknown", displacement=readings[kept]
        )
        two, three, plain = fitted(run, 2)[0], fitted(run, 3)[0], exponentials(run)
        words = f"{name}, {before:g} s to {last:.0f} s, row 1 of {every}, {1e6 * step:g} um"
        if three > BESIDE * plain:
            missed.append(words)
        rows.append(f"| {words} | {1e3 * two:.4f} | {1e3 * three:.4f} | {1e3 * plain:.4f} | {three / plain:.2f} |")
        print(rows[-1], flush=True)
    head = (
        "Windows drawn, from so long before the contact to so long after it, with the step to which readings are "
        "rounded:\n\n| window | two modes | three | three exponentials and a trend | three modes over these |\n"
        "|---|---|---|---|---|\n"
    )
    return head + "\n".join(rows), missed


def fitted(run: Run, modes: int) -> tuple[float, float]:
    """What a fit leaves [m], and its processor time [s]."""
    begun = time.process_time()
    fit = ipmclab.identify(with_stages(strip(), f"relaxation.displacement={modes}"), run, free="coupling,relaxation")
    took = time.process_time() - begun
    return float(np.sqrt(np.nanmean(fit.residuals[0]["displacement"] ** 2))), took


def exponentials(run: Run) -> float:
    """What a constant, a trend and three exponentials from the step on leave [m]."""
    assert run.displacement is not None
    use = np.isfinite(run.displacement)
    since = np.clip(run.time - run.time[np.argmax(run.voltage != 0.0)], 0.0, None)

    def residual(constants: Array) -> Array:
        columns = [np.ones_like(since), run.time, *(1.0 - np.exp(-since / constant) for constant in np.exp(constants))]
        table = np.column_stack(columns)[use]
        return np.asarray(table @ np.linalg.lstsq(table, run.displacement[use], rcond=None)[0] - run.displacement[use])

    generator, longest = np.random.default_rng(0), float(since.max())
    least = np.inf
    for _ in range(8):
        start = np.sort(generator.uniform(np.log(0.05), np.log(3.0 * longest), 3))
        bounds = np.log(0.005), np.log(100.0 * longest)
        least = min(least, scipy.optimize.least_squares(residual, start, bounds=bounds, x_scale=0.1).cost)
    return float(np.sqrt(2.0 * least / np.count_nonzero(use)))


if __name__ == "__main__":
    main()
