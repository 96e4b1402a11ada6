"""A chamber that is watched while an experiment runs: what ends it, and how soon."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ipmclab.rig.chambers import driver, watch
from ipmclab.rig.chambers.chamber import ChamberError, Conditions
from ipmclab.rig.chambers.settings import MOST_PATIENCE, OTHERS_PATIENCE
from ipmclab.rig.chambers.virtual import VirtualChamber
from ipmclab.rig.chambers.watch import ChamberWatch
from tests.rig.chambers.benches_of_chambers import KINDS, WANTED, Kind, Pair, paired, set_by_another
from tests.rig.chambers.test_faults import tried
from tests.rig.chambers.wire import Fault
from tests.waiting import HANGS, until

pytestmark = pytest.mark.usefixtures("often")


@contextmanager
def watched(
    kind: Kind, folder: Path, patience: float = MOST_PATIENCE
) -> Iterator[tuple[ChamberWatch, Pair, list[ChamberError]]]:
    with paired(kind, folder, patience=patience) as pair:
        held = ChamberWatch(pair.chamber)
        problems: list[ChamberError] = []
        held.on_problem = problems.append
        try:
            held.set(*WANTED)
            yield held, pair, problems
        finally:
            held.close()


def wait_for(problems: list[ChamberError]) -> ChamberError:
    until(lambda: problems)
    return problems[0]


def further_readings(held: ChamberWatch) -> None:
    """Wait until two more have come: the first may have been asked for before."""
    for _ in range(2):
        last = held.latest
        until(lambda last=last: held.latest is not last)


@pytest.mark.parametrize(
    ("happens", "code", "words"),
    [
        (lambda pair: set_by_another(pair, KINDS[0]), "chamber-changed", "42"),
        (lambda pair: pair.room.trip(), "chamber-alarm", "alarm 1"),
        (lambda pair: setattr(pair.room, "humidity_set_point", None), "chamber-changed", "no set point"),
        (lambda pair: setattr(pair.room, "mode", "RUN"), "chamber-changed", "program"),
    ],
)
def test_what_nobody_asked_for_ends_an_experiment(
    happens: Callable[[Pair], None], code: str, words: str, tmp_path: Path
) -> None:
    with watched(KINDS[0], tmp_path) as (held, pair, problems):
        happens(pair)
        problem = wait_for(problems)
        assert problem.code == code
        assert words in problem.message
        pair.room.alarms = []
        held.safe()
        assert pair.room.mode == "STANDBY"


def test_a_program_that_starts_while_the_chamber_is_still(tmp_path: Path) -> None:
    with watched(KINDS[0], tmp_path) as (held, pair, problems):
        held.still(60.0)
        further_readings(held)
        assert problems == []
        pair.room.mode = "RUN"
        assert "program" in wait_for(problems).message


def test_silence_is_borne_for_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with watched(KINDS[-1], tmp_path) as (held, pair, problems):
        further_readings(held)
        with monkeypatch.context() as patch:
            patch.setattr(driver, "READ_TIME", 0.5)
            pair.emulator.fault = Fault("silence")
            until(lambda: held._failure is not None)
        pair.emulator.fault = None
        further_readings(held)
        assert (held._failure, problems) == (None, [])


@pytest.mark.real_time
def test_silence_is_told_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver, "READ_TIME", 0.5)
    monkeypatch.setattr(watch, "SILENT", 1.5)
    with watched(KINDS[-1], tmp_path, patience=0.2) as (held, pair, problems):
        further_readings(held)
        pair.emulator.fault = Fault("silence")
        began = time.monotonic()
        assert wait_for(problems).code == "chamber-silent"
        assert time.monotonic() - began < 1.5 + 0.5 + 2.0


def test_silence_and_the_reading_under_way_end_within_half_a_minute() -> None:
    assert watch.SILENT + driver.READ_TIME + OTHERS_PATIENCE + driver.SAFE_TIME <= 30.0
    # A call waits for whoever has the line, has its own time, and what brings the chamber to standby where it fails.
    assert driver.READ_TIME + driver.SET_TIME + driver.SAFE_TIME + 1.0 < 30.0


def test_a_humidity_that_the_chamber_rounds_is_nobody_elses(tmp_path: Path) -> None:
    kind = next((one for one in KINDS if one.driver == "espec-sh"), None)
    if kind is None:
        pytest.skip("no pseudo-terminals")
    with watched(kind, tmp_path) as (held, _, problems):
        held.set(25.0, 60.4)
        further_readings(held)
        assert problems == []


@pytest.mark.real_time
def test_safe_does_not_wait_for_a_reading_that_is_under_way(tmp_path: Path) -> None:
    with paired(KINDS[0], tmp_path, patience=0.3) as pair:
        pair.chamber.set(*WANTED)
        pair.emulator.fault = Fault("silence", lasts=2)
        reading = threading.Thread(target=lambda: tried(pair.chamber.read))
        reading.start()
        time.sleep(0.1)
        began = time.monotonic()
        pair.chamber.safe()
        assert time.monotonic() - began < 3.0
        assert pair.room.mode == "STANDBY"
        reading.join()


@pytest.mark.real_time
def test_safe_cuts_the_standby_of_a_call_that_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in (("READ_TIME", 0.5), ("SET_TIME", 0.3), ("_POLITE", 0.2)):
        monkeypatch.setattr(driver, name, seconds)
    with paired(KINDS[0], tmp_path, patience=3.0) as pair:
        pair.chamber.read()
        pair.emulator.fault = Fault("silence", after=1)
        setting = threading.Thread(target=lambda: tried(pair.chamber.set, *WANTED))
        setting.start()
        time.sleep(0.5)  # it is bringing the chamber to standby, of which it hears nothing for 3 s
        pair.emulator.fault = None
        pair.chamber.safe()
        assert pair.room.mode == "STANDBY"
        setting.join()


class Broken(VirtualChamber):
    """A chamber whose driver has a fault of its own, or hangs."""

    def __init__(self, act: Callable[[], None]) -> None:
        super().__init__()
        self.act = act

    def read(self) -> Conditions:
        self.act()
        return super().read()


def test_a_fault_of_the_driver_is_told_and_ends_no_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "SILENT", 0.3)
    problems: list[ChamberError] = []

    def fail() -> None:
        raise OverflowError("too large")

    chamber = Broken(fail)
    held = ChamberWatch(chamber)
    held.on_problem = problems.append
    held.set(*WANTED)
    assert wait_for(problems).code == "chamber-failed"
    assert "OverflowError" in problems[0].message
    chamber.act = lambda: None
    heard = threading.Event()
    held.on_reading = lambda _: heard.set()
    assert heard.wait(HANGS)
    held.close()


def test_what_hears_of_readings_and_fails_is_a_problem_of_the_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    problems: list[ChamberError] = []

    def fail(_: Conditions) -> None:
        raise OSError("the disk is full")

    held = ChamberWatch(VirtualChamber())
    held.on_reading, held.on_problem = fail, problems.append
    held.set(*WANTED)
    assert "the disk is full" in wait_for(problems).message
    held.close()


def test_a_reading_that_hangs_is_noticed_by_whoever_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    hangs = threading.Event()
    held = ChamberWatch(Broken(lambda: bool(hangs.wait(HANGS)) and None))
    held.set(*WANTED)
    held.check()
    monkeypatch.setattr(watch, "SILENT", 0.2)
    time.sleep(0.3)
    with pytest.raises(ChamberError) as caught:
        held.check()
    assert caught.value.code == "chamber-silent"
    hangs.set()
    held.close()


@pytest.mark.parametrize("answers_again", [True, False])
def test_a_chamber_that_does_not_answer_is_resumed_once_it_does(
    monkeypatch: pytest.MonkeyPatch, *, answers_again: bool
) -> None:
    monkeypatch.setattr(watch, "SILENT", HANGS if answers_again else 1.0)
    chamber = VirtualChamber()
    held = ChamberWatch(chamber)
    held.set(*WANTED)
    held.still(60.0)
    chamber.silent = True
    until(lambda: held._failure is not None)
    asked: list[bool] = []
    monkeypatch.setattr(chamber, "resume", lambda: asked.append(True))
    if answers_again:
        threading.Timer(0.3, lambda: setattr(chamber, "silent", False)).start()
        held.resume()
        assert len(asked) == 1
    else:
        with pytest.raises(ChamberError, match="no reading has come"):
            held.resume()
        assert asked == []
    held.close()


def test_after_a_resume_that_failed_the_readings_say_what_the_chamber_does() -> None:
    now = [0.0]
    chamber = VirtualChamber(lambda: now[0])
    held = ChamberWatch(chamber, clock=lambda: now[0])
    held.set(*WANTED)
    held.still(60.0)

    def resume() -> None:
        chamber.safe()
        raise ChamberError("it is locked", code="chamber-refused", where="chamber", repair="look at its panel")

    chamber.resume = resume  # type: ignore[method-assign]
    failed: list[ChamberError | None] = []
    held.resume_soon(failed.append)
    assert failed[0] is not None
    assert not held.is_still
    for _ in range(2):
        now[0] += 1.0
        held.take()
    with pytest.raises(ChamberError, match="it is in standby"):
        held.check()


def test_a_chamber_that_follows_another_program_is_nobody_elses_to_stop(tmp_path: Path) -> None:
    told: list[bool] = []
    with paired(KINDS[0], tmp_path) as pair:
        pair.room.mode = "RUN"
        held = ChamberWatch(pair.chamber, keeper=told.append)
        with pytest.raises(ChamberError) as caught:
            held.set(*WANTED)
        assert (caught.value.code, held.is_ours, told[-1]) == ("chamber-in-use", False, False)
        held.close()
