"""Proposed runs: what is expected of them is what identify says after they were recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from ipmclab import (
    Actuator,
    Allowance,
    Fit,
    InputError,
    Run,
    RunMetadata,
    identify,
    load_actuator,
    propose_runs,
    read_fit,
    simulate,
    write_fit,
)
from ipmclab.model.environment import Environment
from ipmclab.planning.answer import FittedStrip
from ipmclab.planning.candidates import REST_BEFORE
from ipmclab.planning.proposal import Proposal
from ipmclab.planning.run_noise import RunNoise
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.signals import Signal, parse

RATE = 25.0
NOISE = {"current": 1e-4, "displacement": 1e-5}
STRIP = load_actuator("friend-2")
QUICK = Allowance(rate=RATE, longest=40.0)


def read(signal: str | Signal, duration: float, *outputs: str, colour: float = 0.0, strip: Actuator = STRIP) -> Run:
    """A run with its rest before, read with noise: white, or autocorrelated by so much from row to row."""
    given = replace(parse(signal) if isinstance(signal, str) else signal, delay=REST_BEFORE)  # type: ignore[call-arg]
    clean = simulate(strip, given, duration=duration + REST_BEFORE, rate=RATE)
    generator = np.random.default_rng([20261123, len(str(signal)), round(duration)])
    channels = {}
    for output in outputs or ("current",):
        noise = lfilter([1.0], [1.0, -colour], generator.standard_normal(len(clean) + 500))[500:]
        channels[output] = getattr(clean, output) + NOISE[output] * noise
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="zero", **channels)


def recorded(proposal: Proposal, *outputs: str, colour: float = 0.0) -> list[Run]:
    """The runs of a plan, as the strip really answers them."""
    each = [run.candidate for run in proposal.runs]
    return [read(one.signal, one.duration, *outputs, colour=colour) for one in each]


def two_runs(colour: float = 0.0) -> list[Run]:
    return [read("step 1 V", 40.0, colour=colour), read("sine 1 V 0.1 Hz", 40.0, colour=colour)]


@pytest.fixture(scope="module")
def fit() -> Fit:
    return identify(STRIP, two_runs(), free="electrical")


def ratios(proposal: Proposal, after: Fit) -> list[float]:
    """Expected standard errors over those that identify states."""
    return [
        one.after / (after.parameters[one.name].standard_error / after.parameters[one.name].value)
        for one in proposal.expected
    ]


@pytest.mark.parametrize(("colour", "within"), [(0.0, 0.05), (0.9, 0.3)])
def test_the_expected_errors_are_those_of_the_fit_that_follows(colour: float, within: float) -> None:
    before = two_runs(colour)
    proposal = propose_runs(identify(STRIP, before, free="electrical"), minutes=8.0, allowed=QUICK)
    after = identify(STRIP, [*before, *recorded(proposal, colour=colour)], free="electrical")
    assert ratios(proposal, after) == pytest.approx([1.0] * 5, rel=within)
    assert all(one.after < one.before for one in proposal.expected)


def test_a_stated_uncertainty_stays_whatever_is_recorded() -> None:
    stated = replace(STRIP, standard_uncertainties={"circuit.sheet_resistance": 0.05})
    before = two_runs()
    proposal = propose_runs(identify(stated, before, free="electrical"), minutes=8.0, allowed=QUICK)
    after = identify(stated, [*before, *recorded(proposal)], free="electrical")
    assert ratios(proposal, after) == pytest.approx([1.0] * 5, rel=0.05)
    # The fast branch is in series with the electrodes: no run makes up for what is not known of these.
    fast = next(one for one in proposal.expected if one.name == "circuit.branches.0.resistivity")
    assert fast.after > 0.1


def test_a_direction_that_no_reading_shows_stays_open() -> None:
    open_one = identify(STRIP, two_runs(), free=["electrical", "circuit.sheet_resistance"])
    proposal = propose_runs(open_one, minutes=8.0, allowed=QUICK)
    assert (proposal.rank_before, proposal.rank_after) == (5, 5)
    after = {one.name: one for one in proposal.expected}
    moved = [name for name, one in after.items() if one.after == np.inf]
    assert moved == [name for name, one in open_one.parameters.items() if one.standard_error == np.inf]
    assert "circuit.sheet_resistance" in moved
    assert not after["circuit.sheet_resistance"].determined_after
    assert "circuit.sheet_resistance" in proposal.remarks[0]


def test_a_plan_is_best_at_what_it_is_for(fit: Fit) -> None:
    of_parameters = propose_runs(fit, minutes=8.0, allowed=QUICK)
    of_prediction = propose_runs(fit, goal="prediction", inputs=["sine 1 V 5 Hz for 20 s"], minutes=8.0, allowed=QUICK)
    again = propose_runs(fit, inputs=["sine 1 V 5 Hz for 20 s"], minutes=8.0, allowed=QUICK)
    assert of_prediction.predicted["current"][1] < again.predicted["current"][1]

    def volume(proposal: Proposal) -> float:
        return float(np.prod([one.after for one in proposal.expected]))

    assert volume(of_parameters) < volume(of_prediction)
    gains = [run.gain_per_minute for run in of_parameters.best_of_kind]
    assert gains == sorted(gains, reverse=True)
    assert of_parameters.time <= 8.0 * 60.0


def test_the_evidence_is_what_least_squares_leaves_of_the_difference(fit: Fit) -> None:
    rival = STRIP.replace(**{"circuit.dc_resistivity": 1.02 * STRIP["circuit.dc_resistivity"], "coupling.gain": 7e-9})
    proposal = propose_runs(fit, goal="model", rival=rival, minutes=2.7, allowed=QUICK)
    ((first, every),) = proposal.evidence.values()
    assert first == every
    strip, (run,) = FittedStrip(fit), proposal.runs
    answer = strip.answer(run.candidate, RATE)
    rows = answer.entries["current"] / fit.observations[0].noise["current"]
    difference = strip.difference_to(rival, run.candidate, answer)["current"] / fit.observations[0].noise["current"]
    covariance = np.array(list(map(list, (row.values() for row in fit.covariance.values()))))
    known = np.linalg.cholesky(np.linalg.inv(covariance / np.outer(strip.chains, strip.chains))).T
    stacked, against = np.vstack([rows, known]), np.append(difference, np.zeros(5))
    left = against - stacked @ np.linalg.lstsq(stacked, against)[0]
    assert first**2 == pytest.approx(float(left @ left), rel=0.02)


def test_a_leak_is_looked_for_above_its_threshold(fit: Fit) -> None:
    with pytest.raises(InputError, match=r"would not show a stage leak.exponential; record above the threshold"):
        propose_runs(fit, goal="model", rival="leak.exponential", allowed=QUICK)
    high = replace(QUICK, limits=Limits(voltage=Limit(3.0, 0.02)))
    proposal = propose_runs(fit, goal="model", rival="leak.exponential", minutes=5.0, allowed=high)
    assert np.abs(proposal.runs[0].candidate.signal.voltage(np.arange(0.0, 10.0, 0.1))).max() > 1.23
    assert proposal.runs[0].remarks[0].startswith("it is above 1.23 V")
    ((name, (least, unit)),) = proposal.shows["leak.exponential"].items()
    assert (name, unit) == ("leak.exponential.current_density", "A/m^2")
    assert least > 0.0
    with pytest.raises(InputError, match="the fit misses no stage"):
        propose_runs(fit, goal="model", allowed=QUICK)


def test_limits_and_time(fit: Fit) -> None:
    few = replace(QUICK, limits=Limits(voltage=Limit(1.0, 0.02), current=Limit(0.04)))
    proposal = propose_runs(fit, minutes=4.0, allowed=few)
    assert 0 < proposal.refused["current"] < proposal.tried
    for run in proposal.runs:
        answer = FittedStrip(fit).answer(run.candidate, RATE)
        assert np.abs(answer.outputs["current"]).max() <= 0.04
    wet = replace(QUICK, wet=145.0, hydration=60.0)
    short = propose_runs(fit, minutes=10.0, allowed=wet).runs
    assert {run.candidate.duration for run in short} == {10.0}
    assert {run.time for run in short} == {200.0}
    with pytest.raises(
        InputError, match=r"the shortest run takes 2.33 min on the bench, and there are 1 min; give 3 min"
    ):
        propose_runs(fit, minutes=1.0, allowed=QUICK)
    with pytest.raises(InputError, match=r"each of the 74 runs would pass a limit: current \(74\)"):
        propose_runs(fit, allowed=replace(QUICK, longest=20.0, limits=Limits(current=Limit(1e-6))))

    with pytest.raises(InputError, match=r"tells anything of what is asked; allow longer signals"):
        propose_runs(fit, allowed=replace(QUICK, longest=0.01 / RATE))  # it is over before the first row is read


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"goal": "parameter"}, "unknown goal 'parameter'; did you mean 'parameters'"),
        ({"minutes": 0.0}, "the time is 0 min, it must be above 0"),
        ({"minutes": 9109399.0}, r"have room for .* runs, a plan has at most 1000; give 2333 min or less"),
        ({"goal": "prediction", "inputs": []}, "no input is named"),
    ],
)
def test_what_is_refused(fit: Fit, asked: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        propose_runs(fit, allowed=QUICK, **asked)  # type: ignore[arg-type]


def test_a_fit_that_lost_the_noise_of_its_runs_is_refused(fit: Fit) -> None:
    for left in ([replace(one, noise={}) for one in fit.observations], []):
        with pytest.raises(InputError, match="the fit does not state the noise of its runs"):
            propose_runs(replace(fit, observations=tuple(left)), allowed=QUICK, minutes=10)


def test_a_fit_from_its_file_proposes_the_same(fit: Fit, tmp_path: Path) -> None:
    write_fit(fit, tmp_path / "fit.toml")
    one, other = (propose_runs(each, minutes=8.0, allowed=QUICK) for each in (fit, read_fit(tmp_path / "fit.toml")))
    assert str(one) == str(other)


def test_a_drift_is_told_from_the_strip_by_a_run_that_turns_back() -> None:
    steps: Sequence[Run] = [read("step 1 V", 40.0)]
    doubted = identify(STRIP, steps, free="electrical")
    assert "drift-not-excluded" in [one.code for one in doubted.findings]
    noise, time = RunNoise.of(doubted, "current"), np.arange(100.0)
    assert noise.constants(time, np.ones(100)).shape == (100, 2)
    assert noise.constants(time, parse("sine 1 V 0.1 Hz").voltage(time)).shape == (100, 1)


def test_a_law_is_learnt_in_another_condition() -> None:
    strip = load_actuator("friend-2+environment.permittivity")
    runs = []
    for number, humidity in enumerate((80.0, 75.0, 78.0)):
        run = read("step 0.5 V", 12.0, strip=strip.at(Environment(20.0, humidity)))
        about = RunMetadata(temperature=20.0, relative_humidity=humidity, run_number=number)
        runs.append(replace(run, metadata=about))
    branches = ["circuit.branches.0.permittivity", "circuit.branches.1.permittivity"]
    fit = identify(strip, runs, free=[*branches, "environment.permittivity.exponent"])
    assert propose_runs(fit, minutes=5.0, allowed=replace(QUICK, longest=10.0)).runs[0].candidate.condition is None
    places = tuple(Environment(20.0, humidity) for humidity in (80.0, 50.0))
    proposal = propose_runs(fit, minutes=8.0, allowed=replace(QUICK, conditions=places, longest=10.0, soak=120.0))
    assert proposal.runs[0].candidate.condition == places[1]
    assert proposal.runs[0].time == proposal.runs[0].candidate.duration + 250.0
    law = next(one for one in proposal.expected if one.name == "environment.permittivity.exponent")
    assert law.after < 0.5 * law.before
