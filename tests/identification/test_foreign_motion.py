"""A motion alone of a foreign record: nothing confines where the edges of the voltage lie between its rows."""

from __future__ import annotations

import numpy as np
import pytest

import ipmclab
from ipmclab import Actuator, Run
from ipmclab.model import simulate_outputs
from ipmclab.model.variants import with_stages
from tests.identification.brief import brief

RATE, STEP, FINE = 25.0, 5.0, 40  # rows a second, s, and instants of the true voltage in a row
TRUE = ("coupling.p1", "coupling.p2", "relaxation.displacement.0.time_constant")


def strip(faster: float, ratio: float, seconds: float) -> Actuator:
    """One that answers so many times faster than the included one, with a slow mode."""
    actuator = with_stages(ipmclab.load_actuator("friend-2"), "relaxation.displacement=1")
    own = actuator.parameter_values
    return actuator.replace(
        **{name: faster * own[name] for name in ("coupling.p1", "coupling.p2")},
        **{"relaxation.displacement.0.ratio": ratio, "relaxation.displacement.0.time_constant": seconds},
    )


def recorded(actuator: Actuator, rows_late: float, noise: float, seed: int) -> Run:
    """20 s of a step whose edge lies some rows after that of the recorded voltage; noise as a part of the range."""
    fine = np.arange(int(20.0 * RATE) * FINE) / (RATE * FINE)
    voltage = np.where(fine >= STEP + rows_late / RATE - 1e-9, 1.5, 0.0)
    motion = np.asarray(simulate_outputs(actuator, fine, voltage, "zero", outputs=["displacement"])[0])[::FINE]
    time = fine[::FINE]
    readings = motion + np.random.default_rng(seed).normal(0.0, noise * np.ptp(motion), len(time))
    return Run.from_arrays(time=time, voltage=np.where(time >= STEP, 1.5, 0.0), displacement=readings, hold="unknown")


@pytest.mark.parametrize(
    ("faster", "rows_late"), [(4.3, 2.1), (2.1, 2.9), (0.7, 2.8), (1.4, 1.5), (4.0, 1.8), (1.6, -2.3)]
)
def test_channels_that_are_rows_apart_make_no_pole_known_that_is_not(faster: float, rows_late: float) -> None:
    """Half a row was taken for the most: poles of the coupling then lay five standard errors off, called determined."""
    actuator = strip(faster, 0.6, 3.0)
    fit = brief(actuator, recorded(actuator, rows_late, 3e-3, 7), "coupling,relaxation", followed=False)
    truth = {name: actuator.parameter_values[name] for name in TRUE} | {"observation.delay[0]": rows_late / RATE}
    for name, value in truth.items():
        low, high = fit.parameters[name].interval
        assert low <= value <= high, name


@pytest.mark.parametrize(
    ("faster", "ratio", "seconds", "rows_late", "noise"),
    [(1.15, 0.65, 2.15, -2.42, 1.36e-3), (10.5, 0.86, 1.5, -1.83, 3e-3)],
)
def test_no_fit_leaves_more_than_the_true_strip(
    faster: float, ratio: float, seconds: float, rows_late: float, noise: float
) -> None:
    """Edges held near the rows left 24 and 65 of chi-square more than the noise."""
    actuator = strip(faster, ratio, seconds)
    run, clean = recorded(actuator, rows_late, noise, 1), recorded(actuator, rows_late, 0.0, 1)
    assert run.displacement is not None
    assert clean.displacement is not None
    fit = brief(actuator, run, "coupling,relaxation", followed=False)
    assert np.sum(fit.residuals[0]["displacement"] ** 2) < np.sum((run.displacement - clean.displacement) ** 2)


@pytest.mark.parametrize("seed", [18, 20])
def test_a_fit_with_the_stage_that_does_not_show_is_asked_for_too(seed: int) -> None:
    """A zero beside a pole took the part of the slow mode, which then did not show: P_1d known to 2 %, 30 times off."""
    actuator = strip(5.8, 0.5617, 3.1985)
    fit = brief(actuator, recorded(actuator, 1.1447, 2.986e-3, seed), "coupling,relaxation", followed=False)
    found = fit.parameters["coupling.p1"]
    assert found.interval[0] <= actuator.parameter_values["coupling.p1"] <= found.interval[1] or not found.determined
