"""Choosing between models: it finds what made the data, says when it cannot tell, and never crashes on a bad one."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import ipmclab
import ipmclab.choosing.choice
from ipmclab import InputError, IpmclabError, Run, RunMetadata
from ipmclab.choosing.choice import Candidate, Choice, as_close, contained_in_excluded
from ipmclab.choosing.compare import Difference

SEED, RATE = 20261121, 25.0
WHITE = 1e-4  # A


def record(truth: str, signal: str, seed: int, *, slow: float = 0.0, seconds: float = 20.0) -> Run:
    """A simulated current with white noise, and noise that lasts 2 s where asked [A]."""
    generator = np.random.default_rng([SEED, seed])
    clean = ipmclab.simulate(ipmclab.load_actuator(truth), signal, duration=seconds, rate=RATE)
    drift, decay = np.zeros(len(clean)), np.exp(-1.0 / (2.0 * RATE))
    for row in range(1, len(clean)):
        drift[row] = decay * drift[row - 1] + slow * np.sqrt(1.0 - decay**2) * generator.standard_normal()
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + drift + WHITE * generator.standard_normal(len(clean)),
        metadata=RunMetadata(starts_from_rest=True, signal=signal),
    )


@cache
def one_branch_or_two(slow: float, seed: int) -> Choice:
    """The choice for a step of a strip with two."""
    return ipmclab.choose(
        record("friend-2", "step 1 V delay=1 s", seed, slow=slow), "branches=1,2", actuator="friend-2"
    )


@cache
def alike() -> Choice:
    """The choice for a step of a strip with one, under a noise that lasts: two predict it as well."""
    run = record("friend-2+branches=1", "step 1 V delay=1 s", 3, slow=2e-4)
    return ipmclab.choose(run, ["branches=1", "branches=2"], actuator="friend-2")


@pytest.mark.parametrize("slow", [0.0, 3e-4], ids=["white", "correlated"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_model_that_made_the_data_is_picked(slow: float, seed: int) -> None:
    """One branch cannot do what two did, in blocks of one run; the full rates are in benchmarks/choice.py."""
    choice = one_branch_or_two(slow, seed)
    assert choice.preferred == "branches=2"
    assert choice.differences["branches=1", "branches=2"].is_distinguished
    assert choice.held_out == "blocks"


def test_the_smaller_of_two_that_cannot_be_told_apart_is_preferred() -> None:
    choice = alike()
    assert choice.preferred == "branches=1"
    assert not choice.differences["branches=1", "branches=2"].is_distinguished
    assert "These records cannot distinguish" in choice.sentences[0]
    assert "it has the fewest parameters of these (3 parameters)" in choice.sentences[1]
    # Drift makes thousands of rows worth a few independent ones.
    assert choice.effective_readings < 0.2 * choice.readings


def test_how_fast_a_parameter_ages_is_refused() -> None:
    """No comparison fits it; it was left out without a word."""
    with pytest.raises(InputError, match="no comparison of models fits"):
        ipmclab.choose(
            record("friend-2", "step 1 V", 3),
            "branches=1,2",
            actuator="friend-2",
            free="electrical, age.runs.coupling.gain",
        )


def test_whole_runs_are_predicted_from_the_others() -> None:
    runs = [record("friend-2", signal, 3) for signal in ("step 1 V", "square 1 V 0.2 Hz", "sine 1 V 0.5 Hz")]
    told: list[tuple[str, int, int]] = []
    choice = ipmclab.choose(
        runs, "branches=1,2", actuator="friend-2", progress=lambda what, done, of: told.append((what, done, of))
    )
    assert choice.held_out == "runs"
    assert choice.preferred == "branches=2"
    assert choice.labels == ("step 1 V", "square 1 V 0.2 Hz", "sine 1 V 0.5 Hz")
    assert [done for _, done, _ in told] == list(range(8))
    assert {of for _, _, of in told} == {8}
    # The held-out error of the right model is the noise.
    assert choice["branches=2"].rmse["current"] == pytest.approx(WHITE, rel=0.1)


def stopped_at(*words: str) -> Callable[[str, int, int], None]:
    """Who presses Ctrl-C when a fit begins whose words these are."""

    def interrupt(what: str, *_: int) -> None:
        if all(word in what for word in words):
            signal.raise_signal(signal.SIGINT)

    return interrupt


def test_who_interrupts_keeps_the_models_that_were_finished() -> None:
    """Two of three are compared as if the third had never been asked for, and a sentence names it."""
    run = record("friend-2", "step 1 V delay=1 s", 0)
    asked = {"actuator": "friend-2", "free": "circuit.dc_resistivity", "blocks": 8, "folds": 2}
    progress = stopped_at("model 3 of 3: branches=3", "part 2 of 2 held out")
    choice = ipmclab.choose(run, "branches=1,2,3", **asked, progress=progress)
    whole = ipmclab.choose(run, "branches=1,2", **asked)
    assert choice.unfinished == ("branches=3",)
    assert choice.sentences[0] == "Interrupted: branches=3 was not finished, and was not compared."
    assert not any(text.startswith("branches=3 could not") for text in choice.sentences)
    assert choice.preferred == whole.preferred
    assert whole.unfinished == ()
    assert [one.name for one in choice.ranked] == [one.name for one in whole.ranked]
    assert [one.log_predictive for one in choice.ranked] == [one.log_predictive for one in whole.ranked]
    assert choice.as_dict()["unfinished"] == ["branches=3"]


@pytest.mark.parametrize("words", [("model 1 of 3", "all runs"), ("model 2 of 3", "part 1 of 2 held out")])
def test_one_finished_model_is_no_comparison(words: tuple[str, str]) -> None:
    run = record("friend-2", "step 1 V", 0, seconds=4.0)
    with pytest.raises(KeyboardInterrupt):
        ipmclab.choose(
            run,
            "branches=1,2,3",
            actuator="friend-2",
            free="circuit.dc_resistivity",
            blocks=4,
            folds=2,
            progress=stopped_at(*words),
        )


def test_what_one_fit_asks_last_is_not_all_that_ctrl_c_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Alone, a fit that is interrupted while it asks what its model lacks is kept."""

    def diagnose(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(sys.modules["ipmclab.identification.identify"], "diagnose", diagnose)
    with pytest.raises(KeyboardInterrupt):
        ipmclab.choose(
            record("friend-2", "step 1 V", 0, seconds=4.0),
            "branches=1,2",
            actuator="friend-2",
            free="circuit.dc_resistivity",
        )


def test_the_linear_algebra_of_a_choice_has_one_thread() -> None:
    """Between its fits too: many threads took ten times as long for its noise on a busy machine."""
    threads: set[int] = set()

    def look(*_: object) -> None:
        threads.update(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")

    run = record("friend-2", "step 1 V", 0, seconds=4.0)
    free = "circuit.dc_resistivity"
    with threadpool_limits(2, "blas"):
        ipmclab.choose(run, "branches=1,2", actuator="friend-2", free=free, blocks=4, folds=2, progress=look)
    assert threads == {1}


def test_a_model_that_needs_what_was_not_measured_is_named_with_its_reason() -> None:
    run = record("friend-2", "step 1 V", 4)
    choice = ipmclab.choose(run, ["branches=1", "branches=2", "relaxation.displacement"], actuator="friend-2")
    lacking = choice["relaxation.displacement"]
    assert lacking.log_predictive is None
    assert "displacement" in lacking.reason
    assert choice.preferred == "branches=2"
    assert any(text.startswith("relaxation.displacement could not be compared") for text in choice.sentences)
    assert choice.as_dict()["models"][-1]["reason"] == lacking.reason


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ("line.modes+leak.cubic", "it cannot leak at every place by a law of the voltage there"),
        ("leak.cubic+leak.exponential", "a strip has one of them"),
        ("leak.slow", "a slow leak follows a static one"),
    ],
)
def test_a_model_whose_stages_do_not_go_together_is_named_with_its_reason(bad: str, reason: str) -> None:
    told: list[int] = []
    choice = ipmclab.choose(
        record("friend-2+branches=1", "step 1 V", 4, seconds=4.0),
        [bad, "branches=1"],
        actuator="friend-2",
        free="electrical",
        folds=2,
        progress=lambda what, done, of: told.append(of),
    )
    assert choice.preferred == "branches=1"
    assert choice[bad].fit is None
    assert reason in choice[bad].reason
    assert set(told) == {3}
    assert choice.as_dict()["models"][-1]["name"] == bad


def test_models_that_are_all_impossible_are_an_error_with_every_reason() -> None:
    with pytest.raises(IpmclabError, match=r"leak.slow: .* follows a static one.*line.modes\+leak.cubic: ") as told:
        ipmclab.choose(
            record("friend-2", "step 1 V", 6, seconds=2.0), "leak.slow,line.modes+leak.cubic", actuator="friend-2"
        )
    assert told.value.code == "nothing-to-compare"


@pytest.mark.parametrize(
    ("bad", "code"),
    [("leak.cubic+leak.cubik", "unknown-stage"), ("clamp+line.modes=0", "bad-count"), ("no.toml", "no-actuator")],
)
def test_a_mistyped_model_is_refused_at_once_by_its_name(bad: str, code: str) -> None:
    with pytest.raises(InputError) as told:
        ipmclab.choose(record("friend-2", "step 1 V", 6, seconds=2.0), ["branches=1", bad], actuator="friend-2")
    assert (told.value.code, told.value.where) == (code, f"models: {bad}")
    assert told.value.repair


def test_a_fit_that_breaks_is_named_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules["ipmclab.choosing.choose"]
    identify = module.identify

    def breaking(actuator, *arguments, **options):
        if actuator.structure.branches == 2:
            raise np.linalg.LinAlgError("Matrix is singular")
        return identify(actuator, *arguments, **options)

    monkeypatch.setattr(module, "identify", breaking)
    choice = ipmclab.choose(record("friend-2+branches=1", "step 1 V", 5), "branches=1,2", actuator="friend-2")
    assert choice["branches=2"].reason == "its fit ended in LinAlgError: Matrix is singular"
    assert choice.preferred == "branches=1"
    assert choice.sentences[0] == "branches=1 is the only model that could be compared."


def test_none_that_can_be_compared_is_an_error_with_every_reason() -> None:
    run = record("friend-2", "step 1 V", 6)
    with pytest.raises(IpmclabError, match=r"none of the models could be compared \(relaxation.displacement: ") as told:
        ipmclab.choose(run, ["relaxation.displacement", "relaxation.displacement=2"], actuator="friend-2")
    assert told.value.code == "nothing-to-compare"


def test_a_name_that_only_one_model_has_is_freed_in_that_one() -> None:
    run = record("friend-2", "step 1 V", 7)
    choice = ipmclab.choose(
        run, "branches=1,2", actuator="friend-2", free="electrical,circuit.branches.1.resistivity", folds=2
    )
    assert choice["branches=1"].free == ("electrical",)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"models": "branches=1"}, "no-models"),
        ({"models": ""}, "no-models"),
        ({"models": ["branches=1", "branches=1,2", "branches=2"]}, "same-model-twice"),
        ({"models": "branches=1,nothing"}, "no-actuator"),
        ({"models": "branches=1,2", "actuator": None}, "no-actuator"),
        ({"models": "branches=1,2", "free": "electric"}, "unknown-parameter"),
        ({"models": "branches=1,2", "held_out": "runs"}, "bad-hold-out"),
        ({"models": "branches=1,2", "held_out": "weeks"}, "bad-hold-out"),
        ({"models": "branches=1,2", "folds": 1}, "bad-folds"),
        ({"models": "branches=1,2", "blocks": 3}, "bad-folds"),
        ({"models": "branches=1,2", "runs": []}, "no-runs"),
    ],
)
def test_bad_input_is_refused_by_name(options: dict, code: str) -> None:
    run = record("friend-2", "step 1 V", 8, seconds=2.0)
    with pytest.raises(InputError) as told:
        ipmclab.choose(**{"runs": [run], "actuator": "friend-2", **options})
    assert told.value.code == code
    assert told.value.repair


def test_a_stage_that_one_run_shows_cannot_be_judged_by_whole_runs() -> None:
    """1.8 V leaks, 0.5 V does not: without the first run nothing tells the leak."""
    truth = "friend-2+branches=1+leak.exponential"
    runs = [record(truth, "step 1.8 V", 7, seconds=10.0), record(truth, "square 0.5 V 0.2 Hz", 8, seconds=10.0)]
    models = ["branches=1", "branches=1+leak.exponential"]
    choice = ipmclab.choose(runs, models, actuator="friend-2")
    assert choice[models[1]].shown_in_one == {"leak.exponential": ("step 1.8 V",)}
    assert choice[models[0]].shown_in_one == {}
    said = [text for text in choice.sentences if "only step 1.8 V shows leak.exponential" in text]
    assert len(said) == 1
    assert "--hold-out blocks" in said[0]
    blocks = ipmclab.choose(runs, models, actuator="friend-2", held_out="blocks", blocks=8, folds=2)
    assert blocks.preferred == models[1]
    assert blocks[models[1]].shown_in_one == {}


def test_a_stage_of_which_nothing_is_free_is_named() -> None:
    run = record("friend-2+branches=1", "step 1 V", 9, seconds=4.0)
    models = ["branches=1", "branches=1+leak.exponential"]
    choice = ipmclab.choose(run, models, actuator="friend-2", free="electrical", blocks=4, folds=2)
    assert choice[models[1]].held == ("leak.exponential",)
    assert choice[models[0]].held == ()
    (said,) = [text for text in choice.sentences if "nothing of leak.exponential is free" in text]
    assert said.startswith(f"{models[1]}: ")
    assert choice.as_dict()["models"][0].keys() >= {"held", "shown_in_one"}


def test_noise_that_cannot_be_is_passed_by_without_a_warning() -> None:
    # With two folds a search of the noise starts where the readings are impossible; a warning is an error here.
    run = record("friend-2", "step 1 V delay=1 s", 0)
    choice = ipmclab.choose(run, "branches=1,2", actuator="friend-2", folds=2)
    assert choice.best == "branches=2"


def test_where_the_criteria_say_otherwise_that_is_said() -> None:
    """Of two models that predict alike the smaller is preferred; a criterion that is least for the other is named."""
    choice = alike()
    assert choice.preferred == "branches=1"
    assert not any("least for" in text for text in choice.sentences)
    turned = [
        replace(one, aic=0.0 if one.name == "branches=2" else ipmclab.choosing.choice.SUPPORTED + 0.5, bic=1.0)
        for one in choice.ranked
    ]
    named = {one.name: one for one in turned}
    for order, why in (
        (("branches=1", "branches=2"), "AIC is least for branches=2: it says how well"),
        (
            ("branches=2", "branches=1"),
            "AIC is least for branches=2, which also predicted best: branches=1 is preferred only",
        ),
    ):
        other = replace(choice, candidates=tuple(named[name] for name in order))
        (said,) = [text for text in other.sentences if "least for" in text]
        assert said.startswith(why)


def test_the_best_of_some_models_need_not_be_complete() -> None:
    """A strip with a leak at 2.5 V, of which neither model knows; and one of which one model knows all."""
    leaking = record("friend-2+leak.exponential", "square 2.5 V 0.2 Hz", 3)
    choice = ipmclab.choose(leaking, "branches=1,2", actuator="friend-2", free="electrical")
    (said,) = [text for text in choice.sentences if "still lacks something" in text]
    assert said.startswith(f"{choice.preferred} still lacks something: ")
    complete = one_branch_or_two(0.0, 0)
    assert not any("still lacks" in text for text in complete.sentences)


def test_a_model_that_misses_readings_by_half_as_much_again_is_not_preferred_for_its_size() -> None:
    """All of an inrush stands in one block of many: its scatter says that chance could be the reason."""
    errors = {"branches=3": 1.32e-3, "branches=2": 1.36e-3, "branches=1": 1.97e-3}
    alike = [Candidate(name, rmse={"current": error}) for name, error in errors.items()]
    assert as_close(alike) == ["branches=3", "branches=2"]
    # By a likelihood that cannot distinguish them the smallest came first: 2.26 mA beside 1.83 and 1.80.
    assert as_close(alike[::-1]) == ["branches=2", "branches=3"]


def test_what_its_parameters_may_be_off_does_not_count_against_a_smaller_model() -> None:
    """Without the only slow run each fit misses it by luck: 0.45 mA beside 0.05, and 0.03 beside what that explains."""
    lucky = Candidate("branches=3", rmse={"current": 4.9e-5}, rmse_left={"current": 2.9e-5})
    small = Candidate("branches=2", rmse={"current": 4.5e-4}, rmse_left={"current": 2.9e-5})
    wrong = Candidate("branches=1", rmse={"current": 2.1e-3}, rmse_left={"current": 9.8e-4})
    assert as_close([small, lucky, wrong]) == ["branches=2", "branches=3"]


def test_two_runs_of_which_each_shows_a_branch_choose_no_larger_model() -> None:
    """A fit without the slow sine does not know the slow branch: three branches missed it less, by luck, and were
    preferred to the two that there are.
    """
    runs = []
    for place, voltage in enumerate(("sine 1 V 0.03 Hz", "sine 1 V 1 Hz")):
        clean = ipmclab.simulate(ipmclab.load_actuator("friend-2"), voltage, duration=15.0, rate=20.0)
        assert clean.current is not None
        noise = 3.0 * WHITE * np.random.default_rng([SEED, 5, place]).standard_normal(len(clean))
        about = RunMetadata(starts_from_rest=True, signal=voltage)
        runs.append(
            Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, metadata=about)
        )
    choice = ipmclab.choose(runs, "branches=2,3", actuator="friend-2")
    assert choice["branches=2"].rmse["current"] > 2.0 * choice["branches=3"].rmse["current"]
    assert choice.preferred == "branches=2"
    assert any("no further than its parameters may be off" in text for text in choice.sentences)


def test_a_part_of_an_excluded_model_that_predicts_worse_is_not_preferred() -> None:
    """A third branch is clearly needed; that one alone is worse by more and less certainly was no reason to take it."""
    names = {"branches=3": "abc", "branches=2": "ab", "branches=1": "a"}
    ranked = [
        Candidate(name, fit=cast(Any, SimpleNamespace(parameters=dict.fromkeys(of)))) for name, of in names.items()
    ]
    zero = "observation.offset.current[0]"  # it belongs to a record: one that only the smallest model needs is no stage
    small = cast(Any, ranked[-1].fit)
    small.parameters[zero] = None
    said = {"branches=2": (-572.0, 108.0), "branches=1": (-908.0, 506.0)}
    differences = {
        (name, "branches=3"): Difference(name, "branches=3", value, error, 2.07, 24)
        for name, (value, error) in said.items()
    }
    assert contained_in_excluded(ranked, differences) == {"branches=1": "branches=2"}
    held = [*ranked[:-1], replace(ranked[-1], held=("leak.cubic",))]
    assert contained_in_excluded(held, differences) == {}  # it has a stage that the others lack
    other = dict.fromkeys(differences, replace(differences["branches=1", "branches=3"], value=-100.0))
    assert contained_in_excluded(ranked, other) == {}


def test_where_each_model_misses_one_output_the_best_prediction_is_the_answer() -> None:
    alike = [
        Candidate("branches=1", rmse={"current": 2.0e-3, "displacement": 1e-5}),
        Candidate("branches=2", rmse={"current": 1.0e-3, "displacement": 2e-5}),
    ]
    assert as_close(alike) == ["branches=1"]


def test_it_says_what_the_fit_of_the_preferred_model_leaves_open() -> None:
    """A step shows that there is a leak, and not of which form: of its terms one may stand for the other."""
    choice = ipmclab.choose(
        record("friend-2+leak.cubic", "step 3 V delay=1 s", 1), ["friend-2", "leak.cubic"], actuator="friend-2"
    )
    open_ones = [name for name, one in choice.fit.parameters.items() if not one.determined]
    assert choice.preferred == "leak.cubic"
    assert {"leak.cubic.quadratic", "leak.cubic.cubic"} <= set(open_ones)
    (said,) = [text for text in choice.sentences if "does not determine" in text]
    assert said.startswith("The fit of leak.cubic does not determine ")
    assert "leak.cubic.quadratic, leak.cubic.cubic: a model may predict well of which these values are open." in said
    assert not any("does not determine" in text for text in one_branch_or_two(0.0, 0).sentences)
