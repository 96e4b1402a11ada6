"""Whether ``choose`` finds the model that made the data, over many noises.

Run ``python -m benchmarks.choice [--trials 60] [--only WORD] [--record]``. Each trial simulates one candidate, adds
noise, and lets ``choose`` rank all of them. White noise, and autocorrelated noise (white noise and an
Ornstein-Uhlenbeck process of three times its size that lasts 3 s). Beside it, what the criterion of
thousands of independent rows would pick (AIC with white residuals, in sample). Seed 20261121.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from ipmclab.choosing.choice import Choice

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "src/ipmclab/choosing",
)

SEED, RATE = 20261121, 25.0
WHITE = {"current": 1e-4, "displacement": 5e-6, "force": 2e-6}
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """What makes the data, and what is compared."""

    name: str
    truth: str
    models: tuple[str, ...]
    signals: tuple[str, ...] = ("step 1 V delay=1 s",)
    correlated: bool = False
    channels: tuple[str, ...] = ("current",)
    free: str = ""
    duration: float = 40.0
    share: float = 1.0  # of the trials
    change: tuple[tuple[str, float], ...] = ()


BRANCHES = ("branches=1", "branches=2", "branches=3")
MIXED = ("step 1 V", "square 1 V 0.1 Hz", "sine 1 V 0.3 Hz")
THREE = (("circuit.branches.2.resistivity", 120.0), ("circuit.branches.2.permittivity", 1.2))
SLOW = (("relaxation.displacement.0.ratio", 0.6), ("relaxation.displacement.0.time_constant", 6.0))
CASES = (
    Case("1 of 2 branches, white", "branches=1", BRANCHES[:2]),
    Case("1 of 2 branches, correlated", "branches=1", BRANCHES[:2], correlated=True),
    Case("2 of 3 branches, white", "branches=2", BRANCHES),
    Case("2 of 3 branches, correlated", "branches=2", BRANCHES, correlated=True),
    Case("2 of 3 branches, white, 3 runs", "branches=2", BRANCHES, signals=MIXED, share=0.5),
    Case("2 of 3 branches, correlated, 3 runs", "branches=2", BRANCHES, signals=MIXED, correlated=True, share=0.5),
    Case("3 of 4 branches, white", "branches=3", (*BRANCHES, "branches=4"), change=THREE, share=0.4),
    Case(
        "3 of 4 branches, correlated", "branches=3", (*BRANCHES, "branches=4"), correlated=True, change=THREE, share=0.4
    ),
    Case(
        "one slow mode of 0 or 1 (displacement), white",
        "relaxation.displacement",
        ("friend-2", "relaxation.displacement"),
        channels=("displacement",),
        free="coupling,relaxation",
        duration=20.0,
        share=0.4,
        change=SLOW,
    ),
)


@dataclass
class Tally:
    """What happened over the trials of one case."""

    trials: int = 0
    picked: int = 0
    alike: int = 0
    ruled_out: int = 0
    bigger: int = 0
    naive: int = 0
    bic: int = 0
    seconds: float = 0.0
    ratios: list[float] = field(default_factory=list)


def noise(generator: np.random.Generator, rows: int, size: float, *, correlated: bool) -> Array:
    """White noise, with a slow part where asked."""
    white = size * generator.standard_normal(rows)
    if not correlated:
        return white
    decay = math.exp(-1.0 / (RATE * 3.0))
    slow = np.empty(rows)
    slow[0] = generator.standard_normal()
    for row, step in enumerate(generator.standard_normal(rows - 1) * math.sqrt(1.0 - decay**2), start=1):
        slow[row] = decay * slow[row - 1] + step
    return white + 3.0 * size * slow


def records(case: Case, generator: np.random.Generator) -> list[ipmclab.Run]:
    """The case's runs with fresh noise."""
    truth = ipmclab.load_actuator(f"friend-2+{case.truth}").replace(**dict(case.change))
    runs = []
    for signal in case.signals:
        clean = ipmclab.simulate(truth, signal, duration=case.duration, rate=RATE)
        runs.append(
            ipmclab.Run.from_arrays(
                time=clean.time,
                voltage=clean.voltage,
                metadata=ipmclab.RunMetadata(starts_from_rest=True, signal=signal),
                **{
                    name: clean.channels[name] + noise(generator, len(clean), WHITE[name], correlated=case.correlated)
                    for name in case.channels
                },
            )
        )
    return runs


def white_criterion(choice: Choice) -> str:
    """What AIC picks if every reading counts as independent."""

    def criterion(name: str) -> float:
        fit = choice[name].fit
        assert fit is not None
        misfit = 0.0
        for output in choice.outputs:
            left = np.concatenate([of_run[output] for of_run in fit.residuals if output in of_run])
            left = left[np.isfinite(left)]
            misfit += len(left) * math.log(float(np.mean(left**2)))
        return misfit + 2.0 * len(fit.parameters)

    return min((one.name for one in choice.ranked), key=criterion)


def run_trials(case: Case, trials: int) -> Tally:
    """Choose once for each noise."""
    tally = Tally()
    for trial in range(trials):
        runs = records(case, np.random.default_rng([SEED, trial]))
        begin = time.process_time()
        choice = ipmclab.choose(runs, case.models, actuator="friend-2", free=case.free)
        tally.seconds += time.process_time() - begin
        tally.trials += 1
        against = choice.to_best(case.truth)
        told = against is not None and against.is_distinguished
        tally.picked += choice.preferred == case.truth
        tally.ruled_out += told
        tally.alike += choice.preferred != case.truth and not told
        tally.bigger += choice[choice.preferred].parameters > choice[case.truth].parameters
        tally.naive += white_criterion(choice) == case.truth
        tally.bic += min(choice.ranked, key=lambda one: one.bic or math.inf).name == case.truth
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--only", default="", help="cases whose name has this in it")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/choice.md")
    options = parser.parse_args()
    lines = [
        "| made by, noise | picked | cannot tell, another preferred | ruled out | a larger one preferred | "
        "BIC (correlated) picks it | AIC of white residuals picks it | time of a choice |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        if options.only not in case.name:
            continue
        tally = run_trials(case, max(1, round(case.share * options.trials)))
        parts = (tally.picked, tally.alike, tally.ruled_out, tally.bigger, tally.bic, tally.naive)
        lines.append(
            f"| {case.name} | {' | '.join(f'{part} of {tally.trials}' for part in parts)} | "
            f"{tally.seconds / tally.trials:.1f} s |"
        )
        print(lines[-1], flush=True)
    finish("choice", "Choosing between models", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
