"""What can be identified, what is said of what cannot, and how long profiles and the bootstrap take.

Run ``python -m benchmarks.identifiability [--trials 20] [--record]``. All runs: friend-2, a 1 V step and a 1 V 0.1 Hz
sine, 2,000 rows at 50 S/s each, 0.1 mA of noise on the current and 1 % of the largest on the force. Seed 20261121.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from benchmarks.harness import finish
from ipmclab import bootstrap, identifiability, identify, load_actuator, profile
from ipmclab.fit.fit import Fit
from ipmclab.model.variants import with_stages
from tests.planning.test_identifiable import (
    FRIEND,
    SHEET,
    SIGNALS,
    SIX,
    bound_of_six,
    by_hand,
    noisy,
    strip_with,
)

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/planning/identifiable.py",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
)

SLOW = with_stages(FRIEND, "relaxation.force")
EIGHT = ["electrical", "coupling.gain", "coupling.p1", "coupling.p2"]


def by_structure(trials: int) -> str:
    """The direction of the model alone, over random strips of two to four branches."""
    worst, right = 0.0, 0
    for seed in range(trials):
        branches = 2 + seed % 3
        strip = strip_with(branches, 100 + seed)
        found = identifiability(strip, free=SIX, outputs="current")
        right += found.rank == 1 + 2 * branches
        expected = by_hand(dict(strip.parameter_values), branches)
        (direction,) = found.directions
        sign = np.sign(direction.coefficients["circuit.branches.0.resistivity"])
        worst = max(worst, *(abs(sign * direction.coefficients[name] - value) for name, value in expected.items()))
    return f"| model alone, {trials} random strips | one less than free in {right} | {worst:.1e} | |"


def from_current(trials: int) -> str:
    """The six parameters from noisy current."""
    worst, right, finite = 0.0, 0, 0
    for seed in range(trials):
        fit = identify(FRIEND, [noisy(FRIEND, signal, ("current",), seed) for signal in SIGNALS], free=SIX)
        right += fit.rank == 5
        finite += sum(np.isfinite(one.standard_error) for one in fit.parameters.values())
        expected = by_hand(dict(fit.actuator.parameter_values), 2)
        worst = max(worst, *(abs(fit.undetermined[0].coefficients[name] - value) for name, value in expected.items()))
    return f"| fits of current, {trials} | 5 in {right} | {worst:.1e} | {finite} of {6 * trials} |"


def with_force(trials: int) -> str:
    """The six parameters with force and a known coupling: widths over the bound's."""
    ratios, right = [], 0
    for seed in range(trials):
        runs = [noisy(FRIEND, signal, ("current", "force"), seed) for signal in SIGNALS]
        fit = identify(FRIEND, runs, free=SIX)
        right += fit.rank == 6 and not fit.undetermined
        if not seed:
            bound = bound_of_six(runs)
        for name, one in fit.parameters.items():
            ratios.append(np.log(one.interval[1] / one.interval[0]) / (2.0 * 1.96 * bound[name]))
    low, middle, high = np.quantile(ratios, [0.0, 0.5, 1.0])
    return (
        f"Force added and the coupling known, {trials} fits: rank 6 and nothing open in {right}; width of the "
        f"intervals over the Cramer-Rao bound's {middle:.3f} in the middle, {low:.3f} to {high:.3f} over all "
        f"{len(ratios)}."
    )


def with_slow_mode(trials: int, free: list[str]) -> tuple[int, int, int, list[float]]:
    """How often the series resistance is named, its measurement is the cure, and a force run is."""
    named = cured = force = 0
    seconds = []
    for seed in range(trials):
        runs = [noisy(SLOW, signal, ("current", "force"), seed) for signal in SIGNALS]
        began = time.process_time()
        fit = identify(SLOW, runs, free=free)
        seconds.append(time.process_time() - began)
        said = [one for one in fit.undetermined if SHEET in one.sentence.split(" because ")[0]]
        named += bool(said)
        cured += any(f"measure {SHEET}" in one.cures for one in said)
        force += any("add a force run" in one.sentence for one in fit.undetermined)
    return named, cured, force, seconds


def timed(work: Callable[[], object], rounds: int = 5) -> tuple[float, float]:
    """Processor time and time on the clock of the quickest of some rounds [s]."""
    found = []
    for _ in range(rounds):
        clock, processor = time.perf_counter(), time.process_time()
        work()
        found.append((time.process_time() - processor, time.perf_counter() - clock))
    return min(one for one, _ in found), min(one for _, one in found)


def speed() -> list[str]:
    """Profiles and the bootstrap."""
    two = [noisy(FRIEND, signal, ("current", "force")) for signal in SIGNALS]
    current = [noisy(FRIEND, signal, ("current",)) for signal in SIGNALS]
    eight, five = identify(FRIEND, two, free=EIGHT), identify(FRIEND, current)
    three = load_actuator("friend-2+branches=3")
    seven = identify(three, [noisy(three, signal, ("current",)) for signal in SIGNALS])
    lines = ["| work | processor time | on the clock |", "|---|---|---|"]
    for title, work in (
        ("profiles of 8 parameters, current and force of two runs", lambda: profile(eight)),
        ("profiles of 5 parameters, current of two runs", lambda: profile(five)),
        ("profiles of 7 parameters of three branches, some of them open", lambda: profile(seven)),
        ("1,000 bootstrap fits of the electrical model, one process", lambda: bootstrap(five)),
    ):
        processor, clock = timed(work)
        lines.append(f"| {title} | {processor:.2f} s | {clock:.2f} s |")
    return [*lines, "", scatter(five)]


def scatter(fit: Fit) -> str:
    """Widths of the bootstrap's intervals over those of the fit, and of its profiles."""
    drawn, followed = bootstrap(fit), profile(fit)
    rows = ["| parameter | 95 % of the fit | of the profile | of the bootstrap |", "|---|---|---|---|"]
    for name, one in fit.parameters.items():
        ends = (one.interval, followed.profiles[name].interval, drawn.intervals[name])
        rows.append(f"| `{name}` | {' | '.join(f'{low:.5g} to {high:.5g}' for low, high in ends)} |")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/identifiability.md")
    options = parser.parse_args()
    lines = [
        "Current alone, six electrical parameters, against the direction found by hand:",
        "",
        "| | rank | largest error of a coefficient | finite standard errors |",
        "|---|---|---|---|",
        by_structure(10 * options.trials),
        from_current(options.trials),
        "",
        with_force(options.trials),
        "",
        "Coupling free and a slow mode present, current and force:",
        "",
        "| free of the coupling | fits | R_e named | its measurement cures | a force run does | median time of a fit |",
        "|---|---|---|---|---|---|",
    ]
    for title, coupling in (("all four", ["coupling"]), ("gain and poles", EIGHT[1:])):
        named, cured, force, seconds = with_slow_mode(options.trials, [*SIX, *coupling, "relaxation"])
        lines.append(
            f"| {title} | {options.trials} | {named} | {cured} | {force} | {np.median(seconds):.1f} s |",
        )
    lines += ["", *speed()]
    finish("identifiability", "What can be identified", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
