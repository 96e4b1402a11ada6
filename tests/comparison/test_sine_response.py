"""Frequency responses from single sines: which runs belong to one, means over repeats, and how sure they are."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ipmclab.comparison.sine_response import bandwidth_of, sine_responses
from ipmclab.comparison.table import RunRow
from ipmclab.quality.metrics import Metric


def sine(
    hertz: float, gain: float, phase: float, *, sample: str = "a", half: float | None = 0.02, **at: float
) -> RunRow:
    """A run with a displacement whose gain and phase are known to 95 % within half an interval."""
    metrics = {
        f"displacement.{name}": Metric(name, "displacement", value, "", half and (value - half, value + half), "")
        for name, value in (("gain", gain), ("phase", phase))
    }
    return RunRow("", sample, "", "", "", "sine", {"frequency": hertz, "voltage": 1.0, **at}, metrics)


def test_repeats_are_averaged_with_the_error_of_their_mean() -> None:
    (found,) = sine_responses(
        [sine(1.0, 10.0, -1.0), sine(0.1, 20.0, -0.1), sine(1.0, 16.0, -1.3), sine(1.0, 10.0, -1.0)]
    )
    assert found.frequency.tolist() == [0.1, 1.0]
    assert found.gain == pytest.approx([20.0, 12.0])
    assert found.phase == pytest.approx([-0.1, -1.1])
    # Of three readings that differ by 6 the mean is known to 2; of one, a 95 % interval is 1.96 errors on each side.
    assert found.gain_error == pytest.approx([0.02 / 1.959964, 2.0])
    assert found.phase_error == pytest.approx([0.02 / 1.959964, 0.1])
    assert (found.sample, found.channel, found.conditions) == ("a", "displacement", {"voltage": 1.0})


def test_phases_of_repeats_on_both_sides_of_half_a_turn_are_alike() -> None:
    """A gain is no angle: 3 and 10 are not 3 and 10 less a turn."""
    (found,) = sine_responses([sine(0.1, 3.0, 0.0), sine(1.0, 3.0, math.pi - 0.1), sine(1.0, 10.0, 0.1 - math.pi)])
    assert abs(math.remainder(found.phase[1] - math.pi, math.tau)) < 1e-9
    assert found.phase_error[1] == pytest.approx(0.1)
    assert found.gain[1] == pytest.approx(6.5)


def test_two_frequencies_of_one_strip_under_one_condition_make_a_response() -> None:
    rows = [sine(0.1, 1.0, 0.0), sine(1.0, 1.0, 0.0, sample="b"), sine(1.0, 1.0, 0.0, humidity=80.0)]
    assert sine_responses(rows) == ()
    assert sine_responses([*rows, sine(0.1, 1.0, 0.0)]) == ()  # twice the same
    square = replace(sine(1.0, 1.0, 0.0), waveform="square")
    assert sine_responses([*rows, square]) == ()
    (found,) = sine_responses([*rows, sine(1.0, 0.5, 0.0), sine(0.2, 1.0, 0.0, voltage=2.0)])
    assert (found.sample, found.frequency.tolist(), found.conditions) == ("a", [0.1, 1.0], {"voltage": 1.0})
    (found,) = sine_responses([sine(0.1, 1.0, 0.0, humidity=79.0), sine(1.0, 1.0, 0.0, humidity=81.0)])
    assert found.conditions == {"voltage": 1.0, "humidity": 80.0}
    (found,) = sine_responses([sine(one, 1.0, 0.0, half=None) for one in (0.1, 1.0)])
    assert found.gain_error.tolist() == [0.0, 0.0]


def test_a_phase_goes_on_without_jumps_and_a_bandwidth_is_where_the_gain_fell_first() -> None:
    phases = [math.remainder(-0.9 * math.pi * step, math.tau) for step in range(5)]
    (found,) = sine_responses([sine(3.0 * 10.0**step, 2.0**-step, phase) for step, phase in enumerate(phases)])
    assert found.phase == pytest.approx([-0.9 * math.pi * step for step in range(5)])
    assert found.bandwidth == pytest.approx(3.0 * 10.0 ** (0.15 / math.log10(2.0)))
    assert bandwidth_of([1.0, 2.0, 3.0], [1.0, 0.8, 1.2]) is None
    assert bandwidth_of([1.0, 2.0, 3.0, 4.0], [1.0, 0.5, 1.0, 0.1]) == pytest.approx(2.0**0.4983, rel=1e-3)
    assert bandwidth_of([1.0, 2.0], np.array([1.0, 10.0 ** (-3.0 / 20.0)])) == pytest.approx(2.0)
