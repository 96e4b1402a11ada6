"""The conditions of an experiment on the page: what it is told of them, and what its form says of them."""

from __future__ import annotations

from pathlib import Path

from ipmclab.page.experiment_form import Draft
from ipmclab.page.experiments import check, save
from ipmclab.page.lab import Lab
from ipmclab.page.live.state import State
from ipmclab.rig.process.messages import Message

CHAMBER = {
    "temperature": 24.9,
    "relative_humidity": 58.0,
    "temperature_set_point": 25.0,
    "humidity_set_point": 60.0,
    "mode": "constant",
    "is_still": False,
    "alarms": ["water tank empty"],
}
WAITING = {"waited": 60.0, "longest": 7200.0, "settled_for": 20.0, "settle": 600.0, "is_over": False}


def test_what_a_chamber_tells_goes_with_the_pulse_and_a_condition_with_the_document() -> None:
    state = State()
    version, pulse = state.version, state.pulse
    state.take(Message("chamber", CHAMBER))
    state.take(Message("equilibrium", WAITING))
    assert (state.version, state.pulse) == (version, pulse + 2)
    told = state.readings()
    assert told["chamber"] == CHAMBER
    assert told["equilibrium"] == WAITING
    state.take(Message("equilibrium", WAITING | {"is_over": True}))
    assert state.readings()["equilibrium"] is None
    state.take(Message("condition", {"number": 2, "of": 5, "name": "25 degC, 60 %RH"}))
    document = state.document()
    assert document["condition"]["number"] == 2
    assert document["chamber"]["alarms"] == ["water tank empty"]
    assert document["notes"][-1]["text"] == "condition 2 of 5: 25 degC, 60 %RH"
    assert state.version > version


def test_conditions_stand_in_the_form_and_what_it_does_not_show_stays_in_the_file(tmp_path: Path) -> None:
    lab = Lab.open(tmp_path)
    text = (
        'sample = "s"\nsignals = ["step 1 V"]\nrate = "50 Hz"\nduration = "10 s"\n'
        'environments = ["25 degC, 40 percent", "25 degC, 60 percent"]\n'
        '[reference]\ntemperature = "25 degC"\nrelative_humidity = "50 percent"\n'
    )
    (tmp_path / "air.toml").write_text(text, encoding="utf-8")
    draft = Draft.read(lab, "air")
    assert draft.values["environments"] == "25 degC, 40 percent\n25 degC, 60 percent"
    checked = check(lab, draft)
    assert checked.errors == {}
    assert checked.plan is not None
    assert [one["name"] for one in checked.plan.conditions][:2] == ["25 degC, 50 %RH", "25 degC, 40 %RH"]
    save(lab, draft, replace=True)
    assert Draft.read(lab, "air").rest["reference"]["relative_humidity"] == "50 percent"
    values = {**draft.values, "environments": "25 degC, 40 percent\nwarm"}
    assert "no condition" in check(lab, Draft("air", values, draft.rest)).errors["environments"]
