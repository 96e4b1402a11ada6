"""A strip that leaks on the virtual bench: the plant carries the law as ``simulate`` does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import load_actuator, simulate
from ipmclab.model import Actuator
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.exact import ExactSystem, to_ticks
from ipmclab.rig.plant import StripPlant

OUTPUT, SHUNT = "cDAQ1Mod2/ao0", "cDAQ1Mod1/ai0"
QUIET = replace(THESIS_RIG, channels=tuple(replace(one, sensor_noise=0.0) for one in THESIS_RIG.channels))
STRIPS = ["leak.exponential", "leak.butler_volmer+leak.slow", "leak.cubic+line.segments=4"]


def actuator(name: str) -> Actuator:
    return load_actuator(f"friend-2+{name}")


@pytest.mark.parametrize("chunk", [1, 7, 400])
@pytest.mark.parametrize("name", STRIPS)
def test_blocks_of_any_length_are_the_simulation(name: str, chunk: int) -> None:
    plant = StripPlant(QUIET, actuator(name))
    rows = np.arange(400)
    volts = 3.0 * np.sign(np.sin(2 * np.pi * rows / 70.0)) * (rows > 0)
    parts = [
        plant.advance(rows[k : k + chunk] / 50.0, {OUTPUT: volts[k : k + chunk]})[SHUNT]
        for k in range(0, len(rows), chunk)
    ]
    in_series = actuator(name).replace(**{"circuit.contact_resistance": 1.0})
    exact = simulate(in_series, volts, duration=8.0, rate=50.0, hold="zero-before")
    assert exact.current is not None
    assert np.max(np.abs(np.concatenate(parts) - exact.current)) < 1e-12 * np.max(np.abs(exact.current))


@pytest.mark.parametrize("name", STRIPS)
def test_one_look_after_a_long_time_is_the_end_of_a_record(name: str) -> None:
    """A program sets 3 V, looks after 10 ms and 0.3 s, then after a minute, then the next day."""
    strip = actuator(name)
    plant = ExactSystem(strip.system)
    looks = plant.advance(np.diff(to_ticks([0.0, 0.01, 0.3, 60.0, 86400.0])), np.full(4, 3.0))
    record = simulate(strip, np.full(3001, 3.0), duration=60.02, rate=50.0, hold="zero")
    for row, seconds in enumerate((0.3, 60.0), start=1):
        index = round(50 * seconds)
        for place, output in enumerate(("current", "applied_voltage", "displacement", "force")):
            expected = record.channels[output][index]
            assert looks[place, row] == pytest.approx(expected, rel=2e-6)
    # The next day: the balance of currents at rest, which one more long look does not move.
    again = plant.advance(to_ticks([86400.0]), np.array([3.0]))
    assert np.allclose(again[:, 0], looks[:, 3], rtol=1e-9)
