"""Prediction bands against the scatter of predictions and of readings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import InputError, Run, identify, load_actuator, prediction_bands, read_fit, simulate, validate, write_fit
from tests.identification.many import CONTACT, FRIEND, NOISE, noisy

SEED = 20261121
SHEET = "circuit.sheet_resistance"
NEW = simulate(FRIEND, "sine 1 V 0.2 Hz", duration=20.0, rate=25.0)


def test_the_band_of_the_answer_is_the_scatter_of_predictions() -> None:
    """Fits to readings drawn anew: how far their predictions lie apart needs no band."""
    generator = np.random.default_rng(SEED)
    predicted, told = [], []
    for _ in range(40):
        bands = prediction_bands(identify(FRIEND, noisy(generator, "step 1 V")), NEW)
        predicted.append(bands.predicted["current"])
        told.append(bands.of_parameters["current"])
    scatter = np.std(predicted, axis=0, ddof=1)
    # 40 draws know a deviation to 11 %; along time they are few degrees of freedom.
    assert np.median(np.mean(told, axis=0)[10:] / scatter[10:]) == pytest.approx(1.0, abs=0.3)


def test_a_fixed_value_with_an_uncertainty_counts_with_what_moved_with_it() -> None:
    """The true sheet resistance differs from strip to strip by what is stated, and the fit holds the stated value."""
    generator = np.random.default_rng(SEED)
    deviation = 0.015
    given = replace(FRIEND, standard_uncertainties={SHEET: deviation})
    away = []
    for _ in range(20):
        sheet = FRIEND[SHEET] + deviation * float(np.clip(generator.standard_normal(), -2.0, 2.0))
        strip = FRIEND.replace(**{SHEET: sheet})
        fit = identify(given, noisy(generator, "step 1 V", strip=strip))
        truth = simulate(strip, "sine 1 V 0.2 Hz", duration=20.0, rate=25.0)
        bands = prediction_bands(fit, truth)
        assert truth.current is not None
        away.append((bands.predicted["current"] - truth.current)[10:] / bands.of_parameters["current"][10:])
        # The current is known to a thousandth, though the first branch is known to a quarter only.
        assert fit.parameters["circuit.branches.0.resistivity"].standard_error > 0.05
        assert np.median(bands.of_parameters["current"]) < 1e-3 * np.ptp(truth.current)
    assert np.sqrt(np.mean(np.square(away))) == pytest.approx(1.0, abs=0.35)


def test_a_fit_that_was_read_has_the_same_band(tmp_path: Path) -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, noisy(generator, "step 1 V", outputs=("current", "force")), free=["electrical", "coupling"])
    write_fit(fit, tmp_path / "fitted.toml")
    one, other = prediction_bands(fit, NEW), prediction_bands(read_fit(tmp_path / "fitted.toml"), NEW)
    for output in ("current", "force"):
        np.testing.assert_allclose(one.reach(output), other.reach(output), rtol=1e-12)
    assert set(one.predicted) == {"current", "force"}


def test_validate_tells_the_share_of_readings_inside() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, [noisy(generator, "step 1 V"), noisy(generator, "sine 1 V 0.1 Hz")])
    shares = []
    for _ in range(5):
        told = validate(fit.actuator, [noisy(generator, "square 1 V 0.1 Hz"), noisy(generator, "sine 1 V 0.4 Hz")])
        shares.append(told.scores["current"].inside_band or 0.0)
    # 7500 readings: three standard deviations.
    assert np.mean(shares) == pytest.approx(0.95, abs=0.012)
    assert validate(FRIEND, NEW).scores["current"].inside_band is None
    other = FRIEND.replace(**{"circuit.dc_resistivity": 30.0})
    of_another = validate(fit.actuator, [noisy(generator, "sine 1 V 0.4 Hz", strip=other)])
    assert (of_another.scores["current"].inside_band or 0.0) < 0.8


def test_an_actuator_that_was_changed_since_its_fit_has_no_band() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, noisy(generator, "step 1 V"))
    changed = fit.actuator.replace(**{"circuit.dc_resistivity": 30.0})
    told = validate(replace(changed, fit_table=fit.actuator.fit_table), noisy(generator, "sine 1 V 0.4 Hz"))
    assert told.scores["current"].inside_band is None
    (finding,) = [one for one in told.findings if one.code == "changed-since-fit"]
    assert finding.message.startswith("circuit.dc_resistivity is no longer what it was when its fit was made")


def test_an_uncertainty_that_was_stated_after_the_fit_is_said_not_to_count() -> None:
    """As the message of `exact-fixed-value` asks for, but in the file of the fit, which held the value as exact."""
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, noisy(generator, "step 1 V"))
    stated = {**fit.actuator.standard_uncertainties, "circuit.sheet_resistance": 0.05}
    told = validate(replace(fit.actuator, standard_uncertainties=stated), noisy(generator, "sine 1 V 0.4 Hz"))
    (finding,) = [one for one in told.findings if one.code == "changed-since-fit"]
    assert finding.message.startswith("the stated uncertainty of circuit.sheet_resistance is no longer what it was")


def test_a_run_of_the_fit_has_its_own_band() -> None:
    """With the contact of its own, and the noise of its own."""
    generator = np.random.default_rng(SEED)
    runs = [
        noisy(generator, signal, strip=FRIEND.replace(**{CONTACT: contact}))
        for signal, contact in (("step 1 V", 0.5), ("sine 1 V 0.1 Hz", 1.5))
    ]
    fit = identify(FRIEND, runs, free="circuit.dc_resistivity", per_run=CONTACT)
    told = validate(fit.actuator, runs)
    assert told.scores["current"].inside_band == pytest.approx(0.95, abs=0.02)
    reach = told.runs[0].comparisons["current"].reach
    assert reach is not None
    assert np.median(reach) == pytest.approx(1.96 * NOISE["current"], rel=0.1)
    # Of a new run's contact two others tell nothing, and the band says so.
    assert prediction_bands(fit, NEW).left_out == (CONTACT,)


def test_messages() -> None:
    fit = identify(FRIEND, noisy(np.random.default_rng(SEED), "step 1 V"))
    with pytest.raises(InputError, match="there is no band of 'force': the fit read current alone") as caught:
        prediction_bands(fit, NEW).interval("force")
    assert caught.value.code == "no-band"
    with pytest.raises(InputError, match="this is an Actuator, not a fit") as caught:
        prediction_bands(FRIEND, NEW)  # type: ignore[arg-type]
    assert caught.value.code == "not-a-fit"
    with pytest.raises(InputError, match=r"read_run"):
        prediction_bands(fit, "step.nc")  # type: ignore[arg-type]


def test_a_table_that_is_none_has_no_band_and_validate_says_why() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, noisy(generator, "step 1 V"))
    table = {**(fit.actuator.fit_table or {}), "rank": -3}
    told = validate(replace(fit.actuator, fit_table=table), noisy(generator, "sine 1 V 0.4 Hz"))
    assert told.scores["current"].inside_band is None
    (finding,) = [one for one in told.findings if one.code == "bad-fit"]
    assert "fit.rank" in finding.message
    assert finding.message.endswith("there is no 95 % band")


@pytest.mark.parametrize("own", ["per_run", "per_mounting"])
def test_what_goes_with_a_parameter_that_no_reading_shows_goes_with_it_in_another_run_too(own: str) -> None:
    """A gain of its own run beside a zero beyond the rows: of a motion of 0.65 mm the band reached over 150 mm."""
    strip = load_actuator("friend-2")
    generator = np.random.default_rng(3)
    runs = []
    for mounting, times in (("a", 1.0), ("b", 1.2), ("c", 0.9)):
        clean = simulate(
            strip.replace(**{"coupling.gain": times * strip["coupling.gain"]}), "step 1 V", duration=20, rate=50
        )
        noise = generator.standard_normal((2, len(clean)))
        run = Run.from_arrays(
            time=clean.time,
            voltage=clean.voltage,
            current=clean.current + 1e-4 * noise[0],
            displacement=clean.displacement + 1e-5 * noise[1],
        )
        runs.append(replace(run, metadata=replace(run.metadata, mounting_id=mounting)))
    fit = identify(strip, runs, free="electrical,coupling", **{own: "coupling.gain"})
    new = simulate(strip, "sine 1 V 0.2 Hz", duration=10, rate=50)
    assert new.displacement is not None
    for mounting in (None, "another"):
        bands = prediction_bands(fit, replace(new, metadata=replace(new.metadata, mounting_id=mounting)))
        assert float(np.max(bands.of_parameters["displacement"])) < 0.5 * float(np.ptp(new.displacement))
        low, high = bands.interval("displacement", of_readings=False)
        assert (low <= new.displacement).all()
        assert (new.displacement <= high).all()
