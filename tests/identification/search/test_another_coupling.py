"""Motion that is read for a series resistance alone, and whether the coupling of the file is that of its strip."""

from __future__ import annotations

import numpy as np
import pytest

import ipmclab
from ipmclab import Run, RunMetadata
from ipmclab.model.environment import Environment
from tests.identification.brief import brief

CODE = "coupling-not-identified"


@pytest.mark.parametrize("drift", [0.0, 4.0, -4.0])
@pytest.mark.parametrize("hold", ["zero", "unknown"])
def test_a_drift_of_the_laser_makes_no_motion_of_another_strip(drift: float, hold: str) -> None:
    """Least squares has no slope of the laser: what it leaves of a drift of four ranges was more than the motion."""
    strip = ipmclab.load_actuator("friend-2")
    clean = ipmclab.simulate(strip, "sine 1 V 0.3 Hz", duration=15, rate=50)
    assert clean.displacement is not None
    assert clean.current is not None
    size = float(np.ptp(clean.displacement))
    noise = np.random.default_rng(3).normal(0.0, 1.0, (2, len(clean)))
    motion = clean.displacement + drift * size * np.linspace(0.0, 1.0, len(clean)) + 3e-3 * size * noise[0]
    current = clean.current + 3e-3 * float(np.ptp(clean.current)) * noise[1]
    free = "electrical,circuit.sheet_resistance"
    for own, sign in ((True, 1.0), (False, -1.0)):  # a motion the other way is that of no strip with this coupling
        run = Run.from_arrays(
            time=clean.time,
            voltage=clean.voltage,
            current=current,
            displacement=motion if sign > 0.0 else motion - 2.0 * clean.displacement,
            hold=hold,
        )
        fit = brief(strip, run, free, followed=False)
        assert (CODE in {finding.code for finding in fit.findings}) is not own
        assert ("displacement" in fit.residuals[0]) is own


@pytest.mark.parametrize("signal", ["step 1 V", "sine 1 V 0.1 Hz"])
def test_a_motion_that_hardly_shows_in_its_noise_makes_no_other_strip(signal: str) -> None:
    """What the coupling leaves is noise: it was said to explain nothing, and the motion was left out."""
    strip = ipmclab.load_actuator("friend-2")
    clean = ipmclab.simulate(strip, signal, duration=20, rate=50)
    assert clean.displacement is not None
    assert clean.current is not None
    noise = np.random.default_rng(3).normal(0.0, 1.0, (2, len(clean)))
    run = Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + 1e-4 * noise[0],
        displacement=clean.displacement + float(np.std(clean.displacement)) * noise[1],
    )
    fit = brief(strip, run, "electrical,circuit.sheet_resistance", followed=False)
    assert CODE not in {finding.code for finding in fit.findings}
    assert "displacement" in fit.residuals[0]


@pytest.mark.parametrize(("humidities", "factor"), [((50.0, 80.0), 1.0), ((80.0, 50.0), 1.0), ((50.0, 80.0), -1.0)])
def test_a_motion_in_another_air_than_the_current_is_that_of_the_strip_there(
    humidities: tuple[float, float], factor: float
) -> None:
    """Both were taken to be in the air of the first run, and a strip that moves more in its own for another one."""
    strip = ipmclab.load_actuator("friend-2+environment.permittivity+environment.coupling_gain")
    noise = np.random.default_rng(3).normal(0.0, 1.0, (2, 300))
    runs = []
    for number, humidity in enumerate(humidities):
        clean = ipmclab.simulate(strip.at(Environment(20.0, humidity)), "step 0.5 V", duration=12, rate=25)
        assert clean.displacement is not None
        assert clean.current is not None
        read = {
            "current": clean.current + 1e-4 * noise[0],
            "displacement": factor * clean.displacement + 3e-6 * noise[1],
        }
        output = ("current", "displacement")[number]
        about = RunMetadata(temperature=20.0, relative_humidity=humidity, run_number=number)
        runs.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, metadata=about, **{output: read[output]}))
    fit = brief(strip, runs, "electrical,circuit.sheet_resistance", followed=False)
    assert (CODE in {finding.code for finding in fit.findings}) is (factor < 0.0)


def test_a_motion_that_is_beyond_its_range_throughout_contradicts_no_coupling() -> None:
    """Each reading is a bound alone: there is none to hold against what the currents say."""
    strip = ipmclab.load_actuator("friend-2")
    clean = ipmclab.simulate(strip, "step 1 V delay=2 s", duration=20, rate=25)
    assert clean.current is not None
    run = Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + np.random.default_rng(3).normal(0.0, 1e-4, len(clean)),
        displacement=np.full(len(clean), 2e-4),
        metadata=RunMetadata(ranges={"displacement": (-1e-4, 2e-4)}),
    )
    fit = brief(strip, run, "electrical,circuit.sheet_resistance", followed=False)
    assert CODE not in {finding.code for finding in fit.findings}
