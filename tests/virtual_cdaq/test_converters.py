"""Steps, ranges, noise and RTDs against data sheets, the IEC table and plain statistics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from virtual_cdaq.model.converters import (
    RTD_CURVES,
    channel_key,
    choose_range,
    decode,
    encode,
    noise,
    rtd_temperature,
    step,
)
from virtual_cdaq.model.modules import NI9205, NI9217, NI9263

KEY = channel_key(20261121, "cDAQ1Mod1/ai0", 0)


@pytest.mark.parametrize(("limit", "volts"), [(10.0, 320e-6), (5.0, 160e-6), (1.0, 32e-6), (0.2, 6.4e-6)])
def test_a_9205_has_the_steps_of_its_data_sheet(limit, volts):
    chosen = choose_range(NI9205, -limit, limit)
    assert step(NI9205, chosen) == pytest.approx(volts, rel=1e-9)


@pytest.mark.parametrize(
    ("low", "high", "chosen"), [(0.0, 0.15, 0.2), (-0.3, 0.1, 1.0), (-1.0, 1.0, 1.0), (0, 10, 10.0)]
)
def test_the_smallest_range_that_holds_the_limits_is_chosen(low, high, chosen):
    assert choose_range(NI9205, low, high).high == chosen


def test_no_range_holds_twelve_volts():
    assert choose_range(NI9205, -12.0, 12.0) is None


@given(st.floats(-10.0, 10.0))
def test_a_round_trip_is_off_by_half_a_step_at_most(volts):
    for module in (NI9205, NI9263):
        chosen = module.ranges[-1]
        back = decode(module, chosen, encode(module, chosen, np.array([volts])))[0]
        assert abs(back - volts) <= step(module, chosen) / 2 * (1 + 1e-9)


def test_what_lies_outside_is_cut_at_the_ends():
    chosen = NI9205.ranges[1]
    assert encode(NI9205, chosen, np.array([-9.0, 9.0, np.inf])).tolist() == [-32768, 32767, 32767]
    assert encode(NI9217, NI9217.ranges[0], np.array([-1.0, np.inf])).tolist() == [0, 2**24 - 1]


@given(st.lists(st.integers(0, 40), min_size=1, max_size=12), st.integers(0, 1000))
def test_noise_does_not_depend_on_how_it_is_cut(pieces, first):
    whole = noise(KEY, first, sum(pieces))
    begin = first
    parts = []
    for piece in pieces:
        parts.append(noise(KEY, begin, piece))
        begin += piece
    assert np.concatenate(parts).tolist() == whole.tolist()


def test_noise_is_standard_normal_and_differs_between_channels_and_acquisitions():
    first = noise(KEY, 0, 200_000)
    assert abs(first.mean()) < 4 / np.sqrt(first.size)
    assert first.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * first.size))
    assert np.mean(np.abs(first) > 3.0) == pytest.approx(0.0027, abs=0.0005)
    for other in (channel_key(20261121, "cDAQ1Mod1/ai1", 0), channel_key(20261121, "cDAQ1Mod1/ai0", 1)):
        assert abs(np.corrcoef(first, noise(other, 0, first.size))[0, 1]) < 4 / np.sqrt(first.size)


# IEC 60751, Pt100.
@pytest.mark.parametrize(
    ("ohms", "celsius"),
    [(18.52, -200.0), (60.26, -100.0), (80.31, -50.0), (100.0, 0.0), (107.79, 20.0), (138.51, 100.0)],
)
def test_a_pt100_reads_as_the_standard_says(ohms, celsius):
    assert rtd_temperature(np.array([ohms]), 100.0, RTD_CURVES[10071])[0] == pytest.approx(celsius, abs=0.02)


# What a 100 ohm sensor has at 100 degC: 100 (1 + 100 alpha), alpha being in its name; by ITS-90 that of Pt3928 is more.
@pytest.mark.parametrize(
    ("curve", "alpha"),
    [(12481, 3.750e-3), (10071, 3.851e-3), (12482, 3.911e-3), (10069, 3.916e-3), (10053, 3.920e-3), (12483, 3.9295e-3)],
)
def test_each_curve_rises_as_its_name_says(curve, alpha):
    assert rtd_temperature(np.array([100.0 * (1.0 + 100.0 * alpha)]), 100.0, RTD_CURVES[curve]) == pytest.approx(
        100.0, abs=0.15
    )


# 100 P of GOST 6651 is Pt3911, JPt100 of JIS C 1604-1981 is Pt3916.
@pytest.mark.parametrize(
    ("curve", "ohms", "celsius"),
    [
        (12482, 59.64, -100.0),
        (12482, 80.00, -50.0),
        (12482, 139.11, 100.0),
        (12482, 395.16, 850.0),
        (10069, 59.57, -100.0),
        (10069, 139.16, 100.0),
    ],
)
def test_other_platinum_reads_as_its_standards_say(curve, ohms, celsius):
    assert rtd_temperature(np.array([ohms]), 100.0, RTD_CURVES[curve])[0] == pytest.approx(celsius, abs=0.05, rel=2e-4)
