"""Whether the interval of the next mounting holds it, and whether a left-out run is judged rightly: Monte-Carlo.

Run ``python -m benchmarks.mountings [--trials 2000] [--strips 200] [--record]``. Three parts. First the interval alone:
members drawn from a normal distribution, each read with an error of its own size (spread over a factor of four), and
one more member to be held; beside it the usual t interval about the REML mean with Hartung and Knapp's variance, with
k - 1 and with k - 2 degrees of freedom. Then the whole way: strips like friend-2 whose five electrical parameters
change by a factor of their own at each mounting, a square of 1 V for 30 s at 25 Hz for each, white noise of 0.1 mA,
identified together; the next mounting's true values against ``interval_next_mounting``, and its readings against the
band of ``validate``. Last, runs of one strip of which each is left out: how often a run is called unlike the others
that is not, and one that is (its strip's dc resistivity 10 % higher). Seed 20261121.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

import ipmclab
from benchmarks.harness import finish
from ipmclab.measurement.random_effect import random_effect
from tests.identification.many import ELECTRICAL, FRIEND, mounted, noisy

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/measurement/random_effect.py",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "src/ipmclab/prediction",
)

SEED = 20261121
_TITLE = "The next mounting, and runs left out"
Array = npt.NDArray[np.float64]


def hartung_knapp(values: Array, variances: Array, freedom: int) -> tuple[float, float]:
    """The predictive t interval of meta-analysis, with REML for the variance between."""
    between = float(np.var(values, ddof=1))
    for _ in range(500):
        weights = 1.0 / (variances + between)
        mean = float(weights @ values / weights.sum())
        raised = float(weights**2 @ ((values - mean) ** 2 - variances) / (weights**2).sum() + 1.0 / weights.sum())
        if abs(max(raised, 0.0) - between) < 1e-10:
            break
        between = max(raised, 0.0)
    weights = 1.0 / (variances + between)
    mean = float(weights @ values / weights.sum())
    about = float((weights * (values - mean) ** 2).sum()) / (len(values) - 1) / weights.sum()
    reach = float(student.ppf(0.975, freedom)) * np.sqrt(between + about)
    return mean - reach, mean + reach


def interval_alone(trials: int) -> Iterator[str]:
    yield from (
        "| members | spread / error | ours holds | median width | t, k - 1 | t, k - 2 |",
        "|---|---|---|---|---|---|",
    )
    for count in (3, 5, 10):
        for between in (0.0, 0.5, 1.0, 3.0, 30.0):
            generator = np.random.default_rng([SEED, count, int(10 * between)])
            held, widths = np.zeros(3), []
            for _ in range(trials):
                errors = np.exp(generator.uniform(-0.7, 0.7, count))
                members = between * generator.standard_normal(count + 1)
                values = members[:count] + errors * generator.standard_normal(count)
                ours = random_effect(values, errors).next_one
                assert ours is not None
                each = [
                    ours,
                    hartung_knapp(values, errors**2, count - 1),
                    hartung_knapp(values, errors**2, max(count - 2, 1)),
                ]
                held += [low <= members[count] <= high for low, high in each]
                widths.append(ours[1] - ours[0])
            shares = 100.0 * held / trials
            yield (
                f"| {count} | {between:g} | {shares[0]:.1f} % | {np.median(widths):.1f} | {shares[1]:.1f} % | "
                f"{shares[2]:.1f} % |"
            )


def whole_way(strips: int) -> Iterator[str]:
    yield from (
        "| mountings | factor (one deviation) | strips | next mounting inside, pooled (least to most of one parameter) "
        "| its readings in the band |",
        "|---|---|---|---|---|",
    )
    for count, spread in ((3, 0.1), (5, 0.1), (5, 0.4)):
        generator = np.random.default_rng([SEED, count, int(10 * spread)])
        inside, banded = [], []
        for _ in range(strips):
            runs, truth = [], {}
            for number in range(count + 1):
                strip, values = mounted(generator, spread)
                runs.append(noisy(generator, "square 1 V 0.1 Hz", strip=strip, mounting=f"m{number}"))
                truth = dict(values)
            fit = ipmclab.identify(FRIEND, runs[:count])
            told = [fit.parameters[name].interval_next_mounting or (np.nan, np.nan) for name in ELECTRICAL]
            inside.append([low <= truth[name] <= high for name, (low, high) in zip(ELECTRICAL, told, strict=True)])
            banded.append(ipmclab.validate(fit.actuator, [runs[count]]).scores["current"].inside_band or 0.0)
        shares = 100.0 * np.mean(inside, axis=0)
        yield (
            f"| {count} | {np.exp(spread):.2f} | {strips} | {shares.mean():.1f} % ({shares.min():.1f} to "
            f"{shares.max():.1f}) | {100.0 * np.mean(banded):.1f} % |"
        )


def runs_left_out(strips: int) -> Iterator[str]:
    yield from (
        "| runs | of them another strip | trials | p < 5 %, of each run | called unlike the others | and it is the one "
        "| readings in the band |",
        "|---|---|---|---|---|---|---|",
    )
    signals = ("step 1 V", "sine 1 V 0.1 Hz", "square 1 V 0.1 Hz", "sine 1 V 0.3 Hz")
    other = FRIEND.replace(**{"circuit.dc_resistivity": 1.1 * FRIEND["circuit.dc_resistivity"]})
    for odd in (False, True):
        generator = np.random.default_rng([SEED, int(odd)])
        low, called, right, banded = [], 0, 0, []
        for _ in range(strips):
            runs = [noisy(generator, signal) for signal in signals]
            if odd:
                runs[2] = noisy(generator, signals[2], strip=other)
            fit = ipmclab.leave_one_run_out(ipmclab.identify(FRIEND, runs))
            low.append([one.p_value < 0.05 for one in fit.left_out])
            banded.append([one.inside["current"] for one in fit.left_out])
            named = [finding.message for finding in fit.findings if finding.code == "run-stands-out"]
            called += bool(named)
            right += bool(named) and named[0].startswith(signals[2])
        yield (
            f"| 4 | {1 if odd else 0} | {strips} | {100.0 * np.mean(low):.1f} % | {100.0 * called / strips:.1f} % | "
            f"{100.0 * right / strips if odd else 0.0:.1f} % | {100.0 * np.mean(banded):.1f} % |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--strips", type=int, default=200)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/mountings.md")
    options = parser.parse_args()
    text = ""
    for title, part in (
        ("The interval alone", interval_alone(options.trials)),
        ("Runs left out", runs_left_out(options.strips)),
        ("From runs to the next mounting", whole_way(options.strips)),
    ):
        lines: list[str] = []
        for line in part:
            lines.append(line)
            page = text + f"## {title}\n\n" + "\n".join(lines)
            if options.record:  # an hour of work: each row as it is done
                finish("mountings", _TITLE, page, [], record=True, gate=False)
        text = page + "\n\n"
    finish("mountings", _TITLE, text, [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
