"""Runs left out: against fits that never saw them, and against runs of which it is known whether they fit in."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Fit, InputError, Run, identify, leave_one_run_out, read_fit, simulate, validate, write_fit
from ipmclab.fit.in_brief import in_brief
from tests.identification.brief import brief
from tests.identification.many import CONTACT, ELECTRICAL, FRIEND, noisy

SEED = 20261121
SIGNALS = ("step 1 V", "sine 1 V 0.1 Hz", "square 1 V 0.1 Hz")

alone = partial(brief, followed=False)
"""No test here looks at what a model lacks, or at an interval of a parameter."""


def test_a_run_is_predicted_as_by_a_fit_that_never_saw_it() -> None:
    """The other fit begins anew, finds its own noise and knows nothing of this one."""
    generator = np.random.default_rng(SEED)
    runs = [noisy(generator, signal, rate=rate) for signal, rate in zip(SIGNALS, (25.0, 40.0, 16.0), strict=True)]
    fit = leave_one_run_out(alone(FRIEND, runs))
    assert [one.label for one in fit.left_out] == list(SIGNALS)
    for place, one in enumerate(fit.left_out):
        others = alone(FRIEND, [run for other, run in enumerate(runs) if other != place])
        score = validate(others.actuator, [runs[place]]).scores["current"]
        assert one.rmse["current"] == pytest.approx(score.rmse, rel=1e-3)
        assert one.fit_percent["current"] == pytest.approx(score.fit_percent, abs=0.01)
        assert one.inside["current"] == pytest.approx(score.inside_band, abs=0.02)
        assert one.standardised["current"] == pytest.approx(1.0, abs=0.1)
        assert one.undetermined == ()
    assert "run-stands-out" not in {finding.code for finding in fit.findings}


def test_the_zero_that_a_wave_shows_is_none_of_the_strip() -> None:
    """The other run predicts it all the same."""
    generator = np.random.default_rng(SEED)
    runs = []
    for signal, zero in (("square 1 V 0.1 Hz delay=2 s", 0.0), ("sine 1 V 0.2 Hz", 3e-3)):
        clean = simulate(FRIEND, signal, duration=40, rate=20)
        current = clean.current + zero + 1e-4 * generator.standard_normal(len(clean))
        runs.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current))
    fit = leave_one_run_out(identify(FRIEND, runs))
    assert "observation.offset.current[1]" in fit.parameters
    for one in fit.left_out:
        assert one.rmse["current"] < 1.2e-4
        assert one.inside["current"] > 0.9
    assert "run-stands-out" not in {finding.code for finding in fit.findings}


def test_runs_of_one_strip_are_alike() -> None:
    """Under no difference the probabilities are spread evenly, and 95 % of the readings lie in the band."""
    generator = np.random.default_rng(SEED)
    p_value, inside = [], []
    for _ in range(20):
        fit = leave_one_run_out(alone(FRIEND, [noisy(generator, signal) for signal in SIGNALS]))
        p_value += [one.p_value for one in fit.left_out]
        inside += [one.inside["current"] for one in fit.left_out]
    # 60 of them: three and a half standard deviations of an even spread.
    assert np.mean(p_value) == pytest.approx(0.5, abs=0.13)
    assert np.mean(np.array(p_value) < 0.05) < 0.15
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_a_run_of_another_strip_is_named() -> None:
    generator = np.random.default_rng(SEED)
    name = "circuit.dc_resistivity"
    other = FRIEND.replace(**{name: 1.2 * FRIEND[name]})
    runs = [noisy(generator, signal) for signal in (*SIGNALS, "sine 1 V 0.3 Hz")]
    runs[1] = noisy(generator, SIGNALS[1], strip=other)
    fit = leave_one_run_out(alone(FRIEND, runs))
    (said,) = [finding for finding in fit.findings if finding.code == "run-stands-out"]
    assert said.message.startswith("sine 1 V 0.1 Hz does not fit in with the other runs")
    assert max(fit.left_out, key=lambda one: one.standardised["current"]).label == SIGNALS[1]
    pair = leave_one_run_out(alone(FRIEND, runs[:2]))
    (said,) = [finding for finding in pair.findings if finding.code == "run-stands-out"]
    assert "which of them is out of place two runs cannot show" in said.message
    (line,), _ = in_brief([said])
    assert re.search(r"do not agree(: (without|the current of) .* \d|$)", line.text)  # a whole clause, or none


def moved(seed: int, signal: str, *, volts: float = 1.0, late: int = 0) -> Run:
    """Current and motion of one strip, its voltage read as so many times itself, its motion so many rows late."""
    clean, noise = simulate(FRIEND, signal, duration=40.0, rate=25.0), np.random.default_rng(seed)
    assert clean.current is not None
    assert clean.displacement is not None
    n = len(clean)
    motion = clean.displacement + 5e-6 * noise.standard_normal(n)
    return Run.from_arrays(
        time=clean.time,
        voltage=volts * clean.voltage,
        current=clean.current + 1e-4 * noise.standard_normal(n),
        displacement=np.append(np.full(late, motion[0]), motion[: n - late]),
    )


@pytest.mark.parametrize("seed", [0, 30])
def test_what_a_fit_leaves_open_is_no_disagreement(seed: int) -> None:
    """The zero of the coupling, along a valley that is bent: of twelve such fits five named a run that was right."""
    signals = "square 1 V 0.1 Hz delay=2 s", "step 1 V delay=2 s", "square 0.8 V 0.2 Hz delay=2 s"
    runs = [moved(seed + number, signal) for number, signal in enumerate(signals)]
    fit = leave_one_run_out(alone(FRIEND, runs, "electrical,coupling"))
    assert not fit.parameters["coupling.zero"].determined
    assert all("coupling.zero" not in one.shifts for one in fit.left_out)
    assert all(one.p_value > 0.003 for one in fit.left_out)
    assert not [finding for finding in fit.findings if finding.code == "run-stands-out"]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (
            {"volts": 1.1},
            r"the fit leaves .* times the noise of its current, and at most 1\S* times that of the others'",
        ),
        ({"late": 25}, r"without it the fit leaves 0\.1.* times as much of their displacement"),
    ],
)
def test_a_run_that_takes_all_it_contradicts_for_noise_is_named(changed: dict[str, float], why: str) -> None:
    signals = "square 1 V 0.1 Hz delay=2 s", "step 1 V delay=2 s"
    runs = [moved(3 + number, signal) for number, signal in enumerate(signals)]
    runs.append(moved(5, "square 0.8 V 0.2 Hz delay=2 s", **changed))  # type: ignore[arg-type]
    fit = leave_one_run_out(alone(FRIEND, runs, "electrical,coupling"))
    (finding,) = [finding for finding in fit.findings if finding.code == "run-stands-out"]
    assert re.search(f"run 2 does not fit in with the other runs: {why}", finding.message)


def test_what_one_run_alone_shows_is_named_and_not_scored() -> None:
    """The others put nothing in its place: what they would predict comes from the run itself."""
    generator = np.random.default_rng(SEED)
    current = noisy(generator, "step 1 V")
    force = noisy(generator, "square 1 V 0.2 Hz", outputs=("force",), rate=100.0, duration=20.0)
    fit = leave_one_run_out(alone(FRIEND, [current, force], free=["electrical", "coupling.gain"]))
    without_current, without_force = fit.left_out
    assert "circuit.dc_resistivity" in without_current.undetermined
    assert without_current.fit_percent == {}
    assert without_force.undetermined == ("coupling.gain",)
    assert without_force.fit_percent == {}


def test_what_each_run_has_for_itself_is_the_mean_of_the_others() -> None:
    generator = np.random.default_rng(SEED)
    contacts = (0.4, 0.8, 1.2, 1.0)
    signals = (*SIGNALS, "sine 1 V 0.3 Hz")
    runs = [
        noisy(generator, signal, strip=FRIEND.replace(**{CONTACT: contact}))
        for signal, contact in zip(signals, contacts, strict=True)
    ]
    free = ["circuit.dc_resistivity", "circuit.branches.1.resistivity"]
    fit = leave_one_run_out(alone(FRIEND, runs, free=free, per_run=CONTACT))
    for place, one in enumerate(fit.left_out):
        mean = float(np.mean([contact for other, contact in enumerate(contacts) if other != place]))
        scored = validate(FRIEND.replace(**{CONTACT: mean}), [runs[place]]).scores["current"]
        assert one.rmse["current"] == pytest.approx(scored.rmse, rel=0.05)
        # Three others show how far a contact may lie off: by Student's interval of two degrees.
        assert one.inside["current"] > 0.9
        assert one.standardised["current"] < 1.5
    assert "run-stands-out" not in {finding.code for finding in fit.findings}


def clamped(
    generator: np.random.Generator, contacts: tuple[float, ...], kind: str, *, other: float = 1.0
) -> tuple[Fit, list[str]]:
    """A fit of runs that each have a contact of their own, and the last another leak; and the names of the contacts."""
    leak = "circuit.dc_resistivity"
    strips = [FRIEND.replace(**{CONTACT: contact}) for contact in contacts]
    strips[-1] = strips[-1].replace(**{leak: other * FRIEND[leak]})
    names = "abcd"[: len(contacts)]
    runs = [
        noisy(generator, signal, strip=strip, mounting=name if kind == "per_mounting" else None)
        for strip, name, signal in zip(strips, names, SIGNALS, strict=False)
    ]
    free = [leak, "circuit.branches.1.resistivity", "circuit.branches.1.permittivity"]
    own = {"per_run": CONTACT} if kind == "per_run" else {"per_mounting": CONTACT}
    endings = [f"[mounting {name}]" if kind == "per_mounting" else f"[{place}]" for place, name in enumerate(names)]
    return leave_one_run_out(alone(FRIEND, runs, free=free, **own)), [CONTACT + ending for ending in endings]


@pytest.mark.parametrize("kind", ["per_run", "per_mounting"])
@pytest.mark.parametrize("contacts", [(0.5, 1.5), (0.5, 1.5, 0.9)])
def test_what_a_run_has_for_itself_is_no_disagreement(contacts: tuple[float, ...], kind: str) -> None:
    """One or two others cannot tell it: it is found on the run, and all else is predicted as well as ever."""
    generator = np.random.default_rng(SEED)
    inside, standardised, p_value = [], [], []
    for _ in range(10):
        fit, names = clamped(generator, contacts, kind)
        assert "run-stands-out" not in {finding.code for finding in fit.findings}
        for one, name in zip(fit.left_out, names, strict=True):
            assert one.undetermined == (name,)
            assert name in one.lacking
            inside.append(one.inside["current"])
            standardised.append(one.standardised["current"])
            p_value.append(one.p_value)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)
    assert np.mean(standardised) == pytest.approx(1.0, abs=0.05)
    # 20 of an even spread, which need not be independent: three standard deviations of 10.
    assert np.mean(p_value) == pytest.approx(0.5, abs=0.27)


def test_a_contact_is_found_on_the_run_as_by_a_fit_of_it_alone() -> None:
    """What all share as the other run has it by itself, and then the contact alone."""
    generator = np.random.default_rng(SEED)
    runs = [
        noisy(generator, "step 1 V", strip=FRIEND.replace(**{CONTACT: contact}), rate=rate)
        for contact, rate in ((0.5, 25.0), (1.5, 40.0))
    ]
    free = ["circuit.dc_resistivity", "circuit.branches.1.resistivity"]
    fit = leave_one_run_out(alone(FRIEND, runs, free=free, per_run=CONTACT))
    for one, run, other in zip(fit.left_out, runs, runs[::-1], strict=True):
        theirs = alone(FRIEND, other, free=[*free, CONTACT])
        shared = FRIEND.replace(**{name: theirs.parameters[name].value for name in free})
        held = validate(replace(alone(shared, run, free=CONTACT).actuator, fit_table=None), run)
        assert one.rmse["current"] == pytest.approx(held.scores["current"].rmse, rel=1e-3)
        assert one.fit_percent["current"] == pytest.approx(held.scores["current"].fit_percent, abs=0.01)


@pytest.mark.parametrize("kind", ["per_run", "per_mounting"])
@pytest.mark.parametrize("contacts", [(0.5, 1.5), (0.5, 1.5, 0.9)])
def test_what_all_should_share_still_stands_out(contacts: tuple[float, ...], kind: str) -> None:
    generator = np.random.default_rng(SEED)
    for _ in range(2):
        fit, _ = clamped(generator, contacts, kind, other=1.2)
        assert {"run-stands-out", "mountings-differ"} & {finding.code for finding in fit.findings}


def test_contacts_that_differ_widely_are_no_disagreement_of_four_runs() -> None:
    """Three others show the contact by Student's interval of two degrees, which is often far from its middle."""
    generator = np.random.default_rng(SEED)
    signals = (*SIGNALS, "sine 1 V 0.3 Hz")
    free = ["circuit.dc_resistivity", "circuit.branches.1.resistivity"]
    for _ in range(25):
        strips = [FRIEND.replace(**{CONTACT: float(np.exp(0.5 * generator.standard_normal()))}) for _ in signals]
        runs = [noisy(generator, signal, strip=strip) for signal, strip in zip(signals, strips, strict=True)]
        fit = leave_one_run_out(alone(FRIEND, runs, free=free, per_run=CONTACT))
        assert "run-stands-out" not in {finding.code for finding in fit.findings}
        assert all(one.undetermined == () for one in fit.left_out)


@pytest.mark.parametrize("uncertainty", [1e-12, 1e-10, 1e-6])
def test_a_sharp_prior_is_an_exact_value(uncertainty: float) -> None:
    """However sharp: what is known a billion times better than the readings know the rest takes nothing from these."""
    generator = np.random.default_rng(SEED)
    runs = [noisy(generator, signal) for signal in SIGNALS[:2]]
    exact = leave_one_run_out(alone(FRIEND, runs, free="electrical"))
    sheet = "circuit.sheet_resistance"
    known = replace(FRIEND, standard_uncertainties={sheet: uncertainty})
    fit = leave_one_run_out(alone(known, runs, free=["electrical", sheet], prior=sheet))
    for one, expected in zip(fit.left_out, exact.left_out, strict=True):
        assert one.shifts[sheet] == 0.0
        assert one.p_value == pytest.approx(expected.p_value, abs=0.01)
        for name in ELECTRICAL:
            assert one.shifts[name] == pytest.approx(expected.shifts[name], abs=0.05)
    assert "run-stands-out" not in {finding.code for finding in fit.findings}


def test_it_goes_into_the_file_and_back(tmp_path: Path) -> None:
    generator = np.random.default_rng(SEED)
    fit = leave_one_run_out(alone(FRIEND, [noisy(generator, signal) for signal in SIGNALS[:2]]))
    write_fit(fit, tmp_path / "fitted.toml")
    again = read_fit(tmp_path / "fitted.toml")
    assert again.left_out == fit.left_out
    with pytest.raises(InputError, match="read from a file holds no runs") as caught:
        leave_one_run_out(again)
    assert caught.value.code == "fit-without-runs"
    with pytest.raises(InputError, match="one run leaves nothing"):
        leave_one_run_out(alone(FRIEND, noisy(generator, "step 1 V")))


def test_runs_of_one_label_are_told_apart() -> None:
    generator = np.random.default_rng(SEED)
    told: list[str] = []
    fit = identify(FRIEND, [noisy(generator, "step 1 V"), noisy(generator, "step 1 V")])
    found = leave_one_run_out(fit, progress=lambda sentence, _: told.append(sentence))
    assert [one.label for one in found.left_out] == ["step 1 V [0]", "step 1 V [1]"]
    assert "predicting step 1 V [1] from the other runs" in told


def test_how_fast_a_strip_ages_is_in_the_band_of_a_run_that_is_left_out() -> None:
    """Three runs tell little of what two hundred have done to the strip."""
    generator, name = np.random.default_rng(SEED), "circuit.dc_resistivity"
    runs = []
    for number in (0, 1, 2, 200):
        run = noisy(generator, "sine 1 V 0.1 Hz", strip=FRIEND.replace(**{name: FRIEND[name] * 1.0005**number}))
        runs.append(replace(run, metadata=replace(run.metadata, run_number=number)))
    fit = leave_one_run_out(alone(FRIEND, runs, free=["electrical", f"age.runs.{name}"]))
    assert fit.left_out[3].inside["current"] > 0.9
    assert fit.left_out[3].standardised["current"] < 1.3
