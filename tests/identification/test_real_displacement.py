"""The displacement of a real strip's step, of which no model is complete."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.real_records import cut, records, strip
from ipmclab import identify
from ipmclab.model.variants import with_stages


def test_a_sensor_drifts_by_no_more_than_its_rows_at_0_v_do(real_runs: Path) -> None:
    """A slope and a slow start of the strip that cancel: least squares alone has 0.9 mm here."""
    assert real_runs.is_dir()
    run = cut(records()["step_2V_poor"], -5.0, 60.0, channels=("displacement",))
    fit = identify(with_stages(strip(), "relaxation.displacement=1"), run, free="coupling,relaxation")
    before = run.voltage == 0.0
    assert run.displacement is not None
    (slope, _), spread = np.polyfit(run.time[before], run.displacement[before], 1, cov=True)
    drift = fit.observations[0].drift["displacement"]
    # Neighbours of that record are alike: its slope is known five times worse than white noise would say.
    assert abs(drift) < abs(slope) + 5.0 * 3.3 * np.sqrt(spread[0, 0])
    left = fit.residuals[0]["displacement"]
    assert np.sqrt(np.nanmean(left**2)) < 0.03 * np.ptp(run.displacement)


def test_a_zero_and_a_slow_start_that_cancel_are_no_bending(real_runs: Path) -> None:
    """Both are metres in that fit: "the displacement reaches 1.965e+04 mm" was said of a motion of 1.3 mm."""
    assert real_runs.is_dir()
    run = cut(records()["step_1V"], -5.0, 60.0, channels=("displacement",))
    fit = identify(with_stages(strip(), "relaxation.displacement=2"), run, free="coupling,relaxation")
    assert fit.observations[0].start == "free"
    assert not [finding for finding in fit.findings if finding.code == "large-bending"]
