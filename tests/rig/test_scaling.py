"""From volts to quantities: the converter, the sensor in front of it, and what is known of a reading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab.rig.channels import Channel, Converter, FourProbe
from ipmclab.rig.scaling import Scaling
from ipmclab.run import QUALITY_FLAGS

COARSE = Converter(-10.0, 10.0, noise=0.0, bits=4)
"""16 codes, 1.25 V from each other: -10 V to 8.75 V."""

LASER = Channel(
    "displacement",
    Converter(-10.0, 10.0, noise=0.0),
    gain=2e-3,
    offset=-4e-3,
    sensor_range=(0.0, 16e-3),  # 2 V to 10 V
    lost=1.0,
    zeroed=True,
)
CELL = Channel("force", COARSE, gain=-0.25, offset=0.5, zeroed=True)
LOST = QUALITY_FLAGS["missing"] | QUALITY_FLAGS["sentinel"]
CLIPPED = QUALITY_FLAGS["clipped"]


def test_a_converter_reads_the_nearest_of_its_codes() -> None:
    assert (COARSE.step, COARSE.top) == (1.25, 8.75)
    assert Converter(0.0, 1.0, noise=0.0).step == 2.0**-16
    assert COARSE.convert([-20.0, -10.0, -0.7, 0.6, 0.7, 8.2, 9.0]).tolist() == [
        -10.0, -10.0, -1.25, 0.0, 1.25, 8.75, 8.75,
    ]  # fmt: skip
    readings = np.array([-10.0, -8.75, 7.5, 8.75, 9.0])
    assert COARSE.at_limit(readings).tolist() == [True, False, False, True, True]


def test_what_a_channel_reads_is_what_converter_and_sensor_both_can() -> None:
    assert CELL.range == (0.5 - 0.25 * 8.75, 3.0)
    assert replace(CELL, sensor_range=(-1.0, 9.0)).range == (-1.0, 3.0)
    assert replace(CELL, sensor_range=(-9.0, 2.0)).range == (0.5 - 0.25 * 8.75, 2.0)
    assert CELL.resolution == 0.25 * 1.25
    assert replace(CELL, sensor_resolution=0.5).resolution == 0.5
    assert CELL.to_volts(np.array([0.5, 0.0])).tolist() == [0.0, 2.0]
    assert CELL.quantity.unit == "N"


def test_a_reading_becomes_a_quantity_less_its_zero_and_is_none_where_the_sensor_lost() -> None:
    top = LASER.converter.top
    # 1.5 V is halfway between the error value and what the sensor gives at the end of its range.
    readings = {"displacement": np.array([-10.0, 1.0, 1.5, 2.0, 6.0, top]), "force": np.array([0.0, 4.0])}
    scaling = Scaling([LASER, CELL], {"displacement": 5e-3})
    values = scaling.values(readings)
    expected = [np.nan, np.nan, -6e-3, -5e-3, 3e-3, 2e-3 * top - 9e-3]
    assert values["displacement"] == pytest.approx(expected, abs=1e-15, nan_ok=True)
    assert values["force"].tolist() == [0.5, -0.5]
    flags = scaling.flags(readings)
    assert flags["displacement"].tolist() == [LOST | CLIPPED, LOST, 0, 0, 0, CLIPPED]
    assert flags["force"].tolist() == [0, 0]
    assert flags["force"].dtype == np.uint8


def test_a_sensor_whose_error_value_lies_above_is_lost_above() -> None:
    above = replace(LASER, gain=1e-3, offset=0.0, sensor_range=(0.0, 6e-3), lost=9.0)
    assert above.is_lost(np.array([-10.0, 6.0, 7.5, 7.6, 9.0])).tolist() == [False, False, False, True, True]
    none = np.array([-10.0, 9.0])
    assert replace(above, lost=None).is_lost(none).tolist() == [False, False]
    assert replace(above, sensor_range=None).is_lost(none).tolist() == [False, False]


def test_a_tip_that_does_not_press_is_flagged_up_to_its_level_before_zeroing() -> None:
    readings = {"force": np.array([3.75, 2.5, 2.0, 1.25, -10.0])}  # -0.4375, -0.125, 0, 0.1875 and 3 N
    scaling = Scaling([CELL], {"force": 0.25}, {"force": 0.0})
    lost = QUALITY_FLAGS["contact_lost"]
    assert scaling.flags(readings)["force"].tolist() == [lost, lost, lost, 0, CLIPPED]
    # It is the reading, not a force of zero.
    assert scaling.values(readings)["force"].tolist() == [-0.6875, -0.375, -0.25, -0.0625, 2.75]


def test_a_record_tells_the_scaling_of_each_channel_and_its_range_after_zeroing() -> None:
    voltage = Channel("voltage", COARSE)
    scaling = Scaling([LASER, CELL, voltage], {"displacement": 5e-3, "voltage": 0.0})
    assert scaling.calibrations == {
        "displacement": "raw [V] x 0.002 m/V - 0.004 m, zeroed at 0.005 m",
        "force": "raw [V] x -0.25 N/V + 0.5 N, zeroed at 0 N",
        "voltage": "raw [V] x 1 V/V",
    }
    assert scaling.ranges == {
        "displacement": (-5e-3, pytest.approx(11e-3, abs=1e-6)),
        "force": (0.5 - 0.25 * 8.75, 3.0),
        "voltage": (-10.0, 8.75),
    }


def test_four_points_read_a_square_less_where_the_strip_ends_near_them() -> None:
    line = FourProbe(spacing=2e-3)
    assert line.sheet_resistance(3.0, width=4e-3) == pytest.approx(6.0)
    points = FourProbe(spacing=1e-3, contacts="points")
    # On a sheet without ends it is pi / ln 2.
    assert points.sheet_resistance(2.0, width=10.0) == pytest.approx(2.0 * np.pi / np.log(2.0), rel=1e-3)
    assert points.sheet_resistance(2.0, width=5e-3, length=5e-3) < points.sheet_resistance(2.0, width=5e-3)
