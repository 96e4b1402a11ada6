"""Whether a fit names the stage that it lacks, and none where only noise is left.

Run ``python -m benchmarks.diagnostics [--trials 3] [--noises 60] [--only NAME] [--record]``. Each trial of a stage
draws its size within a factor of 1.5 of a usual one, simulates two noisy records of 40 s at 50 S/s of friend-2 with the
stage, and identifies friend-2 without it. Each trial of a noise identifies the circuit of friend-2 from records with
that noise. Seed 20261121.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

import ipmclab
from benchmarks.harness import finish
from ipmclab.model.variants import with_stages

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")

SEED = 20261121
NOISE = {"current": 1e-4, "displacement": 2e-6, "force": 1e-5}
_LOW = ("step 1 V delay=1 s", "sine 1 V 0.1 Hz")
_HIGH = ("step 2 V delay=1 s", "sine 2.5 V 0.1 Hz")
_ALL = ("current", "displacement", "force")


@dataclass(frozen=True)
class Case:
    """A stage that the strip has and the model lacks.

    Parameters
    ----------
    stage : str
    values : mapping of name to float [SI]
        Usual ones of what is drawn.
    free : str
    keep : tuple of str
    signals : tuple of str
    """

    stage: str
    values: Mapping[str, float] = field(default_factory=dict)
    free: str = "electrical"
    keep: tuple[str, ...] = ("current",)
    signals: tuple[str, ...] = _LOW


CASES = (
    Case("leak.exponential", {"leak.exponential.current_density": 10.0}, signals=_HIGH),
    Case("leak.cubic", {"leak.cubic.cubic": 5.0}, signals=_HIGH),
    Case("branches=3", {"circuit.branches.2.resistivity": 30.0, "circuit.branches.2.permittivity": 0.02}),
    Case("clamp", {"clamp.direct_share": 0.5}),
    Case("line.modes"),
    Case("relaxation.displacement", {"relaxation.displacement.0.ratio": 0.5}, "electrical,coupling", _ALL),
    Case("relaxation.force", {"relaxation.force.0.ratio": 0.5}, "electrical,coupling", _ALL),
    Case("viscoelastic", {"viscoelastic.0.amplitude": 0.3}, "electrical,coupling", _ALL),
)


def lacking(case: Case, trials: int) -> list[str]:
    """The row of a stage."""
    generator = np.random.default_rng(SEED)
    base = ipmclab.load_actuator("friend-2")
    named: Counter[str] = Counter()
    first = among = 0
    begin = time.process_time()
    for _ in range(trials):
        drawn = {name: value * 1.5 ** generator.uniform(-1.0, 1.0) for name, value in case.values.items()}
        strip = with_stages(base, case.stage).replace(**drawn)
        runs = []
        for signal in case.signals:
            run = ipmclab.simulate(strip, signal, duration=40.0, rate=50.0)
            read: dict[str, Any] = {
                n: run.channels[n] + NOISE[n] * generator.standard_normal(len(run)) for n in case.keep
            }
            runs.append(ipmclab.Run.from_arrays(time=run.time, voltage=run.voltage, **read))
        fit = ipmclab.identify(base, runs, free=case.free)
        said = [finding for finding in fit.findings if finding.code == "stage-missing"]
        one = str(said[0].values["stage"]) if said else "none"
        named[one] += 1
        first += one == case.stage
        among += bool(said) and f"+{case.stage}" in said[0].repair
    each = (time.process_time() - begin) / trials
    listed = ", ".join(f"{name} {count}" for name, count in named.most_common())
    return [case.stage, str(trials), f"{first} of {trials}", f"{among} of {trials}", listed, f"{each:.1f} s"]


def noise_of(kind: str, count: int, generator: np.random.Generator) -> Any:
    """Noise of the current [A]."""
    new = generator.standard_normal(count)
    other = generator.standard_normal(count)
    shapes = {
        "white": new,
        "AR(1) 0.9": lfilter([1.0], [1.0, -0.9], np.concatenate([np.zeros(100), new]))[100:],
        "random walk": new + 0.1 * np.cumsum(other),
        "linear drift": new + 6.0 * other[0] * np.linspace(-1.0, 1.0, count),
    }
    return NOISE["current"] * shapes[kind]


def only_noise(kind: str, trials: int) -> list[str]:
    """The row of a noise."""
    generator = np.random.default_rng(SEED)
    base = ipmclab.load_actuator("friend-2")
    clean = [ipmclab.simulate(base, signal, duration=40.0, rate=50.0) for signal in _LOW]
    follow = wrong = outputs = 0
    for _ in range(trials):
        runs = []
        for run in clean:
            assert run.current is not None
            current = run.current + noise_of(kind, len(run), generator)
            runs.append(ipmclab.Run.from_arrays(time=run.time, voltage=run.voltage, current=current))
        fit = ipmclab.identify(base, runs)
        outputs += len(fit.diagnoses)
        follow += sum(one.verdict in ("follows the voltage", "bends with the voltage") for one in fit.diagnoses)
        wrong += any(finding.code == "stage-missing" for finding in fit.findings)
    return [kind, str(trials), f"{follow} of {outputs}", f"{wrong} of {trials}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--noises", type=int, default=60)
    parser.add_argument("--only", help="one stage or noise by its name")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/diagnostics.md")
    options = parser.parse_args()
    lines = [
        "| missing stage | trials | named first | named, perhaps beside others | first, how often | processor time |",
        "|---|---|---|---|---|---|",
    ]
    for case in CASES:
        if options.only in (None, case.stage):
            lines.append("| " + " | ".join(lacking(case, options.trials)) + " |")
            print(lines[-1], flush=True)
    lines += ["", "| only noise | trials | outputs said to follow the voltage | a stage named |", "|---|---|---|---|"]
    for kind in ("white", "AR(1) 0.9", "random walk", "linear drift"):
        if options.only in (None, kind):
            lines.append("| " + " | ".join(only_noise(kind, options.noises)) + " |")
            print(lines[-1], flush=True)
    finish("diagnostics", "The stage that is missing", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
