"""A fit does not end under other names of the same poles."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, identify, load_actuator, simulate

SEED = 20261121
STRIP = {
    "coupling.gain": 8.7e-9,
    "coupling.zero": 354.0,
    "coupling.p1": 16.3,
    "coupling.p2": 24.2,
    "relaxation.displacement.0.ratio": 0.4,
    "relaxation.displacement.0.time_constant": 20.0,
}


@pytest.mark.parametrize("draw", [1, 4])
def test_a_fast_pole_that_was_called_a_slow_mode_makes_nobody_certain_of_another_coupling(draw: int) -> None:
    usual = load_actuator("friend-2+relaxation.displacement")
    clean = simulate(usual.replace(**STRIP), "sine 1 V 0.1 Hz", duration=10.0, rate=50.0)
    noise = 5e-6 * np.random.default_rng([SEED, draw]).standard_normal(len(clean))
    rest = RunMetadata(starts_from_rest=True)
    run = Run.from_arrays(
        time=clean.time, voltage=clean.voltage, displacement=clean.displacement + noise, metadata=rest
    )
    fit = identify(usual, run, free=["coupling", "relaxation"])
    for name, true in STRIP.items():
        low, high = fit.parameters[name].interval
        assert low <= true <= high, name
    assert fit.parameters["relaxation.displacement.0.time_constant"].value > 5.0
