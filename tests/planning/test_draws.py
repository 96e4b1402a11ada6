"""A plan that is asked on average over the values that a strip may have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Allowance, Fit, InputError, Run, identify, load_actuator, propose_runs, simulate
from ipmclab.planning.answer import FittedStrip
from ipmclab.planning.candidates import Candidate
from ipmclab.planning.draws import DRAWS, Samples, drawn_strips, read_samples
from ipmclab.planning.questions import Questions
from ipmclab.posterior.posterior import Posterior, write_posterior
from ipmclab.rig.safety.limit import Limit
from ipmclab.signals import Step

LEAK = "circuit.dc_resistivity"
STRIP = load_actuator("friend-2")
QUICK = Allowance(rate=10.0, longest=20.0)


@pytest.fixture(scope="module")
def fit() -> Fit:
    clean = simulate(STRIP, "step 1 V delay=5 s", duration=25.0, rate=10.0)
    noise = 1e-3 * np.random.default_rng(20261123).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="zero", current=clean.current + noise)
    return identify(STRIP, run, free="electrical")


def test_draws_have_the_covariance_of_the_fit(fit: Fit) -> None:
    drawn = drawn_strips(FittedStrip(fit), 400)
    values = np.log([one.actuator[LEAK] for one in drawn])
    own = fit.parameters[LEAK]
    assert values.mean() == pytest.approx(np.log(own.value), abs=0.1 * own.standard_error / own.value)
    assert 0.6 < values.std() / (own.standard_error / own.value) < 1.1  # cut off at its interval
    low, high = own.interval
    assert low <= np.exp(values.min())
    assert np.exp(values.max()) <= high


def test_the_average_over_a_sure_fit_is_the_plan_at_its_values(fit: Fit) -> None:
    at_values = propose_runs(fit, minutes=5.0, allowed=QUICK)
    own = {name: np.full(3, one.value) for name, one in fit.parameters.items()}
    runs = tuple(content for _, content in fit.runs)
    averaged = propose_runs(fit, minutes=5.0, allowed=QUICK, draws=Samples(own, runs))
    assert [str(one) for one in averaged.runs] == [str(one) for one in at_values.runs]
    assert (averaged.draws, at_values.draws) == (3, 0)
    assert [one.gain for one in averaged.runs] == pytest.approx([one.gain for one in at_values.runs])


def test_the_gain_is_the_mean_of_the_gains_at_each_value(fit: Fit) -> None:
    runs = tuple(content for _, content in fit.runs)
    grown = [fit.parameters[LEAK].value * factor for factor in (0.7, 1.4)]

    def gains(*values: float) -> dict[str, float]:
        asked = propose_runs(fit, minutes=5.0, allowed=QUICK, draws=Samples({LEAK: np.array(values)}, runs))
        return {str(one): one.gain for one in asked.best_of_kind}

    first, second, both = gains(grown[0]), gains(grown[1]), gains(*grown)
    shared = first.keys() & second.keys() & both.keys()
    assert shared
    for name in shared:
        assert both[name] == pytest.approx(0.5 * (first[name] + second[name]))


def test_a_run_that_some_values_refuse_says_so(fit: Fit) -> None:
    # At a third of the values the first branch has less resistance, and the peak of the current is higher.
    runs = tuple(content for _, content in fit.runs)
    name = "circuit.branches.0.resistivity"
    values = fit.parameters[name].value * np.array([0.3, 1.0, 1.0])
    branches = Samples({name: values}, runs)
    high, low = (
        simulate(fit.actuator.replace(**{name: value}), "step 1.2 V", duration=1.0, rate=10.0).current.max()
        for value in values[:2]
    )
    limits = replace(QUICK.limits, current=Limit(0.5 * (high + low)))
    step = Candidate(Step(1.2), 20.0)
    asked = Questions(fit, "parameters", {"": replace(QUICK, limits=limits)}, [step], None, branches)
    (run,) = [one for one, _ in asked.offers(asked.start, None) if one.candidate == step]
    (said,) = asked.with_remarks(run).remarks
    assert said == "the strip may pass the limit of the current: it does so at 1 of 3 values that the fit allows"


def test_samples_of_a_posterior_are_read_back(fit: Fit, tmp_path: Path) -> None:
    pytest.importorskip("arviz")
    drawn = fit.parameters[LEAK].value * np.linspace(0.9, 1.1, 60).reshape(2, 30)
    written = Posterior(
        fit.actuator.name, {}, {LEAK: drawn}, np.zeros((2, 30)), (), (), "", fit.runs, seed=1, steps=400, accepted=0.3
    )
    write_posterior(written, tmp_path / "posterior.nc")
    samples = read_samples(tmp_path / "posterior.nc")
    strips = drawn_strips(FittedStrip(fit), samples)
    values = [one.actuator[LEAK] for one in strips]
    assert len(values) == DRAWS
    assert [values[0], values[-1]] == [drawn[0, 0], drawn[-1, -1]]
    with pytest.raises(InputError, match="other runs"):
        drawn_strips(FittedStrip(fit), Samples(samples.values, ("another",)))
    (tmp_path / "wrong.nc").write_text("no samples")
    with pytest.raises(InputError, match="no samples of a fit"):
        read_samples(tmp_path / "wrong.nc")
