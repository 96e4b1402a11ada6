"""What a stage that does not show leaves open of everything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Actuator, Fit, Run, RunMetadata, identify, load_actuator, simulate
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.solved import solved
from ipmclab.identification.uncertainty.may_be_there import with_usual_stages
from ipmclab.model.variants import with_stages

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


def step(volts: float, seed: int, strip: Actuator = TRUTH) -> Run:
    clean = simulate(strip, f"step {volts} V delay=2 s", duration=60.0, rate=25.0)
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


def usual_stages(fit: Fit) -> list[Rival]:
    """The fits in which a stage that does not show has its usual shape."""
    estimate = solved(fit)
    assert estimate.with_unseen is not None
    without = Rival.of(estimate.problem, estimate.solution.theta)
    return list(with_usual_stages(estimate.with_unseen, estimate.unseen, without))


def test_no_run_has_a_whole_leak_beside_that_of_another() -> None:
    """With the leak of one run small, that of the other was held at its usual size, which its readings contradict."""
    strip = load_actuator("friend-2")
    runs = [step(1.2, 1, strip), step(2.0, 2, strip)]
    asked = with_stages(strip, "leak.exponential")
    size = "leak.exponential.current_density"
    each = identify(asked, runs, free="electrical,leak", per_run=size)
    assert not any(each.parameters[f"{size}[{place}]"].determined for place in range(2))
    least, most = each.parameters["circuit.dc_resistivity"].interval
    assert least < strip["circuit.dc_resistivity"] < most
    found = [np.exp(rival.entries["circuit.dc_resistivity"]) for rival in usual_stages(each)]
    assert found == pytest.approx([strip["circuit.dc_resistivity"]] * 2, rel=0.03)


def test_a_stage_of_two_sizes_has_as_little_of_both() -> None:
    """Its lead was held at the usual size, which the readings contradict: p1 was said to be not determined."""
    strip = load_actuator("friend-2")
    clean = simulate(strip, "step 1.2 V delay=5 s", duration=60.0, rate=25.0)
    assert clean.displacement is not None
    noise = 1e-6 * np.random.default_rng(20261128).standard_normal(len(clean))
    run = replace(clean, displacement=clean.displacement + noise, current=None, force=None)
    fit = identify(with_stages(strip, "relaxation.displacement_pair"), run, free="coupling,relaxation")
    assert not fit.parameters["relaxation.displacement_pair.0.ratio"].determined
    for name in ("coupling.p1", "coupling.p2"):
        least, most = fit.parameters[name].interval
        assert least < strip[name] < most
        found = [np.exp(rival.entries[name]) for rival in usual_stages(fit)]
        assert found == pytest.approx([strip[name]] * len(found), rel=0.1)
        assert len(found) == 2
