"""The models of samples: from which runs, how they are kept, and what becomes of one that cannot be identified."""

import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from ipmclab import load_actuator, read_fit, simulate, validate, write_run
from ipmclab.campaign import identified
from ipmclab.campaign.board import board_of
from ipmclab.campaign.campaign_file import campaign_from_text
from ipmclab.campaign.identified import choose_runs, identify_samples
from ipmclab.campaign.methods import identification
from ipmclab.campaign.results import RunResult
from ipmclab.campaign.state import State
from ipmclab.campaign.template import TEMPLATE
from ipmclab.cli.app import run
from ipmclab.errors import InputError
from ipmclab.reporting.sample_models import model_part
from ipmclab.signals import Sine, Step

STRIP = load_actuator("friend-2")
CAMPAIGN = replace(campaign_from_text(TEMPLATE.replace("friend-1-measured", "friend-2")), facts=())


@dataclass(frozen=True)
class Planned:
    """What of a planned run a choice looks at."""

    signal: object
    repeat: int
    purpose: str = "signal"


def result(signal, measured="displacement", condition="room", repeat=1, verdict="kept") -> RunResult:
    clean = simulate(STRIP, str(signal), duration=8.0, rate=25.0)
    record = replace(clean, **{one: None for one in ("displacement", "force") if one != measured})
    run = SimpleNamespace(
        sample="strip-1",
        part=measured,
        measured=measured,
        condition=condition,
        label=str(signal),
        id=f"{condition}/{signal}/{measured}/{repeat}",
        planned=Planned(signal, repeat),
    )
    return RunResult(run, record, "", verdict, (), ())


SINE = result(Sine(1.0, 0.25))
STEP = result(Step(1.0))
PUSH = result(Step(1.0), "force")


def test_the_lowest_step_where_most_signals_were_applied_is_the_source():
    alone, high, again = result(Step(0.5), condition="dry"), result(Step(2.0)), result(Step(1.0), repeat=2)
    flagged = result(Step(0.2), verdict="flagged")
    first, second = choose_runs([flagged, alone, high, SINE, STEP, again, PUSH], STRIP)
    assert first.source is STEP
    assert first.free == ("electrical", "coupling")
    assert first.unseen == (high, SINE, again)
    assert (second.source, second.free, second.unseen) == (PUSH, ("beam.modulus",), ())
    assert (first.name, second.name) == ("strip-1", "strip-1-force")
    assert choose_runs([SINE, flagged], STRIP) == ()
    assert choose_runs([PUSH], STRIP)[0].free == ("electrical", "coupling")
    assert choose_runs([result(Step(1.0), "current")], STRIP)[0].free == ("electrical",)


def test_a_model_is_kept_as_a_fit_and_not_made_twice(tmp_path, monkeypatch):
    results = [STEP, SINE, PUSH]
    with State(tmp_path) as state:
        model, modulus = identify_samples(CAMPAIGN, tmp_path, results, state)
    assert min(model.scores.values()) > 99.0
    assert modulus.scores == {}
    fit = read_fit(tmp_path / "models" / "strip-1.toml")
    assert validate(fit, SINE.record).scores["displacement"].fit_percent > 99.0
    assert read_fit(modulus.path).parameters["beam.modulus"].value == pytest.approx(STRIP["beam.modulus"], rel=0.01)
    part = model_part(model)
    assert "friend" not in part.sentences[0]
    assert part.picture is not None
    assert [label for label, _ in part.scores] == ["sine 1 V 0.25 Hz (displacement)"]
    assert "modulus" in identification([model, modulus])[0]

    monkeypatch.setattr(identified, "identify", None)
    with State(tmp_path) as state:
        again = identify_samples(CAMPAIGN, tmp_path, results, state)
        assert [one.scores for one in again] == [model.scores, {}]
        assert len(state.of("model")) == 2
        plan = {"event": "campaign", "title": "", "plan": []}
        assert f"displacement {model.scores['displacement']:.1f} %" in board_of([plan, *state.events]).models["strip-1"]
        near = {"event": "model", "model": "strip-1", "sample": "strip-1", "failure": "", "scores": {"current": 99.96}}
        assert board_of([plan, near]).models["strip-1"] == "current 99.96 %"  # 100 is perfect


def test_what_cannot_be_identified_is_said_and_not_tried_again(tmp_path, monkeypatch):
    asked = []

    def fails(*_, **__):
        asked.append(1)
        raise InputError("the readings are worth nothing", code="x")

    monkeypatch.setattr(identified, "identify", fails)
    for _ in range(2):
        with State(tmp_path) as state:
            (one,) = identify_samples(CAMPAIGN, tmp_path, [STEP, PUSH], state)
    assert asked == [1]
    assert one.fit is None
    part = model_part(one)
    assert part.doubt
    assert "the readings are worth nothing" in part.sentences[0]
    assert identification([one]) == ()


def test_the_command_that_shows_the_other_findings_runs(tmp_path, monkeypatch):
    write_run(STEP.record, tmp_path / "step.nc")
    with State(tmp_path) as state:
        (model,) = identify_samples(CAMPAIGN, tmp_path, [replace(STEP, path="step.nc")], state)
    part = model_part(model)
    assert "identified from step 1 V (displacement) in the room (models/strip-1.toml)" in part.sentences[0]
    monkeypatch.chdir(tmp_path)
    found = re.search(r"ipmclab (report .*), in the folder of this report", part.more)
    assert run(found.group(1).split()) == 0
    assert (tmp_path / "models" / "strip-1.html").is_file()  # in tmp_path lie report.html and comparison.html


def test_another_fit_in_its_place_is_left_as_it_is(tmp_path):
    (tmp_path / "models").mkdir()
    mine = tmp_path / "models" / "strip-1.toml"
    mine.write_text("mine")
    with State(tmp_path) as state:
        (one,) = identify_samples(CAMPAIGN, tmp_path, [STEP], state)
    assert one.fit is None
    assert mine.read_text() == "mine"
