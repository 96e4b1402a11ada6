"""What a reading moves by as the delay grows, against differences."""

from __future__ import annotations

import numpy as np

from ipmclab.model.numerics.timeline import timeline


def test_a_row_on_a_corner_of_the_voltage_takes_the_mean_of_both_slopes() -> None:
    time = 0.1 * np.arange(12)
    voltage = np.array([0.0, 1.0, 2.0, 1.5, 1.0, 1.0, 1.0, -2.0, 0.0, 3.0, 2.0, 2.0])
    step = 1e-3  # [s]; the voltage consists of straight lines, so that the difference is exact
    later, earlier = (timeline(time, voltage, "first", delay=delay, from_rest=True) for delay in (step, -step))
    inside = slice(1, -1)
    found = timeline(time, voltage, "first", delay=0.0, from_rest=True).reading_rate[inside]
    np.testing.assert_allclose(found, (later.reading - earlier.reading)[inside] / (2.0 * step), rtol=1e-9, atol=1e-9)
