"""A whole experiment at the virtual bench, with what is asked, read and kept."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import Bench, BenchError, Block
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.experiments import archive as archive_module
from ipmclab.rig.experiments.archive import Recorded
from ipmclab.rig.experiments.earlier import Earlier, earlier_runs
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.rig.experiments.fingerprint import Fingerprint, fingerprint_finding
from ipmclab.rig.experiments.plan import make_plan
from ipmclab.rig.experiments.session import Session
from ipmclab.rig.experiments.steps import Question
from ipmclab.rig.process.messages import Message
from ipmclab.rig.virtual import VirtualBench
from ipmclab.run import Finding, Run
from ipmclab.store.journal import finalise as finalise_module
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.run_file import read_run
from tests.waiting import AtRow

BASE: dict[str, Any] = {
    "sample": "friend-2",
    "signal": "step 1 V",
    "rate": "50 Hz",
    "duration": "2 s",
    "rest_before": "1 s",
    "rest_after": "1 s",
    "zero_time": "4 s",
    "fingerprint": False,
    "steps": ["apply"],
    "measured": ["current"],
}


class Desk:
    """Answers as it is told, and remembers."""

    def __init__(self, **answers: str) -> None:
        self.answers = answers
        self.asked: list[str] = []
        self.told: list[Message] = []
        self.on_message: Callable[[Message], None] = lambda _: None

    def tell(self, message: Message) -> None:
        self.told.append(message)
        self.on_message(message)

    def ask(self, question: Question, ended: Callable[[], bool]) -> str:
        self.asked.append(question.step)
        return question.check(self.answers.get(question.step, question.default))

    def texts(self, kind: str = "note") -> list[str]:
        return [str(message.values["text"]) for message in self.told if message.kind == kind]


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run files are made here: a process for each would take most of the time."""

    def finalise(journal: Path, laboratory: Laboratory) -> Path:
        return Path(finalise_module.finish_here(Path(journal), laboratory).path)

    monkeypatch.setattr(archive_module, "finalise", finalise)


def inspect(run: Run) -> Sequence[Finding]:
    found = fingerprint_finding(run)
    return [found] if found is not None else []


def make(folder: Path, desk: Desk, bench: Bench | None = None, **changes: Any) -> Session:
    table = {key: value for key, value in (BASE | changes).items() if value is not None}
    plan = make_plan(experiment_from_table(table), THESIS_RIG, bytes_free=10**10)
    laboratory = Laboratory.open(folder / "laboratory")
    return Session(
        plan,
        bench or VirtualBench(),
        laboratory,
        desk,
        inspect=inspect,
        earlier=lambda sample: earlier_runs(laboratory, sample),
    )


def runs_of(recorded: Sequence[Recorded]) -> list[Run]:
    return [read_run(one.path) for one in recorded]


def test_a_bench_that_is_not_there_is_found_before_the_first_step(tmp_path: Path) -> None:
    """It was found at the first recording, with the strip out of its water and in the clamp."""

    class Absent(VirtualBench):
        def open(self, measured: Collection[str], rate: float) -> None:
            raise BenchError("nothing answers", code="bench-unreachable")

    desk = Desk()
    with pytest.raises(BenchError, match="nothing answers"):
        make(tmp_path, desk, Absent(), steps=None).run()
    assert not desk.asked
    assert "step" not in [message.kind for message in desk.told]


def test_every_step_of_the_thesis(tmp_path: Path) -> None:
    """Tare, preload, environment and mounting are in the run; half an hour of waiting passes at once."""
    desk = Desk()
    air = {"temperature": "30 degC", "relative_humidity": "60 percent", "settle": "10 min"}
    session = make(tmp_path, desk, steps=None, measured=["current", "force"], environment=air, clamp_pressure="20 kPa")
    (run,) = runs_of(session.run())
    assert [message["name"] for message in desk.told if message.kind == "step"] == [
        "hydrate",
        "clamp",
        "chamber-on",
        "equilibrium",
        "chamber-off",
        "zero",
        "preload",
        "apply",
        "hydrate",
    ]
    assert desk.asked == ["hydrate", "clamp", "chamber-on", "chamber-off", "zero", "preload", "zero", "hydrate"]
    about = run.metadata
    assert about.sample is not None
    assert (about.sample.id, about.purpose, about.state, about.chamber) == ("friend-2", "signal", "complete", "off")
    assert about.mounting_id
    assert about.clamp_pressure == pytest.approx(20e3)
    # The air follows the chamber with 300 s: within 1 degC of 8 more after 300 ln 8 = 624 s, then it holds for 600 s.
    assert about.minutes_in_environment == pytest.approx((624.0 + 600.0) / 60.0, rel=0.1)
    assert about.minutes_out_of_water == pytest.approx(about.minutes_in_environment, abs=1.0)
    assert about.temperature == pytest.approx(30.0, abs=1.0)
    assert about.relative_humidity == pytest.approx(60.0, abs=3.0)
    kinds = [(zero.channel, zero.kind, zero.when) for zero in about.zeros if zero.channel == "force"]
    assert kinds == [
        ("force", "tare", "before"),
        ("force", "preload", "before"),
        ("force", "preload", "after"),
        ("force", "tare", "after"),
    ]
    tare, preload, _, _ = [zero.value for zero in about.zeros if zero.channel == "force"]
    assert (tare, preload) == (pytest.approx(0.0, abs=1e-4), pytest.approx(4.48e-3, abs=1e-4))
    assert run.raw.keys() >= {"voltage", "current", "force", "output"}


def test_pairs_repeats_and_the_baseline(tmp_path: Path) -> None:
    desk = Desk()
    session = make(tmp_path, desk, pair=True, repeats=2, baseline=True, pause="2 min")
    recorded = session.run()
    assert [one.purpose for one in recorded] == ["baseline"] + 4 * ["signal"]
    baseline, plus, minus, _, last = runs_of(recorded)
    assert np.max(np.abs(baseline.voltage)) < 1e-3
    assert plus.metadata.pair_id == minus.metadata.pair_id != last.metadata.pair_id
    assert last.metadata.repeat == 2
    assert plus.current is not None
    assert minus.current is not None
    # Half the sum of a pair has no response of a linear strip: noise and zeros are left of some 60 mA.
    assert np.max(np.abs(plus.current + minus.current)) < 3e-4 < 0.04 < np.max(np.abs(plus.current))
    assert plus.metadata.starts_from_rest
    assert minus.metadata.starts_from_rest
    assert sum("current: half the difference of the pair peaks at 5" in text for text in desk.texts()) == 2


def test_what_nobody_says_is_not_invented(tmp_path: Path) -> None:
    """Three recordings of one clamping that nobody vouched for are no three mountings."""
    for _ in range(3):
        desk = Desk(clamp="unknown", hydrate="unknown")
        (run,) = runs_of(make(tmp_path, desk, steps=["hydrate", "clamp", "apply"]).run())
        assert run.metadata.mounting_id is None
        assert run.metadata.minutes_out_of_water is None
        assert "nobody said whether this was done: clamp; the run belongs to no known mounting" in str(
            run.metadata.notes
        )
        assert "nobody said whether this was done: hydrate" in desk.texts()
    assert earlier_runs(Laboratory.open(tmp_path / "laboratory"), "friend-2").mounting_id is None


def test_a_new_mounting_at_every_clamping_unless_it_was_kept(tmp_path: Path) -> None:
    ids = []
    for answer in ("done", "done", "kept"):
        desk = Desk(clamp=answer)
        (run,) = runs_of(make(tmp_path, desk, steps=["clamp", "apply"]).run())
        ids.append(run.metadata.mounting_id)
    assert ids[0] != ids[1] == ids[2]
    assert None not in ids
    fresh = Desk(clamp="kept")
    (run,) = runs_of(make(tmp_path, fresh, steps=["clamp", "apply"], sample="another").run())
    assert run.metadata.mounting_id not in ids
    assert any("no earlier mounting of another" in text for text in fresh.texts())


def test_a_fingerprint_outside_the_earlier_ones_is_asked_about(tmp_path: Path) -> None:
    """Three alike, then a bad contact: the operator clamps again, a new fingerprint is taken, and all of it is kept."""
    for _ in range(3):
        make(tmp_path, Desk(), fingerprint=True, pause="1 min").run()
    earlier = earlier_runs(Laboratory.open(tmp_path / "laboratory"), "friend-2")
    assert len(earlier.fingerprints) == 3
    # Circuit: 1 ohm of the shunt, 16.0 ohm of the strip (twice 8 ohm of its electrodes) and its first branch.
    assert all(15.0 < one.series_resistance < 20.0 for one in earlier.fingerprints)
    bench = VirtualBench()
    bench.operate("contact bad")
    desk = Desk(fingerprint="clamp")
    asked = desk.ask

    def clamp_well(question: Question, ended: Callable[[], bool]) -> str:
        if question.step == "clamp":
            bench.operate("contact good")
        return asked(question, ended)

    desk.ask = clamp_well  # type: ignore[method-assign]
    recorded = make(tmp_path, desk, bench, fingerprint=True, pause="1 min").run()
    assert desk.asked == ["fingerprint", "clamp"]
    assert [one.purpose for one in recorded] == ["fingerprint", "fingerprint", "signal"]
    first, second, run = runs_of(recorded)
    assert first.metadata.mounting_id is None
    assert second.metadata.mounting_id == run.metadata.mounting_id is not None
    assert "series resistance" in (run.metadata.notes or "")
    assert "clamp" in (run.metadata.notes or "")
    # The bad one is among the earlier ones now: one outlier does not excuse the next.
    going_on = Desk(fingerprint="continue")
    bench.operate("contact bad")
    recorded = make(tmp_path, going_on, bench, fingerprint=True, pause="1 min").run()
    assert [one.purpose for one in recorded] == ["fingerprint", "signal"]
    assert "continue" in (read_run(recorded[-1].path).metadata.notes or "")


def test_an_environment_that_never_settles_ends_it_before_a_volt(tmp_path: Path) -> None:
    air = {"temperature": "30 degC", "settle": "1 min", "longest_wait": "10 min"}
    bench = Watched()
    session = make(tmp_path, Desk(), bench, steps=["equilibrium", "apply"], environment=air)
    with pytest.raises(InputError) as caught:
        session.run()
    assert caught.value.code == "never-settles"
    assert "the temperature is 22.0 degC, not 30 +- 1" in str(caught.value)  # nobody has set the chamber
    assert bench.largest == 0.0
    assert not session.recorded


class Watched(VirtualBench):
    """Remembers the largest voltage that it gave."""

    largest = 0.0

    def apply(self, source: Any, rows: int | None = None) -> Any:
        for block in super().apply(source, rows):
            self.largest = max(self.largest, float(np.max(np.abs(block.output))))
            yield block


def test_an_abort_ends_the_experiment_and_keeps_the_run(tmp_path: Path) -> None:
    desk = Desk()
    session = make(tmp_path, desk, repeats=3, pause="0 s")

    desk.on_message = AtRow(60, lambda: (session.mark("fan on"), session.abort("smoke")))
    (run,) = runs_of(session.run())
    assert (run.metadata.state, run.metadata.state_reason) == ("aborted", "smoke")
    assert [mark.text for mark in run.metadata.marks if mark.kind == "note"] == ["fan on"]
    assert session.ended_early == "abort"


def test_stop_before_the_first_run(tmp_path: Path) -> None:
    desk = Desk()
    session = make(tmp_path, desk, steps=["clamp", "apply"])
    desk.on_message = lambda message: session.stop() if message.kind == "step" else None
    assert session.run() == ()


@pytest.mark.parametrize("how", ["stop", "zero", "abort"])
def test_how_many_rows_a_run_that_is_ended_will_have_is_told_at_once(tmp_path: Path, how: str) -> None:
    desk = Desk()
    session = make(tmp_path, desk, duration="30 s", rest_after="2 s", fingerprint=False)

    desk.on_message = AtRow(100, getattr(session, how))
    (run,) = runs_of(session.run())
    told = [one for one in desk.told if one.kind in ("event", "progress")]
    place = next(place for place, one in enumerate(told) if one.kind == "event")
    assert told[place].values["ending"] == how
    assert {one.values["of"] for one in told[:place]} == {33 * 50}
    assert {one.values["of"] for one in told[place + 1 :]} == {len(run)}
    # It is heard behind the next block of two rows: 2 s of rest, 5 s of discharge or nothing are read after that.
    assert len(run) == 102 + {"stop": 2, "zero": 5, "abort": 0}[how] * 50


def test_a_limit_that_ends_a_run_is_told_with_the_rows_the_run_will_have(tmp_path: Path) -> None:
    """One that only warns is told before it, and ends nothing."""
    desk = Desk()
    limits = {"mean_current": "20 mA", "energy": "0.1 mJ"}
    session = make(tmp_path, desk, duration="30 s", limits=limits)
    (run,) = runs_of(session.run())
    told = [one for one in desk.told if one.kind in ("event", "progress")]
    events = [place for place, one in enumerate(told) if one.kind == "event"]
    assert ["the energy" in told[place].values["text"] for place in events[:2]] == [True, False]
    assert [told[place].values.get("ending") for place in events[:2]] == [None, "limit"]
    assert {told[place].values.get("ending") for place in events[2:]} <= {None}
    place = events[1]
    assert "the mean current" in told[place].values["text"]
    assert {one.values["of"] for one in told[:place] if one.kind == "progress"} == {32 * 50}
    assert {one.values["of"] for one in told[place:] if one.kind == "progress"} == {len(run)}
    # Five seconds at 0 V, from the end of the block in which it was passed.
    assert len(run) - told[place].values["time"] * 50 == pytest.approx(5.0 * 50, abs=3)


def test_a_limit_ends_the_experiment(tmp_path: Path) -> None:
    session = make(tmp_path, Desk(), repeats=2, limits={"current": {"most": "20 mA", "duration": "0 s"}}, pause="0 s")
    (recorded,) = session.run()
    assert recorded.state == "aborted"
    assert "beyond its limit of 20 mA" in (recorded.state_reason or "")
    assert session.ended_early == "abort"


class Failing(VirtualBench):
    """Breaks down in the middle."""

    def apply(self, source: Any, rows: int | None = None) -> Any:
        for block in super().apply(source, rows):
            if float(np.max(np.abs(block.output))) > 0.5 and block.first_row > 100:
                raise IpmclabError("the cable is out", code="bench-lost", where="chassis", repair="plug it in")
            assert isinstance(block, Block)
            yield block


def test_a_bench_that_fails_keeps_what_was_recorded(tmp_path: Path) -> None:
    desk = Desk()
    session = make(tmp_path, desk, Failing())
    with pytest.raises(IpmclabError, match="the cable is out"):
        session.run()
    (run,) = runs_of(session.recorded)
    assert run.metadata.state == "aborted"
    assert len(run) > 50
    assert any("the cable is out" in text for text in desk.texts("event"))


def test_what_is_known_of_a_sample_without_a_catalogue(tmp_path: Path) -> None:
    laboratory = Laboratory.open(tmp_path / "laboratory")
    (laboratory.root / "catalogue.db").write_bytes(b"this is no database")
    assert earlier_runs(laboratory, "friend-2") == Earlier()
    assert isinstance(Fingerprint(1.0, 1.0, 0.0, "current", 0.0).as_dict()["drift"], float)


def test_a_strip_that_stays_otherwise_is_clamped_three_times_at_most(tmp_path: Path) -> None:
    before = [Fingerprint(30.0 + k, 5e-3, 0.0, "current", 1e-7) for k in range(3)]
    session = make(tmp_path, Desk(fingerprint="clamp"), fingerprint=True, pause="1 s")
    session._earlier = lambda _: Earlier(tuple(before))
    with pytest.raises(IpmclabError, match="clamped again 3 times") as caught:
        session.run()
    assert caught.value.code == "fingerprint-outside"
    assert len(session.recorded) == 4


def test_a_mark_between_runs_is_in_the_next_one(tmp_path: Path) -> None:
    desk = Desk()
    session = make(tmp_path, desk, steps=["clamp", "apply"])
    desk.on_message = lambda message: session.mark(message["name"]) if message.kind == "step" else None
    (run,) = runs_of(session.run())
    noted = {mark.text.split(" (")[0] for mark in run.metadata.marks if mark.kind == "note"}
    assert noted == {"clamp", "apply"}


def test_a_tare_counts_for_one_run(tmp_path: Path) -> None:
    desk = Desk(zero="done")
    session = make(
        tmp_path, desk, steps=["zero", "preload", "apply"], measured=["current", "force"], repeats=2, pause="1 s"
    )
    asked: list[str] = []

    def skip_the_second(message: Message) -> None:
        if message.kind == "step" and message["name"] == "zero":
            asked.append("zero")
            desk.answers["zero"] = "done" if len(asked) == 1 else "skip"

    desk.on_message = skip_the_second
    first, second = runs_of(session.run())
    assert any(zero.kind == "tare" for zero in first.metadata.zeros)
    assert not any(zero.kind == "tare" for zero in second.metadata.zeros)
    assert desk.asked.count("zero") == 3  # before each run, and after the one that has a tare


def test_a_check_that_fails_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk()
    session = make(tmp_path, desk, repeats=2, pause="0 s")
    session._archive._inspect = lambda _: 1 / 0  # type: ignore[assignment, return-value]
    assert [one.state for one in session.run()] == ["complete", "complete"]
    assert any("ZeroDivisionError" in text for text in desk.texts())
    monkeypatch.setattr(archive_module, "_MOST_CHECKED", 100)
    session = make(tmp_path, desk)
    assert [one.state for one in session.run()] == ["complete"]
    assert any("ipmclab check" in text and "200 rows" in text for text in desk.texts())
