"""A fit of a strip that bends so far that the laser loses it: the rows without a reading are left out."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Run, identify, load_actuator, simulate, validate


def test_a_strip_that_the_laser_loses_is_identified_from_what_it_read() -> None:
    strip = load_actuator("friend-2+laser")
    strip = strip.replace(**{"coupling.gain": 18.0 * strip["coupling.gain"]})
    run = simulate(strip, "square 1.2 V 0.1 Hz", duration=20.0, rate=20.0)
    assert run.displacement is not None
    readings = run.displacement + np.random.default_rng(20261121).normal(0.0, 2e-6, len(run))
    measured = Run.from_arrays(time=run.time, voltage=run.voltage, displacement=readings)
    lost = np.isnan(readings)
    assert 20 < lost.sum() < len(run) - 50
    names = ["coupling.gain", "coupling.p2"]
    fit = identify(strip.replace(**{"coupling.gain": 3e-8, "coupling.p2": 60.0}), measured, free=names)
    assert fit.observations[0].samples["displacement"] == len(run) - lost.sum()
    for name in names:
        parameter = fit.parameters[name]
        assert parameter.value == pytest.approx(strip[name], abs=4.0 * parameter.standard_error)
        assert parameter.standard_error < 1e-3 * strip[name]
    validation = validate(fit.actuator, measured, used=())
    assert "laser-lost" in {finding.code for finding in validation.findings}
    assert validation.scores["displacement"].rmse == pytest.approx(2e-6, rel=0.2)
    predicted = validation.runs[0].predicted.displacement
    assert predicted is not None
    assert np.all(np.isfinite(predicted[~lost]))  # also where the model has just lost what was read
    assert np.isnan(predicted[lost]).sum() > lost.sum() - 5
    (told,) = [finding for finding in validation.findings if finding.code == "laser-lost"]
    assert abs(int(str(told.values["count"])) - lost.sum()) < 5
    # With the beam of small bending the same readings are no strip.
    small = load_actuator("friend-2").replace(**{"coupling.gain": strip["coupling.gain"]})
    other = identify(small, measured, free=names)
    wrong = validate(other.actuator, measured).scores["displacement"].rmse
    assert wrong is not None
    assert wrong > 20e-6
