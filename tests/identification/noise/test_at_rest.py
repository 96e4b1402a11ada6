"""What rows at 0 V show of a sensor, where a wire is touched meanwhile and where none is."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.identification.noise.at_rest import without_spikes
from ipmclab.model.variants import with_stages


def test_noise_about_a_slope_stays_as_it_is() -> None:
    generator = np.random.default_rng(20261123)
    time = np.arange(500) / 25.0
    values = 3.0 * time + generator.standard_normal(500)
    assert np.array_equal(without_spikes(time, values, 0.0), values)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_readings_are_no_spikes(count: int) -> None:
    values = np.arange(float(count))
    assert np.array_equal(without_spikes(np.arange(float(count)), values, 0.1), values)


def test_a_touched_wire_is_brought_back_to_where_noise_would_end() -> None:
    generator = np.random.default_rng(20261123)
    time = np.arange(125) / 25.0
    values = 1e-5 * generator.standard_normal(125)
    values[70:73] = 0.04
    kept = without_spikes(time, values, 0.0)
    assert np.abs(kept).max() < 1e-4
    assert np.array_equal(np.delete(kept, [70, 71, 72]), np.delete(values, [70, 71, 72]))


def test_a_drift_that_rows_at_rest_have_is_one_beside_a_wrong_model_too() -> None:
    # Of three branches two are fitted.
    drift = 2e-5
    truth = with_stages(load_actuator("friend-2"), "branches=3").replace(
        **{"circuit.branches.2.resistivity": 150.0, "circuit.branches.2.permittivity": 0.6}
    )
    clean = simulate(truth, "step 1 V delay=10 s", duration=40.0, rate=25.0)
    assert clean.current is not None
    noise = 1e-5 * np.random.default_rng(20261123).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise + drift * clean.time)
    found = identify(load_actuator("friend-2"), run, free="electrical").observations[0].drift
    assert found.get("current", 0.0) == pytest.approx(drift, abs=2e-6)
