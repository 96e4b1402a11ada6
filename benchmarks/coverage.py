"""Whether the electrical fit's intervals hold the truth, over many strips and noises.

Run ``python -m benchmarks.coverage [--trials 400] [--record]``. Each trial draws a strip around friend-2 (five
parameters, logarithmically uniform), simulates a 1 V step and a 1 V 0.1 Hz sine of 2,000 samples at 50 S/s
with 0.1 mA of noise by an independent route, and identifies it from an actuator that knows only the sheet
resistance. Two spreads: half a decade (intervals of all parameters count) and one decade (intervals of the
parameters that are called determined count). Seed 20261121.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from tests.independent.bounds import (
    ELECTRICAL,
    log_parameters_of,
    noisy_current,
    relative_errors,
    step_and_sine,
    strip_of,
)
from tests.independent.thesis import FRIEND_2, Strip

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")

SEED, RATE, NOISE = 20261121, 50.0, 1e-4
Array = npt.NDArray[np.float64]


@dataclass
class Tally:
    """What happened over the trials of one spread."""

    trials: int = 0
    at_floor: int = 0
    inside: int = 0
    counted: int = 0
    inside_determined: int = 0
    determined: int = 0
    sharp: int = 0
    sharp_determined: int = 0
    blunt: int = 0
    blunt_undetermined: int = 0
    ratios: list[float] = field(default_factory=list)
    seconds: float = 0.0


def truths(decades: float, trials: int) -> list[Strip]:
    """Random strips, the faster branch first."""
    generator = np.random.default_rng(SEED)
    centre = log_parameters_of(FRIEND_2)
    found = []
    for _ in range(trials):
        rho1, eps1, rho2, eps2, leak = centre + np.log(10.0) * generator.uniform(-decades, decades, len(centre))
        first, second = sorted([(rho1, eps1), (rho2, eps2)], key=sum)
        found.append(strip_of(np.array([*first, *second, leak])))
    return found


def run_trials(decades: float, trials: int) -> Tally:
    """Identify each strip from its own noisy records."""
    tally = Tally()
    generator = np.random.default_rng([SEED, int(100 * decades)])
    library = ipmclab.load_actuator("friend-2")
    rest = ipmclab.RunMetadata(starts_from_rest=True)
    records = step_and_sine()
    for strip in truths(decades, trials):
        runs = [
            ipmclab.Run.from_arrays(
                time=times,
                voltage=voltage,
                current=noisy_current(strip, voltage, RATE, NOISE, generator),
                hold="zero",
                metadata=rest,
            )
            for times, voltage in records
        ]
        begin = time.perf_counter()
        fit = ipmclab.identify(library, runs, free="electrical")
        tally.seconds += time.perf_counter() - begin
        truth, bound = strip.dotted(), relative_errors(strip, records, NOISE)
        tally.trials += 1
        chi_square = sum(float(np.nansum((run["current"] / NOISE) ** 2)) for run in fit.residuals)
        # The truth itself leaves 4000 +- 89; the fit less.
        tally.at_floor += chi_square < 4000 + 4 * 89
        for name in ELECTRICAL:
            parameter = fit.parameters[name]
            low, high = parameter.interval
            holds = low <= truth[name] <= high
            tally.counted += 1
            tally.inside += holds
            if parameter.determined:
                tally.determined += 1
                tally.inside_determined += holds
            if bound[name] < 0.4:
                tally.sharp += 1
                tally.sharp_determined += parameter.determined
                tally.ratios.append((high - low) / (2.0 * 1.96 * bound[name] * truth[name]))
            elif bound[name] > 0.5:
                tally.blunt += 1
                tally.blunt_undetermined += not parameter.determined
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/coverage.md")
    options = parser.parse_args()
    lines = [
        "| truths within | at the noise floor | truth inside, all | truth inside, determined | "
        "bound < 40 %: determined | median width / bound's | bound > 50 %: undetermined | mean time of a fit |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for label, decades in (("half a decade", 0.5), ("one decade", 1.0)):
        tally = run_trials(decades, options.trials)
        lines.append(
            f"| {label} | {tally.at_floor} of {tally.trials} | {_part(tally.inside, tally.counted)} | "
            f"{_part(tally.inside_determined, tally.determined)} | {_part(tally.sharp_determined, tally.sharp)} | "
            f"{np.median(tally.ratios):.3f} | {_part(tally.blunt_undetermined, tally.blunt)} | "
            f"{1e3 * tally.seconds / tally.trials:.0f} ms |"
        )
    finish("coverage", "Coverage of the electrical fit", "\n".join(lines), [], record=options.record, gate=False)


def _part(count: int, total: int) -> str:
    return f"{count} of {total} ({count / max(total, 1):.1%})"


if __name__ == "__main__":
    main()
