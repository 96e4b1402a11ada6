"""The electrical fit of two 2,000-sample runs from no start, against what users write with SciPy.

Run ``python -m benchmarks.fit [--rounds 61] [--gate] [--record]``. The data: friend-2, a 1 V step and a 1 V
0.1 Hz sine at 50 S/s, zero-order hold, 0.1 mA of noise, seed 20261121; the sheet resistance is known.
Ours is the whole Python call of ``identify``, diagnosis, covariance and intervals included. The other is
``scipy.optimize.least_squares`` with bounds and finite differences on log parameters over
``scipy.signal.lsim``, from a random start within a decade. Both must reach the noise floor.
"""

from __future__ import annotations

import argparse

import numpy as np
import numpy.typing as npt
import scipy.optimize
import scipy.signal

import ipmclab
from benchmarks.harness import Ratio, clock, finish
from tests.independent.bounds import (
    ELECTRICAL,
    log_parameters_of,
    noisy_current,
    relative_errors,
    step_and_sine,
    strip_of,
)
from tests.independent.thesis import FRIEND_2, circuit

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")

SEED, RATE, NOISE = 20261121, 50.0, 1e-4
CALLS = 20
"""Calls of ours before each fit by hand, and as many after it."""
Array = npt.NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=61)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/fit.md")
    options = parser.parse_args()

    generator = np.random.default_rng(SEED)
    records = [
        (times, voltage, noisy_current(FRIEND_2, voltage, RATE, NOISE, generator)) for times, voltage in step_and_sine()
    ]
    truth = log_parameters_of(FRIEND_2)
    rows = sum(len(times) for times, _, _ in records)

    def residual(log_parameters: Array) -> Array:
        a, b, c, d = circuit(strip_of(log_parameters))
        system = (a, b, c[:1], d[:1])
        return np.concatenate(
            [
                (scipy.signal.lsim(system, voltage, times, interp=False)[1] - current) / NOISE
                for times, voltage, current in records
            ]
        )

    def by_hand(start: Array) -> Array:
        bounds = (truth - np.log(1e2), truth + np.log(1e2))
        solution = scipy.optimize.least_squares(residual, start, jac="2-point", bounds=bounds, method="trf")
        return solution.x  # type: ignore[no-any-return]

    runs = [
        ipmclab.Run.from_arrays(
            time=times,
            voltage=voltage,
            current=current,
            hold="zero",
            metadata=ipmclab.RunMetadata(starts_from_rest=True),
        )
        for times, voltage, current in records
    ]
    # The actuator's own values are of no use as a start: two and more decades off, both branches alike.
    wrong = {name: 100.0 * value for name, value in zip(ELECTRICAL, np.exp(truth[[0, 1, 0, 1, 4]]), strict=True)}
    actuator = ipmclab.load_actuator("friend-2").replace(**wrong)

    def ours() -> ipmclab.Fit:
        return ipmclab.identify(actuator, runs, free=["electrical"])

    # The best that any parameters can do: a fit by hand that starts at the truth.
    floor = float(np.sum(residual(by_hand(truth)) ** 2))

    def excess(log_parameters: Array) -> float:
        return float(np.sum(residual(log_parameters) ** 2)) - floor

    fit = ours()
    found = np.log([fit.actuator.parameters()[name].value for name in ELECTRICAL])
    if not excess(found) < 1.0:
        raise SystemExit(f"identify stopped {excess(found):.3g} above the least sum of squares, {floor:.5g}")
    bound = relative_errors(FRIEND_2, step_and_sine(), NOISE)
    errors = "\n".join(
        f"| `{name}` | {np.expm1(found[j] - truth[j]):+.2%} | "
        f"{fit.parameters[name].standard_error / fit.parameters[name].value:.3%} | {bound[name]:.3%} |"
        for j, name in enumerate(ELECTRICAL)
    )

    ours_times, hand_times, failed = [], [], 0
    for _ in range(options.rounds):
        guess = truth + np.log(10.0) * generator.uniform(-1.0, 1.0, len(truth))
        # Ours before and after it: what changes meanwhile meets both.
        moments = [clock()]
        for _ in range(CALLS):
            ours()
        moments.append(clock())
        solution = by_hand(guess)
        moments.append(clock())
        for _ in range(CALLS):
            ours()
        moments.append(clock())
        before, by_hand_took, after = np.diff(moments)
        ours_times.append((before + after) / (2 * CALLS))
        hand_times.append(by_hand_took)
        # The branches may come out in either order: the sum of squares does not care.
        failed += excess(solution) > 1.0
    body = (
        f"Two records of 2,000 samples, {options.rounds} rounds; five parameters, the sheet resistance known.\n\n"
        f"| | median time | reaches the noise floor |\n|---|---|---|\n"
        f"| `ipmclab.identify`, no start | {np.median(ours_times) * 1e3:.2f} ms | yes "
        f"(reduced chi-square {np.sum(residual(found) ** 2) / (rows - 5):.4f}) |\n"
        f"| `least_squares` over `lsim`, random start | {np.median(hand_times) * 1e3:.0f} ms | "
        f"{options.rounds - failed} of {options.rounds} |\n\n"
        f"| parameter | error | standard error given | Cramer-Rao bound |\n|---|---|---|---|\n{errors}"
    )
    if failed:
        body += "\n\nA fit by hand that failed is counted with its time: it would have to be started again."
    ratio = Ratio("by hand / identify", np.array(hand_times) / np.array(ours_times), at_least=50.0)
    finish("fit", "The electrical fit from no start", body, [ratio], record=options.record, gate=options.gate)


if __name__ == "__main__":
    main()
