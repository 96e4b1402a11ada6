"""A current under waves, of a strip that no number of branches describes: followed as plain least squares follows it.

A wave has no edge, so that its rows at 0 V were not looked at; one without such rows shows the zero of the current by
itself; and what a pole search does without that zero leads elsewhere.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.wrong_model import compared_wave
from ipmclab import Run, check, identify, load_actuator, simulate
from ipmclab.quality.record import rest_rows

STRIP = load_actuator("friend-2")
ZERO = "observation.offset.current[0]"


def measured(signal: str, *, zero: float, seed: int = 1, rate: float = 25.0) -> Run:
    """A record of friend-2 over 40 s with 0.05 mA of noise, and a zero [A] that its amplifier adds."""
    clean = simulate(STRIP, signal, duration=40.0, rate=rate)
    noise = 5e-5 * np.random.default_rng([20261128, seed]).standard_normal(len(clean))
    assert clean.current is not None
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + zero + noise, hold="zero")


def codes(run: Run) -> set[str]:
    return {finding.code for finding in check(run)}


@pytest.mark.parametrize(("number", "branches"), [(0, 2), (0, 3), (10, 2), (10, 3)])
def test_no_record_is_followed_worse_than_by_plain_least_squares(number: int, branches: int) -> None:
    assert compared_wave(number, branches).ratio < 1.02


@pytest.mark.parametrize("signal", ["sine 1 V 0.2 Hz delay=2 s", "triangle 1 V 0.1 Hz delay=2 s", "step 1 V delay=2 s"])
def test_rows_before_any_voltage_show_the_zero(signal: str) -> None:
    run = measured(signal, zero=1e-3)
    (finding,) = [one for one in check(run) if one.code == "offset-before-step"]
    assert finding.values["offset"] == pytest.approx(1e-3, abs=4.0 * 5e-5 / np.sqrt(45))
    assert rest_rows(run) in (50, 51)
    assert "offset-before-step" not in codes(measured(signal, zero=0.0))


@pytest.mark.parametrize(
    "signal", ["sine 1 V 0.2 Hz", "triangle 1 V 0.02 Hz", "sine 1 V 0.001 Hz", "triangle 1 V 0.005 Hz"]
)
def test_a_wave_that_begins_at_once_has_no_rows_at_rest(signal: str) -> None:
    assert not codes(measured(signal, zero=1e-3, rate=500.0)) & {"offset-before-step", "drift-before-step"}


@pytest.mark.parametrize("signal", ["sine 1 V 0.2 Hz", "square 1 V 0.1 Hz"])
def test_a_wave_without_rest_shows_a_zero_by_itself(signal: str) -> None:
    free = ("circuit.dc_resistivity", "circuit.branches.1.permittivity")
    with_zero, without = (identify(STRIP, measured(signal, zero=zero), free=free) for zero in (2e-3, 0.0))
    found = with_zero.parameters[ZERO]
    assert abs(found.value - 2e-3) < 4.0 * found.standard_error < 1e-4
    assert ZERO not in without.parameters
    assert "start-not-at-rest" not in {finding.code for finding in with_zero.findings}
    for name in free:
        low, high = with_zero.parameters[name].interval
        assert low <= STRIP[name] <= high


def test_a_step_without_rest_does_not() -> None:
    """There a zero looks like the dc path."""
    assert ZERO not in identify(STRIP, measured("step 1 V", zero=2e-3), free="electrical").parameters
