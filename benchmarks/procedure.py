"""Whether each step of the procedure finds the truth within its stated uncertainty.

Run ``python -m benchmarks.procedure [--trials 1000] [--coupling 200] [--joint 40] [--record]``. In each trial the
dimensions, the spacing of the contacts, the mass, and the scale of the push are read with normal errors of their stated
standard uncertainties; the meter's offset lies anywhere within its limit of 0.05 ohm; meter, push and runs have
noise. The strip is friend-2; runs begin with 5 s at 0 V, at 50 S/s: a step of 80 s and four periods of 0.1 Hz. The
coupling and the joint fit take longer, so fewer trials have them. Seed 20261121.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from benchmarks.harness import finish
from ipmclab import Run, RunMetadata, follow_procedure, load_actuator, simulate
from ipmclab.measurement.push import Push
from ipmclab.measurement.uncertain import Uncertain, mean_of
from ipmclab.model import Actuator
from ipmclab.procedure.four_probe import FourProbes
from ipmclab.procedure.procedure import Procedure

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "src/ipmclab/procedure",
)

SEED = 20261121
ERRORS = {
    "free_length": 0.2e-3,
    "clamped_length": 0.2e-3,
    "width": 0.05e-3,
    "thickness": 3e-6,
    "sensing_length": 0.2e-3,
}
"""Standard uncertainties of the dimensions [m]."""

SPACING, SPACING_ERROR = 10e-3, 0.05e-3
OFFSET = 0.05  # ohm, limit
METER = 1.2e-3  # ohm, of a reading
MASS = 0.5e-6  # kg
SCALE = 0.01  # of the push
NOISE = {"current": 3e-5, "force": 1e-4}  # A, N
PUSH = 2e-5  # N, of a reading of the push

STEP, SINE = ("step 1 V delay=5 s", 85.0), ("sine 1 V 0.1 Hz delay=5 s", 45.0)


@dataclass(frozen=True, eq=False)
class VirtualStrip:
    """A strip that is measured again and again.

    Parameters
    ----------
    truth : Actuator
    rate : float [Hz]
    noise : mapping of channel to float [SI]
    """

    truth: Actuator
    rate: float = 50.0
    noise: Mapping[str, float] = field(default_factory=lambda: dict(NOISE))
    signals: tuple[tuple[str, float], ...] = (STEP, SINE)

    def __post_init__(self) -> None:
        clean = [simulate(self.truth, text, duration=length, rate=self.rate) for text, length in self.signals]
        object.__setattr__(self, "clean", clean)

    def run(self, number: int, channels: tuple[str, ...], rng: np.random.Generator) -> Run:
        """One of the signals, recorded with noise."""
        clean: Run = self.clean[number]  # type: ignore[attr-defined]
        read = {
            channel: clean.channels[channel] + self.noise[channel] * rng.standard_normal(len(clean))
            for channel in channels
        }
        about = RunMetadata(signal=self.signals[number][0], starts_from_rest=True)
        return Run.from_arrays(
            time=clean.time,
            voltage=clean.voltage,
            hold=clean.hold,
            metadata=about,
            current=read["current"],
            force=read.get("force"),
        )

    def procedure(self, rng: np.random.Generator) -> Procedure:
        """Everything measured once."""
        truth = self.truth
        lengths = {
            f"geometry.{key}": Uncertain(
                truth[f"geometry.{key}"] + error * float(rng.standard_normal()), {key.replace("_", " "): error}
            )
            for key, error in ERRORS.items()
        }
        width, thickness = truth["geometry.width"], truth["geometry.thickness"]
        length = truth["geometry.free_length"] + truth["geometry.clamped_length"]
        read = truth["circuit.sheet_resistance"] * SPACING / width + rng.uniform(-OFFSET, OFFSET)
        probes = FourProbes(
            "line",
            mean_of(list(read + METER * rng.standard_normal(20)), "scatter of the readings of the meter"),
            Uncertain(SPACING + SPACING_ERROR * float(rng.standard_normal()), {"spacing": SPACING_ERROR}),
            OFFSET,
        )
        mass = truth["beam.density"] * length * width * thickness + MASS * float(rng.standard_normal())
        stiffness = truth["beam.modulus"] * width * thickness**3 / (4.0 * truth["geometry.sensing_length"] ** 3)
        travel = np.concatenate([np.linspace(0.0, 0.5e-3, 11), np.linspace(0.5e-3, 0.0, 11)])
        force = stiffness * travel * (1.0 + SCALE * rng.standard_normal()) + PUSH * rng.standard_normal(22)
        step, sine = (self.run(number, ("current",), rng) for number in (0, 1))
        pressed = [self.run(number, ("current", "force"), rng) for number in (0, 1)]
        return Procedure(
            "virtual",
            lengths,
            sheet_resistance=probes,
            dc_resistance=(("step", step),),
            branches=(("step", step), ("sine", sine)),
            mass=Uncertain(mass, {"mass": MASS}),
            modulus=Push(travel, force, SCALE),
            coupling=(("force-step", pressed[0]), ("force-sine", pressed[1])),
        )


@dataclass
class Tally:
    """Of one number: how often its interval held the truth, how far it was off, how well it was known."""

    inside: list[bool] = field(default_factory=list)
    off: list[float] = field(default_factory=list)
    relative: list[float] = field(default_factory=list)

    def add(self, value: float, uncertainty: float, interval: tuple[float, float], truth: float) -> None:
        """Count one trial."""
        self.inside.append(interval[0] <= truth <= interval[1])
        self.off.append((value - truth) / uncertainty)
        self.relative.append(uncertainty / value)

    def row(self, name: str) -> str:
        """A row of the table."""
        return (
            f"| {name} | {100.0 * np.mean(self.inside):.1f} | {np.std(self.off):.2f} | {np.mean(self.off):+.2f} | "
            f"{100.0 * np.median(self.relative):.2g} | {len(self.inside)} |"
        )


def static(actuator: Actuator) -> float:
    """d(0) = K_d Z_d/P_2d [m/V]."""
    return actuator["coupling.gain"] * actuator["coupling.zero"] / actuator["coupling.p2"]


Part = Literal["hand and current", "force", "all at once"]
"""How far a trial goes: steps 1 to 5; step 6 too; the joint fit too."""


def trials(strip: VirtualStrip, count: int, part: Part) -> Iterator[tuple[dict[str, Tally], dict[str, Tally]]]:
    """Follow the procedure again and again: tallies of the steps and of the joint fit, after each trial."""
    rng = np.random.default_rng([SEED, get_args(Part).index(part)])
    staged: dict[str, Tally] = {}
    together: dict[str, Tally] = {}
    for _ in range(count):
        procedure = strip.procedure(rng)
        if part == "hand and current":
            procedure = replace(procedure, coupling=())
        found = follow_procedure(procedure, all_at_once=part == "all at once")
        for step in found.steps:
            for name, result in {**step.results, **step.also}.items():
                amount = result.amount
                truth = static(strip.truth) if name == "d(0)" else strip.truth.parameter_values.get(name)
                if truth is not None and math.isfinite(amount.uncertainty):
                    tally = staged.setdefault(name, Tally())
                    tally.add(amount.value, amount.uncertainty, amount.interval, truth)
        if found.joint is not None:
            for name, one in found.joint.fit.parameters.items():
                if one.determined:
                    tally = together.setdefault(name, Tally())
                    tally.add(one.value, one.standard_error, one.interval, strip.truth[name])
            known = found.joint.static
            if math.isfinite(known.uncertainty):
                tally = together.setdefault("d(0)", Tally())
                tally.add(known.value, known.uncertainty, known.interval, static(strip.truth))
        yield staged, together


HEADER = """| number | 95 % interval holds the truth [%] | sd of (found - truth)/uncertainty | its mean | \
uncertainty, median [%] | trials |
|---|---|---|---|---|---|"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--coupling", type=int, default=200)
    parser.add_argument("--joint", type=int, default=40)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    strip = VirtualStrip(load_actuator("friend-2"))
    pages: dict[str, str] = {}

    def tell(*, record: bool) -> None:
        body = "\n\n".join(f"## {title}\n\n{HEADER}\n{rows}" for title, rows in pages.items())
        finish("procedure", "The procedure of the thesis, step by step", body, [], record=record, gate=False)

    counts: dict[Part, int] = {
        "hand and current": options.trials,
        "force": options.coupling,
        "all at once": options.joint,
    }
    for part, count in counts.items():
        for done, (staged, together) in enumerate(trials(strip, count, part), start=1):
            if part == "hand and current":
                pages["Steps 1 to 5"] = "\n".join(one.row(name) for name, one in staged.items())
            elif part == "force":
                pages["Step 6"] = "\n".join(
                    one.row(name) for name, one in staged.items() if name.startswith(("coupling.", "d("))
                )
            else:
                pages["All runs at once"] = "\n".join(one.row(name) for name, one in together.items())
            # It takes long: what is done is kept.
            if options.record and (done == count or done % {"hand and current": 100, "force": 10}.get(part, 1) == 0):
                tell(record=True)
    if not options.record:
        tell(record=False)


if __name__ == "__main__":
    main()
