"""What a search leaves to linear algebra: entries that move the residuals in proportion, all of them together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import load_actuator, simulate
from ipmclab.model.variants import with_stages
from ipmclab.run import Run
from tests.identification.brief import brief

RATIO = "relaxation.displacement.0.ratio"


@pytest.mark.parametrize("at_rest", [True, False])
def test_what_is_linear_is_so_beside_all_that_is(at_rest: bool) -> None:
    """A ratio multiplies the state in which a run begins: where that is free the two are not linear together."""
    strip = with_stages(load_actuator("friend-2"), "relaxation.displacement").replace(
        **{RATIO: 0.6, "relaxation.displacement.0.time_constant": 3.0}
    )
    clean = simulate(strip, "square 1 V 0.1 Hz delay=1 s", duration=30.0, rate=25.0)
    assert clean.displacement is not None
    moved = clean.displacement + 1e-6 * np.random.default_rng(3).standard_normal(len(clean))
    begun = 0 if at_rest else 40
    run = Run.from_arrays(
        time=clean.time[begun:] - clean.time[begun],
        voltage=clean.voltage[begun:],
        displacement=moved[begun:],
        hold=clean.hold,
    )
    rest = replace(run.metadata, starts_from_rest=at_rest)
    fit = brief(strip, replace(run, metadata=rest), "coupling.gain,relaxation,observation.offset.displacement")
    estimate = fit.estimate
    assert estimate is not None
    problem, theta = estimate.problem.plain, estimate.solution.theta
    linear = np.flatnonzero(problem.linear)
    names = [problem.unknowns[place].base for place in linear]
    assert (RATIO in names) is at_rest
    assert any(name.startswith("observation.initial_state.") for name in names) is not at_rest
    here = problem.evaluate(theta)
    generator = np.random.default_rng(4)
    for _ in range(5):
        there = theta.copy()
        there[linear] += np.maximum(np.abs(theta[linear]), 1.0) * generator.uniform(-1.0, 1.0, len(linear))
        straight = here.residual + here.jacobian[:, linear] @ (there - theta)[linear]
        found = problem.evaluate(there).residual
        np.testing.assert_allclose(found, straight, atol=1e-8 * np.abs(straight).max())
