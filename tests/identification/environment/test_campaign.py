"""One strip in many environments: the twin of benchmarks/environments.py, in two short campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.environments import AGES, HELD_OUT, LAWS, Campaign, answer, fitted, monotone, palindrome
from ipmclab import Run, prediction_bands, read_fit, validate, write_fit
from ipmclab.fit.fit import Fit
from ipmclab.prediction.in_state import as_it_is_now
from ipmclab.prediction.verdict import verdict_of

SHORT = [condition for number, condition in enumerate(palindrome(40)) if number % 3 == 0 or number > 36]


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return Campaign.drawn(np.random.default_rng(20261123), SHORT)


@pytest.fixture(scope="module")
def fit(campaign: Campaign) -> Fit:
    found, inseparable = fitted(campaign.runs)
    assert not inseparable
    return found


def test_every_exponent_energy_and_age_is_found(campaign: Campaign, fit: Fit) -> None:
    for name in (*LAWS, *AGES):
        one = fit.parameters[name]
        assert one.determined or name in AGES, name
        assert abs(one.value - campaign.truth[name]) < 3.5 * one.standard_error, name


def test_a_condition_never_measured_is_predicted_with_its_interval(campaign: Campaign, fit: Fit) -> None:
    clean = answer(campaign.truth, HELD_OUT, len(SHORT))
    true = clean.channels["displacement"]
    peak = int(np.argmax(np.abs(true)))
    reaches = []
    for error in (0.0, 2.0):
        about = replace(
            clean.metadata,
            relative_humidity=HELD_OUT[0],
            temperature=HELD_OUT[1],
            uncertainties={"relative_humidity": error},
        )
        bands = prediction_bands(fit, replace(clean, metadata=about))
        reach = bands.reach("displacement", of_readings=False)[peak]
        assert bands.predicted["displacement"][peak] == pytest.approx(true[peak], rel=0.05)
        assert abs(bands.predicted["displacement"][peak] - true[peak]) < 1.5 * reach
        reaches.append(reach)
    assert reaches[1] > 1.2 * reaches[0]  # what the sensor leaves open of the humidity is in the band


def test_a_file_keeps_states_laws_and_ages(fit: Fit, campaign: Campaign, tmp_path) -> None:  # type: ignore[no-untyped-def]
    write_fit(fit, tmp_path / "fitted.toml")
    again = read_fit(tmp_path / "fitted.toml")
    assert [one.state for one in again.observations] == [one.state for one in fit.observations]
    assert {one.state.how for one in again.observations if one.state is not None} == {"assumed"}
    new = _at(campaign.runs[0], 55.0, 30.0)
    bands = [prediction_bands(one, new) for one in (fit, again)]
    for output in ("current", "displacement"):
        assert bands[1].predicted[output] == pytest.approx(bands[0].predicted[output], rel=1e-9)
        assert bands[1].of_parameters[output] == pytest.approx(bands[0].of_parameters[output], rel=1e-6)
        assert bands[1].of_model[output] == pytest.approx(bands[0].of_model[output], rel=1e-6)
        # In its own air the strip is moved by its laws, and what its model may lack with it; its readings show that.
        assert 0.0 < np.median(bands[0].of_model[output]) < 0.01 * np.median(bands[0].of_noise[output])


def test_age_and_humidity_that_rise_together_are_named(campaign: Campaign) -> None:
    _, inseparable = fitted(Campaign.drawn(np.random.default_rng(7), monotone(10)).runs)
    assert inseparable


def _at(run: Run, humidity: float, temperature: float) -> Run:
    """A run that the fit never saw, in some air."""
    assert run.current is not None
    about = replace(run.metadata, relative_humidity=humidity, temperature=temperature)
    return replace(run, current=run.current + 1e-6, metadata=about)


def test_a_run_beyond_all_conditions_of_the_fit_is_named(fit: Fit, campaign: Campaign) -> None:
    beyond = _at(campaign.runs[0], 95.0, 55.0)
    validation = validate(fit, beyond)
    assert "recorded in an environment outside that of the fit" in " ".join(verdict_of(validation).sentences)
    codes = {finding.code: finding.message for finding in validation.findings}
    assert "55 degC" in codes["environment-extrapolated"]
    assert "condensation" in codes
    within = {finding.code for finding in validate(fit, _at(campaign.runs[0], 55.0, 30.0)).findings}
    assert not within & {"environment-extrapolated", "condensation", "not-in-equilibrium"}


def test_a_strip_that_was_not_given_the_time_is_not_in_equilibrium(fit: Fit, campaign: Campaign) -> None:
    run = _at(campaign.runs[0], 60.0, 20.0)
    soon, late = (replace(run, metadata=replace(run.metadata, minutes_in_environment=one)) for one in (5.0, 200.0))
    assert "not-in-equilibrium" in {finding.code for finding in validate(fit, soon).findings}
    assert "not-in-equilibrium" not in {finding.code for finding in validate(fit, late).findings}


def test_a_run_that_does_not_say_its_air_is_predicted_in_reference(fit: Fit, campaign: Campaign) -> None:
    run = _at(campaign.runs[0], 60.0, 20.0)
    silent = replace(run, metadata=replace(run.metadata, temperature=None))
    assert "environment-not-stated" in {finding.code for finding in validate(fit, silent).findings}


def test_a_fitted_strip_is_as_old_as_after_its_last_run(fit: Fit) -> None:
    now = as_it_is_now(fit.actuator)
    rate = fit.parameters["age.runs.coupling.gain"].value
    assert now["coupling.gain"] == pytest.approx(fit.actuator["coupling.gain"] * np.exp(rate * len(SHORT)))
