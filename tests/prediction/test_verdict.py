"""What a validation says in sentences: of the new runs alone, each that is missed by its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, identify, load_actuator, simulate, validate
from ipmclab.fit.answer import answer_of
from ipmclab.model import Actuator
from ipmclab.model.variants import with_stages
from ipmclab.prediction.fitted import fitted_outputs
from ipmclab.prediction.scores import score
from ipmclab.prediction.verdict import verdict_of


@pytest.fixture(scope="module")
def strip() -> Actuator:
    return load_actuator("friend-2")


def named(run: Run, name: str) -> Run:
    return replace(run, file=name)


def test_each_run_that_is_missed_is_named(strip: Actuator) -> None:
    run = simulate(strip, "square 1 V 0.1 Hz", duration=20.0, rate=50.0)
    turned = replace(run, current=-np.asarray(run.current))
    found = verdict_of(validate(strip, [named(run, "good.nc"), named(turned, "turned.nc")]))
    assert found.predicted["current"] == pytest.approx(100.0)
    # A prediction of the opposite sign leaves twice the reading: with its mean near zero, a fit of about -100 %.
    ((output, label, fit),) = found.missed
    assert (output, label) == ("current", "turned.nc")
    assert fit == pytest.approx(-100.0, abs=5.0)
    said = " ".join(found.sentences)
    assert "current with a fit of 100.0 %" in said
    assert f"It does not predict the current of turned.nc ({fit:.1f} %)" in said


def test_a_coupling_that_no_fit_gave_is_not_judged(strip: Actuator) -> None:
    step, square = (
        named(simulate(strip, signal, duration=20.0, rate=50.0), f"{signal[:2]}.nc")
        for signal in ("step 1 V", "square 1 V 0.1 Hz")
    )
    fit = identify(strip.replace(**{"coupling.gain": 1e-9}), replace(step, displacement=None, force=None))
    found = verdict_of(validate(fit.actuator, square))
    assert set(found.predicted) == {"current"}
    assert found.missed == ()
    assert "the fit did not identify the coupling" in " ".join(found.sentences)
    fitted = validate(fit.actuator, square, used=[square.content_sha256])
    assert verdict_of(fitted).sentences[-1].startswith("sq.nc was used to identify it")
    assert verdict_of(fitted).predicted == {}


def test_a_run_of_the_fit_has_one_score_wherever_it_is_said(strip: Actuator) -> None:
    """Where a sensor drifts, too: the report's table and a validation measure what was read."""
    generator = np.random.default_rng(20261121)
    clean = simulate(strip, "step 1 V delay=4 s", duration=30.0, rate=25.0)
    drift = 2e-4 * clean.time
    read = np.asarray(clean.current) + drift + 1e-4 * generator.standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=read)
    fit = identify(strip, run, free="electrical")
    assert fit.observations[0].drift["current"] == pytest.approx(2e-4, rel=0.2)
    of_fit = score("current", [fitted_outputs(fit, run, 0)["current"]])
    of_run = validate(fit, run).scores["current"]
    assert of_run.fit_percent == pytest.approx(of_fit.fit_percent, abs=1e-6)
    assert of_run.rmse_percent_of_range == pytest.approx(of_fit.rmse_percent_of_range, rel=1e-6)
    # And what the verdict of the fit says: the residual over the range of the readings.
    observation = fit.observations[0]
    told = 100.0 * observation.noise["current"] / observation.span["current"]
    assert of_run.rmse_percent_of_range == pytest.approx(told, rel=0.02)


@pytest.mark.parametrize(("times", "percent", "how"), [(1.85, 15.0, "hardly"), (1.4, 60.0, "roughly")])
def test_a_prediction_that_leaves_much_is_called_so(strip: Actuator, times: float, percent: float, how: str) -> None:
    run = simulate(strip, "square 1 V 0.1 Hz", duration=20.0, rate=50.0)
    read = replace(run, current=np.asarray(run.current) / times, displacement=None, force=None)
    found = verdict_of(validate(strip, named(read, "less.nc")))
    # What was read is one of so many parts of the prediction: of 1.85 times it 0.85 are left.
    assert found.predicted["current"] == pytest.approx(percent, abs=2.0)
    assert f"the model {how} predicts 1 run" in found.sentences[0]


def test_a_stage_that_the_model_has_is_not_proposed(strip: Actuator) -> None:
    """A current that rises at constant voltage, beside a model without and with a leak that grows."""
    run = simulate(strip, "step 1 V delay=2 s", duration=60.0, rate=10.0)
    rising = np.asarray(run.current) + 0.005 * np.clip(run.time - 10.0, 0.0, None)
    read = named(replace(run, current=rising, displacement=None, force=None), "rises.nc")
    for model, words in (
        (strip, "which only a leak that grows (leak.slow) can follow"),
        (with_stages(strip, "leak.exponential", "leak.slow"), "more than the growing leak of this model"),
    ):
        (said,) = (one for one in verdict_of(validate(model, read)).sentences if "does not predict" in one)
        assert words in said


def test_a_fit_that_is_not_to_be_used_says_so_before_its_scores(strip: Actuator) -> None:
    run = named(simulate(strip, "square 1 V 0.1 Hz", duration=20.0, rate=50.0), "square.nc")
    turned = Run.from_arrays(time=run.time, voltage=run.voltage, current=-np.asarray(run.current), hold=run.hold)
    fit = identify(strip, turned, free="circuit.dc_resistivity")
    assert answer_of(fit).is_refused
    assert verdict_of(validate(fit.actuator, run)).sentences[0].startswith("Do not use this fit")
