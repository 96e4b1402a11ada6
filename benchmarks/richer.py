"""Whether the intervals of the richer stages hold the truth, and are as narrow as they can be: Monte-Carlo coverage.

Run ``python -m benchmarks.richer [--trials 500] [--only NAME] [--record]``. Each case is one strip, friend-2 with a
further stage, seen in two records that begin with 5 s at 0 V and are long enough to show the stage; only the noise
(white) differs from trial to trial. The Cramer-Rao bound is that of all freed parameters together, by central
differences of the noise-free records. ``benchmarks.recovery`` draws the strips instead, some of which show little.
Seed 20261121.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from benchmarks.recovery import NOISE, noisy
from benchmarks.trust import Tally
from ipmclab.model import Actuator
from ipmclab.model.variants import with_stages

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "benchmarks/recovery.py",
)

SEED = 20261121
Array = npt.NDArray[np.float64]
_CHANGE = 1e-4
_ABOVE = ("step 2.5 V", "sine 3 V 0.1 Hz")


@dataclass(frozen=True)
class Case:
    """A strip, how it is recorded, and what is identified of it.

    Parameters
    ----------
    stages : tuple of str
        What friend-2 gets.
    truth : mapping of name to float [SI]
        What differs from the stage's usual values, from which the search begins.
    free : str
    keep : tuple of str
        Channels that are recorded.
    signals : tuple of str
    duration, rate : float
        [s], [Hz]
    """

    stages: tuple[str, ...]
    truth: Mapping[str, float]
    free: str
    keep: tuple[str, ...] = ("current",)
    signals: tuple[str, ...] = _ABOVE
    duration: float = 45.0
    rate: float = 50.0

    @cached_property
    def known(self) -> Actuator:
        """What the search begins with."""
        return with_stages(ipmclab.load_actuator("friend-2"), *self.stages)

    @cached_property
    def strip(self) -> Actuator:
        """The truth."""
        return self.known.replace(**self.truth)

    def clean(self, strip: Actuator) -> list[ipmclab.Run]:
        """Its records without noise."""
        delayed = (f"{signal} delay=5 s" for signal in self.signals)
        return [ipmclab.simulate(strip, signal, duration=self.duration, rate=self.rate) for signal in delayed]

    def jacobian(self, names: tuple[str, ...]) -> Array:
        """Derivatives of every reading over its noise, by the logarithms of some parameters."""

        def stacked(strip: Actuator) -> Array:
            runs = self.clean(strip)
            return np.concatenate([getattr(run, name) / NOISE[name] for run in runs for name in self.keep])

        columns = []
        for name in names:
            up, down = (self.strip.replace(**{name: self.strip[name] * (1.0 + side * _CHANGE)}) for side in (1.0, -1.0))
            columns.append((stacked(up) - stacked(down)) / (2.0 * _CHANGE))
        return np.stack(columns, axis=1)


_LEAK = {
    "leak.exponential.current_density": 8.0,
    "leak.exponential.threshold": 1.1,
    "leak.exponential.voltage_scale": 0.4,
}
_SLOW = {"relaxation.displacement.0.ratio": 0.6, "relaxation.displacement.0.time_constant": 9.0}
_MOTION = ("step 1 V", "square 1 V 0.03 Hz")
_ELECTRICAL = ("step 1 V", "sine 1 V 0.1 Hz")

CASES: dict[str, Case] = {
    "three branches": Case(("branches=3",), {}, "electrical", signals=_ELECTRICAL, duration=205.0, rate=20.0),
    "leak, cubic": Case(("leak.cubic",), {"leak.cubic.quadratic": 6.0, "leak.cubic.cubic": 6.0}, "electrical,leak"),
    "leak, exponential": Case(("leak.exponential",), _LEAK, "electrical,leak"),
    "leak, Butler-Volmer": Case(
        ("leak.butler_volmer",),
        {name.replace("exponential", "butler_volmer"): value for name, value in _LEAK.items()}
        | {"leak.butler_volmer.voltage_scale": 0.3},
        "electrical,leak",
    ),
    "leak, exponential and slow": Case(
        ("leak.exponential", "leak.slow"),
        {**_LEAK, "leak.slow.growth": 0.8, "leak.slow.time_constant": 9.0},
        "electrical,leak",
    ),
    "relaxation of the displacement": Case(
        ("relaxation.displacement",), _SLOW, "coupling,relaxation", ("displacement",), _MOTION
    ),
    "relaxation of both": Case(
        ("relaxation.displacement", "relaxation.force"),
        {**_SLOW, "relaxation.force.0.ratio": 0.4, "relaxation.force.0.time_constant": 6.0},
        "coupling,relaxation",
        ("displacement", "force"),
        _MOTION,
    ),
    "relaxation in a pair": Case(
        ("relaxation.displacement_pair",),
        {
            "relaxation.displacement_pair.0.ratio": 0.6,
            "relaxation.displacement_pair.0.lead": 2.0,
            "relaxation.displacement_pair.0.time_constant": 6.0,
            "relaxation.displacement_pair.0.damping_ratio": 1.1,
        },
        "coupling,relaxation",
        ("displacement",),
        _MOTION,
    ),
    "viscoelastic modulus": Case(
        ("viscoelastic",),
        {"viscoelastic.0.amplitude": 0.4, "viscoelastic.0.damping_ratio": 1.5, "viscoelastic.0.frequency": 3.0},
        "viscoelastic,beam.modulus",
        ("force",),
        ("step 1 V", "square 1 V 0.3 Hz"),
    ),
    "clamped section": Case(("clamp",), {"clamp.direct_share": 0.5}, "electrical,clamp", signals=_ELECTRICAL),
    "line of 6 modes": Case(("line.modes=6",), {}, "electrical", signals=_ELECTRICAL),
    "line of 6 segments that leak": Case(("line.segments=6", "leak.exponential"), _LEAK, "electrical,leak"),
}


def run_trials(name: str, trials: int, part: int = 0, identify: Callable[..., ipmclab.Fit] = ipmclab.identify) -> Tally:
    """Identify from noisy records, again and again; parts of a longer run have numbers of their own."""
    case = CASES[name]
    clean = case.clean(case.strip)
    generator = np.random.default_rng([SEED, 5, list(CASES).index(name), part])
    tally: Tally | None = None
    names: tuple[str, ...] = ()
    for _ in range(trials):
        runs = [noisy(run, case.keep, generator) for run in clean]
        begin = time.process_time()
        fit = identify(case.known, runs, free=case.free)
        spent = time.process_time() - begin
        if tally is None:
            names = tuple(one for one in fit.parameters if one in case.strip.parameter_values)
            jacobian = case.jacobian(names)
            size = np.linalg.norm(jacobian, axis=0)
            information = (jacobian / size).T @ (jacobian / size)
            tally = Tally(np.sqrt(np.linalg.inv(information).diagonal()) / size)
        found = [fit.parameters[one] for one in names]
        values = [case.strip[one] for one in names]
        tally.seconds += spent
        tally.inside.append([p.interval[0] <= value <= p.interval[1] for p, value in zip(found, values, strict=True)])
        tally.determined.append([p.determined for p in found])
        tally.width.append([(p.interval[1] - p.interval[0]) / value for p, value in zip(found, values, strict=True)])
    assert tally is not None
    return tally


_HEAD = (
    "| model | trials | 95 % interval holds the truth, determined: pooled (least to most of one parameter) | "
    "bound below 40 % | of these determined, least | median width / bound's | processor time | |\n"
    "|---|---|---|---|---|---|---|---|"
)


def row(name: str, tally: Tally) -> str:
    """A line of the table."""
    inside, determined = np.array(tally.inside), np.array(tally.determined)
    covered, widths = tally.covered, tally.widths
    return (
        f"| {name} | {len(inside)} | {100.0 * inside[determined].mean():.1f} "
        f"({np.nanmin(covered):.1f} to {np.nanmax(covered):.1f}) | {int(tally.sharp.sum())} of {len(tally.sharp)} | "
        f"{tally.called_determined.min():.1f} | {widths.min():.2f} to {widths.max():.2f} | "
        f"{tally.seconds / len(inside):.2f} s | {'; '.join(tally.misses('white')) or 'holds'} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--only", default=";".join(CASES), help="some cases by their names, with semicolons between")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/richer.md")
    options = parser.parse_args()
    lines = [_HEAD]
    for name in options.only.split(";"):
        lines.append(row(name, run_trials(name, options.trials)))
        print(lines[-1], flush=True)
    finish("richer", "Intervals of the richer stages", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
