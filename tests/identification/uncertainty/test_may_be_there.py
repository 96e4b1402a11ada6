"""What a stage that does not show leaves open of everything else."""

from __future__ import annotations

import numpy as np

from ipmclab import Run, RunMetadata, identify, load_actuator, simulate

TRUTH = load_actuator("friend-2+leak.exponential").replace(
    **{
        "geometry.thickness": 0.5e-3,
        "circuit.sheet_resistance": 2.0 / 3.0,
        "circuit.dc_resistivity": 90.0,
        "circuit.branches.0.resistivity": 3.6,
        "circuit.branches.0.permittivity": 0.1,
        "circuit.branches.1.resistivity": 24.0,
        "circuit.branches.1.permittivity": 0.27,
        "leak.exponential.current_density": 30.0,
        "leak.exponential.threshold": 1.23,
        "leak.exponential.voltage_scale": 0.6,
    }
)


def step(volts: float, seed: int) -> Run:
    clean = simulate(TRUTH, f"step {volts} V delay=2 s", duration=60.0, rate=25.0)
    assert clean.current is not None
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(clean))
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + noise,
        metadata=RunMetadata(starts_from_rest=True),
    )


def test_one_step_above_the_threshold_does_not_tell_a_leak_from_the_dc_path() -> None:
    """The circuit was called determined beside a leak that "does not show", at values four times too small."""
    for seed in range(4):
        fit = identify(TRUTH, step(2.5, seed), free="electrical,leak")
        assert not fit.parameters["leak.exponential.current_density"].determined
        assert not fit.parameters["circuit.dc_resistivity"].determined
        for name, one in fit.parameters.items():
            assert one.interval[0] < TRUTH[name] < one.interval[1], (seed, name)


def test_a_step_below_it_does() -> None:
    """As the fit advises: record above the threshold, and below it."""
    fit = identify(TRUTH, [step(1.0, 1), step(2.5, 2)], free="electrical,leak")
    assert all(one.determined for one in fit.parameters.values())
    assert (
        fit.parameters["circuit.dc_resistivity"].interval[0]
        < 90.0
        < fit.parameters["circuit.dc_resistivity"].interval[1]
    )
