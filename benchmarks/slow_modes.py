"""Slow modes of real displacements: what each mode more leaves, beside three exponentials and a trend.

Run ``python -m benchmarks.slow_modes [--gate] [--record]``; ``IPMCLAB_REAL_RUNS`` names the folder of the records. The
displacement alone of each record, from 5 s before the step to 60 and to 240 s after it, is fitted with one to three
slow modes from no start (``--free coupling,relaxation``). Beside it stands what a user writes in ten lines: a constant,
a trend and three exponentials from the step on, of any size and with any time constants, the best of eight starts.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time

import numpy as np
import numpy.typing as npt
import scipy.optimize

import ipmclab
from benchmarks.harness import finish
from benchmarks.real_records import cut, records, strip
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

Array = npt.NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gate", action="store_true", help="exit 1 where a mode more leaves more")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/slow_modes.md")
    options = parser.parse_args()
    rows, missed = [], []
    for name, record in records().items():
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
    held = (
        "No mode more leaves more than a mode less (1 %), and three modes leave less than the exponentials everywhere."
    )
    found = f"missed: {'; '.join(missed)}" if missed else held
    body = head + "\n".join(rows) + f"\n\n{found}"
    finish("slow_modes", "Slow modes of real displacements", body, [], record=options.record, gate=options.gate)
    if options.gate and missed:
        sys.exit(found)


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
