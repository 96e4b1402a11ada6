"""How often an interval holds the true answer: ``python -m benchmarks.answers [--trials 1000] [--record]``.

A strip is fitted to runs under white noise, and simulated under a voltage that it never saw; its true answer is known.
Counted at the row of the largest answer and at the last one, as ``ipmclab simulate`` prints them.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from benchmarks.harness import finish

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/measurement/random_effect.py",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "src/ipmclab/prediction",
)

SEED = 20261121
_NEW = ("sine 1 V 0.2 Hz", 20.0, 25.0)
_CASES = (("step 1 V",), ("sine 1 V 0.1 Hz",), ("step 1 V", "sine 1 V 0.1 Hz"))
_NOISE = 1e-4


def main() -> None:
    """Count, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--record", action="store_true")
    asked = parser.parse_args()
    rows = [
        "| runs of the fit | answer at the peak | answer at the end | reading at the peak | no interval |",
        "|---|---|---|---|---|",
    ]
    for signals in _CASES:
        peak, end, reading, none = counted(signals, asked.trials)
        rows.append(f"| {' and '.join(signals)} | {peak:.1%} | {end:.1%} | {reading:.1%} | {none} |")
    error = math.sqrt(0.95 * 0.05 / asked.trials)
    body = (
        f"{asked.trials} fits each of the electrical model of friend-2 to its current (30 s at 25 Hz, white noise of "
        f"0.1 mA), simulated under {_NEW[0]}. Nominal is 95 %; chance alone moves a count by {error:.1%} (one standard "
        "deviation).\n\n"
    )
    finish(
        "answers",
        "How often an interval holds the true answer",
        body + "\n".join(rows),
        [],
        record=asked.record,
        gate=False,
    )


def counted(signals: tuple[str, ...], trials: int) -> tuple[float, float, float, int]:
    """Shares inside of true answers at the peak and the end and of readings at the peak; trials without an interval."""
    from ipmclab import Run, RunMetadata, identify, load_actuator, simulate
    from ipmclab.prediction.answer import sure_answer

    strip, noise = load_actuator("friend-2"), np.random.default_rng([SEED, len(signals), len(signals[0])])
    signal, duration, rate = _NEW
    truth = simulate(strip, signal, duration=duration, rate=rate).channels["current"]

    def read(text: str) -> Run:
        clean = simulate(strip, text, duration=30.0, rate=25.0)
        current = clean.channels["current"] + _NOISE * noise.standard_normal(len(clean))
        about = RunMetadata(signal=text, starts_from_rest=True)
        return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, metadata=about)

    inside: list[tuple[bool, bool, bool]] = []
    for _ in range(trials):
        fitted = identify(strip, [read(text) for text in signals], free="electrical").actuator
        run = simulate(fitted, signal, duration=duration, rate=rate)
        sure = sure_answer(fitted, run)
        if sure is None or sure.here is None:
            continue
        peak = int(np.argmax(np.abs(run.channels["current"])))
        low, high = sure.here.interval("current", of_readings=False)
        lowest, highest = sure.here.interval("current")
        reading = truth[peak] + _NOISE * noise.standard_normal()
        held = [bool(low[row] <= truth[row] <= high[row]) for row in (peak, -1)]
        inside.append((held[0], held[1], bool(lowest[peak] <= reading <= highest[peak])))
    shares = np.mean(inside, axis=0)
    return float(shares[0]), float(shares[1]), float(shares[2]), trials - len(inside)


if __name__ == "__main__":
    assert Path("benchmarks").is_dir(), "run it in the root of the repository"
    main()
