"""The least-squares problem of runs in several states: its derivatives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, Sample, load_actuator, simulate
from ipmclab.identification.environment.with_states import with_states
from ipmclab.identification.problem.free import parse_free
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import prepare
from ipmclab.identification.problem.unknowns import WATER
from ipmclab.identification.search.pose import entries_at, problem_at
from ipmclab.identification.search.starts.start import StartingPoint

STRIP = load_actuator("friend-2+environment.permittivity+environment.coupling_gain+environment.thickness")
FREE = [
    "circuit.branches.0.permittivity",
    "coupling.gain",
    "beam.density",
    "environment",
    "age.runs.coupling.gain",
    "age.hours.circuit.branches.0.permittivity",
]


def problem() -> Problem:
    """One run assumed in equilibrium, two weighed, one out of water."""
    clean = simulate(STRIP, "step 0.5 V", duration=2, rate=10)
    clean = replace(clean, force=None, applied_voltage=None)
    sample = Sample(id="a", dry_mass=1.1e-4)
    read = {"uncertainties": {"relative_humidity": 2.0}}
    ways = [
        read,
        {"mass": 1.2e-4, "sample": sample},
        {"mass": 1.17e-4, "sample": sample},
        {"minutes_out_of_water": 5.0},
    ]
    runs: list[Run] = []
    for number, way in enumerate(ways):
        known = {"temperature": 20.0 + 5.0 * number, "relative_humidity": 60.0 + 10.0 * number, **way}
        about = RunMetadata(origin="simulated", recorded_at=f"2026-11-23T1{number}:00:00+00:00", **known)
        runs.append(replace(clean, metadata=about))
    names = parse_free(STRIP.parameter_values, FREE)
    records = [prepare(run, place, ["current", "displacement"], ()) for place, run in enumerate(runs)]
    records = with_states(STRIP, runs, records, names.age)
    noise = {(place, output): 1e-4 for place in range(len(runs)) for output in ("current", "displacement")}
    start = StartingPoint({name: STRIP[name] for name in names.shared}, {})
    return problem_at(STRIP, names, records, start, noise)


def test_derivatives_by_laws_water_and_age_are_exact() -> None:
    posed = problem()
    start = StartingPoint({name: STRIP[name] for name in STRIP.parameter_values}, {})
    theta = entries_at(posed, start)
    ages = [place for place, unknown in enumerate(posed.unknowns) if unknown.base.startswith("age.")]
    theta[ages] = [0.3, -0.2]
    here = posed.evaluate(theta).jacobian
    bases = {unknown.base for unknown in posed.unknowns if unknown.is_water}
    assert bases == {"observation.humidity", "observation.water_content"}
    assert sum(unknown.base == "observation.ionic_groups" for unknown in posed.unknowns) == 1
    for place, unknown in enumerate(posed.unknowns):
        step = np.where(np.arange(len(theta)) == place, 1e-5 * max(1.0, abs(theta[place])), 0.0)
        sides = [posed.evaluate(theta + sign * step).residual for sign in (1.0, -1.0)]
        slope = (sides[0] - sides[1]) / (2.0 * step[place])
        size = max(float(np.abs(slope).max()), 1e-6)
        assert here[:, place] == pytest.approx(slope, abs=1e-5 * size), unknown.name


def test_derivatives_by_what_is_held_follow_the_laws_too() -> None:
    posed = problem()
    theta = entries_at(posed, StartingPoint({name: STRIP[name] for name in STRIP.parameter_values}, {}))
    name = "geometry.thickness"
    found = posed.fixed_jacobian(theta, [name])[:, 0]
    step = 1e-6 * STRIP[name]
    sides = [posed.without([], {name: STRIP[name] + sign * step}).evaluate(theta).residual for sign in (1.0, -1.0)]
    slope = (sides[0] - sides[1]) / (2.0 * step)
    assert found == pytest.approx(slope, abs=1e-5 * float(np.abs(slope).max()))


def test_weighed_runs_share_the_error_of_the_ionic_groups() -> None:
    """What is known of their water: the mass errs in each, the ionic groups in all at once."""
    posed = problem()
    here = posed.evaluate(entries_at(posed, StartingPoint({name: STRIP[name] for name in STRIP.parameter_values}, {})))
    known = here.jacobian[len(here.jacobian) - here.beforehand :]
    columns = [place for place, unknown in enumerate(posed.unknowns) if unknown.prior is not None]
    covariance = np.linalg.inv(known[:, columns].T @ known[:, columns])
    first, second = (
        columns.index(place) for place, one in enumerate(posed.unknowns) if one.name in (f"{WATER}[1]", f"{WATER}[2]")
    )
    states = [record.state for record in posed.records]
    assert states[1] is not None
    assert states[2] is not None
    assert covariance[first, first] == pytest.approx(states[1].standard_uncertainty ** 2)
    assert covariance[first, second] == pytest.approx(
        math.prod(one.shared["observation.ionic_groups"] for one in states[1:3] if one is not None)
    )
