"""What is said against a forecast: an undetermined fit, old readings, a strip beyond its length, a guessed period."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Actuator, Fit, InputError, Run, forecast, identify, load_actuator, read_fit, simulate, write_fit
from ipmclab.fit.fit_table import fit_to_table
from ipmclab.forecasting.forecast import with_slow_modes

RATE = 10.0
RATIO = "relaxation.displacement.0.ratio"
TAU = "relaxation.displacement.0.time_constant"


def strip(ratio: float = 0.6) -> Actuator:
    return load_actuator("friend-2+relaxation.displacement").replace(**{RATIO: ratio, TAU: 9.0})


def record(actuator: Actuator, lost: tuple[float, float] | None = None) -> Run:
    """A step of 1 V with noise; between two times the laser reads nothing."""
    run = simulate(actuator, "step 1 V delay=5 s", duration=90.0, rate=RATE)
    assert run.displacement is not None
    read = run.displacement + np.random.default_rng(20261121).normal(0.0, 2e-6, len(run))
    if lost is not None:
        read = np.where((run.time >= lost[0]) & (run.time < lost[1]), np.nan, read)
    return Run.from_arrays(time=run.time, voltage=run.voltage, displacement=read)


def codes(actuator: Actuator | Fit, run: Run, **given: float) -> list[str]:
    return [finding.code for finding in forecast(actuator, run, **{"origin": 40.0, **given}).findings]


def test_a_channel_of_noise_alone_is_told() -> None:
    run = record(strip())
    noise = 5e-5 * np.random.default_rng(20261128).standard_normal(len(run))
    found = forecast(None, replace(run, force=noise), origin=40.0, channel="force").findings
    assert [finding.code for finding in found if finding.channel == "force"] == ["noise-only"]
    assert "noise-only" not in codes(strip(), replace(run, force=noise))


def undetermined(names: tuple[str, ...], ratio: float) -> Fit:
    """A fit that left some parameters open, its ratio at a value that means nothing."""
    fit = identify(strip(), record(strip()), free=["coupling.gain", RATIO, TAU])
    parameters = {
        name: replace(one, standard_error=math.inf, interval=(-math.inf, math.inf), determined=False)
        if name in names
        else one
        for name, one in fit.parameters.items()
    }
    values = {**fit.actuator.parameter_values, RATIO: ratio}
    sure = {n: u for n, u in fit.actuator.standard_uncertainties.items() if n not in names}
    actuator = replace(fit.actuator, parameter_values=values, standard_uncertainties=sure)
    changed = replace(fit, parameters=parameters, actuator=actuator)
    return replace(changed, actuator=replace(actuator, fit_table=fit_to_table(changed)))


def test_what_a_fit_left_open_is_no_prior_and_is_said(tmp_path: Path) -> None:
    fit = undetermined((RATIO, "coupling.gain"), ratio=-21.0)
    write_fit(fit, tmp_path / "fit.toml")
    for model in (fit, fit.actuator, load_actuator(tmp_path / "fit.toml"), read_fit(tmp_path / "fit.toml")):
        ahead = forecast(model, record(strip()), origin=40.0)
        (finding,) = [one for one in ahead.findings if one.code == "model-undetermined"]
        assert finding.severity == "warning"
        assert f"{RATIO} counted as 0" in finding.message
        assert "coupling.gain stay as they are" in finding.message
        assert "ipmclab forecast - RUN, in Python forecast(None, run)" in finding.repair
    # As if the ratio had never been fitted.
    never = replace(fit.actuator, fit_table=None).replace(**{RATIO: 0.0})
    np.testing.assert_allclose(ahead.mean, forecast(never, record(strip()), origin=40.0).mean, rtol=1e-9)
    # Modes spread in place of those of the fit do not cure the coupling.
    (finding,) = [
        one
        for one in forecast(with_slow_modes(fit.actuator), record(strip()), origin=40.0).findings
        if one.code == "model-undetermined"
    ]
    assert "did not determine 1 of its parameters: coupling.gain" in finding.message


@pytest.mark.parametrize(
    "table",
    [
        {"parameters": [{"determined": False}], "correlations": [[1.0]]},
        {"parameters": 3, "correlations": 3},
        {"parameters": [3], "correlations": [3]},
        {"parameters": [{"name": RATIO, "determined": True}], "correlations": []},
        {"runs": []},
    ],
)
def test_a_table_that_no_fit_wrote_says_nothing(table: dict[str, object]) -> None:
    """It was a KeyError, or an IndexError."""
    by_hand = replace(strip(), fit_table=table)
    assert codes(by_hand, record(strip())) == codes(strip(), record(strip()))
    assert not (with_slow_modes(by_hand).fit_table or {}).get("parameters")


def test_a_determined_fit_and_a_trend_carry_no_such_finding() -> None:
    fit = identify(strip(), record(strip()), free=[RATIO])
    assert codes(fit, record(strip())) == []
    assert codes(strip(), record(strip())) == []


def test_old_readings_are_said_and_very_old_ones_refused() -> None:
    run = record(strip(), lost=(40.0, 80.0))
    assert codes(strip(), run, origin=40.5) == []
    ahead = forecast(strip(), run, origin=44.0, horizon=10.0)
    (finding,) = ahead.findings
    assert (finding.code, finding.severity) == ("readings-old", "warning")
    assert "was read at 39.9 s, 4.1 s earlier" in finding.message
    assert "reaches 14.1 s beyond it" in finding.message
    assert codes(strip(), run, origin=55.0, horizon=30.0) == ["readings-old"]
    with pytest.raises(
        InputError, match=r"was read at 39\.9 s, 30\.1 s earlier; give an origin up to 40\.9 s"
    ) as caught:
        forecast(strip(), run, origin=70.0, horizon=10.0)
    assert (caught.value.code, caught.value.where) == ("readings-too-old", "origin")
    assert codes(strip(), run, origin=82.0) == []


def test_a_strip_beyond_its_length_is_said() -> None:
    far = strip(ratio=0.0)
    far = far.replace(**{"coupling.gain": 100.0 * far["coupling.gain"]})
    run = simulate(far, "step 1 V delay=5 s", duration=60.0, rate=RATE)
    (finding,) = [one for one in forecast(far, run, origin=40.0).findings if one.code == "beyond-free-length"]
    assert "free length of 25 mm" in finding.message
    assert finding.values["largest"] > 25e-3
    assert "beyond-free-length" not in [one.code for one in forecast(None, run, origin=40.0).findings]
    assert "beyond-free-length" not in codes(strip(), record(strip()))


def test_a_guessed_sampling_period_is_passed_on() -> None:
    run = record(strip())
    guessed = replace(run, metadata=replace(run.metadata, sampling_period_known=False))
    assert codes(strip(), guessed) == ["sampling-period-unknown"]


def test_a_coupling_that_no_fit_gave_is_said() -> None:
    run = simulate(strip(), "step 1 V delay=5 s", duration=90.0, rate=RATE)
    of_circuit = identify(strip(), run, free="circuit.dc_resistivity")
    for model in (of_circuit, of_circuit.actuator):
        assert "coupling-not-identified" in codes(model, run)
    assert "coupling-not-identified" not in codes(identify(strip(), run, free="coupling.gain"), run)
    assert "coupling-not-identified" not in codes(strip(), run)  # no fit: whose values these are is not said


def test_a_voltage_that_has_not_moved_yet_is_said() -> None:
    run = replace(record(strip()), voltage=np.where(record(strip()).time < 45.0, 0.0, 1.0))
    assert codes(strip(), run) == ["plan-not-shown"]
    assert codes(strip(), run, origin=60.0) == []
    assert codes(strip(), replace(run, voltage=np.zeros(len(run)))) == []
