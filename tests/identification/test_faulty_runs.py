"""What identification does with records that `check` speaks against, and what a fit says of them."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import InputError, Run, RunMetadata, check, identify, import_run, load_actuator, simulate, validate
from ipmclab.identification.problem.record import ASSUMED_REST, as_read, prepare
from ipmclab.model.excitation import excitation
from ipmclab.prediction.fitted import fitted_outputs
from tests.identification.brief import brief

SEED = 20261121
MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
FRIEND = load_actuator("friend-2")
RHO_1 = "circuit.branches.0.resistivity"
NOISE = {"current": 1e-4, "displacement": 5e-6}


def measured(signal: str, *channels: str, seed: int = 0, rate: float = 50.0, hold: str = "zero") -> Run:
    generator = np.random.default_rng([SEED, seed])
    clean = simulate(FRIEND, signal, duration=40.0, rate=rate)
    noisy = {name: clean.channels[name] + NOISE[name] * generator.standard_normal(len(clean)) for name in channels}
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        hold=hold,  # type: ignore[arg-type]
        metadata=RunMetadata(signal=signal),
        **noisy,
    )


def codes(fit: object) -> set[str]:
    return {finding.code for finding in fit.findings}  # type: ignore[attr-defined]


def test_a_channel_of_noise_is_left_out_and_said() -> None:
    runs = [measured("step 1 V delay=2 s", "displacement"), measured("sine 1 V 0.5 Hz", "displacement", seed=1)]
    silent = 1e-4 * np.random.default_rng(SEED).standard_normal(2000)
    with_noise = [replace(run, force=silent) for run in runs]
    assert all("noise-only" in {finding.code for finding in check(run)} for run in with_noise)
    here, there = (brief(FRIEND, given, "coupling", followed=False) for given in (runs, with_noise))
    for name, parameter in here.parameters.items():
        assert there.parameters[name].value == pytest.approx(parameter.value, rel=1e-6), name
    told = [finding for finding in there.findings if finding.code == "channel-left-out"]
    assert [finding.channel for finding in told] == ["force", "force"]
    assert "step 1 V delay=2 s: force held nothing but noise and was left out of the fit" in told[0].message
    with pytest.raises(InputError, match=r"coupling\.gain is free.*no usable.*force held nothing but noise"):
        identify(FRIEND, [replace(run, displacement=None) for run in with_noise], free="coupling")


@pytest.mark.parametrize("channel", ["displacement", "current"])
def test_a_channel_that_was_lost_throughout_is_left_out_and_said(channel: str) -> None:
    """A laser that never met the strip, or a wire of the current that was off: the other channel and run count."""
    runs = [
        measured(one, "current", "displacement", rate=10.0) for one in ("step 1 V delay=2 s", "step 0.8 V delay=2 s")
    ]
    runs[1] = replace(runs[1], **{channel: np.full(len(runs[1]), np.nan)})
    fit = identify(FRIEND, runs, free=f"{RHO_1}, coupling.gain")
    (told,) = [finding.message for finding in fit.findings if finding.code == "channel-left-out"]
    assert told == f"step 0.8 V delay=2 s: {channel} held no usable reading and was left out of the fit"
    assert channel not in fit.observations[1].noise
    assert all(one.determined for one in fit.parameters.values())


def test_a_leak_is_found_beside_a_run_without_its_current() -> None:
    strip = load_actuator("friend-2+leak.cubic")
    runs = [simulate(strip, one, duration=4.0, rate=25.0) for one in ("sine 2 V 0.5 Hz", "sine 1.5 V 0.5 Hz")]
    runs[1] = replace(runs[1], current=np.full(100, np.nan))
    fit = identify(strip, runs, free="leak, coupling.gain")
    for name, one in fit.parameters.items():
        assert one.value == pytest.approx(strip[name], rel=1e-3, abs=1e-6), name


def test_a_voltage_in_millivolts_is_refused_and_not_searched() -> None:
    """So large a voltage that an exponential leak would draw what no number holds."""
    strip = load_actuator("friend-2+leak.exponential")
    run = simulate(FRIEND, "step 1 V", duration=4.0, rate=25.0)
    with pytest.raises(InputError, match="do not show where a search could start"):
        identify(strip, replace(run, voltage=1000.0 * run.voltage), free=f"{RHO_1}, leak, coupling")


@pytest.mark.parametrize("spike", [0.0, 5.0], ids=["clean", "spike"])
def test_a_masked_spike_does_not_make_a_start_look_like_rest(spike: float) -> None:
    """At 0 V the strip still gives back what it held: a reading of 5 A, which no fit uses, is no scale for that."""
    time = 0.02 * np.arange(1500)
    voltage = np.where((time < 10.0) | (time >= 12.0), 1.0, 0.0)
    whole = simulate(FRIEND, voltage, rate=50.0, duration=30.0)
    assert whole.current is not None
    current = whole.current + 1e-5 * np.random.default_rng(SEED).standard_normal(1500)
    current[900] += spike
    run = Run.from_arrays(time=time[505:] - time[505], voltage=voltage[505:], current=current[505:])
    assert ("spike" in {finding.code for finding in check(run)}) == (spike > 0.0)
    assert prepare(run, 0, ["current"], check(run)).start == ASSUMED_REST
    assert excitation(FRIEND, [as_read(prepare(run, 0, ["current"], check(run)))], ["current"]).current_density < 1e4


def test_errors_of_a_record_stand_in_its_fit_and_in_its_message() -> None:
    runs = [measured("step 1 V delay=2 s", "current"), measured("sine 1 V 0.1 Hz", "current", seed=1)]
    assert "errors" not in identify(FRIEND, runs).message
    unknown = replace(runs[0], metadata=RunMetadata(signal="a guess", sampling_period_known=False))
    fit = identify(FRIEND, [unknown, runs[1]])
    (told,) = (finding for finding in fit.findings if finding.code == "sampling-period-unknown")
    assert told.message.startswith("a guess: ")
    # An error of a channel that the fit does not use is an error of the record all the same.
    moving = measured("step 1 V delay=2 s", "current", "displacement")
    reversed_run = replace(moving, displacement=-moving.displacement)  # type: ignore[operator]
    assert "response-opposite" in {finding.code for finding in check(reversed_run)}
    fit = identify(FRIEND, [reversed_run, runs[1]], free="electrical")
    assert "response-opposite" in codes(fit)
    assert fit.message.endswith("but errors contradict this fit (see the findings response-opposite)")


def without_contact(rows: int) -> Run:
    """A step of 1 V at row 100 that reaches the strip so many rows later."""
    run, late = measured("step 1 V delay=2 s", "current"), measured(f"step 1 V delay={2 + rows / 50} s", "current")
    assert "contact-missing" in {finding.code for finding in check(replace(run, current=late.current))}
    return replace(run, current=late.current)


def test_the_voltage_begins_at_the_contact() -> None:
    run = without_contact(130)
    fit = identify(FRIEND, [run, measured("sine 1 V 0.1 Hz", "current", seed=1)])
    (late,) = (finding for finding in fit.findings if finding.code == "contact-missing")
    # The fit has put right what is wrong with the record: the values below are those of the strip.
    assert late.severity == "warning"
    assert late.message.endswith("the fit takes the voltage as 0 V there")
    assert "errors" not in fit.message
    for name, parameter in fit.parameters.items():
        assert abs(parameter.value - FRIEND[name]) < 3.5 * parameter.standard_error, name
    # The prediction and the fitted values follow the same reading.
    fresh = validate(FRIEND, run)
    assert fresh.scores["current"].fit_percent > 95
    again = validate(fit.actuator, run)
    assert again.scores["current"].rmse == pytest.approx(
        np.sqrt(np.nanmean(fit.residuals[0]["current"] ** 2)), rel=1e-6
    )
    error = fitted_outputs(fit, run, 0)["current"].error
    np.testing.assert_allclose(error, fit.residuals[0]["current"], atol=1e-9)


def test_the_late_contact_of_a_real_step(real_runs: Path) -> None:
    run = import_run(real_runs / "step_3V.csv.gz", MAPS / "step_3V.toml")
    rows = slice(400, 1900)
    cut = Run.from_arrays(time=run.time[rows], voltage=run.voltage[rows], current=run.current[rows], hold="unknown")
    strip = FRIEND.replace(
        **{
            "geometry.free_length": 25e-3,
            "geometry.clamped_length": 5e-3,
            "geometry.width": 5e-3,
            "geometry.thickness": 0.5e-3,
            "geometry.sensing_length": 15e-3,
            "circuit.sheet_resistance": 30.0 / 12.0,
        }
    )
    fit = brief(strip, [cut], followed=False)
    assert "contact-missing" in codes(fit)
    rho = fit.parameters[RHO_1]
    # Two branches leave far more of this current than its noise, and that counts: the first branch is open.
    assert not rho.determined
    assert not rho.at_bound
    # What lies in series with everything behind it lets the largest current through at the edge.
    elements = fit.actuator.circuit_elements()
    behind = 1.0 / (1.0 / elements.dc + sum(1.0 / resistance for resistance in elements.branch_resistances))
    assert 50.0 < 30.0 + behind.real < 1.6 * 2.957 / np.nanmax(cut.current)


def rms(residual: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(residual**2)))


def test_one_record_is_read_in_one_way() -> None:
    # A zero that the current's own rows before the step do not show surely: the fit takes none off, nor may validate.
    runs = [
        measured("step 1 V delay=2 s", "current", "displacement", hold="unknown"),
        measured("sine 1 V 0.1 Hz", "current", "displacement", seed=1, hold="unknown"),
    ]
    shifted = runs[0].current + np.where(runs[0].voltage == 0, 4e-5, 0.0)  # type: ignore[operator]
    runs[0] = replace(runs[0], current=shifted)
    cut = Run.from_arrays(
        time=runs[1].time[300:],
        voltage=runs[1].voltage[300:],
        current=runs[1].current[300:],  # type: ignore[index]
        hold="unknown",
        metadata=RunMetadata(starts_from_rest=False),
    )
    for given in (runs, [runs[0], cut]):
        fit = brief(FRIEND, given, followed=False)
        validation = validate(fit.actuator, given)
        for residuals, one in zip(fit.residuals, validation.runs, strict=True):
            assert one.scores["current"].rmse == pytest.approx(rms(residuals["current"]), rel=1e-6)


def test_a_second_fit_reads_a_run_as_the_first_did() -> None:
    runs = [
        measured("step 1 V delay=2 s", "current", "displacement", hold="unknown"),
        measured("sine 1 V 0.1 Hz", "current", "displacement", seed=1, hold="unknown"),
    ]
    first = brief(FRIEND, runs, followed=False)
    second = brief(first.actuator, runs, "coupling", followed=False)
    for before, after in zip(first.observations, second.observations, strict=True):
        assert after.delay == before.delay
        assert after.offset.get("current", 0.0) == before.offset.get("current", 0.0)
    assert not any(name.startswith("observation.delay") for name in second.parameters)
    for one, two in zip(validate(first.actuator, runs).runs, validate(second.actuator, runs).runs, strict=True):
        assert two.scores["current"].rmse == pytest.approx(one.scores["current"].rmse, rel=1e-9)
    # A fit that frees the circuit looks for the delay that belongs to its circuit.
    both = brief(first.actuator, runs, "electrical,coupling", followed=False)
    assert "observation.delay[0]" in both.parameters


def test_steps_of_two_rates_and_unknown_hold_do_not_claim_what_they_cannot_tell() -> None:
    # Both edges lie on their rows: a usual case, at the very end of what the rows allow.
    missed: dict[str, int] = {}
    for seed in range(8):
        generator = np.random.default_rng([SEED, seed])
        runs = []
        for rate in (50.0, 100.0):
            clean = simulate(FRIEND, "step 1 V delay=1 s", duration=40.0, rate=rate)
            noise = 2e-5 * generator.standard_normal(len(clean))
            runs.append(
                Run.from_arrays(
                    time=clean.time,
                    voltage=clean.voltage,
                    current=clean.current + noise,  # type: ignore[operator]
                    hold="unknown",
                )
            )
        fit = brief(FRIEND, runs)
        for name, parameter in fit.parameters.items():
            low, high = parameter.interval
            truth = FRIEND[name] if name in FRIEND.parameter_values else 0.0
            missed[name] = missed.get(name, 0) + (parameter.determined and not low <= truth <= high)
    assert max(missed.values()) <= 1, missed


@pytest.mark.parametrize("rows", [3, 5, 6, 7, 9, 12])
def test_few_rows_are_refused_or_their_fit_says_that_it_is_worth_nothing(rows: int) -> None:
    # Warnings are errors in this suite: none of NumPy's may come out.
    run = measured("step 1 V delay=0.1 s", "current")
    assert run.current is not None
    short = Run.from_arrays(
        time=run.time[:rows], voltage=run.voltage[:rows], current=run.current[:rows], hold="unknown"
    )
    if rows < 6:
        with pytest.raises(InputError, match=r"voltage is zero throughout|6 unknowns for \d usable readings"):
            identify(FRIEND, [short])
        return
    fit = identify(FRIEND, [short])
    left, varies = rms(fit.residuals[0]["current"]), float(np.std(short.current))
    said = "model-explains-nothing" in codes(fit)
    assert said == (left >= 0.5 * varies)
    assert ("does not follow what was read" in fit.message) == said
    assert not all(parameter.determined for parameter in fit.parameters.values())


def test_a_model_that_explains_some_says_how_much() -> None:
    """Beside a response of amplitude 4 another sine of amplitude 3: 16 of 25 parts of the variance are explained."""
    run = measured("sine 1 V 0.1 Hz", "current")
    assert run.current is not None
    size = math.sqrt(2.0) * float(np.std(run.current))
    mixed = replace(run, current=run.current + 0.75 * size * np.sin(2 * np.pi * 0.35 * run.time))
    (told,) = (one for one in brief(FRIEND, [mixed], followed=False).findings if one.code == "model-explains-nothing")
    percent = re.search(r"the model explains only (\d+) % of the variance of the current: it leaves", told.message)
    assert percent is not None
    assert int(percent[1]) == pytest.approx(64, abs=2)


def test_a_model_that_explains_nothing_never_just_converges() -> None:
    run = measured("sine 1 V 0.1 Hz", "current")
    wrong = replace(run, current=0.03 * np.sin(2 * np.pi * 0.37 * run.time))
    fit = identify(FRIEND, [wrong])
    (told,) = (finding for finding in fit.findings if finding.code == "model-explains-nothing")
    assert told.severity == "error"
    assert "does not follow what was read" in fit.message
    assert "the model explains nothing of the current" in told.message
    # A weak signal in much noise is no such case.
    generator = np.random.default_rng(SEED)
    weak = replace(run, current=run.current + 0.05 * generator.standard_normal(2000))  # type: ignore[operator]
    assert "model-explains-nothing" not in codes(identify(FRIEND, [weak]))
