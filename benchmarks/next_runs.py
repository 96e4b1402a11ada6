"""Bench time that proposed runs need for the precision of the thesis's plan, and whether their errors are as expected.

Run ``python -m benchmarks.next_runs [--strips 100] [--expected 20] [--whole 3] [--record]``. Strips like friend-2 whose
five electrical and three coupling parameters differ by a factor of 1.35 (0.3 is the standard deviation of the
logarithm); current and displacement are read 25 times a second with white noise of 30 uA and 8 um. The thesis's plan:
steps of 1, 2 and 3 V, sines of 1 V at 0.05, 0.1, 0.2, 0.5 and 1 Hz, a square of 1 V at 0.1 Hz, 40 s each. Ours begins
with the same 1 V step, asks for the next run at what that leaves known (an estimate drawn with its covariance), and
asks again after it. Each run costs its signal and 130 s. Compared is the time until the geometric mean of the standard
errors of all parameters is that of the thesis's plan. First by information at the true values; then some of the strips
with the goal averaged over values drawn from what each estimate leaves open, in place of the estimate alone; then a few
strips the whole way, where every run is simulated with noise and identified. Seed 20261123.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from benchmarks.harness import finish
from ipmclab import Actuator, Allowance, Fit, Run, identify, load_actuator, propose_runs, simulate
from ipmclab.confidence import NORMAL_95
from ipmclab.planning.answer import FittedStrip
from ipmclab.planning.candidates import REST_BEFORE, Candidate
from ipmclab.planning.information import information_of
from ipmclab.planning.knowledge import Knowledge
from ipmclab.planning.run_noise import RunNoise
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.signals import parse

SOURCES = (
    "src/ipmclab/planning",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/model",
    "src/ipmclab/fit",
)

SEED = 20261123
RATE = 25.0
NOISE = {"current": 30e-6, "displacement": 8e-6}
FREE = ["electrical", "coupling.gain", "coupling.p1", "coupling.p2"]
THESIS = (
    "step 1 V",
    *("step 2 V", "step 3 V"),
    *(f"sine 1 V {frequency} Hz" for frequency in (0.05, 0.1, 0.2, 0.5, 1)),
    "square 1 V 0.1 Hz",
)
PLAN = tuple(Candidate(parse(text), 40.0) for text in THESIS)
SPREAD = 0.3
SHORT = 5.0  # seconds of a first run after which slow parameters are hardly known
FARTHEST = 1.0  # of a logarithm, that an estimate is off
_TITLE = "Bench time of proposed runs against the thesis's plan"
Array = npt.NDArray[np.float64]


def allowed(volts: float) -> Allowance:
    """The rig's limits, wide enough for the thesis's own 3 V step."""
    limits = Limits(
        voltage=Limit(volts, 0.02),
        current=None,
        mean_current=None,
        charge=None,
        power=None,
        energy=None,
        displacement=None,
    )
    return Allowance(limits=limits, rate=RATE, longest=80.0)


def drawn(generator: np.random.Generator) -> Actuator:
    """A strip."""
    strip = load_actuator("friend-2")
    names = list(template().parameters)
    return strip.replace(**{name: strip[name] * float(np.exp(SPREAD * generator.standard_normal())) for name in names})


def read(strip: Actuator, candidate: Candidate, generator: np.random.Generator) -> Run:
    """A run of a strip, its rest before it."""
    given = replace(candidate.signal, delay=REST_BEFORE)  # type: ignore[call-arg]
    clean = simulate(strip, given, duration=candidate.duration + REST_BEFORE, rate=RATE)
    channels = {
        output: getattr(clean, output) + sigma * generator.standard_normal(len(clean))
        for output, sigma in NOISE.items()
    }
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="zero", **channels)


_MADE: list[Fit] = []


def template() -> Fit:
    """A fit whose values and covariance others take the place of."""
    if not _MADE:
        generator = np.random.default_rng(SEED)
        strip = load_actuator("friend-2")
        runs = [read(strip, Candidate(parse(text), 40.0), generator) for text in ("step 1 V", "sine 1 V 0.1 Hz")]
        _MADE.append(replace(identify(strip, runs, free=FREE), findings=(), undetermined=()))
    return _MADE[0]


def fit_at(values: Mapping[str, float], covariance: Array) -> Fit:
    """A fit that found these values, with this covariance of their logarithms."""
    made = template()
    strip = load_actuator("friend-2").replace(**values)
    reach = np.exp(np.minimum(NORMAL_95 * np.sqrt(np.diag(covariance)), 700.0))
    parameters = {
        name: replace(one, value=values[name], interval=(values[name] / each, values[name] * each))
        for (name, one), each in zip(made.parameters.items(), reach.tolist(), strict=True)
    }
    scale = np.array(list(values.values()))
    rows = (covariance * np.outer(scale, scale)).tolist()
    table = {one: dict(zip(values, row, strict=True)) for one, row in zip(values, rows, strict=True)}
    return replace(made, actuator=strip, parameters=parameters, covariance=table)


class Truth:
    """A strip of which everything is known but by nobody."""

    def __init__(self, strip: Actuator) -> None:
        names = list(template().parameters)
        self.values = {name: strip[name] for name in names}
        count = len(names)
        self._strip = FittedStrip(fit_at(self.values, np.eye(count)))
        self._noise = {output: RunNoise.of(template(), output) for output in self._strip.outputs}
        nothing = Knowledge.of(self._strip)
        self.nothing = replace(nothing, fitted=np.zeros_like(nothing.fitted))

    def after(self, known: Knowledge, candidate: Candidate) -> Knowledge:
        """What is known after a run."""
        return known.after(information_of(self._strip.answer(candidate, RATE), self._noise, RATE))

    def estimate(self, known: Knowledge, generator: np.random.Generator) -> Fit:
        """What a fit of the runs so far could find."""
        values, vectors = np.linalg.eigh(known.covariance)
        off = vectors @ (np.sqrt(values) * generator.standard_normal(len(values)))
        factors = np.exp(np.clip(off, -FARTHEST, FARTHEST))
        found = {
            name: value * float(factor) for (name, value), factor in zip(self.values.items(), factors, strict=True)
        }
        return fit_at(found, known.covariance)


def precision(known: Knowledge) -> float:
    """Geometric mean of the standard errors."""
    return float(np.exp(np.mean(np.log(known.errors))))


def cost(candidate: Candidate, bench: Allowance) -> float:
    return bench.time(candidate, None)


def by_information(strips: int, volts: float, draws: int = 0, first: Candidate = PLAN[0]) -> tuple[Array, Array, Array]:
    """Time of ours over that of the thesis, the errors of ours after as long over the thesis's, and how many runs."""
    bench = allowed(volts)
    every = sum(cost(one, bench) for one in PLAN)
    ratios, errors, counts = [], [], []
    for number in range(strips):
        generator = np.random.default_rng([SEED, number])
        truth = Truth(drawn(generator))
        known = truth.nothing
        for one in PLAN:
            known = truth.after(known, one)
        target = precision(known)
        known = truth.after(truth.nothing, first)
        time, reached, count = cost(first, bench), np.inf, 1
        for asked in range(2):
            left = (every - time) / 60.0
            estimate = truth.estimate(known, generator)
            proposal = propose_runs(estimate, minutes=left + 1e-6, allowed=bench, draws=draws)
            for run in proposal.runs[: 1 if asked == 0 else None]:
                known, time, count = (
                    truth.after(known, run.candidate),
                    time + run.time,
                    count + (precision(known) > target),
                )
                if precision(known) <= target and reached == np.inf:
                    reached = time
        ratios.append(reached / every)
        errors.append(precision(known) / target)
        counts.append(count)
    return np.array(ratios), np.array(errors), np.array(counts)


def told_of_information(strips: int) -> Iterator[str]:
    yield from (
        "| strips | our largest voltage | time over the thesis's: median (5 % to 95 %) | at most half | runs (of 9) "
        "| errors after as long |",
        "|---|---|---|---|---|---|",
    )
    for volts in (3.0, 1.0):
        ratios, errors, counts = by_information(strips, volts)
        low, high = np.quantile(ratios, [0.05, 0.95])
        yield (
            f"| {strips} | {volts:g} V | {np.median(ratios):.2f} ({low:.2f} to {high:.2f}) | "
            f"{np.count_nonzero(ratios <= 0.5)} of {strips} | {np.median(counts):.0f} | {np.median(errors):.2f} times |"
        )


def told_of_expectation(strips: int, draws: int) -> Iterator[str]:
    """The same strips planned at an estimate, and on average over what it leaves open."""
    yield from (
        "| strips | first run | our largest voltage | planned | time over the thesis's: mean (5 % to 95 %) "
        "| errors after as long: median (95 %) |",
        "|---|---|---|---|---|---|",
    )
    for first in (PLAN[0], replace(PLAN[0], duration=SHORT)):
        for volts in (3.0, 1.0):
            for count in (0, draws):
                ratios, errors, _ = by_information(strips, volts, count, first)
                low, high = np.quantile(ratios, [0.05, 0.95])
                how = f"on average over {count} draws" if count else "at the estimate"
                yield (
                    f"| {strips} | {first.signal}, {first.duration:g} s | {volts:g} V | {how} | "
                    f"{np.mean(ratios):.3f} ({low:.2f} to {high:.2f}) | "
                    f"{np.median(errors):.3f} ({np.quantile(errors, 0.95):.3f}) times |"
                )


def whole_way(strips: int) -> Iterator[str]:
    yield from (
        "| strip | thesis's plan | error | ours | error, identified | as expected | off by, rms in standard errors |",
        "|---|---|---|---|---|---|---|",
    )
    bench = allowed(3.0)
    for number in range(strips):
        generator = np.random.default_rng([SEED, 7, number])
        strip = drawn(generator)
        start = load_actuator("friend-2")
        theirs = identify(start, [read(strip, one, generator) for one in PLAN], free=FREE)
        target = stated(theirs)
        runs = [read(strip, PLAN[0], generator), read(strip, PLAN[3], generator)]
        time = cost(PLAN[0], bench) + cost(PLAN[3], bench)
        known = identify(start, runs, free=FREE)
        asked = FittedStrip(known)
        after = Knowledge.of(asked)
        noise = {output: RunNoise.of(known, output) for output in asked.outputs}
        for run in propose_runs(known, minutes=25.0, allowed=bench).runs:
            after = after.after(information_of(asked.answer(run.candidate, RATE), noise, RATE))
            runs.append(read(strip, run.candidate, generator))
            time += run.time
            if precision(after) <= target:
                break
        ours = identify(start, runs, free=FREE)
        off = [
            np.log(one.value / strip[name]) * one.value / one.standard_error for name, one in ours.parameters.items()
        ]
        yield (
            f"| {number + 1} | {sum(cost(one, bench) for one in PLAN) / 60.0:.1f} min | {100.0 * target:.3f} % | "
            f"{time / 60.0:.1f} min | {100.0 * stated(ours):.3f} % | {100.0 * precision(after):.3f} % | "
            f"{np.sqrt(np.mean(np.square(off))):.2f} |"
        )


def stated(fit: Fit) -> float:
    """Geometric mean of the relative standard errors that a fit states."""
    return float(np.exp(np.mean([np.log(one.standard_error / one.value) for one in fit.parameters.values()])))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--strips", type=int, default=100)
    parser.add_argument("--expected", type=int, default=20, help="strips that are planned on average over draws too")
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--whole", type=int, default=3)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args(arguments)
    body = "\n".join(
        [
            "By information at the true values:",
            "",
            *told_of_information(options.strips),
            "",
            "Planned on average over values drawn from what each estimate leaves open, in place of the estimate alone:",
            "",
            *told_of_expectation(options.expected, options.draws),
            "",
            "The whole way, with noise; ours begins with the 1 V step and the 0.05 Hz sine of the thesis, and errors"
            " are geometric means of relative standard errors:",
            "",
            *whole_way(options.whole),
        ]
    )
    finish("next_runs", _TITLE, body, [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
