"""Records made shorter for a search: the model answers alike, little is lost, and the fit is the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.identification.problem import means
from ipmclab.identification.problem.record import prepare
from ipmclab.identification.search.tangent import entry_errors, gauss_newton
from ipmclab.identification.solved import solved
from ipmclab.model.outputs import simulate_outputs
from ipmclab.statespace.terms import Terms
from tests.identification.brief import brief

STRIP = load_actuator("friend-2+relaxation.displacement").replace(
    **{"relaxation.displacement.0.ratio": 0.6, "relaxation.displacement.0.time_constant": 60.0}
)


def long_run(hold: str, *, noise: float = 1.0) -> Run:
    """Twenty minutes at 10 S/s: two steps, read with noise, the voltage as it was sensed."""
    generator = np.random.default_rng(20261121)
    rows = 12_000
    time = np.arange(rows) / 10.0
    volts = np.where(time < 5.0, 0.0, np.where(time < 700.0, 1.0, -0.5)) + noise * 1e-3 * generator.standard_normal(
        rows
    )
    run = simulate(STRIP, volts, duration=1200.0, rate=10.0, hold=hold)  # type: ignore[arg-type]
    assert run.current is not None
    assert run.displacement is not None
    return Run.from_arrays(
        time=run.time,
        voltage=run.voltage,
        current=run.current + noise * 1e-4 * generator.standard_normal(rows),
        displacement=run.displacement + noise * 5e-6 * generator.standard_normal(rows),
        hold=hold,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("hold", ["zero", "zero-before"])
def test_the_model_answers_to_fewer_rows_as_to_all(hold: str) -> None:
    run = long_run(hold, noise=0.0)
    record = prepare(run, 0, ["current", "displacement"], ())
    shorter = means.in_means(record)
    assert shorter is not None
    assert len(shorter.run) < 0.1 * len(run)
    outputs = ["current", "displacement"]
    found = simulate_outputs(STRIP, shorter.run.time, shorter.run.voltage, hold, outputs=outputs)  # type: ignore[arg-type]
    for row, output in enumerate(outputs):
        reading = shorter.readings[output]
        away = np.abs(found[row] - reading.values)[reading.used]
        assert away.max() < 2e-3 * np.ptp(reading.values), output


def test_a_voltage_that_never_stands_still_keeps_its_rows() -> None:
    time = np.arange(12_000) / 10.0
    run = Run.from_arrays(time=time, voltage=np.sin(0.6 * time), current=np.cos(0.6 * time))
    assert means.in_means(prepare(run, 0, ["current"], ())) is None
    short = Run.from_arrays(time=time[:500], voltage=np.ones(500), current=np.ones(500))
    assert means.in_means(prepare(short, 0, ["current"], ())) is None
    straight = long_run("first", noise=0.0)
    assert means.in_means(prepare(straight, 0, ["current"], ())) is None


def test_squares_and_information_of_means_are_those_of_all_rows() -> None:
    """What is lost is what varies within a mean, under 0.1 % of any parameter."""
    strip, generator = load_actuator("friend-2"), np.random.default_rng(20261123)
    clean = simulate(strip, "step 1 V delay=5 s", duration=300.0, rate=25.0)
    assert clean.current is not None
    current = clean.current + 1e-4 * generator.standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, hold="unknown")
    estimate = brief(strip, run, followed=False).estimate
    problem, theta = estimate.problem.plain, estimate.solution.theta
    fewer = problem.on_means
    assert fewer is not None
    rows, shorter = problem.evaluate(theta), fewer.evaluate(theta)
    weights = fewer.records[0].readings["current"].weights
    assert weights is not None
    counts = np.rint(weights**2).astype(int)
    assert counts.sum() == len(run)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    within = rows.residual[: len(run)] - np.repeat(np.add.reduceat(rows.residual[: len(run)], first) / counts, counts)
    assert rows.cost == pytest.approx(shorter.cost + float(within @ within), abs=0.2)  # of chi-square
    errors = entry_errors(rows), entry_errors(shorter)
    assert np.abs(errors[1] / errors[0] - 1.0).max() < 5e-4


def test_a_drift_is_beside_means_what_it_is_beside_all_rows() -> None:
    """It begins at the first reading, beside a zero that is an unknown: the mean of the first rows lies later."""
    strip, generator = load_actuator("friend-2"), np.random.default_rng(20261128)
    clean = simulate(strip, "step 1 V delay=5 s", duration=300.0, rate=25.0)
    assert clean.current is not None
    current = clean.current + 1e-3 * clean.time / 300.0 + 1e-4 * generator.standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current + 1e-3, hold="zero")
    found = solved(brief(strip, run, "circuit.dc_resistivity", followed=False))
    assert [unknown.base for unknown in found.problem.unknowns] == [
        "circuit.dc_resistivity",
        "observation.offset.current",
    ]
    assert found.correlated.zeros[0, "current"].terms == Terms(trend=True)
    fewer = found.problem.on_means
    assert fewer is not None
    there = fewer.evaluate(found.solution.theta)
    np.testing.assert_allclose(entry_errors(there), entry_errors(found.solution.evaluation), rtol=5e-4)
    assert np.abs(gauss_newton(there)[0] / entry_errors(there)).max() < 0.5


def test_readings_that_are_left_out_stay_out_of_the_means() -> None:
    run = long_run("zero", noise=0.0)
    assert run.current is not None
    wrong = run.current.copy()
    wrong[6000:6400] = 7.0
    record = prepare(Run.from_arrays(time=run.time, voltage=run.voltage, current=wrong), 0, ["current"], ())
    used = record.readings["current"].used.copy()
    used[6000:6400] = False
    record.readings["current"].__dict__["used"] = used
    shorter = means.in_means(record)
    assert shorter is not None
    assert shorter.readings["current"].values.max() < 1.0


def test_the_fit_is_that_of_every_row(monkeypatch: pytest.MonkeyPatch) -> None:
    run = long_run("zero")
    free = "coupling.gain,relaxation"
    quick = identify(STRIP, run, free=free)
    monkeypatch.setattr(means, "LONG", 10**9)
    every = identify(STRIP, run, free=free)
    for name, one in every.parameters.items():
        assert quick.parameters[name].value == pytest.approx(one.value, abs=0.02 * one.standard_error), name
        assert quick.parameters[name].standard_error == pytest.approx(one.standard_error, rel=0.02), name


def test_a_mean_without_a_reading_is_not_used_and_a_bound_is_of_its_own_row() -> None:
    """A gap longer than a mean; bounds in the first rows, each of them its own mean, and late, among others."""
    run = long_run("zero")
    record = prepare(run, 0, ["current"], ())
    reading = record.readings["current"]
    used, side = reading.used.copy(), np.zeros(len(run), dtype=np.int8)
    used[4000:5000] = False
    side[[0, 1]], side[3000:3010] = 1, -1
    marked = replace(reading, used=used, side=side, values=np.where(used, reading.values, 0.0))
    shorter = means.in_means(replace(record, readings={"current": marked}))
    assert shorter is not None
    told = shorter.readings["current"]
    first = np.searchsorted(run.time, shorter.run.time)
    assert told.side[:3].tolist() == [1, 1, 0]
    assert not told.side[2:].any()
    gap = (first > 4200) & (first < 4800)
    assert gap.any()
    assert not told.used[gap].any()
    assert told.used[~((first >= 3900) & (first <= 5100))].all()
    assert np.abs(told.values[told.used]).max() <= np.abs(reading.values).max()


@pytest.mark.parametrize("size", [0.01, 100.0])
def test_what_stands_still_is_told_by_the_largest_voltage(size: float) -> None:
    run = long_run("zero")
    times = [
        shorter.run.time
        for one in (run, replace(run, voltage=size * run.voltage))
        if (shorter := means.in_means(prepare(one, 0, ["current"], ()))) is not None
    ]
    np.testing.assert_array_equal(*times)
