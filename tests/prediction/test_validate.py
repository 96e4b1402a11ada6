"""Free-run prediction against runs: known truths, known faults, and the messages."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from ipmclab import Run, RunMetadata, identify, import_run, load_actuator, simulate
from ipmclab.errors import InputError
from ipmclab.model import Actuator
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.variants import with_stages
from ipmclab.prediction.open_coupling import open_coupling
from ipmclab.prediction.validate import validate
from ipmclab.prediction.verdict import verdict_of
from ipmclab.statespace.noise_model import NoiseModel

SEED = 20261121
RATE = 50.0


@pytest.fixture(scope="module")
def actuator() -> Actuator:
    return load_actuator("friend-2")


def record(actuator: Actuator, signal: str = "square 1 V 0.1 Hz", duration: float = 20.0, **changes: object) -> Run:
    """What the actuator would give, without noise, as a measured run."""
    run = simulate(actuator, signal, duration=duration, rate=RATE)
    return replace(
        run, **{"applied_voltage": None, "metadata": RunMetadata(signal=signal, starts_from_rest=True), **changes}
    )


def test_prediction_is_the_free_run_and_the_error_is_the_noise(actuator: Actuator) -> None:
    clean = record(actuator)
    rng = np.random.default_rng(SEED)
    noise = {name: rng.normal(0, size, len(clean)) for name, size in (("current", 1e-4), ("force", 2e-5))}
    noisy = replace(clean, displacement=None, **{name: getattr(clean, name) + added for name, added in noise.items()})
    validation = validate(actuator, [noisy])
    assert list(validation.scores) == ["current", "force"]
    for name, added in noise.items():
        one = validation.runs[0].scores[name]
        assert np.allclose(getattr(validation.runs[0].predicted, name), getattr(clean, name), rtol=0, atol=1e-12)
        y = getattr(noisy, name)
        assert one.fit_percent == pytest.approx(
            100 * (1 - np.linalg.norm(added) / np.linalg.norm(y - y.mean())), rel=1e-6
        )
        assert one.rmse == pytest.approx(np.sqrt(np.mean(added**2)), rel=1e-6)
        assert one.lags_outside < 0.3
    assert validation.findings == ()


def test_a_wrong_model_scores_worse_and_leaves_a_correlated_residual(actuator: Actuator) -> None:
    run = record(actuator)
    wrong = actuator.replace(**{"coupling.gain": 0.8 * actuator["coupling.gain"]})
    validation = validate(wrong, run)
    # Force is proportional to the coupling's gain: the residual is a fifth of the reading.
    assert validation.scores["force"].rmse == pytest.approx(0.2 * np.sqrt(np.mean(run.force**2)), rel=1e-9)
    assert validation.scores["current"].fit_percent == pytest.approx(100.0)
    assert validation.scores["force"].max_error_sample == int(np.argmax(np.abs(run.force)))
    assert validation.runs[0].scores["force"].lags_outside == 1.0


def test_the_zero_of_a_preloaded_cell_is_taken_off_and_said(actuator: Actuator) -> None:
    rng = np.random.default_rng(SEED)
    clean = record(actuator, "square 1 V 0.1 Hz delay=1 s")
    noise = rng.normal(0, 1e-5, len(clean))
    validation = validate(actuator, replace(clean, force=clean.force + 2e-3 + noise, displacement=None))
    # Known from 50 rows: to a seventh of the noise.
    assert validation.runs[0].zeros == {"force": pytest.approx(2e-3, abs=5e-6)}
    assert validation.scores["force"].rmse == pytest.approx(1e-5, rel=0.1)
    (finding,) = validation.findings
    assert finding.code == "zero-taken-off"
    assert "2 mN of force" in finding.message


@pytest.mark.parametrize("signal", ["square 1 V 0.1 Hz", "sine 1 V 0.2 Hz"])
def test_the_zero_that_a_wave_without_rest_shows_is_taken_off_and_said(actuator: Actuator, signal: str) -> None:
    noise = 1e-4 * np.random.default_rng(SEED).standard_normal(1000)
    clean = record(actuator, signal, displacement=None, force=None)
    validation = validate(actuator, replace(clean, current=clean.current + 2e-3 + noise))
    (one,) = validation.runs
    assert one.zeros == {"current": pytest.approx(2e-3, abs=4e-5)}
    assert one.scores["current"].rmse == pytest.approx(1e-4, rel=0.1)
    (finding,) = validation.findings
    assert "mA of current, which its wave shows, was subtracted" in finding.message
    assert validate(actuator, replace(clean, current=clean.current + noise)).runs[0].zeros == {}


def test_a_record_that_begins_amid_a_wave_shows_no_zero(actuator: Actuator) -> None:
    """Of a strip with more branches than the search has poles, a state at its start explains as much as a zero."""
    strip = with_stages(actuator, "branches=4").replace(
        **{"circuit.branches.2.resistivity": 40.0, "circuit.branches.2.permittivity": 2.0}
    )
    whole = record(strip, "square 1 V 0.05 Hz", 60.0, displacement=None, force=None)
    noise = 1e-4 * np.random.default_rng(SEED).standard_normal(1500)
    cut = Run.from_arrays(
        time=whole.time[:1500], voltage=whole.voltage[1025:2525], current=whole.current[1025:2525] + noise
    )
    assert validate(actuator, cut).runs[0].zeros == {}


@pytest.mark.parametrize("signal", ["sine 1 V 0.2 Hz", "step 1 V", "square 1 V 0.1 Hz"])
@pytest.mark.parametrize("output", ["displacement", "force"])
def test_the_zero_of_a_motion_without_rest_is_taken_off_and_said(actuator: Actuator, signal: str, output: str) -> None:
    """The score was that of a model that is wrong, and nothing said why. A gain that is wrong is no zero."""
    clean = record(actuator, signal, current=None)
    size = float(np.ptp(getattr(clean, output)))
    read = getattr(clean, output) + 0.002 * size * np.random.default_rng(SEED).standard_normal(len(clean))
    weak = actuator.replace(**{"coupling.gain": 0.8 * actuator["coupling.gain"]})
    for zero in (1.2 * size, -0.8 * size):
        for model in (actuator, weak):
            with_zero = replace(clean, **{"displacement": None, "force": None, output: read + zero})
            validation = validate(model, with_zero)
            assert validation.runs[0].zeros == {output: pytest.approx(zero, abs=0.05 * size)}
            assert model is weak or validation.scores[output].fit_percent > 95.0
            (finding,) = [one for one in validation.findings if one.code == "zero-taken-off"]
            assert "most of what was missed, also before the strip has moved much" in finding.message
    for model in (actuator, weak):
        assert (
            validate(model, replace(clean, **{"displacement": None, "force": None, output: read})).runs[0].zeros == {}
        )


@pytest.mark.parametrize(("output", "said"), [("current", "mA may have been read as A"), ("displacement", "mm may")])
def test_a_wrong_unit_comes_first_and_is_no_other_strip(actuator: Actuator, output: str, said: str) -> None:
    """ "The strip or its state was another one" was all that was said of it."""
    run = record(actuator)
    wrong = replace(run, **{output: 1e3 * getattr(run, output)})
    validation = validate(actuator, [run, wrong])
    assert (validation.findings[0].code, validation.findings[0].channel) == ("unit-off", output)
    verdict = verdict_of(validation)
    assert said in verdict.sentences[0]
    assert not verdict.missed
    assert not [sentence for sentence in verdict.sentences if "strip or its state was another one" in sentence]
    assert verdict.predicted[output] > 99.0  # that of the other run


@pytest.mark.parametrize("signal", ["sine 1 V 0.2 Hz", "square 1 V 0.1 Hz"])
def test_a_motion_without_rest_that_drifts_is_said_to(actuator: Actuator, signal: str) -> None:
    """ "The strip or its state was another one" was all that was said of a strip that curls as it dries."""
    run = record(actuator, signal, 40.0)
    assert run.displacement is not None
    slope = 3.0 * float(np.ptp(run.displacement)) / 40.0
    (sentence,) = [
        one
        for one in verdict_of(
            validate(actuator, replace(run, displacement=run.displacement + slope * run.time))
        ).sentences
        if "straight line" in one
    ]
    (said,) = re.findall(r"is a straight line of ([\d.]+) mm/s", sentence)
    assert float(said) == pytest.approx(1e3 * slope, rel=0.1)
    assert "strip or its state was another one" not in sentence


def test_a_channel_that_is_far_off_is_said(actuator: Actuator) -> None:
    run = record(actuator, "square 1 V 0.2 Hz delay=1 s")
    assert run.current is not None
    late = replace(run, current=np.append(np.full(6, run.current[0]), run.current[:-6]))
    (finding,) = [one for one in validate(actuator, late).findings if one.code == "channel-skew"]
    assert "lags behind the voltage channel by 6 rows" in finding.message


def test_a_zero_within_the_noise_stays(actuator: Actuator) -> None:
    rng = np.random.default_rng(SEED)
    clean = record(actuator, "square 1 V 0.1 Hz delay=0.2 s")
    noise = rng.normal(0, 1e-4, len(clean))
    validation = validate(actuator, replace(clean, force=clean.force + noise))
    assert validation.runs[0].zeros == {}
    assert validation.scores["force"].rmse == pytest.approx(np.sqrt(np.mean(noise**2)), rel=1e-9)


@pytest.mark.parametrize(
    "signal", ["chirp 1 V 0.02 Hz 2 Hz sweep_time=20 s", "sine 1 V 0.01 Hz", "triangle 1 V 0.01 Hz"]
)
def test_the_answer_to_a_voltage_that_begins_slowly_is_no_zero(actuator: Actuator, signal: str) -> None:
    """The strip draws current, and moves, before its voltage counts as on; what its sensors add is still found."""
    rng = np.random.default_rng(SEED)
    clean = simulate(actuator, signal, duration=20.0, rate=RATE)
    assert clean.current is not None
    current = clean.current + rng.normal(0, 1e-4, len(clean))
    for zero in (0.0, 2e-3):
        read = replace(clean, current=current + zero, displacement=None, force=None)
        zeros = validate(actuator, read).runs[0].zeros
        assert zeros == ({"current": pytest.approx(zero, abs=2e-4)} if zero else {})


@pytest.mark.parametrize("rows", [20, 40, 100])
def test_a_mean_of_autocorrelated_noise_is_rarely_a_zero(rows: int) -> None:
    """Of AR(1) noise of 0.9; three standard errors of white noise took a mean off in 53 to 57 %."""
    truth = load_actuator("friend-2")
    draws = np.random.default_rng(SEED).standard_normal((41, rows + 800))
    noise = 1e-4 * lfilter([np.sqrt(0.19)], [1.0, -0.9], draws)[:, 200:]

    def read(signal: str, duration: float, added: np.ndarray) -> Run:
        clean = simulate(truth, signal, duration=duration, rate=20.0)
        assert clean.current is not None
        return Run.from_arrays(
            time=clean.time, voltage=clean.voltage, current=clean.current + added[: len(clean)], hold=clean.hold
        )

    fit = identify(truth, read("square 1 V 0.1 Hz", 30.0, noise[-1]))
    waits = f"square 1 V 0.1 Hz delay={rows / 20.0} s"
    taken = ["current" in validate(fit, read(waits, rows / 20.0 + 10.0, one)).runs[0].zeros for one in noise[:-1]]
    assert sum(taken) <= 0.1 * len(taken)


@pytest.mark.parametrize("rest", [0.5, 2.0])
def test_what_a_model_lacks_hides_no_zero(rest: float) -> None:
    """The noise of its fit is slow and large, where rows at rest show none of that: a zero of 1 mA stayed in."""
    lacking = load_actuator("friend-2")
    strip = with_stages(lacking, "branches=3")
    strip = strip.replace(**{"circuit.branches.2.resistivity": 30.0, "circuit.branches.2.permittivity": 0.04})

    def read(signal: str, waits: float, zero: float) -> Run:
        clean = simulate(strip, f"{signal} delay={waits} s", duration=30.0, rate=50.0)
        assert clean.current is not None
        noise = np.random.default_rng(2).normal(0.0, 2e-5, len(clean))
        return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise + zero)

    fit = identify(lacking, read("step 2 V", 2.0, 0.0))
    for zero in (1e-4, 1e-3):
        assert validate(fit, read("step 1 V", rest, zero)).runs[0].zeros == {"current": pytest.approx(zero, abs=2e-5)}


def test_a_pause_among_rows_at_rest_needs_no_grid_of_it() -> None:
    noise = NoiseModel(step=1e-4, driven=1.0, coefficients=(0.9,))
    time = np.append(np.arange(50) * 1e-4, 3600.0 + np.arange(50) * 1e-4)
    assert noise.variance_of_mean(time) == pytest.approx(0.5 * noise.variance_of_mean(time[:50]), rel=1e-6)


def test_a_run_that_asks_for_a_stage_the_model_lacks_contradicts_its_band(actuator: Actuator) -> None:
    """A leak that 1 V does not show: what the fit leaves is noise, and it predicts 2 V to a fit of 70 %."""
    rng = np.random.default_rng(SEED)

    def read(strip: Actuator, signal: str) -> Run:
        clean = simulate(strip, signal, duration=30.0, rate=RATE)
        assert clean.current is not None
        current = clean.current + rng.normal(0, 1e-4, len(clean))
        return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, hold=clean.hold)

    leaking = load_actuator("friend-2+leak.cubic").replace(**{"leak.cubic.cubic": 15.0})
    for strip, expected in ((leaking, ["current"]), (actuator, [])):
        known = read(strip, "step 1 V delay=2 s")
        fit = identify(actuator, known)
        assert "stage-missing" not in {finding.code for finding in fit.findings}
        outcome = validate(fit, [known, read(strip, "step 2 V delay=1 s"), read(strip, "sine 0.5 V 0.2 Hz")])
        said = [finding for finding in outcome.findings if finding.code == "outside-band"]
        assert [finding.channel for finding in said] == expected
        assert (outcome.runs[1].scores["current"].fit_percent or 0.0) > 70.0
        for finding in said:
            assert finding.message.startswith(f"{outcome.runs[1].label}: the current lies farther")
            assert (finding.values["times"] or 0.0) > 5.0


@pytest.mark.parametrize("signal", ["step 1 V", "square 1 V 0.1 Hz", "sine 0.7 V 0.1 Hz offset=0.5 V"])
def test_no_zero_is_invented_where_the_model_lacks_a_relaxation(actuator: Actuator, signal: str) -> None:
    """What it misses has a mean of its own, but not before the strip has moved."""
    for ratio in (-0.6, 0.8):
        slow = {"relaxation.displacement.0.ratio": ratio, "relaxation.displacement.0.time_constant": 5.0}
        run = record(with_stages(actuator, "relaxation.displacement=1").replace(**slow), signal, 40.0)
        assert validate(actuator, replace(run, current=None, force=None)).runs[0].zeros == {}


def test_a_shunt_inside_the_sensed_voltage_is_part_of_the_path(actuator: Actuator) -> None:
    name = "circuit.contact_resistance"
    behind = record(actuator.replace(**{name: 1.0}))
    shunt = RunMetadata(voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    assert validate(actuator, replace(behind, metadata=shunt)).scores["current"].fit_percent == pytest.approx(100.0)
    assert validate(actuator, behind).scores["current"].fit_percent < 98.0


@pytest.mark.parametrize("delay", [-0.013, 0.008])
def test_the_delay_of_a_foreign_record_is_found_and_said(actuator: Actuator, delay: float) -> None:
    time = np.arange(1000) / RATE
    voltage = np.where(time % 10 < 5, 1.0, -1.0) * (time >= 2)
    outputs = simulate_outputs(actuator, time, voltage, "zero", outputs=["current", "force"], delay=delay)
    run = Run.from_arrays(time=time, voltage=voltage, current=outputs[0], force=outputs[1], hold="unknown")
    validation = validate(actuator, run)
    assert validation.runs[0].delay == pytest.approx(delay, abs=0.02 / RATE)
    assert validation.scores["current"].fit_percent > 99.9
    assert [finding.code for finding in validation.findings] == ["estimated-delay"]


def test_a_wrong_model_does_not_buy_a_better_score_with_a_delay(actuator: Actuator) -> None:
    clean = record(actuator, "square 1 V 0.1 Hz delay=2 s")
    unknown = replace(clean, hold="unknown", displacement=None)
    wrong = actuator.replace(**{"coupling.gain": 1e-8, "circuit.dc_resistivity": 10.0})
    validation = validate(wrong, unknown)
    assert abs(validation.runs[0].delay) < 0.5 / RATE
    assert validation.scores["force"].fit_percent < 90


def test_no_delay_is_claimed_where_no_edge_shows_it(actuator: Actuator) -> None:
    clean = record(actuator, "step 1 V")
    validation = validate(actuator, replace(clean, hold="unknown"))
    assert validation.runs[0].delay is None
    assert [finding.code for finding in validation.findings] == ["no-edge-shown"]
    assert validation.scores["current"].fit_percent > 99.9


def test_a_run_of_the_fit_is_read_as_the_fit_read_it(actuator: Actuator) -> None:
    rng = np.random.default_rng(SEED)
    time = np.arange(1000) / RATE
    voltage = np.where(time % 10 < 5, 1.0, -1.0) * (time >= 2)
    current = simulate_outputs(actuator, time, voltage, "zero", outputs=["current"], delay=0.007)[0]
    run = Run.from_arrays(time=time, voltage=voltage, current=current + rng.normal(0, 1e-4, 1000), hold="unknown")
    fit = identify(actuator, run, free="electrical")
    validation = validate(fit.actuator, run)
    assert validation.runs[0].delay == fit.observations[0].delay
    assert {finding.code for finding in validation.findings} == {"used-in-fit", "delay-of-the-fit"}
    residual = fit.residuals[0]["current"]
    assert validation.scores["current"].rmse == pytest.approx(np.sqrt(np.nanmean(residual**2)), rel=1e-6)


def test_a_run_of_the_fit_has_its_own_parameters(actuator: Actuator) -> None:
    rng = np.random.default_rng(SEED)
    signals = {"square 1 V 0.1 Hz": 0.0, "step 1 V": 6.0}
    runs = []
    for signal, contact in signals.items():
        clamped = actuator.replace(**{"circuit.contact_resistance": contact})
        clean = record(clamped, signal, displacement=None, force=None)
        runs.append(replace(clean, current=clean.current + rng.normal(0.0, 1e-4, len(clean))))
    name = "circuit.contact_resistance"
    fit = identify(actuator, runs, free=["circuit.dc_resistivity", name], per_run=[name])
    for place, one in enumerate(validate(fit.actuator, runs).runs):
        residual = fit.residuals[place]["current"]
        assert one.scores["current"].rmse == pytest.approx(np.sqrt(np.nanmean(residual**2)), rel=1e-6)


def test_an_open_coupling_is_said(actuator: Actuator) -> None:
    def fitted(names: list[str], **coefficients: float) -> Actuator:
        direction = {"coefficients": {f"coupling.{key}": value for key, value in coefficients.items()}, "sentence": "S"}
        table = {"parameters": [{"name": name} for name in names], "undetermined": [direction] if coefficients else []}
        return replace(actuator, fit_table=table)

    def known_to(error: float) -> Actuator:
        """Gain and zero trade against each other, d(0) = K_d Z_d/P_2d being known to a relative error."""
        parts = {"coupling.gain": 1.0, "coupling.zero": -0.5, "coupling.p2": 0.5}
        model = fitted([*parts], gain=0.8, zero=-0.5, p2=0.3)
        table = dict(model.fit_table or {})
        table["undetermined"] = [{**table["undetermined"][0], "error": 2.0}]
        # A large common part, along which d(0) stands still, and its own error in the gain.
        rows = [
            [
                actuator[one]
                * actuator[other]
                * (100.0 * parts[one] * parts[other] + error**2 * (one == other == "coupling.gain"))
                for other in parts
            ]
            for one in parts
        ]
        return replace(model, fit_table={**table, "covariance": {"names": [*parts], "rows": rows}})

    def known_size() -> Actuator:
        """The same directions as one that is open, and d(0) among what the readings determine."""
        model = fitted(["coupling.gain"], gain=1.0)
        return replace(model, fit_table={**(model.fit_table or {}), "known": [{"name": "coupling.static"}]})

    run = record(actuator, "step 1 V")
    cases = (
        (known_size(), []),
        (known_to(0.1), []),
        (known_to(0.6), ["coupling-undetermined"]),
        (fitted(["circuit.dc_resistivity"]), ["coupling-not-identified"]),
        (fitted(["coupling.gain"], gain=1.0), ["coupling-undetermined"]),
        (fitted(["coupling.gain", "coupling.zero"], gain=0.7071, zero=-0.7071), []),
        (fitted(["coupling.gain"]), []),
        (actuator, []),
    )

    def said(model: Actuator, run: Run) -> list[str]:
        # These tables hold what the coupling is judged by and no more, which is said too.
        return [finding.code for finding in validate(model, run).findings if finding.code != "bad-fit"]

    for model, codes in cases:
        assert said(model, run) == codes
    assert said(cases[0][0], replace(run, displacement=None, force=None)) == []


def test_missing_and_masked_readings_are_left_out(actuator: Actuator) -> None:
    clean = record(actuator)
    lost = clean.displacement.copy()
    lost[300:420] = np.nan
    validation = validate(actuator, replace(clean, displacement=lost))
    assert validation.scores["displacement"].left_out >= 120
    assert validation.scores["displacement"].fit_percent == pytest.approx(100.0)
    assert np.all(np.isnan(validation.runs[0].comparisons["displacement"].error[300:420]))


def test_runs_of_the_fit_are_named(actuator: Actuator) -> None:
    run = record(actuator)
    by_argument = validate(actuator, [run, record(actuator, "step 1 V")], used=[run.content_sha256])
    assert [one.used_in_fit for one in by_argument.runs] == [True, False]
    (finding,) = by_argument.findings
    assert finding.code == "used-in-fit"
    assert "square 1 V 0.1 Hz was used to identify" in finding.message


def test_an_assumed_rest_is_said(actuator: Actuator) -> None:
    run = replace(record(actuator), metadata=RunMetadata(starts_from_rest=False))
    assert [finding.code for finding in validate(actuator, run).findings] == ["assumed-rest"]


def test_nothing_to_compare_and_no_run_are_refused(actuator: Actuator) -> None:
    with pytest.raises(InputError, match=r"nothing was measured that friend-2 predicts, the run has voltage"):
        validate(actuator, Run.from_arrays(time=[0.0, 0.02], voltage=[0.0, 1.0]))
    with pytest.raises(InputError, match="there is no run to predict"):
        validate(actuator, [])


def test_a_run_that_is_given_twice_is_refused(actuator: Actuator) -> None:
    run = simulate(actuator, "step 1 V", duration=2, rate=50)
    with pytest.raises(InputError, match=r"copy: the same record is given twice, as step\.nc too"):
        validate(actuator, [replace(run, file="step.nc"), replace(run, file="copy")])


def test_a_channel_with_nothing_but_noise_is_not_scored(actuator: Actuator) -> None:
    rng = np.random.default_rng(SEED)
    clean = record(actuator)
    validation = validate(actuator, replace(clean, force=rng.normal(0, 1e-4, len(clean))))
    one = validation.scores["force"]
    assert (one.fit_percent, one.rmse, one.samples) == (None, None, 0)
    assert "nothing but noise" in one.reason


def test_a_channel_that_nothing_moves_gives_no_fit_but_a_reason(actuator: Actuator) -> None:
    clean = record(actuator)
    validation = validate(actuator, replace(clean, force=np.full(len(clean), 1e-4)))
    assert validation.scores["force"].fit_percent is None
    assert validation.scores["force"].reason


def test_pooled_scores_cover_only_the_runs_that_have_the_output(actuator: Actuator) -> None:
    square = replace(record(actuator), force=None)
    step = replace(record(actuator, "step 1 V"), displacement=None)
    validation = validate(actuator, [square, step])
    assert validation.scores["force"].samples == len(step)
    assert validation.scores["current"].samples == len(step) + len(square)
    document = validation.as_dict()
    assert document["actuator"] == "friend-2"
    assert [run["label"] for run in document["runs"]] == ["square 1 V 0.1 Hz", "step 1 V"]


def test_a_real_record_is_scored_without_its_missing_contact(actuator: Actuator, real_runs: Path) -> None:
    maps = Path(__file__).parents[2] / "docs" / "import_maps"
    run = import_run(real_runs / "step_3V.csv.gz", maps / "step_3V.toml")
    validation = validate(actuator, run)
    # The contact is missing for 130 rows after the voltage steps at row 560; the load cell was not used.
    assert np.flatnonzero(~validation.runs[0].comparisons["current"].used).tolist() == list(range(560, 690))
    assert validation.scores["current"].fit_percent < 0  # another strip than friend-2
    assert "nothing but noise" in validation.scores["force"].reason


def test_every_finding_of_a_validation_is_explained_in_the_documentation() -> None:
    root = Path(__file__).parents[2]
    source = (root / "src/ipmclab/prediction/validate.py").read_text("utf-8")
    for name in ("open_coupling", "said_of_run", "outside_band"):
        source += (root / f"src/ipmclab/prediction/{name}.py").read_text("utf-8")
    codes = set(re.findall(r'Finding\(\s*"([a-z-]+)"', source))
    assert {"used-in-fit", "zero-taken-off"} <= codes
    rows = re.findall(r"^\| (`[^|]*`) \|", (root / "docs/commands.md").read_text("utf-8"), flags=re.MULTILINE)
    assert codes <= {code for row in rows for code in re.findall(r"`([a-z-]+)`", row)}


@pytest.mark.parametrize(
    "direction",
    [
        {"coefficients": {"coupling.gain": "much"}},
        {"coefficients": ["coupling.gain"]},
        {"coefficients": {"coupling.gain": 1.0}, "error": "large"},
        {},
    ],
)
def test_a_direction_that_somebody_spoiled_says_nothing_of_the_coupling(
    actuator: Actuator, direction: dict[str, object]
) -> None:
    """It was a ValueError."""
    table = {"parameters": [{"name": "coupling.gain"}], "undetermined": [direction]}
    assert open_coupling(replace(actuator, fit_table=table)) == []


@pytest.mark.parametrize(
    ("edited", "key"),
    [
        ({"parameters": [{"value": 1.0}]}, "fit.parameters.0"),
        ({"parameters": ["gone"]}, "fit.parameters.0"),
        ({"runs": [{"content_sha256": "0", "noise": 1.0}]}, "fit.runs.0.noise"),
        ({"runs": [{"content_sha256": "0", "offset": ["a"]}]}, "fit.runs.0.offset"),
        ({"runs": [{"content_sha256": "0", "drift": 3.0}]}, "fit.runs.0.drift"),
    ],
)
def test_a_fit_table_that_somebody_spoiled_is_named(actuator: Actuator, edited: dict[str, object], key: str) -> None:
    """Found among drawn bad inputs: it was a KeyError."""
    table = {"runs": [{"content_sha256": "0"}], "parameters": [], **edited}
    with pytest.raises(InputError) as caught:
        validate(replace(actuator, fit_table=table), [record(actuator, duration=2.0)])
    assert caught.value.where == key
