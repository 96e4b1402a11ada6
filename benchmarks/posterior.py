"""Whether the posterior holds the truth as often as it says, wherever the truth was drawn from the prior.

Run ``python -m benchmarks.posterior [--trials 100] [--record]``. Simulation-based calibration (Talts et al. 2018): each
trial draws the five electrical parameters of a strip from their log-normal priors (15 % about friend-2), simulates 5 s
at 0 V and a square wave of 1 V and 0.1 Hz for 20 s at 20 S/s by an independent route, adds noise, and samples the
posterior of a fit with those priors. The rank of the truth among the samples is then as likely to be anywhere: its
distribution is held against the uniform one (Kolmogorov and Smirnov), and the 50 and 95 % intervals against their
names. Two noises: white, and an autoregression of 0.9 about an unknown offset. Seed 20261121.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter
from scipy.stats import kstest

import ipmclab
from benchmarks.harness import finish
from tests.independent.bounds import ELECTRICAL, log_parameters_of, noisy_current, strip_of
from tests.independent.thesis import FRIEND_2

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "src/ipmclab/posterior",
)

SEED, RATE, NOISE, SPREAD, REST = 20261121, 20.0, 3e-4, 0.15, 5.0
Array = npt.NDArray[np.float64]

NOISES: Final = {"white": 0.0, "AR(1) 0.9, offset": 0.9}


@dataclass
class Tally:
    """What happened over the trials under one noise."""

    refused: int = 0
    seconds: float = 0.0
    ranks: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in ELECTRICAL})
    widths: list[float] = field(default_factory=list)

    def row(self, label: str) -> str:
        ranks = np.array([self.ranks[name] for name in ELECTRICAL])
        worst = min(float(kstest(one, "uniform").pvalue) for one in ranks)
        half, most = (float(np.mean(np.abs(ranks - 0.5) < 0.5 * part)) for part in (0.5, 0.95))
        count = ranks.shape[1]
        return (
            f"| {label} | {count} | {self.refused} | {worst:.2f} | {half:.1%} | {most:.1%} | "
            f"{np.median(self.widths):.2f} | {self.seconds / max(count + self.refused, 1):.1f} s |"
        )


def run_trials(noise: float, trials: int) -> Tally:
    """Sample the posterior of each strip from its own noisy record."""
    tally = Tally()
    generator = np.random.default_rng([SEED, int(100 * noise)])
    library = ipmclab.load_actuator("friend-2")
    centre = log_parameters_of(FRIEND_2)
    known = replace(library, standard_uncertainties={name: SPREAD * library[name] for name in ELECTRICAL})
    times = np.arange(int((REST + 20.0) * RATE)) / RATE
    voltage = np.where(times < REST, 0.0, np.where((times - REST) % 10.0 < 5.0, 1.0, -1.0))
    rest = ipmclab.RunMetadata(starts_from_rest=True)
    for _ in range(trials):
        strip = strip_of(centre + SPREAD * generator.standard_normal(len(centre)))
        clean = noisy_current(strip, voltage, RATE, 0.0, generator)
        if noise:
            new = NOISE * (1.0 - noise**2) ** 0.5 * generator.standard_normal(len(times) + 200)
            error = lfilter([1.0], [1.0, -noise], new)[200:] + 1e-3 * generator.standard_normal()
        else:
            error = NOISE * generator.standard_normal(len(times))
        run = ipmclab.Run.from_arrays(time=times, voltage=voltage, current=clean + error, hold="zero", metadata=rest)
        begin = time.process_time()
        fit = ipmclab.identify(known, [run], free="electrical", prior="electrical")
        try:
            posterior = ipmclab.sample_posterior(fit)
        except ipmclab.IpmclabError:
            tally.refused += 1
            continue
        finally:
            tally.seconds += time.process_time() - begin
        truth = strip.dotted()
        for name in ELECTRICAL:
            tally.ranks[name].append(float(np.mean(posterior.samples[name] < truth[name])))
            one, fitted = posterior.parameters[name], fit.parameters[name]
            tally.widths.append((one.interval[1] - one.interval[0]) / (fitted.interval[1] - fitted.interval[0]))
        print(tally.row(f"so far, {noise:g}"), file=sys.stderr, flush=True)
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/posterior.md")
    options = parser.parse_args()
    lines = [
        "| noise | trials | refused | least p of the ranks, of five parameters | truth inside 50 % | inside 95 % | "
        "median width / that of the fit's interval | processor time of a trial |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [run_trials(noise, options.trials).row(label) for label, noise in NOISES.items()]
    finish("posterior", "Calibration of the posterior", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
