"""A small fit whose every text is known, and the runs it speaks of."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ipmclab import Finding, Run, RunMetadata, load_actuator, simulate
from ipmclab.fit.fit import Direction, Fit, FittedParameter
from ipmclab.fit.observation import Observation
from ipmclab.model import Actuator
from ipmclab.sample import Sample

SEED = 20261121
HOSTILE = 'strip <script>alert("x")</script> & co'
FREE = ("circuit.dc_resistivity", "circuit.branches.0.resistivity", "coupling.gain", "coupling.zero")


def measured(actuator: Actuator, signal: str, outputs: tuple[str, ...], rng: np.random.Generator) -> Run:
    """A noisy record of some outputs."""
    run = simulate(actuator, signal, duration=12.0, rate=50.0)
    noise = {"current": 1e-4, "force": 2e-5, "displacement": 5e-6}
    readings = {
        name: getattr(run, name) + rng.normal(0, size, len(run)) if name in outputs else None
        for name, size in noise.items()
    }
    sample = Sample(id=HOSTILE, membrane="Nafion N117")
    metadata = RunMetadata(signal=signal, mounting_id="mounting-7", starts_from_rest=True, sample=sample)
    return replace(run, applied_voltage=None, metadata=metadata, **readings)


@dataclass(frozen=True)
class Material:
    fit: Fit
    runs: list[Run]
    validation_runs: list[Run]


def make_fit(actuator: Actuator, runs: list[Run], **changes: object) -> Fit:
    """A fit of known content: two parameters determined, two not."""
    parameters = {}
    for name in FREE:
        known = actuator.parameters()[name]
        determined = name.startswith("circuit")
        error = 0.01 * known.value if determined else math.inf
        parameters[name] = FittedParameter(
            name=name,
            value=known.value,
            unit=known.unit,
            symbol=known.symbol,
            standard_error=error,
            interval=(known.value - 2 * error, known.value + 2 * error) if determined else (0.0, math.inf),
            determined=determined,
        )
    content = {
        "actuator": replace(actuator, name=HOSTILE),
        "parameters": parameters,
        "undetermined": (
            Direction({"coupling.gain": 0.7, "coupling.zero": -0.7}, "gain & zero move against each other", math.inf),
        ),
        "correlations": {a: {b: 1.0 if a == b else -0.25 for b in FREE} for a in FREE},
        "rank": 3,
        "singular_values": (3.0, 2.0, 1.0, 0.0),
        "observations": tuple(
            Observation(
                label=str(run.metadata.signal),
                content_sha256=run.content_sha256,
                hold=run.hold,
                delay=0.0,
                start="stated rest",
                noise={name: 1e-4 for name in ("current", "force") if name in run.channels},
            )
            for run in runs
        ),
        "findings": (Finding("exact-value-assumed", "warning", "R_s is taken as exact", "state its uncertainty"),),
        "converged": True,
        "message": "the cost stopped falling",
        "evaluations": 17,
        "software_version": "0.1.0",
    }
    return Fit(**{**content, **changes})


@pytest.fixture(scope="session")
def material() -> Material:
    rng = np.random.default_rng(SEED)
    actuator = load_actuator("friend-2")
    runs = [
        measured(actuator, "step 1 V", ("current", "force"), rng),
        measured(actuator, "sine 1 V 0.5 Hz", ("current", "force"), rng),
    ]
    return Material(
        make_fit(actuator, runs), runs, [measured(actuator, "square 1 V 0.25 Hz", ("current", "displacement"), rng)]
    )
