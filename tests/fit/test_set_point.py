"""What a fit of a relaxing strip says of holding a set point: r against 1, with its interval."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Fit, Run, identify, load_actuator, simulate
from ipmclab.fit.fit import FittedParameter
from ipmclab.fit.set_point import set_point_findings

TAU = "relaxation.displacement.0.time_constant"
RATIO = "relaxation.displacement.0.ratio"


def fit_of(ratio: float) -> Fit:
    strip = load_actuator("friend-2+relaxation.displacement").replace(**{RATIO: ratio, TAU: 9.0})
    run = simulate(strip, "step 1 V delay=2 s", duration=60.0, rate=10.0)
    rng = np.random.default_rng(20261121)
    assert run.displacement is not None
    readings = run.displacement + rng.normal(0.0, 2e-6, len(run))
    measured = Run.from_arrays(time=run.time, voltage=run.voltage, displacement=readings)
    return identify(strip.replace(**{RATIO: 0.8, TAU: 6.0}), measured, free=[RATIO, TAU])


@pytest.mark.parametrize(
    ("ratio", "severity", "words"),
    [(0.6, "info", "can be held"), (1.4, "warning", "integral action in the original direction cannot")],
)
def test_the_fit_says_whether_a_set_point_can_be_held(ratio: float, severity: str, words: str) -> None:
    fit = fit_of(ratio)
    (finding,) = [one for one in fit.findings if one.code == "set-point"]
    assert (finding.severity, finding.channel) == (severity, "displacement")
    assert words in finding.message
    parameter = fit.parameters[RATIO]
    assert (finding.values["low"], finding.values["high"]) == parameter.interval
    assert parameter.value == pytest.approx(ratio, abs=4.0 * parameter.standard_error)
    assert fit.actuator.fit_table is not None
    assert [one["code"] for one in fit.actuator.fit_table["findings"]] == [one.code for one in fit.findings]
    # The same value, less well known: nobody can tell.
    vague = {**fit.parameters, RATIO: replace(parameter, interval=(0.5, 1.5))}
    (finding,) = set_point_findings(replace(fit, parameters=vague))
    assert finding.severity == "warning"
    assert finding.message.startswith("these runs do not show whether a set point of the displacement can be held")


@pytest.mark.parametrize("interval", [(-math.inf, math.inf), (0.2, math.inf), (-math.inf, 3.0), (math.nan, math.nan)])
def test_an_interval_without_bounds_gives_no_verdict(interval: tuple[float, float]) -> None:
    fit = fit_of(0.6)
    vague = {**fit.parameters, RATIO: replace(fit.parameters[RATIO], interval=interval, determined=False)}
    (finding,) = set_point_findings(replace(fit, parameters=vague))
    assert finding.severity == "warning"
    assert finding.message.startswith("these runs do not show whether a set point of the displacement can be held")
    assert "keeps" not in finding.message  # what the point value would mean, it does not
    for which, bound in zip(("low", "high"), interval, strict=True):
        assert finding.values[which] == (bound if math.isfinite(bound) else None)


def test_the_interval_of_a_sum_uses_the_correlation() -> None:
    fit = fit_of(0.6)
    names = [RATIO, "relaxation.displacement.1.ratio"]
    two = {
        name: FittedParameter(name, value, "", "", error, (0.0, 1.0), True)
        for name, value, error in zip(names, (0.7, 0.2), (0.3, 0.4), strict=True)
    }
    actuator = load_actuator("friend-2+relaxation.displacement=2").replace(**{n: p.value for n, p in two.items()})
    correlations = {a: {b: 1.0 if a == b else -0.9 for b in names} for a in names}
    both = replace(fit, actuator=actuator, parameters=two, correlations=correlations)
    (finding,) = set_point_findings(both)
    reach = 1.96 * np.sqrt(0.3**2 + 0.4**2 - 2 * 0.9 * 0.3 * 0.4)
    assert finding.values["low"] == pytest.approx(0.9 - reach, abs=1e-3)
    assert finding.values["high"] == pytest.approx(0.9 + reach, abs=1e-3)
    assert "do not show" in finding.message


def test_without_a_fitted_slow_mode_nothing_is_said() -> None:
    fit = fit_of(0.6)
    assert set_point_findings(replace(fit, parameters={})) == []
