"""What the channels tell of the output: whether it is at 0 V."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.safety.readback import at_output, channels_at_output, left_at_output


def test_a_discharging_strip_does_not_look_like_a_stuck_output() -> None:
    # 0.2 A back into an amplifier of 2 ohm, read upstream of the shunt: 0.4 V, and 0 V at the output.
    source = replace(THESIS_RIG, source_resistance=2.0)
    assert left_at_output(source, {"voltage": 0.4, "current": -0.2}) is None
    assert left_at_output(THESIS_RIG, {"voltage": 0.4, "current": -0.2}) == 0.4
    at_strip = replace(source, voltage_sensed="electrodes")
    assert left_at_output(at_strip, {"voltage": 0.6, "current": -0.2}) is None
    assert left_at_output(at_strip, {"voltage": 2.0, "current": 0.1}) == pytest.approx(2.3)
    # Without the current nobody can tell.
    assert left_at_output(at_strip, {"voltage": 2.0}) is None
    assert left_at_output(THESIS_RIG, {"current": 0.2}) is None


def test_0_1_v_may_be_left() -> None:
    for volts in (0.1, -0.1):
        assert left_at_output(THESIS_RIG, {"voltage": volts}) is None
        beyond = float(np.nextafter(volts, 10.0 * volts))
        assert left_at_output(THESIS_RIG, {"voltage": beyond}) == at_output(THESIS_RIG, {"voltage": beyond}) == beyond


@pytest.mark.parametrize("source_resistance", [0.0, 2.0])
def test_the_output_is_told_by_channels_that_are_wired(source_resistance: float) -> None:
    """By the voltage alone where nothing is between, otherwise with the current that drops over it."""
    rig = replace(THESIS_RIG, source_resistance=source_resistance)
    voltage, current = rig["voltage"], rig["current"]
    needed = ("voltage", "current") if source_resistance else ("voltage",)
    loose = replace(current, physical="")
    for channels, told in (
        ((voltage, current), needed),
        ((voltage, loose), () if source_resistance else needed),
        ((replace(voltage, physical=""), current), ()),
    ):
        assert channels_at_output(replace(rig, channels=channels)) == told
