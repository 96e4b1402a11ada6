"""A drift that no run would show, and questions that are asked again under the noise that was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.trust import CASES, draw
from ipmclab import Fit, Run, RunMetadata, load_actuator
from ipmclab.model.variants import with_stages
from tests.identification.brief import brief

SEED = 20261121
FRIEND = load_actuator("friend-2")
CIRCUIT = CASES["circuit"]
CLEAN = CIRCUIT.clean(CIRCUIT.truth)


def runs(noise: str, generator: np.random.Generator, places: tuple[int, ...] = (0, 1), begin: int = 0) -> list[Run]:
    return [
        Run.from_arrays(
            time=CIRCUIT.time[begin:],
            voltage=CIRCUIT.voltages[place][begin:],
            current=CLEAN[place][begin:] + CIRCUIT.noise * draw(noise, CIRCUIT.rows, generator)[begin:],
            hold="zero",
            metadata=RunMetadata(starts_from_rest=True),
        )
        for place in places
    ]


def inside(fit: Fit) -> float:
    intervals = [fit.parameters[name].interval for name in CIRCUIT.names]
    return float(
        np.mean([low <= truth <= high for (low, high), truth in zip(intervals, np.exp(CIRCUIT.truth), strict=True)])
    )


@pytest.mark.parametrize("noise", ["linear drift", "white"])
def test_a_step_alone_has_intervals_that_allow_for_a_drift(noise: str) -> None:
    generator = np.random.default_rng(SEED)
    fits = [brief(FRIEND, runs(noise, generator, (0,))) for _ in range(15)]
    # Without it they hold the truth in 22 of 100 under the drift.
    assert np.mean([inside(fit) for fit in fits]) >= 0.85
    (told,) = (finding for finding in fits[0].findings if finding.code == "drift-not-excluded")
    assert "allow for an offset and a straight drift" in told.message
    assert all(fit.parameters[name].determined for fit in fits for name in CIRCUIT.names)


def test_a_sine_beside_it_would_show_the_drift() -> None:
    fit = brief(FRIEND, runs("white", np.random.default_rng(SEED)), followed=False)
    assert "drift-not-excluded" not in {finding.code for finding in fit.findings}
    assert not fit.observations[0].noise_model


def test_a_drift_beside_noise_that_hangs_together_is_allowed_for_too() -> None:
    """Under white noise the step would show it; an autoregression takes it up, and without it the truth is lost."""
    generator = np.random.default_rng(SEED)
    free = ["circuit.dc_resistivity", "circuit.branches.1.resistivity"]
    held = []
    for _ in range(8):
        (run,) = runs("AR(1) 0.9", generator, (0,))
        assert run.current is not None
        drift = generator.choice([-3.0, 3.0]) * CIRCUIT.noise * np.linspace(0.0, 1.0, len(run))
        fit = brief(FRIEND, replace(run, current=run.current + drift), free=free)
        model = fit.observations[0].noise_model.get("current")
        assert model is not None
        assert model.terms.drifts
        held += [fit.parameters[name].interval[0] <= FRIEND[name] <= fit.parameters[name].interval[1] for name in free]
    # Without it they held the truth in 7 of 24.
    assert np.mean(held) >= 0.85


def test_where_a_drift_would_leave_nothing_known_the_fit_says_that_it_rests_on_there_being_none() -> None:
    # From the row of the edge on: neither a zero nor a drift has anything to show against.
    fit = brief(FRIEND, runs("white", np.random.default_rng(SEED), (0,), begin=250), followed=False)
    (told,) = (finding for finding in fit.findings if finding.code == "drift-not-excluded")
    assert "assume that there is none" in told.message
    assert not fit.observations[0].noise_model
    assert fit.parameters["circuit.dc_resistivity"].determined


def test_what_stands_beside_an_unseen_stage_is_known_under_the_noise() -> None:
    generator = np.random.default_rng(SEED)
    fit = brief(with_stages(FRIEND, "leak.exponential"), runs("AR(1) 0.9", generator), free="electrical,leak")
    assert not any(parameter.determined for name, parameter in fit.parameters.items() if name.startswith("leak."))
    assert fit.estimate is not None
    assert fit.estimate.with_unseen is not None
    assert {str(noise.terms) for noise in fit.estimate.with_unseen.noise.values()} == {"AR(1)"}
    alone = brief(FRIEND, runs("AR(1) 0.9", np.random.default_rng(SEED)))
    for name in CIRCUIT.names:
        low, high = alone.parameters[name].interval
        assert fit.parameters[name].interval[0] <= low * 1.001
        assert fit.parameters[name].interval[1] >= high * 0.999


@pytest.mark.parametrize("noise", ["AR(1) 0.9", "random walk"])
def test_noise_that_hangs_together_contradicts_no_rest(noise: str) -> None:
    generator = np.random.default_rng(SEED)
    for _ in range(5):
        said = [
            Run.from_arrays(time=run.time, voltage=run.voltage, current=run.current, hold="zero")
            for run in runs(noise, generator)
        ]
        assert "start-not-at-rest" not in {finding.code for finding in brief(FRIEND, said, followed=False).findings}
