"""The electrical fit of two 2,000-sample runs from no start, against what users write with SciPy.

Run ``python -m benchmarks.fit [--rounds 61] [--gate] [--record]``. The data: friend-2, a 1 V step and a 1 V
0.1 Hz sine at 50 S/s, zero-order hold, 0.1 mA of noise, seed 20261121; the sheet resistance is known.
Ours is the whole Python call of ``identify``, diagnosis, covariance and intervals included. The other is
``scipy.optimize.least_squares`` with bounds and finite differences on log parameters over
``scipy.signal.lsim``, from a random start within a decade. Both must reach the noise floor. Many fits are those of
``refit`` to currents that are drawn anew, each held against the fit that goes alone (1e-9 of a logarithm).
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.optimize
import scipy.signal

import ipmclab
from benchmarks.harness import Ratio, clock, finish
from ipmclab.identification.search.solve import Shifted, descend
from ipmclab.refitting.again import fitted
from tests.independent.bounds import (
    ELECTRICAL,
    log_parameters_of,
    noisy_current,
    relative_errors,
    step_and_sine,
    strip_of,
)
from tests.independent.thesis import FRIEND_2, circuit

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/refitting",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
)

SEED, RATE, NOISE = 20261121, 50.0, 1e-4
TIMES_BY_HAND = 30.0
"""What a landing must keep of the first ratio. ``identify`` is 13,000 calls of Python, which a neighbour that takes the
caches slows down more than the long loops of ``lsim``: 57 to 64 were measured alone on a machine, 40 to 42 beside
others."""

CALLS = 20
"""Calls of ours before each fit by hand, and as many after it."""

MANY = 256
"""Fits to other readings of the same runs, in each round."""

FULL = 7
"""Calls of the full fit."""

Array = npt.NDArray[np.float64]

TRUTH = log_parameters_of(FRIEND_2)
BOUNDS = (TRUTH - np.log(1e2), TRUTH + np.log(1e2))


@dataclass(frozen=True)
class Given:
    """Two noisy records of friend-2, and a fit of them as users write it.

    Parameters
    ----------
    records : list of (time [s], voltage [V], current [A])
    """

    records: list[tuple[Array, Array, Array]]

    @classmethod
    def drawn(cls, generator: np.random.Generator) -> Given:
        """The step and the sine, with noise of this generator."""
        return cls(
            [
                (times, voltage, noisy_current(FRIEND_2, voltage, RATE, NOISE, generator))
                for times, voltage in step_and_sine()
            ]
        )

    @property
    def runs(self) -> list[ipmclab.Run]:
        """The same for ``identify``."""
        return [
            ipmclab.Run.from_arrays(
                time=times,
                voltage=voltage,
                current=current,
                hold="zero",
                metadata=ipmclab.RunMetadata(starts_from_rest=True),
            )
            for times, voltage, current in self.records
        ]

    def residual(self, log_parameters: Array) -> Array:
        """What a circuit leaves of both, in standard deviations of the noise."""
        a, b, c, d = circuit(strip_of(log_parameters))
        system = (a, b, c[:1], d[:1])
        return np.concatenate(
            [
                (scipy.signal.lsim(system, voltage, times, interp=False)[1] - current) / NOISE
                for times, voltage, current in self.records
            ]
        )

    def by_hand(self, start: Array) -> scipy.optimize.OptimizeResult:
        """By ``least_squares`` over ``lsim``."""
        return scipy.optimize.least_squares(self.residual, start, jac="2-point", bounds=BOUNDS, method="trf")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=61)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/fit.md")
    options = parser.parse_args()

    generator = np.random.default_rng(SEED)
    given = Given.drawn(generator)
    runs = given.runs
    rows = sum(len(run) for run in runs)
    # The actuator's own values are of no use as a start: two and more decades off, both branches alike.
    wrong = {name: 100.0 * value for name, value in zip(ELECTRICAL, np.exp(TRUTH[[0, 1, 0, 1, 4]]), strict=True)}
    actuator = ipmclab.load_actuator("friend-2").replace(**wrong)

    def ours() -> ipmclab.Fit:
        return ipmclab.identify(actuator, runs, free=["electrical"])

    # The best that any parameters can do: a fit by hand that starts at the truth.
    floor = float(np.sum(given.residual(given.by_hand(TRUTH).x) ** 2))

    def excess(log_parameters: Array) -> float:
        return float(np.sum(given.residual(log_parameters) ** 2)) - floor

    fit = ours()
    found = np.log([fit.actuator.parameters()[name].value for name in ELECTRICAL])
    if not excess(found) < 1.0:
        raise SystemExit(f"identify stopped {excess(found):.3g} above the least sum of squares, {floor:.5g}")
    drawn = [{"current": run.current + NOISE * generator.standard_normal((MANY, len(run)))} for run in runs]
    check_many(fit, drawn)
    bound = relative_errors(FRIEND_2, step_and_sine(), NOISE)
    errors = "\n".join(
        f"| `{name}` | {np.expm1(found[j] - TRUTH[j]):+.2%} | "
        f"{fit.parameters[name].standard_error / fit.parameters[name].value:.3%} | {bound[name]:.3%} |"
        for j, name in enumerate(ELECTRICAL)
    )

    ours_times, many_times, hand_times, failed = [], [], [], 0
    for _ in range(options.rounds):
        guess = TRUTH + np.log(10.0) * generator.uniform(-1.0, 1.0, len(TRUTH))
        # Ours before and after it: what changes meanwhile meets both.
        moments = [clock()]
        for _ in range(CALLS):
            ours()
        moments.append(clock())
        solution = given.by_hand(guess).x
        moments.append(clock())
        for _ in range(CALLS):
            ours()
        moments.append(clock())
        ipmclab.refit(fit, drawn)
        moments.append(clock())
        before, by_hand_took, after, many_took = np.diff(moments)
        ours_times.append((before + after) / (2 * CALLS))
        hand_times.append(by_hand_took)
        many_times.append(many_took / MANY)
        # The branches may come out in either order: the sum of squares does not care.
        failed += excess(solution) > 1.0
    whole = full_fit()
    body = (
        f"Two records of 2,000 samples, {options.rounds} rounds; five parameters, the sheet resistance known.\n\n"
        f"| | median time | reaches the noise floor |\n|---|---|---|\n"
        f"| `ipmclab.identify`, no start | {np.median(ours_times) * 1e3:.2f} ms | yes "
        f"(reduced chi-square {np.sum(given.residual(found) ** 2) / (rows - 5):.4f}) |\n"
        f"| `ipmclab.refit`, each of {MANY} fits to other currents | {np.median(many_times) * 1e3:.3f} ms "
        f"({60.0 / np.median(many_times):,.0f} a minute on one processor) | yes |\n"
        f"| `least_squares` over `lsim`, random start | {np.median(hand_times) * 1e3:.0f} ms | "
        f"{options.rounds - failed} of {options.rounds} |\n\n"
        f"With force and displacement read too and the coupling free, nine parameters: `identify` takes {whole:.2f} s, "
        f"median of {FULL} calls.\n\n"
        f"| parameter | error | standard error given | Cramer-Rao bound |\n|---|---|---|---|\n{errors}"
    )
    if failed:
        body += "\n\nA fit by hand that failed is counted with its time: it would have to be started again."
    by_hand_times = np.array(hand_times)
    ratios = [
        Ratio("by hand / identify", by_hand_times / np.array(ours_times), at_least=TIMES_BY_HAND),
        Ratio("by hand / one of many fits", by_hand_times / np.array(many_times), at_least=700.0),
    ]
    finish("fit", "The electrical fit from no start", body, ratios, record=options.record, gate=options.gate)


def full_fit() -> float:
    """Of circuit and coupling from current, force and displacement: the time of a call [s]."""
    generator, strip = np.random.default_rng(SEED), ipmclab.load_actuator("friend-2")
    read = ("current", "force", "displacement")
    cleans = [
        ipmclab.simulate(strip, signal, duration=40.0, rate=RATE)
        for signal in ("step 1 V delay=1 s", "sine 1 V 0.1 Hz delay=1 s")
    ]
    noises = [
        {name: generator.normal(0.0, 3e-3 * np.ptp(clean.channels[name]), len(clean)) for name in read}
        for clean in cleans
    ]
    runs = [
        ipmclab.Run.from_arrays(
            time=clean.time,
            voltage=clean.voltage,
            **{name: clean.channels[name] + noise[name] for name in read},  # type: ignore[arg-type]
        )
        for clean, noise in zip(cleans, noises, strict=True)
    ]
    took = []
    for _ in range(FULL):
        begin = clock()
        fit = ipmclab.identify(strip, runs, free=["electrical", "coupling"])
        took.append(clock() - begin)
        left = {name: float(np.std([one[name] for one in fit.residuals])) for name in read}
        size = {name: float(np.std([one[name] for one in noises])) for name in read}
        if len(fit.parameters) != 9 or any(left[name] > 1.02 * size[name] for name in read):
            raise SystemExit(f"the full fit leaves {left}, the noise is {size}")
    return float(np.median(took))


def check_many(fit: ipmclab.Fit, drawn: Sequence[Mapping[str, Array]]) -> None:
    """Refuse to time fits that end elsewhere than those that go alone."""
    found = ipmclab.refit(fit, drawn)
    start = fitted(fit)
    for place in (0, MANY // 2, MANY - 1):
        shift = np.concatenate(
            [
                (record.readings["current"].values - given["current"][place])
                / start.problem.noise[record.place, "current"]
                for record, given in zip(start.problem.records, drawn, strict=True)
            ]
        )
        alone = descend(Shifted(start.problem, shift), start.theta, tolerance=1e-8)
        own = np.array([found[unknown.name][place] for unknown in start.problem.unknowns])
        values = np.array([u.value(float(entry)) for u, entry in zip(start.problem.unknowns, alone.theta, strict=True)])
        if not np.abs(own / values - 1.0).max() < 1e-9:
            raise SystemExit(f"fit {place} of many is off by {np.abs(own / values - 1.0).max():.1e}")


if __name__ == "__main__":
    main()
