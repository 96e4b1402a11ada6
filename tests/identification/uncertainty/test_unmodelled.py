"""What the readings of a fit leave open of relaxations that its model lacks, and what that does to predictions."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import (
    Fit,
    InputError,
    Run,
    identify,
    load_actuator,
    prediction_bands,
    read_fit,
    simulate,
    validate,
    write_fit,
)
from ipmclab.fit.fit_file import fit_of
from ipmclab.fit.unmodelled import Unmodelled, lagged
from ipmclab.identification.solved import Estimate
from ipmclab.identification.uncertainty.unmodelled import unmodelled
from ipmclab.model.order import Order
from ipmclab.run import FloatArray
from tests.identification.many import FRIEND, NOISE, noisy

SEED = 20261121
SEEN = 15.0
RATE = 25.0
ROWS = round((5.0 + SEEN) * RATE)
STEP = simulate(FRIEND, "step 1 V delay=5 s", duration=5.0 + 2.0 * SEEN, rate=RATE)


_CONSTANTS = np.geomspace(1.0 / RATE, 100.0 * SEEN, 60)
DIFFUSION = (np.sqrt(SEEN / _CONSTANTS) * np.log(_CONSTANTS[1] / _CONSTANTS[0])) @ lagged(
    STEP.time, STEP.voltage, _CONSTANTS
)
"""What diffusion adds to an answer: relaxations of any time constant, of no circuit with two branches [V]."""


def recorded(generator: np.random.Generator, size: float = 0.0) -> tuple[FloatArray, Run]:
    """The current of a strip to the end [A], and the run that a fit sees, with so much diffusion [A/V]."""
    assert STEP.current is not None
    current = STEP.current + size * DIFFUSION + NOISE["current"] * generator.standard_normal(len(STEP))
    return current, Run.from_arrays(time=STEP.time[:ROWS], voltage=STEP.voltage[:ROWS], current=current[:ROWS])


def test_the_band_beyond_the_record_holds_what_a_model_of_two_branches_lacks() -> None:
    generator = np.random.default_rng(SEED)
    inside, if_right = [], []
    for _ in range(16):
        current, seen = recorded(generator, -1e-3)
        bands = prediction_bands(identify(FRIEND, seen), STEP)
        missed = np.abs(current - bands.predicted["current"])[ROWS:]
        right = 1.2816 * np.hypot(bands.of_parameters["current"], bands.of_noise["current"])[ROWS:]
        inside.append(np.mean(missed <= bands.reach("current", 0.8)[ROWS:]))
        if_right.append(np.mean(missed <= right))
    assert np.mean(if_right) < 0.3
    assert np.mean(inside) > 0.6


def test_a_band_holds_what_hardly_shows_in_a_fit_that_may_be_used() -> None:
    """A hundredth part of the current: the fit follows it to its noise, and goes on elsewhere. ``validate`` says it."""
    generator = np.random.default_rng(SEED)
    inside, if_right, told = [], [], []
    for _ in range(8):
        current, seen = recorded(generator, -3e-5)
        fit = identify(FRIEND, seen)
        assert not any(finding.severity == "error" for finding in fit.findings)
        whole = Run.from_arrays(time=STEP.time, voltage=STEP.voltage, current=current)
        bands = prediction_bands(fit, whole)
        missed = np.abs(current - bands.predicted["current"])
        inside.append(np.mean(missed <= bands.reach("current")))
        if_right.append(np.mean(missed <= replace(bands, of_model={}).reach("current")))
        told.append(validate(fit, whole).scores["current"].inside_band)
    assert np.mean(if_right) < 0.92
    assert np.mean(inside) > 0.93
    assert told == pytest.approx(inside, abs=0.02)


def test_a_model_that_lacks_nothing_has_the_band_of_its_parameters() -> None:
    """Neither beyond the record nor under another voltage do the readings of a right model leave much open."""
    generator = np.random.default_rng(SEED)
    sine = simulate(FRIEND, "sine 1 V 0.4 Hz", duration=20.0, rate=RATE)
    wider = []
    for _ in range(8):
        fit = identify(FRIEND, recorded(generator)[1])
        for run in (STEP, sine):
            bands = prediction_bands(fit, run)
            right = np.hypot(bands.of_parameters["current"], bands.of_noise["current"])
            wider.append(np.median(np.hypot(right, bands.of_model["current"]) / right))
    assert np.mean(wider) < 1.01
    assert np.max(wider) < 1.05


def test_what_is_open_grows_beyond_the_record() -> None:
    """Within its time the readings hold it down, under half of the voltage too."""
    fit = identify(FRIEND, recorded(np.random.default_rng(SEED))[1])
    step = prediction_bands(fit, STEP).of_model["current"]
    half = prediction_bands(fit, simulate(FRIEND, "step 0.5 V", duration=SEEN, rate=RATE)).of_model["current"]
    assert np.median(step[ROWS + 200 :]) > 3.0 * np.median(step[200:ROWS])
    assert np.median(half[75:]) < np.median(step[200:ROWS])


def test_readings_that_the_model_meets_exactly_leave_nothing_open() -> None:
    fit = identify(FRIEND, simulate(FRIEND, "step 1 V", duration=10.0, rate=RATE), free="circuit.dc_resistivity")
    bands = prediction_bands(fit, STEP)
    assert float(np.max(bands.of_model["current"])) < 1e-9


def test_a_force_has_it_as_a_current_has() -> None:
    generator = np.random.default_rng(SEED)
    run = noisy(generator, "step 1 V", outputs=("current", "force"), mounting="a")
    fit = identify(FRIEND, run, free=["electrical", "coupling"])
    assert set(fit.unmodelled) == {"current", "force"}
    bands = prediction_bands(fit, simulate(FRIEND, "step 1 V", duration=60.0, rate=RATE))
    assert set(bands.of_model) == {"current", "force"}
    assert all(np.isfinite(one).all() for one in bands.of_model.values())


def test_a_fit_that_was_read_has_the_same(tmp_path: Path) -> None:
    fit = identify(FRIEND, noisy(np.random.default_rng(SEED), "step 1 V"))
    write_fit(fit, tmp_path / "fitted.toml")
    read = read_fit(tmp_path / "fitted.toml")
    assert read.unmodelled == fit.unmodelled
    one, other = prediction_bands(fit, STEP), prediction_bands(read, STEP)
    np.testing.assert_allclose(one.of_model["current"], other.of_model["current"], rtol=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("time_constants", [0.0, 1.0], "a time constant"),
        ("amplitudes", [[1.0]], "unequal lengths"),
        ("moved", {"circuit.dc_resistivity": [1.0, 2.0]}, "unequal lengths"),
        ("seen", float("nan"), "not finite"),
    ],
)
def test_a_table_that_no_fit_wrote_is_refused(tmp_path: Path, key: str, value: object, said: str) -> None:
    table = Unmodelled((1.0, 3.0), ((1e-4, 1e-5),), {"circuit.dc_resistivity": (0.1,)}, 10.0).to_table()
    assert Unmodelled.from_table(table).to_table() == table
    with pytest.raises(ValueError, match=said):
        Unmodelled.from_table({**table, key: value})
    fit = identify(FRIEND, noisy(np.random.default_rng(SEED), "step 1 V"))
    write_fit(fit, tmp_path / "fitted.toml")
    actuator = load_actuator(tmp_path / "fitted.toml")
    assert actuator.fit_table is not None
    wrong = {**actuator.fit_table, "unmodelled": {"current": {**table, key: value}}}
    with pytest.raises(InputError) as caught:
        fit_of(replace(actuator, fit_table=wrong), where="fitted.toml")
    assert caught.value.code == "bad-fit"


def test_a_lag_on_an_irregular_clock_is_that_on_a_regular_one() -> None:
    time = np.arange(200) * 0.05
    voltage = np.where(time > 2.0, 1.0, 0.0)
    constants = np.array([0.1, 3.0])
    kept = np.sort(np.random.default_rng(SEED).choice(200, 120, replace=False))
    kept = np.unique(np.append(kept, [0, 40, 41, 42, 199]))
    regular, irregular = lagged(time, voltage, constants), lagged(time[kept], voltage[kept], constants)
    np.testing.assert_allclose(irregular, regular[:, kept], atol=1e-12)


def test_a_fast_run_beside_a_long_one_costs_no_more_than_their_rows() -> None:
    """The answer was computed at each row of the fast one, for as long as the long one is: 20 million rows."""
    generator = np.random.default_rng(SEED)
    fast = noisy(generator, "step 1 V", duration=0.2, rate=1000.0)
    long = noisy(generator, "step 1 V", duration=20_000.0, rate=0.05)
    fit = identify(FRIEND, [fast, long])
    assert isinstance(fit.estimate, Estimate)
    tracemalloc.start()
    found = unmodelled(fit.estimate.correlated, FRIEND, Order(FRIEND.parameter_values))
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found["current"].seen == pytest.approx(20_000.0, rel=0.01)
    assert most < 20e6


@pytest.mark.parametrize("per", ["per_run", "per_mounting"])
def test_what_each_mounting_has_for_itself_makes_up_for_it_in_another_too(per: str) -> None:
    """A model that is right: it was taken not to have moved there, and the band became eleven times the noise."""
    generator = np.random.default_rng(SEED)
    name, runs = "coupling.gain", []
    for mounting, gain in (("a", 1.0), ("b", 1.2), ("c", 0.9)):
        strip = FRIEND.replace(**{name: gain * FRIEND[name]})
        runs.append(noisy(generator, "step 1 V", strip=strip, outputs=("current", "displacement"), mounting=mounting))
    fit = identify(FRIEND, runs, free=["electrical", "coupling"], **{per: name})
    sine = simulate(FRIEND, "sine 1 V 0.2 Hz", duration=20.0, rate=RATE)
    for mounting in (None, "b", "new"):
        run = replace(sine, metadata=replace(sine.metadata, mounting_id=mounting))
        assert np.max(prediction_bands(fit, run).of_model["displacement"]) < 0.1 * NOISE["displacement"]


def test_a_fit_of_a_zero_alone_has_a_band_too() -> None:
    """None of the strip's own parameters moved to make up for what the model may lack."""
    run = noisy(np.random.default_rng(SEED), "step 1 V")
    fit = identify(FRIEND, run, free="observation.offset.current")
    bands = prediction_bands(fit, STEP)
    assert 0.0 < np.max(bands.of_model["current"]) < NOISE["current"]
    assert np.all(bands.of_parameters["current"] == 0.0)


def test_no_time_constant_at_all_is_nothing_lacking() -> None:
    none = Unmodelled.from_table({"time_constants": [], "amplitudes": [[], []], "moved": {}, "seen": 1.0})
    np.testing.assert_array_equal(none.answers(STEP.time, STEP.voltage), np.zeros((2, len(STEP))))


def test_validate_says_that_a_run_is_longer_than_those_of_the_fit() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, noisy(generator, "step 1 V", duration=15.0))
    told = validate(fit.actuator, noisy(generator, "step 1 V", duration=30.0))
    (finding,) = [one for one in told.findings if one.code == "longer-than-fit"]
    assert finding.message.endswith("what the strip does only after that is not in its band")
    same = validate(fit.actuator, noisy(generator, "square 1 V 0.2 Hz", duration=15.0))
    assert not any(one.code == "longer-than-fit" for one in same.findings)
    plain = validate(FRIEND, noisy(generator, "step 1 V", duration=30.0))
    assert not any(one.code == "longer-than-fit" for one in plain.findings)


def test_validate_says_that_a_run_is_at_other_voltages_than_those_of_the_fit() -> None:
    """A step at one voltage does not show whether a strip answers in proportion."""
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, noisy(generator, "step 1 V", duration=15.0))

    def said(fit: Fit, signal: str) -> list[str]:
        told = validate(fit.actuator, noisy(generator, signal, duration=15.0))
        return [one.message for one in told.findings if one.code == "other-voltages"]

    (message,) = said(fit, "step 2 V")
    assert "100 % of" in message
    assert "(2 V) at which no run of the fit was (1 V)" in message
    assert len(said(fit, "step 0.5 V")) == len(said(fit, "square 1 V 0.2 Hz")) == 1
    assert said(fit, "step 1.05 V") == []
    through = identify(FRIEND, noisy(generator, "triangle 1 V 0.1 Hz", duration=15.0))
    assert said(through, "step 0.5 V") == said(through, "square 1 V 0.2 Hz") == []
    (message,) = said(through, "sine 2 V 0.2 Hz")
    assert "(-0.99 to 0.99 V)" in message
    assert Unmodelled.from_table({"time_constants": [], "amplitudes": [], "moved": {}, "seen": 1.0}).levels == ()


def test_the_noise_of_a_recorded_voltage_is_no_step() -> None:
    """No recorded voltage is exactly zero before its step: the rest there was counted as time under voltage."""
    generator = np.random.default_rng(SEED)
    clean = simulate(FRIEND, "step 1 V delay=5 s", duration=20.0, rate=RATE)
    assert clean.current is not None
    run = Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage + 1e-3 * generator.standard_normal(len(clean)),
        current=clean.current + NOISE["current"] * generator.standard_normal(len(clean)),
    )
    fit = identify(FRIEND, run)
    assert fit.unmodelled["current"].seen == pytest.approx(15.0, abs=0.1)
    told = validate(fit.actuator, noisy(generator, "step 1 V", duration=20.0))
    assert any(one.code == "longer-than-fit" for one in told.findings)
