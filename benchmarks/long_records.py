"""Time of fits of the real records, whole and their first minute, and what means of rows lose.

Run ``python -m benchmarks.long_records [--record]``; ``IPMCLAB_REAL_RUNS`` names the real records.

The answer stands when parameters, curve, score and intervals do: then Ctrl-C keeps the fit. What follows asks which
stage the model lacks. Times are processor time of one call, the less of two. The first 60 s are 1,626 rows, 5 s of them
before the contact. What is left is held against plain bounded least squares of the same circuit on every row, from six
starts. What means lose is told by the errors that a circuit's parameters have from means of the rows and from all rows,
under white noise.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import clock, finish
from benchmarks.real_records import StepRecord, records
from benchmarks.wrong_model import circuit_current, cut_out, plain_fit
from ipmclab import Actuator, Fit, Run
from ipmclab.identification.search.tangent import entry_errors
from ipmclab.model.variants import with_stages

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")
FREE = ("electrical", "circuit.sheet_resistance")
ASKING, AFTER = "asking what the model lacks", "errors and intervals"
WHOLE = 1e9
Array = npt.NDArray[np.float64]


def timed(actuator: Actuator, run: Run, free: Sequence[str], rounds: int = 2) -> tuple[float, float, Fit]:
    """Processor time [s] until the answer stands, that of the whole call, and the fit."""
    best: tuple[float, float, Fit] | None = None
    for _ in range(rounds):
        begun: dict[str, float] = {}
        start = clock()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fit = ipmclab.identify(
                actuator, run, free=free, progress=lambda said, _, begun=begun: begun.setdefault(said, clock())
            )
        whole = clock() - start
        asked = begun[AFTER] - begun[ASKING]
        if best is None or whole < best[1]:
            best = whole - asked, whole, fit
    assert best is not None
    return best


def times(found: dict[str, StepRecord]) -> list[str]:
    """The table of times."""
    two = ipmclab.load_actuator("friend-2")
    three = with_stages(two, "branches=3")
    leaking = with_stages(three, "leak.exponential")
    cases = [(f"{name}, 60 s", cut_out(record, 60.0), two, "2 branches", FREE) for name, record in found.items()]
    cases += [
        (f"{name}, 60 s", cut_out(found[name], 60.0), actuator, words, free)
        for name in ("step_1V", "step_2V")
        for actuator, words, free in (
            (three, "3 branches", FREE),
            (leaking, "3 branches and a leak", (*FREE, "leak")),
        )
    ]
    cases += [(f"{name}, whole", cut_out(record, WHOLE), two, "2 branches", FREE) for name, record in found.items()]
    lines = ["| record | rows | circuit | to the answer | with all that follows |", "|---|---|---|---|---|"]
    for name, run, actuator, words, free in cases:
        answer, whole, _ = timed(actuator, run, free)
        lines.append(f"| {name} | {len(run):,} | {words} | {answer:.2f} s | {whole:.2f} s |")
        print(lines[-1], flush=True)
    return lines


def beside_plain(found: dict[str, StepRecord]) -> list[str]:
    """The table of what is left of whole records."""
    two = ipmclab.load_actuator("friend-2")
    lines = ["| record | rows | fit, mA | plain, mA | ratio |", "|---|---|---|---|---|"]
    for name, record in found.items():
        run = cut_out(record, WHOLE)
        assert run.current is not None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            residual = ipmclab.identify(two, run, free=FREE).residuals[0]["current"]
        seen, period = np.isfinite(residual), 1.0 / run.rate
        point = plain_fit(run.voltage, np.where(seen, run.current, 0.0), period, 2, seen)
        plain = circuit_current(point[:-1], run.voltage, period) + 1e-3 * point[-1] - run.current
        left, beside = rms(residual[seen]), rms(plain[seen])
        lines.append(f"| {name} | {len(run):,} | {1e3 * left:.4f} | {1e3 * beside:.4f} | {left / beside:.3f} |")
        print(lines[-1], flush=True)
    return lines


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def lost() -> list[str]:
    """The table of what means lose of simulated records."""
    strip = ipmclab.load_actuator("friend-2")
    generator = np.random.default_rng(20261123)
    lines = ["| record | rows | means | information lost, at most | of |", "|---|---|---|---|---|"]
    for minutes, rate in ((5, 25.0), (20, 25.0), (34, 25.0), (20, 100.0)):
        clean = ipmclab.simulate(strip, "step 1 V delay=5 s", duration=60.0 * minutes, rate=rate)
        assert clean.current is not None
        current = clean.current + 1e-4 * generator.standard_normal(len(clean))
        run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, hold="zero")
        estimate = ipmclab.identify(strip, run, free="electrical").estimate
        problem, theta = estimate.problem.plain, estimate.solution.theta
        means = problem.on_means
        assert means is not None
        rows, fewer = entry_errors(problem.evaluate(theta)), entry_errors(means.evaluate(theta))
        parts = 1.0 - (rows / fewer) ** 2
        worst = int(np.argmax(parts))
        lines.append(
            f"| {minutes} min at {rate:g} S/s | {len(run):,} | {len(means.records[0].run):,} | "
            f"{100 * parts[worst]:.2g} % | `{problem.unknowns[worst].name}` |"
        )
        print(lines[-1], flush=True)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/long_records.md")
    options = parser.parse_args()
    found = records()
    ipmclab.identify(ipmclab.load_actuator("friend-2"), cut_out(found["step_1V"], 20.0), free=FREE)  # compiles
    begin = time.perf_counter()
    body = [
        *("## Time", "", *times(found), ""),
        *("## Beside plain least squares of every row, two branches", "", *beside_plain(found), ""),
        *("## What means of rows lose", "", *lost(), ""),
        f"All of this took {time.perf_counter() - begin:.0f} s.",
    ]
    finish("long_records", "Fits of long records", "\n".join(body), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
