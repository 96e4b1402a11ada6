"""Residuals of many vectors against the evaluation of each, which computes them with their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ipmclab import Run, load_actuator, simulate
from ipmclab.identification.problem.free import Prior, parse_free
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun, Reading, prepare
from ipmclab.identification.search.pose import entries_at, problem_at
from ipmclab.identification.search.starts.start import StartingPoint
from ipmclab.model import Actuator
from ipmclab.posterior.many import residuals

FRIEND = load_actuator("friend-2")
WITH_LEAK = load_actuator("friend-1-measured")
NOISE = {"current": 1e-4, "displacement": 2e-6, "force": 2e-6}
Changed = Callable[[PreparedRun], PreparedRun]


def read(place: int, outputs: tuple[str, ...], strip: Actuator, *, hold: Any, irregular: bool) -> PreparedRun:
    """A noisy run, of another voltage and rate at each place."""
    generator = np.random.default_rng(20261121 + place)
    signal, rate = (("step 1 V", 20.0), ("sine 1 V 0.3 Hz", 25.0))[place]
    clean = simulate(strip, signal, duration=6.0, rate=rate)
    time = clean.time + (0.3 / rate * generator.random(len(clean)) if irregular else 0.0)
    noisy = {name: clean.channels[name] + NOISE[name] * generator.standard_normal(len(clean)) for name in outputs}
    record = prepare(Run.from_arrays(time=time, voltage=clean.voltage, hold=hold, **noisy), place, outputs, ())
    return replace(record, start="stated rest")


def posed(
    *,
    strip: Actuator = FRIEND,
    free: str = "electrical",
    per_run: tuple[str, ...] = (),
    known: Mapping[str, float] | None = None,
    outputs: tuple[str, ...] = ("current",),
    hold: str = "zero",
    irregular: bool = False,
    changed: Changed = lambda record: record,
) -> Problem:
    """The problem of two runs."""
    records = [changed(read(place, outputs, strip, hold=hold, irregular=irregular)) for place in range(2)]
    priors = {name: Prior(strip[name], uncertainty) for name, uncertainty in (known or {}).items()}
    names = replace(parse_free(strip.parameter_values, free, per_run), priors=priors)
    point = StartingPoint({}, {record.place: record.at_its_rows for record in records})
    noise = {(record.place, output): NOISE[output] for record in records for output in outputs}
    return problem_at(strip, names, records, point, noise)


def clipped(record: PreparedRun) -> PreparedRun:
    """The largest readings are bounds, and some are missing."""
    found: dict[str, Reading] = {}
    for output, reading in record.readings.items():
        most = np.quantile(reading.values, 0.8)
        side = np.where(reading.values > most, 1, 0).astype(np.int8)
        used = np.arange(len(side)) % 7 > 0
        found[output] = replace(reading, values=np.minimum(reading.values, most), used=used, side=side)
    return replace(record, readings=found)


ALL = ("current", "displacement", "force")
BOTH = "electrical,coupling,observation.offset.force,observation.drift.force"
SIDE_BY_SIDE: Mapping[str, dict[str, Any]] = {
    "current": {},
    "current, straight lines": {"hold": "first"},
    "current, an irregular clock": {"irregular": True},
    "current, read before its edge": {"hold": "zero-before"},
    "current, contacts of each run": {"per_run": ("circuit.contact_resistance",)},
    "current behind a shunt": {"changed": lambda record: replace(record, series_resistance=0.4)},
    "current, edges known": {"hold": "unknown", "changed": lambda record: replace(record, known_delay=0.013)},
    "current, clipped": {"changed": clipped},
    "current, some known beforehand": {"known": {"circuit.dc_resistivity": 2.0, "circuit.branches.0.resistivity": 0.1}},
    "current, a zero of the sensor": {"free": "electrical,observation.offset.current"},
    "all outputs": {"free": BOTH, "outputs": ALL},
    "all outputs, straight lines": {"free": BOTH, "outputs": ALL, "hold": "first"},
    "force behind a shunt": {
        "free": "coupling",
        "outputs": ("force",),
        "changed": lambda record: replace(record, series_resistance=0.4),
    },
    "displacement, clipped": {"free": "coupling", "outputs": ("displacement",), "changed": clipped},
}
ONE_BY_ONE: Mapping[str, dict[str, Any]] = {
    "current, edges unknown": {"hold": "unknown"},
    "current, start unknown": {"changed": lambda record: replace(record, start="free")},
    "force, an irregular clock": {"free": "coupling", "outputs": ("force",), "irregular": True},
    "force, start unknown": {
        "free": "coupling",
        "outputs": ("force",),
        "changed": lambda record: replace(record, start="free"),
    },
    "current through a leak": {"strip": WITH_LEAK, "free": "circuit.dc_resistivity,circuit.branches.0.resistivity"},
}


@pytest.mark.parametrize("name", [*SIDE_BY_SIDE, *ONE_BY_ONE])
def test_costs_are_those_of_each_vector(name: str) -> None:
    problem = posed(**{**SIDE_BY_SIDE, **ONE_BY_ONE}[name])
    known = {unknown.base: problem.base[unknown.base] for unknown in problem.unknowns if unknown.base in problem.base}
    delays = {record.place: record.at_its_rows for record in problem.records}
    middle = entries_at(problem, StartingPoint(known, delays))
    spread = [
        0.3 if unknown.log else 0.3 * abs(entry) + 1e-3 for unknown, entry in zip(problem.unknowns, middle, strict=True)
    ]
    foreign = [u.beforehand is None for u in problem.unknowns if u.prior is not None]

    @settings(max_examples=10, deadline=None, database=None)
    @given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 9))
    def agree(seed: int, count: int) -> None:
        drawn = middle + spread * np.random.default_rng(seed).standard_normal((count, len(middle)))
        thetas = np.clip(drawn, problem.lower, problem.upper)
        found = sum(
            (rows * rows).sum(axis=1) for rows in (*residuals(problem, thetas).values(), problem.from_priors(thetas))
        )
        for theta, cost in zip(thetas, found, strict=True):
            each = problem.evaluate(theta)
            ranges = each.residual[len(each.residual) - each.beforehand :][foreign]
            assert cost == pytest.approx(each.cost - ranges @ ranges, rel=1e-10)

    agree()


@pytest.mark.parametrize("name", SIDE_BY_SIDE)
def test_strips_at_rest_go_side_by_side(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = posed(**SIDE_BY_SIDE[name])
    monkeypatch.delattr(Problem, "outputs")
    residuals(problem, np.array([[u.entry(u.inside(1.0)) for u in problem.unknowns]]))
