"""Headline numbers: readings against the thesis's equations done the long way, the library's strips, and the search."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from benchmarks.printed.headline_fit import Prior, fit_headlines
from benchmarks.printed.measured import measured_strip
from benchmarks.published import CASES, fit
from ipmclab import InputError, load_actuator
from ipmclab.data import PublishedMeasurement, measured_contacts, measured_names, measured_parameters, published_sample
from ipmclab.model import Actuator, library_names
from ipmclab.prediction.headline import DURATION, RATE, READINGS, HeadlineRun, compare, headline_runs
from ipmclab.quality import measure
from tests.independent.thesis import FRIEND_2, respond

ROWS = round(DURATION * RATE)
TIME = np.arange(ROWS) / RATE


@pytest.fixture(scope="module")
def friend_2() -> Actuator:
    return load_actuator("friend-2")


def numbers_of(strip: Actuator, run: HeadlineRun, contact: float) -> HeadlineRun:
    """The run as it would have been printed of this strip."""
    found = []
    for row in compare(strip, run, contact):
        text = f"{row.quantity.to_display(row.model):.12g} {row.quantity.display_unit}"
        (printed,) = (one for one in run.numbers if one.metric == row.metric)
        found.append(replace(printed, number=text, qualifier="stated"))
    return replace(run, numbers=tuple(found))


def test_readings_are_those_of_the_equations_done_the_long_way(friend_2: Actuator) -> None:
    half = round(5.0 * RATE)
    sine = np.sin(2.0 * math.pi * 0.1 * TIME)
    square = np.where(np.arange(ROWS) // half % 2 == 0, 1.0, -1.0)
    step, of_sine, of_square = (respond(FRIEND_2, volts, RATE, "zero") for volts in (np.ones(ROWS), sine, square))
    last = slice(-2 * half, None)
    expected = {
        ("step", "peak_current"): 1.0 / 16.0 * (1.0 - step["applied_voltage"][0]),
        ("step", "steady_current"): step["current"][-1],
        ("step", "max_force"): step["force"].max(),
        ("sine", "peak_current"): np.ptp(of_sine["current"][last]) / 2.0,
        ("sine", "max_force"): np.ptp(of_sine["force"][last]) / 2.0,
        ("square", "peak_current"): -of_square["current"][half],
        ("square", "half_period_end_current"): of_square["current"][half - 1],
        ("square", "max_force"): np.ptp(of_square["force"][last]) / 2.0,
    }
    found = {
        (row.run.waveform, row.metric): row.model for run in headline_runs(2, "force") for row in compare(friend_2, run)
    }
    assert set(found) == set(expected)
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, rel=1e-9), key


def test_a_lower_bound_is_only_missed_from_below(friend_2: Actuator) -> None:
    step = headline_runs(2, "displacement")[0]
    (peak,) = (row for row in compare(friend_2, step) if row.metric == "peak_current")
    assert peak.lower_bound
    assert not peak.agrees
    assert replace(peak, model=0.5).difference == 0.0
    assert step.value("peak_current") == pytest.approx(0.2048)
    with pytest.raises(KeyError):
        step.value("max_force")


def test_there_is_a_strip_for_each_sample_and_for_both_states_of_sample_2() -> None:
    assert set(measured_names()) == {case.name for case in CASES}
    assert set(measured_names()) == {name for name in library_names() if "measured" in name}
    with pytest.raises(InputError, match="choose one of friend-2-measured-displacement, friend-2-measured-force"):
        load_actuator("friend-2-measured")
    samples = {load_actuator(name).sample for name in measured_names()}
    assert {sample.id for sample in samples if sample} == {f"friend-{number}" for number in range(1, 8)}
    with pytest.raises(
        InputError,
        match="no strip of the thesis is called 'friend-2'; known: 'friend-1-measured', 'friend-2-measured-d",
    ):
        measured_strip("friend-2")


@pytest.mark.parametrize("name", measured_names())
def test_a_strip_gives_every_printed_number_within_its_tolerance(name: str) -> None:
    """By the stated readings, and again by the metrics that ``measure`` takes of any run."""
    strip = measured_strip(name)
    assert {run.figure for run in strip.runs} == set(strip.contacts)
    assert all(ohms >= 0.0 for ohms in strip.contacts.values())
    limits = {"current": 0.20, "displacement": 0.10, "force": 0.20}
    for run in strip.runs:
        record = run.simulate(strip.actuator, strip.contacts[run.figure])
        metrics = {(metric.channel, metric.name): abs(metric.value) for metric in measure(record)}
        for row in compare(strip.actuator, run, strip.contacts[run.figure]):
            channel = row.metric.rpartition("_")[2]
            limit = 0.15 if row.metric == "peak_current" else limits[channel]
            assert row.reading.tolerance == limit
            names = {
                "half_period_end_current": ("half_period_end",),
                "steady_current": ("steady_value", "mean_of_last_tenth"),
                "peak_current": ("amplitude",) if run.waveform == "sine" else ("largest",),
            }.get(row.metric, ("peak_at_first_edge", "largest") if run.waveform == "step" else ("amplitude",))
            for value in (row.model, *(metrics[channel, kind] for kind in names)):
                error = value / row.published - 1.0
                assert abs(min(error, 0.0) if row.lower_bound else error) <= limit, (run.figure, row.metric, value)


@pytest.mark.parametrize("name", measured_names())
def test_a_file_says_of_every_parameter_where_it_comes_from(name: str) -> None:
    text = (resources.files("ipmclab.model") / "library" / f"{name}.toml").read_text(encoding="utf-8")
    actuator = load_actuator(name)
    sources = {source.name: source for source in measured_parameters(name)}
    assert list(sources) == list(actuator.parameter_values)
    for source in sources.values():
        assert f"# {source.role}" in text
        assert source.reason in text
        if source.factor is None or source.usual_factor is None:
            assert source.name not in actuator.standard_uncertainties
            continue
        halved = math.log(source.factor) <= 0.5 * math.log(source.usual_factor)
        assert source.role == ("determined" if halved else "free") or abs(source.factor**2 - source.usual_factor) < 0.05
        spread = abs(actuator[source.name]) * math.log(source.factor)
        assert actuator.standard_uncertainties[source.name] == pytest.approx(spread, rel=0.08)
    tomllib.loads(text)
    published = published_sample(int(name[7]))
    assert actuator.sample is not None
    assert published.hydrated_mass is not None
    assert (actuator.sample.hydrated_mass, actuator.sample.membrane) == (published.hydrated_mass, published.membrane)
    volume = 30e-3 * 5e-3 * actuator["geometry.thickness"]
    assert actuator["beam.density"] * volume == pytest.approx(published.hydrated_mass, rel=1e-3)


def test_the_file_is_what_the_program_finds() -> None:
    """Nothing in the search is random: sample 6 once more."""
    (case,) = (case for case in CASES if case.sample == 6)
    found = fit(case)
    for name, value in load_actuator(case.name).parameter_values.items():
        assert found.actuator[name] == pytest.approx(value, rel=2e-3), name
    for figure, ohms in measured_contacts(case.name).items():
        assert found.contacts[figure] == pytest.approx(ohms, abs=0.02)


def test_a_strip_is_found_again_from_its_own_numbers() -> None:
    """Sample 6's runs of a strip elsewhere: what is called determined comes back within its spread."""
    (case,) = (case for case in CASES if case.sample == 6)
    base = load_actuator(case.name)
    truth = base.replace(
        **{
            "circuit.dc_resistivity": 140.0,
            "circuit.branches.1.resistivity": 40.0,
            "circuit.branches.1.permittivity": 0.12,
            "coupling.gain": 2e-9,
            "coupling.p2": 4.0,
        }
    )
    runs = [numbers_of(truth, run, ohms) for run, ohms in zip(case.runs, (0.0, 1.0, 2.0), strict=True)]
    names = ("circuit.dc_resistivity", "circuit.branches.1.permittivity", "coupling.gain", "coupling.p2")
    priors = [Prior(name, base[name], 10.0) for name in names]
    start = truth.replace(**{prior.name: prior.usual for prior in priors})
    found = fit_headlines(start, runs, priors)
    assert all(row.agrees for row in found.comparisons)
    for constraint in found.constraints[: len(priors)]:
        assert constraint.determined, constraint
        off = abs(math.log(found.actuator[constraint.name] / truth[constraint.name]))
        assert off <= math.log(constraint.spread), constraint
        assert found.factor({constraint.name: 1.0}) == pytest.approx(constraint.spread, rel=1e-9)
    both = found.factor({"coupling.gain": 1.0, "coupling.p2": -1.0})
    apart = [math.log(found.factor({name: 1.0})) for name in ("coupling.gain", "coupling.p2")]
    assert abs(apart[0] - apart[1]) <= math.log(both) <= sum(apart)  # between all and nothing in common


@pytest.mark.parametrize(
    ("priors", "message"),
    [
        ([Prior("beam.module", 1.0, 2.0)], "unknown parameter 'beam.module'; did you mean 'beam.modulus'"),
        ([Prior("beam.modulus", 0.0, 2.0)], "beam.modulus: the usual value is 0 and the factor 2; give a usual value"),
        ([Prior("beam.modulus", 1e9, 1.0)], "beam.modulus: the usual value is 1e\\+09 and the factor 1; give"),
        ([], "runs: no runs; give one published run or more"),
    ],
)
def test_what_cannot_be_searched_for_is_refused(friend_2: Actuator, priors: list[Prior], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fit_headlines(friend_2, headline_runs(6) if priors else [], priors)


def test_every_reading_is_of_something_printed() -> None:
    printed = {
        (run.waveform, row.metric) for sample in range(1, 8) for run in headline_runs(sample) for row in run.numbers
    }
    assert printed == set(READINGS)
    assert isinstance(headline_runs(1)[0].numbers[0], PublishedMeasurement)
