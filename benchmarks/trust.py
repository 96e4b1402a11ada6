"""Whether the intervals of a fit hold the truth under noise that is not white: Monte-Carlo coverage.

Run ``python -m benchmarks.trust [--trials 400] [--noises walk,drift] [--cases circuit] [--record]``. Two problems of
the linear model, each with a 1 V step and a 1 V sine that begin with 5 s at 0 V: the five electrical parameters of
friend-2 from the current, its sheet resistance known; and the four of its coupling from the force, its circuit known.
Four noises of equal strength: white; AR(1) with a pole of 0.9; white with a straight drift of 3 standard deviations
over the record, up or down; white with a random walk that strays as far. Trials are simulated by the thesis's
equations (``tests/independent``), the Cramer-Rao bound comes from dense covariance matrices of the true noise, in the
case of the drift with its offset and slope unknown. The naive interval is that of ordinary least squares about the
truth, whose errors count the residuals as white. Seed 20261121.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.signal

import ipmclab
from benchmarks.harness import finish
from tests.independent.bounds import ELECTRICAL, log_parameters_of, strip_of
from tests.independent.thesis import FRIEND_2, Strip, respond

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")

SEED = 20261121
Array = npt.NDArray[np.float64]
COUPLING = ("coupling.gain", "coupling.zero", "coupling.p1", "coupling.p2")
NOISES = ("white", "AR(1) 0.9", "linear drift", "random walk")
WIDEST = dict(zip(NOISES, (1.3, 3.0, 1.3, 3.0), strict=True))
"""Width of an interval over the bound's: least squares is not the sharpest estimate under autocorrelated noise."""
POLE, STRAYS = 0.9, 3.0


def _coupled(log_parameters: Array) -> Strip:
    gain, zero, p1, p2 = np.exp(log_parameters)
    return FRIEND_2.changed(gain=gain, zero=zero, p1=p1, p2=p2)


@dataclass(frozen=True)
class Case:
    """What is free, seen where, at what rate and with how much noise [SI]."""

    free: str
    names: tuple[str, ...]
    output: str
    rate: float
    rows: int
    noise: float
    truth: Array
    strip: Callable[[Array], Strip]

    @property
    def time(self) -> Array:
        return np.arange(self.rows) / self.rate

    @property
    def voltages(self) -> list[Array]:
        on = self.time >= 5.0
        frequency = 4.0 / (self.time[-1] - 5.0)
        return [np.where(on, 1.0, 0.0), np.where(on, np.sin(2.0 * np.pi * frequency * (self.time - 5.0)), 0.0)]

    def clean(self, log_parameters: Array) -> list[Array]:
        strip = self.strip(log_parameters)
        return [respond(strip, voltage, self.rate, "zero")[self.output] for voltage in self.voltages]

    @cached_property
    def jacobians(self) -> list[Array]:
        """Derivatives by the logarithms of the parameters, over the noise, by central differences."""
        columns = []
        for step in 1e-5 * np.eye(len(self.truth)):
            sides = zip(self.clean(self.truth + step), self.clean(self.truth - step), strict=True)
            columns.append([(up - down) / (2e-5 * self.noise) for up, down in sides])
        return [np.stack(of_run, axis=1) for of_run in zip(*columns, strict=True)]


CASES = {
    "circuit": Case("electrical", ELECTRICAL, "current", 50.0, 2000, 1e-4, log_parameters_of(FRIEND_2), strip_of),
    "coupling": Case(
        "coupling",
        COUPLING,
        "force",
        200.0,
        3000,
        5e-7,
        np.log([FRIEND_2.gain, FRIEND_2.zero, FRIEND_2.p1, FRIEND_2.p2]),
        _coupled,
    ),
}


def draw(noise: str, rows: int, generator: np.random.Generator) -> Array:
    """Noise of unit strength."""
    white = generator.standard_normal(rows)
    if noise == "AR(1) 0.9":
        driven = np.sqrt(1.0 - POLE**2) * white
        driven[0] = white[0]
        return np.asarray(scipy.signal.lfilter([1.0], [1.0, -POLE], driven))
    if noise == "linear drift":
        return white + generator.choice([-1.0, 1.0]) * STRAYS * np.arange(rows) / (rows - 1)
    if noise == "random walk":
        return white + np.cumsum(generator.standard_normal(rows)) * STRAYS / np.sqrt(rows)
    return white


def bounds(noise: str, jacobians: list[Array]) -> Array:
    """Smallest standard error of each logarithm under the true noise, from dense matrices."""
    information = np.zeros((jacobians[0].shape[1],) * 2)
    for jacobian in jacobians:
        rows = np.arange(len(jacobian))
        white = jacobian
        if noise == "AR(1) 0.9":
            white = scipy.linalg.solve_toeplitz(POLE**rows, jacobian)
        elif noise == "linear drift":
            basis = np.linalg.qr(np.column_stack([np.ones(len(rows)), rows / len(rows)]))[0]
            white = jacobian - basis @ (basis.T @ jacobian)
        elif noise == "random walk":
            covariance = np.eye(len(rows)) + STRAYS**2 / len(rows) * (1.0 + np.minimum(rows[:, None], rows))
            white = scipy.linalg.solve(covariance, jacobian, assume_a="pos")
        information += jacobian.T @ white
    return np.asarray(np.sqrt(np.linalg.inv(information).diagonal()))


@dataclass
class Tally:
    """What happened over the trials of one noise; a row for each trial, a column for each parameter."""

    bound: Array
    inside: list[list[bool]] = field(default_factory=list)
    determined: list[list[bool]] = field(default_factory=list)
    width: list[list[float]] = field(default_factory=list)
    naive: list[list[bool]] = field(default_factory=list)
    seconds: float = 0.0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.bound,
            self.inside + other.inside,
            self.determined + other.determined,
            self.width + other.width,
            self.naive + other.naive,
            self.seconds + other.seconds,
        )

    @property
    def sharp(self) -> npt.NDArray[np.bool_]:
        """Parameters whose bound is below 40 %."""
        return np.asarray(self.bound < 0.4)

    @property
    def covered(self) -> Array:
        """Per cent of trials in which an interval holds the truth, of those in which it is called determined; NaN for
        a parameter that is so in less than half of them."""
        inside, determined = np.array(self.inside), np.array(self.determined)
        counts = determined.sum(axis=0)
        held = (inside & determined).sum(axis=0) / np.maximum(counts, 1)
        return np.where(counts > 0.5 * len(inside), 100.0 * held, np.nan)

    @property
    def called_determined(self) -> Array:
        """Per cent of trials in which each sharp parameter is."""
        return np.asarray(100.0 * np.array(self.determined)[:, self.sharp].mean(axis=0))

    @property
    def widths(self) -> Array:
        """Median width of each sharp parameter's interval, over that of its bound."""
        median = np.median(np.array(self.width), axis=0)
        return np.asarray(median[self.sharp] / (2.0 * 1.96 * self.bound[self.sharp]))

    @property
    def naively_covered(self) -> Array:
        """Per cent of trials in which a naive interval holds the truth."""
        return np.asarray(100.0 * np.array(self.naive).mean(axis=0))

    def misses(self, noise: str, least: float = 92.0, most: float = 98.0) -> list[str]:
        """What does not hold: coverage between two bounds [%], sharp parameters determined, widths near the bound."""
        found = []
        if not least <= np.nanmin(self.covered) <= np.nanmax(self.covered) <= most:
            found.append(f"covers {self.covered.round(1).tolist()} %")
        if self.called_determined.min() < 95.0:
            found.append(f"determined in {self.called_determined.round(1).tolist()} %")
        if self.widths.max() > WIDEST[noise]:
            found.append(f"{self.widths.round(2).tolist()} times as wide as the bound")
        return found

    def row(self, case: str, noise: str) -> str:
        """A line of the table."""
        inside, determined = np.array(self.inside), np.array(self.determined)
        covered, naive = self.covered, self.naively_covered
        return (
            f"| {case} | {noise} | {len(inside)} | {100.0 * inside[determined].mean():.1f} "
            f"({np.nanmin(covered):.1f} to {np.nanmax(covered):.1f}) | {int(self.sharp.sum())} of {len(self.sharp)} | "
            f"{self.called_determined.min():.1f} | {self.widths.min():.2f} to {self.widths.max():.2f} | "
            f"{naive.mean():.1f} ({naive.min():.1f} to {naive.max():.1f}) | "
            f"{1e3 * self.seconds / len(inside):.0f} ms | {'misses' if self.misses(noise) else 'holds'} |"
        )


_TITLE = "Intervals under noise that is not white"

HEAD = (
    "| problem | noise | trials | 95 % interval holds the truth, determined: pooled (least to most of one parameter) | "
    "bound below 40 % | of these determined, least | median width / bound's | naive interval | processor time | |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def run_trials(
    name: str, noise: str, trials: int, part: int = 0, identify: Callable[..., ipmclab.Fit] = ipmclab.identify
) -> Tally:
    """Identify from noisy records, again and again; parts of a longer run have numbers of their own."""
    case = CASES[name]
    library = ipmclab.load_actuator("friend-2")
    rest = ipmclab.RunMetadata(starts_from_rest=True)
    jacobians, clean = case.jacobians, case.clean(case.truth)
    tally = Tally(bounds(noise, jacobians))
    stacked = np.concatenate(jacobians)
    inverse = np.linalg.inv(stacked.T @ stacked)
    generator = np.random.default_rng([SEED, NOISES.index(noise), list(CASES).index(name), *([part] if part else [])])
    truth = np.exp(case.truth)
    for _ in range(trials):
        noises = [draw(noise, case.rows, generator) for _ in clean]
        runs = [
            ipmclab.Run.from_arrays(
                time=case.time,
                voltage=voltage,
                hold="zero",
                metadata=rest,
                **{case.output: response + case.noise * added},
            )
            for voltage, response, added in zip(case.voltages, clean, noises, strict=True)
        ]
        begin = time.process_time()
        fit = identify(library, runs, free=case.free)
        tally.seconds += time.process_time() - begin
        found = [fit.parameters[name] for name in case.names]
        tally.inside.append(
            [one.interval[0] <= value <= one.interval[1] for one, value in zip(found, truth, strict=True)]
        )
        tally.determined.append([one.determined for one in found])
        tally.width.append(
            [(one.interval[1] - one.interval[0]) / value for one, value in zip(found, truth, strict=True)]
        )
        added = np.concatenate(noises)
        missed = inverse @ (stacked.T @ added)
        left = added - stacked @ missed
        error = np.sqrt(inverse.diagonal() * (left @ left) / (len(left) - len(missed)))
        tally.naive.append((np.abs(missed) < 1.96 * error).tolist())
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--noises", default=",".join(NOISES))
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/trust.md")
    options = parser.parse_args()
    lines = [HEAD]
    for case in options.cases.split(","):
        for noise in options.noises.split(","):
            lines.append(run_trials(case, noise, options.trials).row(case, noise))
            print(lines[-1], flush=True)
            if options.record:  # hours of work: each row as it is done
                finish("trust", _TITLE, "\n".join(lines), [], record=True, gate=False)
    finish("trust", _TITLE, "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
