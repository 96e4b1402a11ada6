"""A branch that hardly shows: what is known of all of them reaches over every place where it may be."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.recovery import CASES, SEED, records_of, truth_of
from ipmclab import identify, load_actuator
from ipmclab.identify.undetermined.diagnosis import names_it
from ipmclab.model.variants import with_stages


@pytest.mark.parametrize("trial", [0, 1])
def test_a_third_branch_that_hardly_shows_leaves_no_false_certainty(trial: int) -> None:
    # The slowest branch takes 100 s and more, the records 40 s: two branches meet them nearly as well.
    case = CASES["three branches"]
    generator = np.random.default_rng([SEED, 7, trial])
    strip = truth_of(case, generator)
    fit = identify(
        with_stages(load_actuator("friend-2"), *case.stages), records_of(case, strip, generator), free=case.free
    )
    for name, parameter in fit.parameters.items():
        low, high = parameter.interval
        assert low <= strip[name] <= high, name
    slowest = fit.parameters["circuit.branches.2.resistivity"]
    assert not slowest.determined
    assert any(names_it(direction, "circuit.branches.2.resistivity") for direction in fit.undetermined)


def test_two_branches_that_show_are_not_looked_for_elsewhere() -> None:
    case = CASES["three branches"]
    generator = np.random.default_rng([SEED, 8])
    friend = load_actuator("friend-2")
    fit = identify(friend, records_of(case, friend, generator), free="electrical")
    assert all(parameter.determined for parameter in fit.parameters.values())
    assert fit.evaluations < 100, "nothing to look for"
