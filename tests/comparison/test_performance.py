"""Work and efficiency: which runs of a strip belong together, and what is left out where something was not measured."""

from __future__ import annotations

import pytest

from ipmclab.comparison.performance import performances
from ipmclab.comparison.table import RunRow
from ipmclab.quality.metrics import Metric

FREE, BLOCKED, ENERGY = "displacement.largest", "force.largest", "current.energy_to_peak"


def run(name: str, sample: str = "a", signal: str = "step 1 V", humidity: float = 80.0, **metrics: float) -> RunRow:
    """A run with some metrics: ``free``, ``blocked`` and ``energy``."""
    keys = {"free": FREE, "blocked": BLOCKED, "energy": ENERGY}
    values = {keys[key]: Metric(key, "", value, "", None, "") for key, value in metrics.items()}
    return RunRow(name, sample, "", "", signal, "step", {"voltage": 1.0, "humidity": humidity}, values)


def test_work_is_of_the_means_of_the_runs_that_differ_in_nothing() -> None:
    rows = [
        run("1", free=-2e-3, energy=5e-4),
        run("2", free=4e-3, energy=35e-4),
        run("3", blocked=-4e-3, humidity=79.0),
    ]
    (found,) = performances(rows, {})
    assert (found.free_displacement, found.blocked_force) == (pytest.approx(3e-3), pytest.approx(4e-3))
    assert found.work == pytest.approx(3e-6)
    assert found.efficiency == pytest.approx(1.5e-3)  # of 2 mJ
    assert found.work_density is None
    assert (found.sample, found.signal, found.runs) == ("a", "step 1 V", ("1", "2", "3"))
    assert found.conditions == {"humidity": pytest.approx(79.6667, abs=1e-4)}


@pytest.mark.parametrize(
    "other",
    [
        run("2", blocked=1e-3, signal="step 1 V for 5 s"),
        run("2", blocked=1e-3, sample="b"),
        run("2", blocked=1e-3, humidity=60.0),
        run("2", blocked=0.0),  # a load cell that was not connected
        run("2", free=1e-3),
    ],
)
def test_a_push_of_another_run_is_no_partner(other: RunRow) -> None:
    assert performances([run("1", free=1e-3), other], {}) == ()


def test_two_runs_without_a_sample_may_be_of_two_strips() -> None:
    assert performances([run("1", sample="", free=1e-3), run("2", sample="", blocked=1e-3)], {}) == ()
    (found,) = performances([run("1", sample="", free=1e-3, blocked=1e-3)], {})
    assert found.runs == ("1",)


def test_an_efficiency_needs_the_energy_of_the_free_runs() -> None:
    """The energy that went in until the displacement was largest: none is known of a blocked run."""
    for free in (run("1", free=1e-3), run("1", free=1e-3, energy=0.0)):
        (found,) = performances([free, run("2", blocked=1e-3, energy=1.0)], {})
        assert found.efficiency is None
