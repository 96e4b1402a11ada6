"""Noisy runs of strips that may differ, for the tests on many runs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ipmclab import Run, RunMetadata, Sample, load_actuator, simulate
from ipmclab.model import Actuator

FRIEND = load_actuator("friend-2")
ELECTRICAL = (
    "circuit.dc_resistivity",
    "circuit.branches.0.resistivity",
    "circuit.branches.0.permittivity",
    "circuit.branches.1.resistivity",
    "circuit.branches.1.permittivity",
)
NOISE = {"current": 1e-4, "displacement": 2e-6, "force": 2e-6}
CONTACT = "circuit.contact_resistance"


def noisy(
    generator: np.random.Generator,
    signal: str,
    *,
    strip: Actuator = FRIEND,
    duration: float = 30.0,
    rate: float = 25.0,
    outputs: tuple[str, ...] = ("current",),
    mounting: str | None = None,
    sample: str | None = None,
) -> Run:
    """A run of a strip with white noise."""
    clean = simulate(strip, signal, duration=duration, rate=rate)
    readings = {name: clean.channels[name] + NOISE[name] * generator.standard_normal(len(clean)) for name in outputs}
    about = RunMetadata(
        signal=signal,
        mounting_id=mounting,
        starts_from_rest=True,
        sample=None if sample is None else Sample(id=sample),
    )
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=readings.get("current"),
        displacement=readings.get("displacement"),
        force=readings.get("force"),
        metadata=about,
    )


def mounted(generator: np.random.Generator, spread: float) -> tuple[Actuator, Mapping[str, float]]:
    """The strip as one more mounting has it: every electrical parameter moved by a factor of its own."""
    values = {name: FRIEND[name] * float(np.exp(spread * generator.standard_normal())) for name in ELECTRICAL}
    return FRIEND.replace(**values), values
