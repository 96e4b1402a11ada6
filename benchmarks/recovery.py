"""Whether the richer models are recovered from no start, with intervals that hold the truth.

Run ``python -m benchmarks.recovery [--trials 200] [--only NAME] [--record]``. Each trial draws the parameters of the
stage around usual ones (and the circuit, where it is fitted too, within a fifth of a decade of friend-2), simulates two
noisy records of 2,000 samples at 50 S/s, and identifies the strip from an actuator that has the stage at its usual
values. A parameter counts as inside where its 95 % interval holds the truth, and as named where it is called not
determined. The Cramer-Rao bound is that of each trial's own truth and noise, with every freed parameter and every zero
of a sensor unknown. Seed 20261121.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from ipmclab.model import Actuator
from ipmclab.model.variants import with_stages

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")

SEED = 20261121
SHARP = 0.4
"""What has a relative Cramer-Rao bound below this must be called determined."""
NOISE = {"current": 1e-4, "displacement": 2e-6, "force": 1e-5}


@dataclass(frozen=True)
class Case:
    """A model, what is drawn of it, and how it is recorded and identified.

    Parameters
    ----------
    stages : tuple of str
        What friend-2 gets.
    drawn : mapping of name to (lower, upper)
        Ranges of the truth [SI]: logarithmically uniform, uniform from 0.
    free : str
    keep : tuple of str
        Channels that are recorded.
    signals : tuple of str
    """

    stages: tuple[str, ...]
    drawn: Mapping[str, tuple[float, float]]
    free: str
    keep: tuple[str, ...] = ("current",)
    signals: tuple[str, ...] = ("step 2 V", "sine 2.5 V 0.1 Hz")


_MOTION = ("step 1 V", "square 1 V 0.03 Hz")
CASES: dict[str, Case] = {
    "three branches": Case(("branches=3",), {}, "electrical", signals=("step 1 V", "sine 1 V 0.1 Hz")),
    "leak, cubic": Case(
        ("leak.cubic",), {"leak.cubic.quadratic": (1.0, 8.0), "leak.cubic.cubic": (1.0, 8.0)}, "electrical,leak"
    ),
    "leak, exponential": Case(
        ("leak.exponential",),
        {
            "leak.exponential.current_density": (3.0, 20.0),
            "leak.exponential.threshold": (0.9, 1.3),
            "leak.exponential.voltage_scale": (0.2, 0.8),
        },
        "electrical,leak",
    ),
    "leak, Butler-Volmer": Case(
        ("leak.butler_volmer",),
        {
            "leak.butler_volmer.current_density": (3.0, 20.0),
            "leak.butler_volmer.threshold": (0.9, 1.3),
            "leak.butler_volmer.voltage_scale": (0.15, 0.5),
        },
        "electrical,leak",
    ),
    "leak, exponential and slow": Case(
        ("leak.exponential", "leak.slow"),
        {
            "leak.exponential.current_density": (3.0, 20.0),
            "leak.exponential.threshold": (0.9, 1.3),
            "leak.exponential.voltage_scale": (0.2, 0.8),
            "leak.slow.growth": (0.3, 2.0),
            "leak.slow.time_constant": (4.0, 20.0),
        },
        "electrical,leak",
    ),
    "leak below its threshold": Case(
        ("leak.exponential",), {}, "electrical,leak", signals=("step 1 V", "sine 1 V 0.1 Hz")
    ),
    "relaxation of the displacement": Case(
        ("relaxation.displacement",),
        {"relaxation.displacement.0.ratio": (0.2, 1.6), "relaxation.displacement.0.time_constant": (3.0, 30.0)},
        "coupling,relaxation",
        ("displacement",),
        _MOTION,
    ),
    "relaxation of both": Case(
        ("relaxation.displacement", "relaxation.force"),
        {
            "relaxation.displacement.0.ratio": (0.2, 1.6),
            "relaxation.displacement.0.time_constant": (3.0, 30.0),
            "relaxation.force.0.ratio": (0.2, 1.0),
            "relaxation.force.0.time_constant": (2.0, 20.0),
        },
        "coupling,relaxation",
        ("displacement", "force"),
        _MOTION,
    ),
    "relaxation in a pair": Case(
        ("relaxation.displacement_pair",),
        {
            "relaxation.displacement_pair.0.ratio": (0.2, 1.2),
            "relaxation.displacement_pair.0.lead": (0.5, 8.0),
            "relaxation.displacement_pair.0.time_constant": (3.0, 12.0),
            "relaxation.displacement_pair.0.damping_ratio": (0.6, 1.8),
        },
        "coupling,relaxation",
        ("displacement",),
        _MOTION,
    ),
    "viscoelastic modulus": Case(
        ("viscoelastic",),
        {
            "viscoelastic.0.amplitude": (0.15, 0.8),
            "viscoelastic.0.damping_ratio": (0.7, 3.0),
            "viscoelastic.0.frequency": (1.0, 8.0),
        },
        "viscoelastic,beam.modulus",
        ("force",),
        ("step 1 V", "square 1 V 0.3 Hz"),
    ),
    "clamped section": Case(
        ("clamp",), {"clamp.direct_share": (0.1, 0.9)}, "electrical,clamp", signals=("step 1 V", "sine 1 V 0.1 Hz")
    ),
    "line of 6 modes": Case(("line.modes=6",), {}, "electrical", signals=("step 1 V", "sine 1 V 0.1 Hz")),
    "line of 6 segments that leak": Case(
        ("line.segments=6", "leak.exponential"),
        {
            "leak.exponential.current_density": (3.0, 20.0),
            "leak.exponential.threshold": (0.9, 1.3),
            "leak.exponential.voltage_scale": (0.2, 0.8),
        },
        "electrical,leak",
    ),
}


@dataclass
class Tally:
    """What happened over the trials of one case."""

    trials: int = 0
    inside: int = 0
    counted: int = 0
    inside_determined: int = 0
    determined: int = 0
    at_floor: int = 0
    converged: int = 0
    falsely_sure: int = 0
    seconds: list[float] = field(default_factory=list)
    outside: dict[str, int] = field(default_factory=dict)
    sharp: dict[str, list[tuple[bool, float]]] = field(default_factory=dict)
    """Of each parameter, in the trials whose bound is below 40 %: whether it is called determined, and how wide its
    interval is over that of the bound."""

    @property
    def called_determined(self) -> dict[str, float]:
        """Share of those trials in which each parameter is."""
        return {name: float(np.mean([one for one, _ in found])) for name, found in self.sharp.items()}

    @property
    def widths(self) -> dict[str, float]:
        """Median width over the bound's."""
        return {name: float(np.median([width for _, width in found])) for name, found in self.sharp.items()}


def truth_of(case: Case, generator: np.random.Generator) -> Actuator:
    """A strip of this case."""
    strip = with_stages(ipmclab.load_actuator("friend-2"), *case.stages)
    changes = {}
    if "electrical" in case.free:
        names = [n for n in strip.parameter_values if n.startswith(("circuit.branches.", "circuit.dc_"))]
        changes = {name: strip[name] * 10.0 ** generator.uniform(-0.2, 0.2) for name in names}
    for name, (low, high) in case.drawn.items():
        uniform = name.endswith(("threshold", "share"))
        changes[name] = generator.uniform(low, high) if uniform else low * (high / low) ** generator.uniform()
    return strip.replace(**changes)


def records_of(case: Case, strip: Actuator, generator: np.random.Generator) -> list[Any]:
    """Its noisy records."""
    clean = (ipmclab.simulate(strip, signal, duration=40.0, rate=50.0) for signal in case.signals)
    return [noisy(run, case.keep, generator) for run in clean]


def noisy(clean: ipmclab.Run, keep: Sequence[str], generator: np.random.Generator) -> ipmclab.Run:
    """Some channels of a simulated run with white noise, as a measured run that begins at rest."""
    readings = {name: getattr(clean, name) + NOISE[name] * generator.standard_normal(len(clean)) for name in keep}
    rest = ipmclab.RunMetadata(starts_from_rest=True)
    return ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, metadata=rest, hold="zero", **readings)


def bounds(case: Case, strip: Actuator, fit: ipmclab.Fit) -> dict[str, float]:
    """Smallest relative standard error of each freed parameter, from central differences of the noise-free records.

    What a fit frees of a run, the zero of a sensor, is unknown here too. Infinite where nothing is told of a parameter.
    """
    names = [name for name in fit.parameters if name in strip.parameter_values]
    columns = [(_clean(case, strip, name, 1e-4) - _clean(case, strip, name, -1e-4)) / 2e-4 for name in names]
    rows = len(columns[0]) // (len(case.signals) * len(case.keep))
    for name in fit.parameters:
        if name in strip.parameter_values:
            continue
        assert name.startswith("observation.offset"), name
        kind, run = name.removeprefix("observation.offset.").rstrip("]").split("[")
        place = (int(run) * len(case.keep) + case.keep.index(kind)) * rows
        columns.append(np.where((np.arange(len(columns[0])) // rows) * rows == place, 1.0, 0.0))
    sizes = np.array([np.linalg.norm(column) for column in columns])
    seen = sizes > 0.0
    scaled = np.stack(columns, axis=1)[:, seen] / sizes[seen]
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    variance = np.full(len(columns), np.inf)
    variance[seen] = ((directions / np.maximum(singular, 1e-9)[:, None]) ** 2).sum(axis=0) / sizes[seen] ** 2
    return dict(zip(names, np.sqrt(variance), strict=False))


def _clean(case: Case, strip: Actuator, name: str, change: float) -> npt.NDArray[np.float64]:
    """Every reading over its noise, with one parameter changed by a share of itself: run by run, channel by channel."""
    changed = strip.replace(**{name: strip[name] * (1.0 + change)})
    told = []
    for signal in case.signals:
        run = ipmclab.simulate(changed, signal, duration=40.0, rate=50.0)
        told += [getattr(run, channel) / NOISE[channel] for channel in case.keep]
    return np.concatenate(told)


def recover(case: Case, trials: int, seed: Sequence[int] = (SEED,)) -> Tally:
    """Identify strips of one case, each from its own records."""
    tally = Tally()
    generator = np.random.default_rng(list(seed))
    known = with_stages(ipmclab.load_actuator("friend-2"), *case.stages)
    for _ in range(trials):
        strip = truth_of(case, generator)
        runs = records_of(case, strip, generator)
        begin = time.perf_counter()
        fit = ipmclab.identify(known, runs, free=case.free)
        tally.seconds.append(time.perf_counter() - begin)
        tally.trials += 1
        tally.converged += fit.converged
        power = sum(
            float(np.nansum((values / NOISE[output]) ** 2)) for run in fit.residuals for output, values in run.items()
        )
        readings = sum(len(values) for run in fit.residuals for values in run.values())
        bound = bounds(case, strip, fit)
        tally.at_floor += power < readings + 4.0 * np.sqrt(2.0 * readings)
        for name, parameter in fit.parameters.items():
            if name not in strip.parameter_values:
                continue  # a sensor's zero
            low, high = parameter.interval
            holds = bool(low <= strip[name] <= high)
            tally.counted += 1
            tally.inside += holds
            if bound[name] < SHARP:
                width = (high - low) / (2.0 * 1.96 * bound[name] * strip[name])
                tally.sharp.setdefault(name, []).append((parameter.determined, width))
            if parameter.determined:
                tally.determined += 1
                tally.inside_determined += holds
            if not holds:
                tally.outside[name] = tally.outside.get(name, 0) + 1
            if not case.drawn and name.startswith("leak."):
                tally.falsely_sure += parameter.determined
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--only", help="one case by its name")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/recovery.md")
    options = parser.parse_args()
    lines = [
        "| model | freed | at the noise floor | converged | truth inside, all | truth inside, determined | "
        "not determined, named | bound below 40 % | of these determined (least of one parameter) | "
        "median width / bound's | median time | longest |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, case in CASES.items():
        if options.only not in (None, name):
            continue
        tally = recover(case, options.trials)
        lines.append(
            f"| {name} | {case.free} | {tally.at_floor} of {tally.trials} | {tally.converged} of {tally.trials} | "
            f"{_part(tally.inside, tally.counted)} | {_part(tally.inside_determined, tally.determined)} | "
            f"{_part(tally.counted - tally.determined, tally.counted)} | "
            f"{_told_of_the_sharp(tally)} | {np.median(tally.seconds):.2f} s | "
            f"{max(tally.seconds):.1f} s |"
        )
        print(lines[-1], tally.outside, f"falsely sure {tally.falsely_sure}", flush=True)
        for parameter, share in tally.called_determined.items():
            width, trials = tally.widths[parameter], len(tally.sharp[parameter])
            print(f"    {parameter}: determined in {share:.1%} of {trials}, {width:.2f} times as wide", flush=True)
        if options.record:  # hours of work: each model as it is done
            finish("recovery", "Recovery of the richer models", "\n".join(lines), [], record=True, gate=False)
    finish("recovery", "Recovery of the richer models", "\n".join(lines), [], record=options.record, gate=False)


def _told_of_the_sharp(tally: Tally) -> str:
    shares, widths = tally.called_determined.values(), tally.widths.values()
    determined, counted = (sum(map(of, tally.sharp.values())) for of in (lambda found: sum(d for d, _ in found), len))
    if not counted:
        return "none | | "
    return (
        f"{_part(counted, tally.counted)} | {determined / counted:.1%} ({min(shares):.1%}) | "
        f"{min(widths):.2f} to {max(widths):.2f}"
    )


def _part(count: int, total: int) -> str:
    return f"{count} of {total} ({count / max(total, 1):.1%})"


if __name__ == "__main__":
    main()
