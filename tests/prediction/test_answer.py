"""The interval of a simulated answer against the strip that the fit was made from, and where there is none."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import InputError, RunMetadata, identify, load_actuator, prediction_bands, read_fit, simulate, write_fit
from ipmclab.fit.fit import Fit
from ipmclab.model import Actuator
from ipmclab.prediction.answer import MOST_ROWS, SureAnswer, sure_answer
from tests.identification.many import CONTACT, FRIEND, NOISE, noisy

SEED = 20261121
DC = "circuit.dc_resistivity"


def asked(strip: Actuator, rate: float = 25.0):
    return simulate(strip, "sine 1 V 0.2 Hz", duration=20.0, rate=rate)


def sure_of(strip: Actuator, *, named: str = "") -> SureAnswer:
    found = sure_answer(strip, asked(strip), named=named)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def fit() -> Fit:
    return identify(FRIEND, noisy(np.random.default_rng(SEED), "step 1 V", mounting="a"), free="electrical")


def test_the_interval_at_the_peak_holds_the_true_answer() -> None:
    """The strip that the runs were drawn from is known: its answer needs no fit."""
    generator = np.random.default_rng(SEED)
    truth = asked(FRIEND).current
    assert truth is not None
    answers, readings = [], []
    for _ in range(80):
        strip = identify(FRIEND, noisy(generator, "step 1 V"), free="electrical").actuator
        run, sure = asked(strip), sure_of(strip)
        assert sure.here is not None
        assert run.current is not None
        for row in (int(np.argmax(np.abs(run.current))), -1):
            low, high = sure.here.interval("current", of_readings=False)
            answers.append(low[row] <= truth[row] <= high[row])
            low, high = sure.here.interval("current")
            readings.append(low[row] <= truth[row] + NOISE["current"] * generator.standard_normal() <= high[row])
    # 80 fits know 95 % to 2.4 %, and the two rows of one fit are correlated; benchmarks/answers.py counts a thousand.
    assert np.mean(answers) == pytest.approx(0.95, abs=0.07)
    assert np.mean(readings) == pytest.approx(0.95, abs=0.05)


def test_mountings_that_differ_have_the_next_one_alone() -> None:
    """What their average answers is none of their answers; a fourth strip like them lies in the interval."""
    generator = np.random.default_rng(SEED)
    strips = [FRIEND.replace(**{DC: value}) for value in (38.0, 42.0, 47.0)]
    runs = [
        noisy(generator, "square 1 V 0.05 Hz", strip=one, mounting=name)
        for one, name in zip(strips, "abc", strict=True)
    ]
    fitted = identify(FRIEND, runs, free=DC).actuator
    sure = sure_of(fitted)
    assert sure.here is None
    assert (
        sure.why_none == "mountings a, b and c differ by more than their errors, and the fit answers for none of them"
    )
    assert sure.sentences()[0].startswith("The 95 % intervals hold for the next mounting alone: mountings a, b and c")
    assert sure.following is not None
    low, high = sure.following.interval("current", of_readings=False)
    for strip in (*strips, FRIEND):
        truth = asked(strip).current
        assert truth is not None
        assert np.all((low <= truth) & (truth <= high))
    two = sure_of(identify(FRIEND, runs[::2], free=DC).actuator)
    assert (two.here, two.following) == (None, None)
    assert two.sentences()[0].startswith("No interval: mountings a and c differ")


def test_mountings_that_are_alike_have_both(fit: Fit) -> None:
    generator = np.random.default_rng(SEED)
    alike = identify(FRIEND, [noisy(generator, "step 1 V", mounting=name) for name in "abc"], free=DC)
    sure = sure_of(alike.actuator)
    assert sure.here is not None
    assert sure.following is not None
    assert np.all(
        sure.following.reach("current", of_readings=False)[5:] > sure.here.reach("current", of_readings=False)[5:]
    )
    assert sure.sentences()[0] == "The 95 % intervals hold for the mountings of the fit, a, b and c."
    alone = sure_of(fit.actuator)
    assert alone.following is None
    assert alone.sentences()[0] == "The 95 % intervals hold for mounting a."
    assert alone.next_mounting_unknown.endswith(
        "cannot be estimated from one mounting: it takes three or more of the same strip"
    )
    assert alone.not_read == ("displacement", "force")


@pytest.mark.parametrize("contacts", [{"a": 0.3, "b": 1.0}, {"a": 0.3, "b": 1.0, "c": 0.6}])
def test_the_interval_holds_what_each_mounting_answers_that_has_its_own_contact(contacts: dict[str, float]) -> None:
    generator = np.random.default_rng(SEED)
    strips = {name: FRIEND.replace(**{CONTACT: contact}) for name, contact in contacts.items()}
    runs = [
        noisy(generator, signal, strip=strip, mounting=name)
        for name, strip in strips.items()
        for signal in ("step 1 V", "sine 1 V 0.1 Hz")
    ]
    fitted = identify(FRIEND, runs, free=DC, per_mounting=CONTACT).actuator
    sure = sure_of(fitted)
    assert sure.here is not None
    low, high = sure.here.interval("current", of_readings=False)
    least, most = np.full(len(low), np.inf), np.full(len(low), -np.inf)
    inside = []
    for strip in strips.values():
        truth = asked(strip).current
        assert truth is not None
        # Beside the farthest mounting the interval is that of its own: four standard deviations, two of them in it.
        size = 2.0 * sure.here.of_parameters["current"] + 1e-12
        assert np.all((low - size <= truth) & (truth <= high + size))
        least, most = np.minimum(least, truth), np.maximum(most, truth)
        noise = NOISE["current"] * generator.standard_normal(len(truth))
        reading_low, reading_high = sure.here.interval("current")
        inside.append(np.mean((reading_low <= truth + noise) & (truth + noise <= reading_high)))
    assert min(inside) > 0.93
    # The middle is the average over the runs: no wider than twice what lies between the mountings, and their errors.
    assert np.all(high - low <= 2.0 * (most - least) + 8.0 * sure.here.of_parameters["current"] + 1e-12)
    names = {2: "a and b", 3: "a, b and c"}[len(contacts)]
    assert sure.sentences()[:2] == [
        f"The 95 % intervals hold for the mountings of the fit, {names}.",
        f"Each of them has its own {CONTACT}: the answer is that of the average over the runs, and the intervals hold "
        "what each mounting answers.",
    ]
    assert not any("beyond what the runs of the fit show" in sentence for sentence in sure.sentences())
    assert (sure.following is None) == (len(contacts) < 3)


def test_what_is_left_out_is_named() -> None:
    generator = np.random.default_rng(SEED)
    runs = [
        noisy(generator, signal, strip=FRIEND.replace(**{CONTACT: contact}))
        for signal, contact in (("step 1 V", 0.5), ("sine 1 V 0.1 Hz", 1.5))
    ]
    told = sure_of(identify(FRIEND, runs, free=DC, per_run=CONTACT).actuator).sentences()
    assert f"What {CONTACT} may change beyond what the runs of the fit show is not in them." in told


def test_the_shunt_of_a_run_is_in_series_with_its_band(fit: Fit) -> None:
    about = RunMetadata(voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    seen = replace(asked(FRIEND), metadata=about)
    bands = prediction_bands(fit, seen)
    np.testing.assert_allclose(bands.predicted["current"], simulate(fit.actuator, seen).current, rtol=1e-9)


def test_a_file_that_was_not_touched_has_its_interval(fit: Fit, tmp_path: Path) -> None:
    uncertain = replace(FRIEND, standard_uncertainties={"geometry.thickness": 2e-6, "circuit.sheet_resistance": 0.015})
    generator = np.random.default_rng(SEED)
    for place, one in enumerate((fit, identify(uncertain, noisy(generator, "step 1 V"), free=[DC, CONTACT]))):
        path = tmp_path / f"{place}.toml"
        write_fit(one, path)
        read = sure_of(load_actuator(path), named=str(path))
        assert read.here is not None, read.why_none
        kept = prediction_bands(read_fit(path), asked(one.actuator))
        np.testing.assert_allclose(read.here.reach("current"), kept.reach("current"), rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('width = "5 mm"', 'width = "6 mm"', "geometry.width is no longer what it was when its fit was made"),
        (
            'dc_resistivity = { value = "',
            'dc_resistivity = { value = "1',
            f"{DC} is no longer what it was when its fit was made",
        ),
        ("converged = true", "converged = false", "the fit did not converge, and its errors mean nothing"),
        ("[fit.covariance]", "[fit.other]", "the [fit] table is not one that identify writes"),
    ],
)
def test_an_edited_file_has_none_and_says_why(fit: Fit, tmp_path: Path, old: str, new: str, why: str) -> None:
    path = tmp_path / "edited.toml"
    write_fit(fit, path)
    text = path.read_text("utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), "utf-8")
    sure = sure_of(load_actuator(path))
    assert (sure.here, sure.following) == (None, None)
    assert sure.sentences() == [f"No interval: {why}."]
    if "no longer" in why:
        with pytest.raises(InputError, match=re.escape(f"{why}: its uncertainty does not hold")) as caught:
            prediction_bands(read_fit(path), asked(FRIEND))
        assert caught.value.code == "changed-since-fit"


def test_stages_that_the_fit_did_not_have(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "fitted.toml"
    write_fit(fit, path)
    named = f"{path}+leak.cubic"
    richer = load_actuator(named)
    why = "No interval: the fit in fitted.toml is of the actuator without leak.cubic."
    assert sure_of(richer, named=named).sentences() == [why]
    assert sure_answer(load_actuator("friend-2+leak.cubic"), asked(FRIEND), named="friend-2+leak.cubic") is None
    assert sure_answer(FRIEND, asked(FRIEND), named="friend-2") is None
    # A stage written into the file beside the fit.
    other = replace(load_actuator("friend-2+relaxation.displacement"), fit_table=load_actuator(path).fit_table)
    assert sure_of(other).why_none == "the actuator has other stages than when its fit was made"


def test_more_rows_than_can_be_held(fit: Fit) -> None:
    rows = MOST_ROWS + 1
    run = simulate(fit.actuator, np.zeros(rows), duration=rows / 1000.0, rate=1000.0)
    sure = sure_answer(fit.actuator, run)
    assert sure is not None
    assert sure.why_none.startswith("200001 rows, and it is computed for 200000 at most")
