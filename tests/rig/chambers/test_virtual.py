"""The virtual chamber: its air lags, overshoots and drifts, and it keeps the protocol of every chamber."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.errors import InputError
from ipmclab.model.environment.sorption import saturation_pressure
from ipmclab.rig.chambers.chamber import Chamber, ChamberError, Ranges
from ipmclab.rig.chambers.virtual import VirtualChamber, VirtualClimate


class Clock:
    """A clock that goes as it is told."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def chamber(clock: Clock) -> VirtualChamber:
    return VirtualChamber(clock)


def after(chamber: VirtualChamber, clock: Clock, seconds: float) -> tuple[float, float]:
    clock.now += seconds
    temperature, humidity = chamber.air(np.array([clock.now]))
    return float(temperature[0]), float(humidity[0])


def test_it_reaches_its_set_points_and_overshoots_them(chamber: VirtualChamber, clock: Clock) -> None:
    chamber.set(40.0, 70.0)
    temperature, humidity = chamber.air(np.arange(7200.0))
    assert 40.5 < temperature.max() < 43.0
    assert temperature[-1] == pytest.approx(40.0, abs=0.05)
    assert humidity[-1] == pytest.approx(70.0, abs=0.2)
    reached = np.flatnonzero(temperature > 22.0 + 0.632 * 18.0)[0]
    assert 180 < reached < 600  # 3 to 10 min


def test_the_humidity_follows_the_temperature_at_once(clock: Clock) -> None:
    climate = VirtualClimate(temperature_time=20.0, damping=1.0, vapour_time=1e9)
    chamber = VirtualChamber(clock, climate)
    chamber.set(32.0, 45.0)
    temperature, humidity = after(chamber, clock, 600.0)
    assert temperature == pytest.approx(32.0, abs=1e-3)
    assert humidity == pytest.approx(45.0 * saturation_pressure(22.0) / saturation_pressure(32.0), abs=0.01)


@pytest.mark.parametrize("leave", ["still", "safe"])
def test_what_is_not_regulated_goes_towards_the_room(chamber: VirtualChamber, clock: Clock, leave: str) -> None:
    chamber.set(40.0, 80.0)
    before = after(chamber, clock, 7200.0)
    assert chamber.is_shaking
    if leave == "still":
        told = chamber.still(300.0)
        assert told.temperature_drift == pytest.approx(18.0 * (1 - np.exp(-300.0 / 2400.0)), rel=0.01)
    else:
        chamber.safe()
        chamber.safe()
    assert not chamber.is_shaking
    later = after(chamber, clock, 300.0)
    assert 0.5 < before[0] - later[0] < 3.0
    assert 1.0 < before[1] - later[1] < 15.0
    chamber.resume()
    assert chamber.is_shaking == (leave == "still")
    assert after(chamber, clock, 7200.0)[0] == pytest.approx(40.0 if leave == "still" else 22.0, abs=1.0)


def test_its_sensors_are_noisy_and_the_same_seed_gives_the_same_readings(clock: Clock) -> None:
    readings = []
    for _ in range(2):
        chamber = VirtualChamber(clock, seed=3)
        chamber.set(22.0, 45.0)
        readings.append([chamber.read() for _ in range(400)])
    assert readings[0] == readings[1]
    temperatures = np.array([one.temperature for one in readings[0]])
    humidities = np.array([one.relative_humidity for one in readings[0]], dtype=float)
    assert 2.0 * temperatures.std() == pytest.approx(0.3, rel=0.15)
    assert 2.0 * humidities.std() == pytest.approx(2.0, rel=0.15)
    assert readings[0][0].temperature_set_point == 22.0


def test_an_empty_tank_raises_an_alarm_and_the_humidity_falls(chamber: VirtualChamber, clock: Clock) -> None:
    chamber.set(22.0, 80.0)
    full = after(chamber, clock, 7200.0)[1]
    chamber.tank_empty = True
    assert after(chamber, clock, 1800.0)[1] < full - 10.0
    assert chamber.read().alarms == ("water tank empty",)


def test_it_is_silent_when_told_so_and_refuses_what_it_cannot_reach(chamber: VirtualChamber) -> None:
    with pytest.raises(InputError, match="temperature: 300 degC is outside"):
        chamber.set(300.0, None)
    with pytest.raises(InputError, match="regulates no humidity"):
        Ranges((0.0, 50.0)).check(20.0, 50.0)
    chamber.silent = True
    kept: Chamber = chamber
    for call in (kept.read, kept.resume, kept.safe, lambda: kept.set(20.0, None), lambda: kept.still(1.0)):
        with pytest.raises(ChamberError, match="does not answer"):
            call()
    kept.close()


def test_dew_does_not_stay_in_the_air(chamber: VirtualChamber, clock: Clock) -> None:
    chamber.set(60.0, 95.0)
    clock.now += 7200.0
    chamber.set(5.0, None)
    _, humidity = chamber.air(clock.now + np.arange(3600.0))
    assert humidity.max() == 100.0
