"""What a laser at a fixed place reads of a strip of uniform curvature, against its shape."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import load_actuator
from ipmclab.model.laser import Laser
from ipmclab.model.shape import shape

STRIP = load_actuator("friend-2+laser").replace(**{"laser.range": 0.5}).parameter_values
LASER = Laser()


@pytest.mark.parametrize("laser_at", [0.021, 0.018, 0.012])
def test_the_reading_is_the_height_of_the_shape(laser_at: float) -> None:
    values = {**STRIP, "geometry.sensing_length": laser_at}
    length = values["geometry.free_length"]
    curvature = np.linspace(-1.3 / laser_at, 1.3 / laser_at, 53)
    read = LASER.reading(0.5 * curvature * laser_at**2, values)
    lost = LASER.lost(read.values, values)
    heights = np.array([shape([one] * 200, length).height_at(laser_at) for one in curvature])
    np.testing.assert_array_equal(lost, np.isnan(heights))
    np.testing.assert_allclose(read.values[~lost], heights[~lost], rtol=1e-9, atol=1e-15)
    assert np.all(np.diff(read.values) > 0)


def test_small_bending_reads_the_displacement() -> None:
    read = LASER.reading([0.0, 1e-6, -2e-5], STRIP)
    np.testing.assert_allclose(read.values, [0.0, 1e-6, -2e-5], rtol=1e-6)
    assert read.by_displacement[0] == 1.0


def test_a_laser_reads_no_further_than_its_range() -> None:
    values = {**STRIP, "laser.range": 4e-3}
    read = LASER.reading(np.linspace(0.0, 9e-3, 91), values).values
    lost = LASER.lost(read, values)
    assert LASER.last_reading(values) == pytest.approx(4e-3, rel=1e-12)
    np.testing.assert_array_equal(lost, read > 4e-3)
    assert read[~lost].max() > 3.9e-3


def test_derivatives() -> None:
    displacement = np.linspace(-12e-3, 12e-3, 41)
    step = 1e-8
    found = LASER.reading(displacement, STRIP)
    for name, slope in (("displacement", found.by_displacement), ("length", found.by_sensing_length)):
        if name == "displacement":
            ends = [LASER.reading(displacement + by, STRIP).values for by in (-step, step)]
        else:
            at = STRIP["geometry.sensing_length"]
            ends = [
                LASER.reading(displacement, {**STRIP, "geometry.sensing_length": at + by}).values
                for by in (-step, step)
            ]
        by_difference = (ends[1] - ends[0]) / (2.0 * step)
        inside = ~LASER.lost(found.values, STRIP) | (name == "displacement")
        np.testing.assert_allclose(slope[inside], by_difference[inside], rtol=1e-6, atol=1e-7)
