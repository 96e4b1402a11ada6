"""Every driver against lines that fail: an error within its deadline, no wrong reading, no unwanted set point."""

from __future__ import annotations

import random
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from ipmclab.rig.chambers import driver
from ipmclab.rig.chambers.chamber import ChamberError
from tests.rig.chambers.benches_of_chambers import KINDS, WANTED, Kind, Pair, Quick, at_once, paired
from tests.rig.chambers.wire import LINE_FAULTS, Fault
from tests.rig.chambers.wire import Kind as FaultKind
from tests.waiting import until

pytestmark = pytest.mark.real_time

SLACK = 1.0
"""A busy machine may take so much longer [s]."""


def tried(call: object, *given: object) -> tuple[str, float]:
    """The code of the error that a call of a chamber ends with, and how long it took [s]."""
    began = time.monotonic()
    try:
        call(*given)  # type: ignore[operator]
    except ChamberError as caught:
        error = caught
    else:
        return "", time.monotonic() - began
    assert error.where
    assert error.repair
    return f"{error.code}: {error.message}", time.monotonic() - began


def hold(pair: Pair, fault: Fault) -> None:
    """Set, read and bring to standby under a fault, and after it."""
    chamber, room = pair.chamber, pair.room
    pair.emulator.fault = fault
    failed, took = tried(chamber.set, *WANTED)
    assert took < driver.SET_TIME + driver.SAFE_TIME + SLACK
    if not failed:
        assert (room.mode, room.temperature_set_point) == ("CONSTANT", WANTED[0])
    elif "could not be brought" not in failed:
        assert room.mode == "STANDBY", failed
    told = []
    failed, took = tried(lambda: told.append(chamber.read()))
    assert took < driver.READ_TIME + SLACK
    if failed:
        assert failed.startswith(("chamber-silent", "chamber-garbled", "chamber-unreachable", "chamber-refused"))
    else:
        assert told[0].temperature == pytest.approx(room.temperature, abs=1.0)
        assert told[0].relative_humidity == pytest.approx(room.relative_humidity, abs=5.0)
    failed, took = tried(chamber.safe)
    assert took < driver.SAFE_TIME + SLACK
    assert room.mode == "STANDBY" or failed.startswith("chamber-not-safe")
    bring_to_standby(pair)
    assert all(one == pytest.approx(WANTED, abs=0.1) for one in room.regulated)


def bring_to_standby(pair: Pair) -> None:
    """Once the line works again; on a busy machine an answer may still come after the driver's patience."""
    pair.emulator.fault = None
    wait_until_quiet(pair)
    until(lambda: not tried(pair.chamber.safe)[0])
    assert pair.room.mode == "STANDBY"


def wait_until_quiet(pair: Pair) -> None:
    """An instrument that is late is still busy with what it was asked."""
    asked = -1
    while asked != pair.emulator.asked:
        asked = pair.emulator.asked
        time.sleep(0.1)


@pytest.mark.parametrize("place", range(2))
def test_a_line_that_fails(place: int, tmp_path: Path, quicker: None) -> None:
    def fail(kind: Kind) -> None:
        number = KINDS.index(kind) + 4 * place
        drawn = random.Random(number)
        what, after = LINE_FAULTS[number % len(LINE_FAULTS)], drawn.randrange(8)
        fault = Fault(what, after, lasts=drawn.choice([1, 2, 10**6]), seconds=drawn.choice([0.1, 0.4]))
        with paired(kind, tmp_path, patience=0.2, seed=number) as pair:
            hold(pair, fault)

    at_once(fail, KINDS)


def test_one_answer_that_fails_costs_a_question_and_nothing_else(tmp_path: Path) -> None:
    def fail(what: FaultKind) -> None:
        for kind in (KINDS[1], KINDS[-1]):
            with paired(kind, tmp_path, patience=1.0) as pair:
                pair.chamber.set(*WANTED)
                pair.emulator.fault = Fault(what, after=1, lasts=1, seconds=1.4)
                assert pair.chamber.read().temperature == WANTED[0]

    at_once(fail, LINE_FAULTS)


def test_standby_is_reached_by_the_first_call_once_it_answers_again(tmp_path: Path, quick: Quick) -> None:
    """Of a line that was listened to for all the time that standby is tried for a second time, nothing was asked."""

    def fail(pair: Pair) -> None:
        pair.chamber.set(*WANTED)
        pair.emulator.fault = Fault("silence")

    with ExitStack() as stack:
        pairs = [stack.enter_context(paired(kind, tmp_path)) for kind in KINDS]
        at_once(fail, pairs)
        with quick():
            at_once(lambda pair: tried(pair.chamber.safe), pairs)
        for pair in pairs:
            pair.emulator.fault = None
        at_once(lambda pair: pair.chamber.safe(), pairs)
        assert {pair.room.mode for pair in pairs} == {"STANDBY"}


@pytest.mark.parametrize("kind", [KINDS[1], *KINDS[::3]], ids=str)
def test_a_line_that_never_falls_quiet_ends_every_call(kind: Kind, tmp_path: Path, quicker: None) -> None:
    with paired(kind, tmp_path, patience=0.2) as pair:
        pair.chamber.set(*WANTED)
        pair.emulator.fault = Fault("flood", seconds=0.0)
        failed, took = tried(pair.chamber.read)
        assert failed.startswith("chamber-")
        assert took < driver.READ_TIME + SLACK
        assert tried(pair.chamber.safe)[1] < driver.SAFE_TIME + SLACK
        bring_to_standby(pair)


def test_a_late_answer_is_never_taken_for_that_to_the_next_question(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "READ_TIME", 18.0)  # how long a whole reading may take is no matter here
    serial = [kind for kind in KINDS if kind.serial]
    if not serial:
        pytest.skip("no pseudo-terminals")

    def ask(case: tuple[Kind, int]) -> None:
        kind, after = case
        with paired(kind, tmp_path, patience=3.0) as pair:
            pair.chamber.set(*WANTED)
            pair.emulator.fault = Fault("late", after=after, lasts=1, seconds=3.5)
            told = pair.chamber.read()
            assert (told.temperature, told.mode) == (WANTED[0], "constant")
            assert told.humidity_set_point == pytest.approx(WANTED[1], abs=0.1)

    at_once(ask, [(kind, after) for kind in serial for after in range(2)])
