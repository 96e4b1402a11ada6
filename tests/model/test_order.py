"""Branches and modes in the order of their speed, and another fit of which only some are free."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import identify, load_actuator, simulate
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.solved import solved
from ipmclab.model.order import Order
from ipmclab.run import Run

MODE = "relaxation.force.{}.time_constant"


@given(
    times=st.lists(st.floats(0.1, 1e3), min_size=1, max_size=6, unique=True),
    data=st.data(),
)
def test_the_fastest_of_those_that_are_named_comes_first(times: list[float], data: st.DataObject) -> None:
    values = {MODE.format(number): time for number, time in enumerate(times)}
    named = data.draw(st.lists(st.sampled_from(sorted(values)), min_size=1, unique=True))
    order = Order(values, named)
    ranked = sorted(named, key=order)
    assert [values[name] for name in ranked] == sorted(values[name] for name in named)
    assert [order(name) for name in ranked] == [MODE.format(number) for number in range(len(named))]


@pytest.mark.parametrize("gone", [0, 1])
def test_another_fit_keeps_its_modes_where_one_of_them_is_held(gone: int) -> None:
    """A mode that did not show was held at 10 s, and a free one of another fit was faster."""
    strip = load_actuator("friend-2+branches=3").replace(
        **{"circuit.branches.2.resistivity": 30.0, "circuit.branches.2.permittivity": 0.02}
    )
    run = simulate(strip, "step 1 V delay=1 s", duration=20, rate=20)
    noise = 1e-5 * np.random.default_rng(20261126).standard_normal(len(run))
    read = Run.from_arrays(time=run.time, voltage=run.voltage, current=run.current + noise)
    estimate = solved(identify(strip, read, free="electrical"))
    problem = estimate.problem
    values = problem.in_reference(estimate.solution.theta, 0)
    held = [
        place for place, unknown in enumerate(problem.unknowns) if unknown.base.startswith(f"circuit.branches.{gone}.")
    ]
    fewer = problem.without(
        held, {problem.unknowns[place].base: values[problem.unknowns[place].base] for place in held}
    )
    theta = np.delete(estimate.solution.theta, held)
    free = sorted({unknown.base.split(".")[2] for unknown in fewer.unknowns if "branches" in unknown.base})
    first, second = (
        [place for place, unknown in enumerate(fewer.unknowns) if f"branches.{number}." in unknown.base]
        for number in free
    )
    swapped = theta.copy()
    swapped[first], swapped[second] = theta[second], theta[first]
    same = Rival.of(fewer, swapped).sorted_as(fewer, values)
    assert same.entries == pytest.approx(Rival.of(fewer, theta).entries)


def test_what_is_known_of_one_mode_alone_is_not_said_of_another() -> None:
    """The size of a mode that does not show may be known of another fit, its time constant not: identify raised."""
    ratio, time = "relaxation.displacement.{}.ratio", "relaxation.displacement.{}.time_constant"
    unknowns = [
        SimpleNamespace(name=name, base=name, value=float)
        for name in (ratio.format(0), ratio.format(1), time.format(1))
    ]
    problem = SimpleNamespace(unknowns=unknowns, base={ratio.format(0): 0.0, time.format(0): 10.0})
    found = {time.format(0): 10.0, time.format(1): 16.0}
    other = Rival.of(problem, np.array([0.3, 0.5, 9.0]))  # type: ignore[arg-type]
    assert other.sorted_as(problem, found) == other  # type: ignore[arg-type]
