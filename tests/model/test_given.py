"""A name or a path in place of an actuator or a run is refused with the call that reads it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ipmclab import InputError, forecast, identify, load_actuator, simulate, validate
from ipmclab.forecasting.forecast import with_slow_modes

FRIEND = load_actuator("friend-2")
RUN = simulate(FRIEND, "step 1 V", duration=10.0, rate=25.0)


@pytest.mark.parametrize("given", ["strip.toml", Path("strip.toml")])
@pytest.mark.parametrize(
    "call",
    [
        lambda one: simulate(one, "step 1 V", duration=1.0, rate=10.0),
        lambda one: simulate(one, RUN),
        lambda one: identify(one, [RUN]),
        lambda one: validate(one, [RUN]),
        lambda one: forecast(one, RUN, origin=8.0),
        with_slow_modes,
    ],
)
def test_a_name_in_place_of_an_actuator(call: Callable[[Any], object], given: Any) -> None:
    with pytest.raises(InputError, match=r"not an actuator( or a fit)?; give load_actuator\('strip\.toml'\)") as caught:
        call(given)
    assert (caught.value.code, caught.value.where) in (
        ("not-an-actuator", "actuator"),
        ("not-an-actuator", "model"),
    )


@pytest.mark.parametrize("given", ["step.nc", Path("step.nc")])
@pytest.mark.parametrize(
    "call",
    [
        lambda one: identify(FRIEND, one),
        lambda one: identify(FRIEND, [RUN, one]),
        lambda one: validate(FRIEND, one),
        lambda one: validate(FRIEND, [RUN, one]),
        lambda one: forecast(FRIEND, one, origin=8.0),
    ],
)
def test_a_path_in_place_of_a_run(call: Callable[[Any], object], given: Any) -> None:
    with pytest.raises(InputError, match=r"not a run; give read_run\('step\.nc'\)") as caught:
        call(given)
    assert caught.value.code == "not-a-run"


def test_anything_else_is_named_by_its_kind() -> None:
    with pytest.raises(InputError, match="this is a float, not an actuator; give one that load_actuator read"):
        simulate(1.5, "step 1 V", duration=1.0, rate=10.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="this is an int, not a run; give one that read_run read"):
        validate(FRIEND, [3])  # type: ignore[list-item]
