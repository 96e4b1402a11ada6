"""The conditions of an experiment: their order, what a file says of them, and an experiment that visits them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.chambers.chamber import ChamberError
from ipmclab.rig.chambers.settings import ChamberSettings
from ipmclab.rig.chambers.virtual import VirtualChamber
from ipmclab.rig.chambers.watch import ChamberWatch
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.experiments import archive as archive_module
from ipmclab.rig.experiments.environments import Reference, TargetEnvironment
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.rig.experiments.plan import Plan, make_plan
from ipmclab.rig.experiments.session import Session
from ipmclab.rig.experiments.visits import visits
from ipmclab.rig.virtual import VirtualBench
from ipmclab.run import Run
from ipmclab.store.journal import finalise as finalise_module
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.run_file import read_run
from tests.rig.test_session import BASE, Desk
from tests.waiting import HANGS

CHAMBER_RIG = replace(THESIS_RIG, chamber=ChamberSettings("virtual"))
WITHOUT_SENSORS = replace(CHAMBER_RIG, channels=THESIS_RIG.channels[:-1], thermometer=None)
AIR = {"temperature": "25 degC", "settle": "3 min", "longest_wait": "2 h"}


def air(humidity: float) -> TargetEnvironment:
    return TargetEnvironment(25.0, humidity, 1.0, 3.0, 600.0, 7200.0)


def planned(rig: Any = CHAMBER_RIG, **changes: Any) -> Plan:
    steps = ["chamber-on", "equilibrium", "chamber-off", "apply"]
    table = BASE | {"steps": steps, "environment": AIR} | changes
    return make_plan(experiment_from_table(table), rig, bytes_free=10**10)


@pytest.mark.parametrize("every", [None, 1, 2, 3, 4, 7])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8])
def test_a_palindromic_order_is_blind_to_a_drift_that_is_linear_in_time(count: int, every: int | None) -> None:
    """Any function of the environment is orthogonal to the run number, and the reference is never far away."""
    reference = None if every is None else Reference(air(80.0), every)
    found = visits([air(float(k)) for k in range(count)], "palindromic", reference)
    humidity = np.array([-1.0 if one.is_reference else one.environment.relative_humidity or 0.0 for one in found])
    assert list(humidity) == list(humidity[::-1])
    number = np.arange(len(found)) - (len(found) - 1) / 2.0
    for function in (humidity, np.exp(humidity / 3.0), (humidity == 0.0).astype(float)):
        assert abs(function @ number) < 1e-9 * (1.0 + np.abs(function).max())
    assert {one.environment.relative_humidity for one in found if not one.is_reference} == set(map(float, range(count)))
    if every is not None:
        at = np.flatnonzero(humidity == -1.0)
        assert at[0] == 0
        assert at[-1] == len(found) - 1
        assert np.diff(at).max() <= every + 1
    assert [one.number for one in found] == list(range(1, len(found) + 1))


def test_a_listed_order_stays_as_it_is_and_visits_are_counted() -> None:
    found = visits([air(30.0), air(60.0), air(30.0)], "listed", Reference(air(50.0), 2))
    assert [one.environment.relative_humidity for one in found] == [50.0, 30.0, 60.0, 50.0, 30.0, 50.0]
    assert [one.again for one in found if one.is_reference] == [0, 1, 2]
    again = visits([air(30.0), air(60.0)], "palindromic")
    assert [one.again for one in again] == [0, 0, 1]


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"environments": []}, "environments"),
        ({"environments": ["warm"]}, "environments.0"),
        ({"environments": ["40 percent", "50 percent, 60 percent"]}, "environments.1"),
        ({"environment": {}}, "environment"),
        ({"environments": [{"relative_humidity": "130 percent"}]}, "environments.0.relative_humidity"),
        ({"environments": [{"relative_humidity": "30 percent"}, {}]}, "environments"),
        ({"reference": {"relative_humidity": "30 percent"}}, "reference"),
        ({"environments": [{}], "reference": {"relative_humidity": "30 percent"}}, "reference"),
        ({"environments": [{}], "reference": {"signal": "step 1 V delay=50 s"}}, "reference.signal"),
        ({"environment": AIR | {"longest_wait": "1 s"}}, "environment.longest_wait"),
        ({"environment": AIR | {"longest_wait": "3 min"}}, "environment.longest_wait"),  # never settled in time
        ({"environment": AIR | {"order": "random"}}, "environment.order"),
    ],
)
def test_what_cannot_be_is_refused_where_it_stands(changes: dict[str, Any], where: str) -> None:
    with pytest.raises(InputError) as caught:
        planned(**changes)
    assert caught.value.where == f"experiment: {where}"


def test_the_plan_tells_conditions_and_times() -> None:
    humidities = [{"relative_humidity": f"{value} percent"} for value in (40, 60)]
    plan = planned(environments=humidities, reference={"relative_humidity": "50 percent"})
    told = plan.as_dict()
    assert [(one["name"], one["is_reference"]) for one in told["conditions"]] == [
        ("25 degC, 50 %RH", True),
        ("25 degC, 40 %RH", False),
        ("25 degC, 60 %RH", False),
        ("25 degC, 40 %RH", False),
        ("25 degC, 50 %RH", True),
    ]
    seconds = 180.0 + 8.0 + 4.0  # settled, zeros read twice for 4 s, and a run of 4 s
    assert [one["starts"] for one in told["conditions"]] == [seconds * k for k in range(5)]
    assert told["longest"] == told["seconds"] + 5 * (7200.0 - 180.0)
    assert [run.purpose for run in plan.runs] == ["reference", "signal", "signal", "signal", "reference"]
    assert [run.repeat for run in plan.runs] == [1, 1, 1, 2, 2]
    assert plan.steps[-1].name == "standby"


def test_a_plan_says_what_it_cannot_tell_apart_and_when_a_run_is_too_long_to_be_still() -> None:
    humidities = [{"relative_humidity": f"{value} percent"} for value in (40, 60, 80)]
    told = planned(environments=humidities, environment=AIR | {"order": "listed", "longest_still": "5 s"}).remarks
    assert any("what age does cannot be separated" in remark for remark in told)
    assert any("the chamber may be still for 5 s" in remark for remark in told)
    with pytest.raises(InputError, match="no temperature is stated"):
        planned(environment={"relative_humidity": "50 percent"})


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def finalise(journal: Path, laboratory: Laboratory) -> Path:
        return Path(finalise_module.finish_here(Path(journal), laboratory).path)

    monkeypatch.setattr(archive_module, "finalise", finalise)


class Room:
    """A virtual bench in its virtual chamber, and an experiment there."""

    def __init__(self, folder: Path, rig: Any = CHAMBER_RIG, **changes: Any) -> None:
        self.desk = Desk()
        self.bench = VirtualBench(rig=rig)
        chamber = self.bench.plant.chamber
        assert isinstance(chamber, VirtualChamber)
        self.chamber = chamber
        self.held: list[bool] = []
        self.watch = ChamberWatch(chamber, clock=self.bench.elapsed, keeper=self.held.append)
        laboratory = Laboratory.open(folder / "laboratory")
        plan = planned(rig, **changes)
        self.session = Session(plan, self.bench, laboratory, self.desk, inspect=lambda _: [], chamber=self.watch)

    def run(self) -> list[Run]:
        return [read_run(one.path) for one in self.session.run()]

    def when(self, kind: str, act: Callable[[], None]) -> None:
        """Do something once, when a message of that kind is told for the first time."""

        def heard(message: Any) -> None:
            if message.kind == kind:
                self.desk.on_message = lambda _: None
                act()

        self.desk.on_message = heard


def test_conditions_are_visited_and_every_run_carries_its_own(tmp_path: Path) -> None:
    room = Room(tmp_path, environments=["50 percent", "25 degC, 60 percent"])
    runs = room.run()
    assert [round(run.metadata.relative_humidity or 0.0, -1) for run in runs] == [50.0, 60.0, 50.0]
    for run in runs:
        about = run.metadata
        assert about.chamber == "still"
        assert about.temperature == pytest.approx(25.0, abs=1.0)
        assert run.time_environment is not None
        assert run.chamber_temperature is not None
        assert len(run.chamber_temperature) == len(run.time_environment) == 4
        assert run.chamber_relative_humidity is not None
        assert run.relative_humidity is not None
        # The chamber's own sensors are noisy, those at the strip are not.
        assert np.ptp(run.chamber_relative_humidity) > np.ptp(run.relative_humidity)
        assert about.minutes_in_environment is not None
        assert 3.0 < about.minutes_in_environment < 60.0
    assert room.chamber.read().mode == "standby"
    assert room.held == [True, True, True, False, False]
    assert any("still for 12 s, in which the air drifted" in text for text in room.desk.texts())
    told = [message for message in room.desk.told if message.kind == "chamber"]
    assert told[-1].values["humidity_set_point"] in (50.0, None)
    assert [one.values["number"] for one in room.desk.told if one.kind == "condition"] == [1, 2, 3]


def test_without_sensors_at_the_strip_the_chambers_own_decide(tmp_path: Path) -> None:
    (run,) = Room(tmp_path, WITHOUT_SENSORS, environment=AIR | {"relative_humidity": "50 percent"}).run()
    assert run.temperature is None
    assert run.chamber_temperature is not None
    assert run.metadata.temperature == pytest.approx(25.0, abs=1.0)
    assert run.metadata.relative_humidity == pytest.approx(50.0, abs=3.0)


def test_air_that_drifts_too_far_while_still_ends_the_stillness_and_not_the_run(tmp_path: Path) -> None:
    still = {"relative_humidity": "80 percent", "humidity_drift": "1 percent"}
    room = Room(tmp_path, environment=AIR | still, duration="90 s", rate="5 Hz")
    (run,) = room.run()
    assert run.metadata.state == "complete"
    (mark,) = [mark for mark in run.metadata.marks if "resumed" in mark.text]
    assert "the relative humidity drifted by -1" in mark.text
    assert 10.0 < mark.time < 80.0


@pytest.mark.parametrize(
    ("fault", "code", "text"),
    [
        (lambda chamber: setattr(chamber, "silent", True), "chamber-silent", "no reading has come from the chamber"),
        (lambda chamber: setattr(chamber, "tank_empty", True), "chamber-alarm", "water tank empty"),
        (lambda chamber: chamber.set(60.0, None), "chamber-changed", "it is set to 60 degC, not to 25"),
        (lambda chamber: chamber.safe(), "chamber-changed", "it is in standby"),
    ],
)
def test_a_chamber_that_fails_while_it_is_waited_for_ends_the_experiment(
    tmp_path: Path, fault: Callable[[VirtualChamber], None], code: str, text: str
) -> None:
    room = Room(tmp_path, environment=AIR | {"relative_humidity": "60 percent"})
    room.when("equilibrium", lambda: fault(room.chamber))
    with pytest.raises(ChamberError, match=text) as caught:
        room.run()
    assert caught.value.code == code
    assert not room.session.recorded
    if code == "chamber-silent":
        assert room.held == [True]  # nobody could tell it: the keeper still holds it
        assert any("may still hold its set points" in note for note in room.desk.texts())
    else:
        assert room.chamber.read().mode == "standby"


def test_an_alarm_ends_the_run_that_is_recorded_and_its_reason_is_kept(tmp_path: Path) -> None:
    room = Room(tmp_path, environment=AIR | {"relative_humidity": "60 percent"}, duration="20 s")
    room.when("air", lambda: setattr(room.chamber, "tank_empty", True))
    (run,) = room.run()
    assert run.metadata.state == "aborted"
    assert "water tank empty" in (run.metadata.state_reason or "")
    assert room.chamber.read().mode == "standby"


def test_air_beyond_its_limits_ends_the_run_and_the_waiting(tmp_path: Path) -> None:
    limits = {"relative_humidity": {"least": "55 percent", "duration": "2 s"}}
    with pytest.raises(IpmclabError, match=r"the relative humidity is .* percent, beyond its limit of 55 percent"):
        Room(tmp_path, environment=AIR | {"relative_humidity": "60 percent"}, limits=limits).run()
    limits = {"temperature": {"most": "24 degC", "duration": "2 s"}}
    room = Room(tmp_path, WITHOUT_SENSORS, limits=limits, steps=["chamber-on", "apply"], duration="600 s", rate="2 Hz")
    (run,) = room.run()
    assert "the temperature is 24" in (run.metadata.state_reason or "")
    assert room.chamber.read().mode == "standby"


def test_every_exit_lets_the_chamber_stand_by(tmp_path: Path) -> None:
    room = Room(tmp_path, environment=AIR | {"relative_humidity": "60 percent"})
    room.when("equilibrium", lambda: room.session.abort("enough"))
    assert room.run() == []
    assert room.chamber.read().mode == "standby"
    room = Room(tmp_path, environment=AIR | {"relative_humidity": "60 percent"})

    def interrupt() -> None:
        raise KeyboardInterrupt

    room.when("run", interrupt)
    with pytest.raises(KeyboardInterrupt):
        room.run()
    assert room.chamber.read().mode == "standby"
    assert room.held[-1] is False


def test_a_chamber_that_was_never_set_is_not_touched(tmp_path: Path) -> None:
    room = Room(tmp_path, environment=AIR | {"relative_humidity": "60 percent"})
    room.chamber.set(40.0, 50.0)  # by somebody else
    room.when("step", lambda: room.session.abort("not today"))
    assert room.run() == []
    assert room.chamber.read().mode == "constant"
    assert room.held == []


def test_one_resume_leaves_one_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    still = {"relative_humidity": "80 percent", "humidity_drift": "1 percent"}
    room = Room(tmp_path, environment=AIR | still, duration="60 s", rate="5 Hz")
    asked: list[Callable[[ChamberError | None], None]] = []
    monkeypatch.setattr(room.watch, "resume_soon", asked.append)  # one that is never done
    room.run()
    assert len(asked) == 1


def test_a_mass_is_asked_for_and_kept(tmp_path: Path) -> None:
    room = Room(tmp_path, steps=["weigh", "apply"])
    room.desk.answers["weigh"] = "131 mg"
    (run,) = room.run()
    assert run.metadata.mass == pytest.approx(131e-6)
    question = next(step.question for step in planned(steps=["weigh", "apply"]).steps if step.question is not None)
    assert question.check("Skip") == "skip"
    for wrong in ("heavy", "131", "-3 mg", "3 mm"):
        with pytest.raises(InputError):
            question.check(wrong)


@pytest.mark.parametrize("steps", [["weigh", "apply"], ["weigh", "chamber-on", "equilibrium", "chamber-off", "apply"]])
def test_a_mass_is_that_of_the_next_run_in_the_same_air(tmp_path: Path, steps: list[str]) -> None:
    room = Room(tmp_path, steps=steps, repeats=2)
    room.desk.answers["weigh"] = "131 mg"
    first, second = room.run()
    assert first.metadata.mass == (None if "chamber-on" in steps else pytest.approx(131e-6))
    assert second.metadata.mass is None


def test_a_real_chamber_is_read_in_a_thread_of_its_own() -> None:
    """Its silence costs the loop that samples a strip nothing."""
    chamber, heard = VirtualChamber(), threading.Event()
    watch = ChamberWatch(chamber)
    watch.on_reading = lambda _: heard.set()
    watch.set(25.0, 50.0)
    assert heard.wait(HANGS)
    assert len(watch.take()["chamber_temperature"]) >= 1
    watch.still(60.0)
    resumed = threading.Event()
    watch.resume_soon(lambda _: resumed.set())
    assert resumed.wait(HANGS)
    assert not watch.is_still
    watch.safe()
    watch.close()
    assert chamber.read().mode == "standby"
