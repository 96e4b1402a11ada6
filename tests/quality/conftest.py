"""Simulated runs as an instrument would have read them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ipmclab.model import load_actuator, simulate
from ipmclab.run import Hold, Run

NOISE = {"current": 1e-4, "displacement": 2e-6, "force": 2e-5}
FULL_SCALE = {"current": 0.2, "displacement": 0.0125, "force": 0.1}

Reading = Callable[..., Run]


@pytest.fixture(scope="session")
def read() -> Reading:
    """A function that gives a run of ``friend-2`` with noise and the rounding of a 16-bit converter."""
    actuator = load_actuator("friend-2")

    def of(
        signal: str,
        *,
        duration: float = 40.0,
        rate: float = 50.0,
        hold: Hold = "zero",
        noise: float = 1.0,
        round_off: bool = True,
        seed: int = 20261121,
        change: dict[str, float] | None = None,
    ) -> Run:
        rng = np.random.default_rng(seed)
        strip = actuator.replace(**change) if change else actuator
        run = simulate(strip, signal, duration=duration, rate=rate, hold=hold)
        readings = {}
        for name, sd in NOISE.items():
            values = getattr(run, name) + rng.normal(0.0, noise * sd, len(run))
            quantum = FULL_SCALE[name] / 2**15
            readings[name] = np.rint(values / quantum) * quantum if round_off else values
        return replace(run, metadata=replace(run.metadata, origin="measured"), **readings)

    return of
