"""Whether the intervals of a model that lacks something hold its best approximation, over many strips.

Run ``python -m benchmarks.misspecified [--trials 500] [--record]``. With a wrong model no value is the true one. What
an interval should hold is the value that the same experiment gives without noise: the best approximation of this
record. Each trial draws a strip about friend-2 by a factor of 3 each way, with one branch more than the fit has, a
leak, or electrodes as a line; a step of 0.5 to 2.5 V from 5 s on, 40 s, 10 to 50 S/s; noise of 3 to 100 uA, white or
AR(1) with a pole of 0.9, readings rounded to 0 to 0.1 mA. Two branches and the dc path are fitted, the sheet
resistance known: to the readings, and to the same record without noise. Seed 20261123.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.signal

import ipmclab
from benchmarks.harness import finish
from ipmclab.model.variants import with_stages

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")
SEED = 20261123
LACKS = {
    "one more branch": "branches=3",
    "cubic leak": "leak.cubic",
    "exponential leak": "leak.exponential",
    "electrodes as a line": "line.segments=10",
}
POLE = 0.9
Array = npt.NDArray[np.float64]


@dataclass
class Tally:
    """What the intervals held: of all parameters, of the determined ones; and how wide they are."""

    trials: int = 0
    held: list[bool] = field(default_factory=list)
    determined: list[bool] = field(default_factory=list)
    widths: list[float] = field(default_factory=list)
    seconds: float = 0.0

    def row(self, name: str) -> str:
        held, determined = np.array(self.held), np.array(self.determined)
        width = f"{100 * np.median(self.widths):.1f} %" if self.widths else ""
        return (
            f"| {name} | {self.trials} | {_part(int(held.sum()), len(held))} | "
            f"{_part(int(held[determined].sum()), int(determined.sum()))} | {width} | "
            f"{self.seconds / max(self.trials, 1):.1f} s |"
        )


def drawn(generator: np.random.Generator) -> tuple[str, ipmclab.Actuator, ipmclab.Run, ipmclab.Run]:
    """What a strip has beside two branches, what the fit knows of it, its readings, and the same without noise."""
    kind = str(generator.choice(list(LACKS)))
    known = ipmclab.load_actuator("friend-2")
    strip = with_stages(known, LACKS[kind])
    about = np.log(3.0)
    moved = [name for name in strip.parameter_values if name.startswith(("circuit.", "leak.")) and strip[name] > 0.0]
    strip = strip.replace(**{name: strip[name] * np.exp(generator.uniform(-about, about)) for name in moved})
    rate, volts = float(generator.choice([10.0, 25.0, 50.0])), float(generator.uniform(0.5, 2.5))
    clean = ipmclab.simulate(strip, f"step {volts:.4g} V delay=5 s", duration=40, rate=rate)
    assert clean.current is not None
    noise = generator.standard_normal(len(clean))
    if generator.random() < 0.5:
        noise = scipy.signal.lfilter([np.sqrt(1.0 - POLE**2)], [1.0, -POLE], noise)
    current = clean.current + np.exp(generator.uniform(np.log(3e-6), np.log(1e-4))) * noise
    step = float(generator.choice([0.0, 1e-6, 1e-5, 1e-4]))
    current = np.round(current / step) * step if step else current
    read, without = (
        ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, current=values, hold=clean.hold)
        for values in (current, clean.current)
    )
    fitted = known.replace(**{"circuit.sheet_resistance": strip["circuit.sheet_resistance"]})
    return kind, fitted, read, without


def trial(generator: np.random.Generator, tally: dict[str, Tally]) -> str:
    """One strip, counted; a line that says what came of it."""
    kind, actuator, read, without = drawn(generator)
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = ipmclab.identify(actuator, read, free="electrical")
        seconds = time.perf_counter() - begin
        best = ipmclab.identify(actuator, without, free="electrical")
    one = tally.setdefault(kind, Tally())
    one.trials += 1
    one.seconds += seconds
    missed = []
    for name, found in fit.parameters.items():
        if name not in actuator.parameter_values:
            continue  # a zero of the sensor, which the other fit may not have
        low, high = found.interval
        value = best.parameters[name].value
        one.held.append(bool(low <= value <= high))
        one.determined.append(found.determined)
        if found.determined:
            one.widths.append((high - low) / (2.0 * value))
        if not one.held[-1]:
            missed.append(f"{name} {low:.4g} to {high:.4g}, best {value:.4g}")
    return f"{kind}: {'; '.join(missed) or 'all held'}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="the trial to begin with")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/misspecified.md")
    options = parser.parse_args()
    tally: dict[str, Tally] = {}
    for number in range(options.first, options.trials):
        # Each trial has its own generator, so that any of them can be looked at alone.
        said = trial(np.random.default_rng([SEED, number]), tally)
        print(f"{number + 1} of {options.trials}: {said}", flush=True)
    lines = [
        "| truth has | strips | best approximation inside, all | inside, determined | median half-width, determined | "
        "mean time of a fit |",
        "|---|---|---|---|---|---|",
        *(tally[kind].row(kind) for kind in sorted(tally)),
    ]
    every = Tally()
    for one in tally.values():
        every.trials += one.trials
        every.held += one.held
        every.determined += one.determined
        every.widths += one.widths
        every.seconds += one.seconds
    lines.append(every.row("all"))
    title = "Intervals of models that are not complete"
    finish("misspecified", title, "\n".join(lines), [], record=options.record, gate=False)


def _part(count: int, total: int) -> str:
    return f"{count} of {total} ({count / max(total, 1):.1%})"


if __name__ == "__main__":
    main()
