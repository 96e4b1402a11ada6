"""The recipe of the command and of the page is the three steps that Python users write."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, identify, leave_one_run_out, load_actuator, profile, simulate, write_run
from ipmclab.errors import InputError
from ipmclab.fit.interrupted import uninterrupted
from ipmclab.progress import reporting_to
from ipmclab.store.run_file import read_run
from ipmclab.workflows import fitting
from ipmclab.workflows.fitting import fit_of_runs
from ipmclab.workflows.many_strips import Asked, fit_strips

STRIP = load_actuator("friend-2")
FREE = ["circuit.dc_resistivity"]


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two records with noise, of a step and a sine."""
    draws = np.random.default_rng(20261121)
    clean = [simulate(STRIP, signal, duration=10, rate=20) for signal in ("step 1 V", "sine 1 V 0.5 Hz")]
    noisy = [one.current + 1e-4 * draws.standard_normal(len(one)) for one in clean]
    return [
        Run.from_arrays(time=one.time, voltage=one.voltage, current=current)
        for one, current in zip(clean, noisy, strict=True)
    ]


def test_it_is_the_three_steps_one_by_one(runs: list[Run]) -> None:
    """The same table as the steps by hand give, to the last digit."""
    by_hand = leave_one_run_out(profile(identify(STRIP, runs, free=FREE, labels=["a", "b"])))
    assert fit_of_runs(STRIP, runs, free=FREE, labels=["a", "b"]).actuator.fit_table == by_hand.actuator.fit_table


def test_it_tells_how_far_it_is(runs: list[Run]) -> None:
    """The fraction only grows, and the profiles and the runs that are left out are named on the way."""
    told: list[tuple[str, float]] = []
    fit = fit_of_runs(STRIP, runs, free=FREE, progress=lambda sentence, done: told.append((sentence, done)))
    fractions = [done for _, done in told]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] < 0.8 < fractions[-1] <= 1.0
    assert any("profile of circuit.dc_resistivity" in sentence for sentence, _ in told)
    assert any("from the other runs" in sentence for sentence, _ in told)
    assert len(fit.left_out) == 2


def test_one_run_is_left_out_of_nothing(runs: list[Run]) -> None:
    """With one run there is nothing that could predict it."""
    assert fit_of_runs(STRIP, runs[:1], free=FREE).left_out == ()


@pytest.mark.parametrize(("at", "profiled"), [("profile of", False), ("predicting", True)])
def test_who_interrupts_what_follows_keeps_the_fit(runs: list[Run], at: str, profiled: bool) -> None:
    """Values and intervals stand before the first profile, and profiles before a run is left out."""

    def interrupt(sentence: str, _: float) -> None:
        if sentence.startswith(at):
            raise KeyboardInterrupt

    fit = fit_of_runs(STRIP, runs, free=FREE, progress=interrupt)
    assert "not-followed" in {finding.code for finding in fit.findings}
    assert (bool(fit.profiles), fit.left_out) == (profiled, ())
    assert fit.parameters[FREE[0]].value == identify(STRIP, runs, free=FREE).parameters[FREE[0]].value


def interrupted_once(at: str) -> Callable[[str, float], None]:
    """Ctrl-C, pressed where a sentence first comes."""
    left = [at]

    def interrupt(sentence: str, _: float) -> None:
        if left and sentence.endswith(left[0]):
            left.clear()
            raise KeyboardInterrupt

    return interrupt


def test_who_interrupts_the_intervals_waits_for_nothing_that_follows(runs: list[Run]) -> None:
    """Also where mountings differ, and all of them are fitted after each."""
    fit = fit_of_runs(STRIP, runs, free=FREE, progress=interrupted_once("errors and intervals"))
    assert "intervals-not-followed" in {finding.code for finding in fit.findings}
    assert not fit.profiles
    assert not fit.left_out
    mounted = [
        replace(run, metadata=replace(run.metadata, mounting_id=mounting))
        for run, mounting in zip([runs[0], replace(runs[1], current=1.5 * runs[1].current)], "ab", strict=True)
    ]
    fit = identify(STRIP, mounted, free=FREE, progress=interrupted_once("all mountings: errors and intervals"))
    assert "intervals-not-followed" in {finding.code for finding in fit.findings}


@pytest.mark.parametrize(
    ("at", "code"),
    [
        ("asking what the model lacks", "stages-not-tried"),
        ("errors and intervals", "intervals-not-followed"),
        ("without what is known beforehand", "prior-not-compared"),
        ("profile of", "not-followed"),
    ],
)
def test_who_ends_all_that_follows_keeps_what_stands(runs: list[Run], at: str, code: str) -> None:
    """As the page does it: from then on every report is answered so."""
    known = replace(STRIP, standard_uncertainties={FREE[0]: 1.0})
    ended: list[str] = []

    def end(sentence: str, _: float) -> None:
        if ended or at in sentence:
            ended.append(sentence)
            raise KeyboardInterrupt

    fit = fit_of_runs(known, runs, free=FREE, prior=FREE, progress=end)
    assert code in {finding.code for finding in fit.findings}
    assert not fit.profiles
    whole = identify(known, runs, free=FREE, prior=FREE)
    assert {"prior-not-compared", "not-followed"}.isdisjoint(finding.code for finding in whole.findings)
    for name, one in whole.parameters.items():
        assert fit.parameters[name].value == one.value
        assert fit.parameters[name].prior_of_literature == one.prior_of_literature


@pytest.mark.parametrize("at", ["asking what the model lacks", "errors and intervals"])
def test_a_fit_that_is_part_of_more_ends_that_when_it_is_interrupted(runs: list[Run], at: str) -> None:
    with reporting_to(interrupted_once(at)):
        fit = identify(STRIP, runs, free=FREE)
    with pytest.raises(KeyboardInterrupt):
        uninterrupted(fit)
    with reporting_to(interrupted_once(at)), pytest.raises(KeyboardInterrupt):
        list(fit_strips({"a": runs, "b": runs}, Asked(STRIP, FREE)))


@pytest.mark.parametrize(
    ("what", "factor"), [("current", 1000.0), ("current", 0.001), ("time", 1000.0), ("voltage", 1000.0)]
)
def test_a_wrong_unit_is_refused_before_any_search(
    runs: list[Run], monkeypatch: pytest.MonkeyPatch, what: str, factor: float
) -> None:
    """What cannot be a reading is said alone; who knows that it is one gets the fit, and no quantity as known."""
    wrong = replace(runs[0], **{what: factor * getattr(runs[0], what)})
    with monkeypatch.context() as patched:
        patched.setattr(fitting, "identify", lambda *_, **__: pytest.fail("it searches"))
        with pytest.raises(InputError, match=f"b: the {what} is about 1000 times too .* identify --anyway") as raised:
            fit_of_runs(STRIP, [runs[1], wrong], free=FREE, labels=["a", "b"])
    assert raised.value.code == "unit-off"
    fit = fit_of_runs(STRIP, [runs[1], wrong], free=FREE, labels=["a", "b"], anyway=True)
    assert fit.findings[0].code == "unit-off"
    assert fit.known == ()
    # A channel that the fit does not read does not stop it.
    moved = replace(
        runs[0], displacement=1e3 * np.asarray(simulate(STRIP, "step 1 V", duration=10, rate=20).displacement)
    )
    assert fit_of_runs(STRIP, [moved], free=FREE).converged


def test_what_takes_long_is_asked_for(runs: list[Run], monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rows without a leak have all of it; many only where it is asked for."""
    assert fit_of_runs(STRIP, runs, free=FREE, thorough=False).profiles
    monkeypatch.setattr(fitting, "LONG", 100)
    brief = fit_of_runs(STRIP, runs, free=FREE, thorough=False)
    assert not brief.profiles
    assert not brief.left_out
    assert "not-followed" in {finding.code for finding in brief.findings}
    assert fit_of_runs(STRIP, runs, free=FREE).profiles


def test_a_run_is_known_by_its_file(runs: list[Run], tmp_path: Path) -> None:
    """Whatever it says of its signal: that is the name that its user gave it."""
    named = replace(runs[0], metadata=replace(runs[0].metadata, signal="step 1 V"))
    for name, run in {"bare.nc": runs[0], "named.nc": named}.items():
        write_run(run, tmp_path / name)
        again = read_run(tmp_path / name)
        assert again.name == name
        assert again.metadata == run.metadata
    assert named.name == "step 1 V"
