"""Why a run ended, as the recorder tells it: its guardian acted, and the chassis or this computer was the cause."""

from __future__ import annotations

import re

import pytest

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.safety import guardian as guardian_module
from ipmclab.rig.safety.guardian import Guardian
from tests.rig.guardian_stand_in import Clock, Process
from tests.rig.guardian_stand_in import clock as clock
from tests.rig.guardian_stand_in import guardian as guardian
from tests.rig.guardian_stand_in import process as process
from tests.waiting import HANGS, until

CHASSIS, COMPUTER = "the chassis gave no readings", "this computer held the recording up"
ACTED = "acted the recorder was silent for 1 s"


@pytest.fixture(autouse=True)
def an_eighth(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread wakes every eighth of a second: times that a computer holds exactly."""
    monkeypatch.setattr(guardian_module, "_OFTEN", 0.25)


def acts(guardian: Guardian, process: Process, *words: str) -> None:
    process.say(ACTED, *words)
    until(lambda: guardian.outcome if words else guardian.acted, HANGS / 6.0)


def frozen(code: str = "bench-frozen") -> BenchError:
    return BenchError("the server of the chassis does not answer", code=code, where="bench", repair="restart it")


@pytest.mark.parametrize(
    ("said", "deed"),
    [
        (["zero"], "brought the output to 0 V"),
        (["zero", "alive"], "brought the output to 0 V"),
        (["unread no reading"], "reset the output, but could not read back that it is at 0 V"),
        (["failed no answer"], "could NOT bring the output to 0 V so far"),
        ([], "is bringing the output to 0 V, and has not read that back yet"),
    ],
)
def test_what_became_of_the_output_is_told_as_the_guardian_said_it(
    guardian: Guardian, process: Process, said: list[str], deed: str
) -> None:
    guardian.arm()
    assert (guardian.acted, guardian.outcome) == ("", "")
    acts(guardian, process, *said)
    assert guardian.acted == "the recorder was silent for 1 s"
    message = f"the guardian {deed}: the recorder was silent for 1 s; {CHASSIS} for 0.0 s"
    with pytest.raises(IpmclabError, match=f"^guardian: {re.escape(message)}; see that the chassis, its cable"):
        guardian.beat()
    assert process.heard == ["arm 1.0"]


@pytest.mark.parametrize(
    ("held_up", "worked", "cause"),
    [(0.625, 0.0, COMPUTER), (0.5625, 0.0, CHASSIS), (0.0, 0.5, COMPUTER), (0.0, 0.4375, CHASSIS)],
)
def test_half_a_silence_without_the_processor_or_computing_is_this_computer_s(
    guardian: Guardian, process: Process, clock: Clock, held_up: float, worked: float, cause: str
) -> None:
    guardian.arm()
    clock.goes_on(2.0)
    clock.used += 9.0
    guardian.beat()
    clock.jumps(held_up)
    clock.used += worked
    acts(guardian, process, "zero")
    with pytest.raises(IpmclabError, match=f"{cause} for {held_up:.1f} s") as told:
        guardian.beat()
    assert (told.value.code, told.value.where) == ("guardian-acted", "guardian")
    assert told.value.repair.startswith("see that" if cause == CHASSIS else "give this computer less to do")


def test_the_first_moment_counts_as_well(guardian: Guardian, process: Process, clock: Clock) -> None:
    guardian.arm()
    clock.jumps(0.625)
    clock.let_it_wake()
    acts(guardian, process, "zero")
    with pytest.raises(IpmclabError, match=f"{COMPUTER} for 0.6 s"):
        guardian.beat()


def test_only_what_was_late_since_the_last_beat_counts(guardian: Guardian, process: Process, clock: Clock) -> None:
    """A recorder that was held up once, and has beaten since, is not the cause of what comes later."""
    guardian.arm()
    clock.jumps(0.875)
    clock.let_it_wake()
    guardian.beat()  # the guardian is asked, and has nothing to say
    acts(guardian, process, "zero")
    with pytest.raises(IpmclabError, match=CHASSIS):
        guardian.beat()


def test_only_what_was_late_since_it_was_armed_counts(guardian: Guardian, process: Process, clock: Clock) -> None:
    guardian.arm()
    clock.jumps(0.875)
    clock.let_it_wake()
    guardian.disarm()
    guardian.arm()
    acts(guardian, process, "zero")
    with pytest.raises(IpmclabError, match=CHASSIS):
        guardian.beat()


def test_once_it_is_disarmed_nothing_counts_as_late(guardian: Guardian, process: Process, clock: Clock) -> None:
    """Nobody wakes any more: a server that freezes then is not excused by it."""
    guardian.arm()
    clock.turn.is_awaited()
    acts(guardian, process)
    del process.answers["disarm"]
    clock.is_patient = False
    guardian.disarm()
    clock.now += 10.0
    failure = frozen()
    guardian.explain(failure)
    assert failure.code == "bench-frozen"


@pytest.mark.parametrize(
    ("acted", "held_up", "went_on", "code", "cause"),
    [
        (True, 0.0, 3.0, "bench-frozen", ""),  # the server it is
        (True, 0.0, 3.0, "bench-lost", f"{CHASSIS} for 3.0 s"),  # the guardian reset what was lost then
        (True, 2.125, 1.875, "bench-frozen", ""),  # half of the time
        (True, 2.25, 1.75, "bench-frozen", f"{COMPUTER} for 4.0 s"),
        (True, 2.25, 1.75, "bench-lost", f"{COMPUTER} for 4.0 s"),
        (True, 0.625, 0.0, "bench-frozen", ""),  # half of the silence
        (True, 0.75, 0.0, "bench-frozen", f"{COMPUTER} for 0.8 s"),
        (False, 2.25, 1.75, "bench-frozen", ""),
        (False, 0.0, 3.0, "bench-lost", ""),
    ],
)
def test_a_failure_is_told_by_its_cause(
    guardian: Guardian, process: Process, clock: Clock,
    acted: bool, held_up: float, went_on: float, code: str, cause: str,
) -> None:  # fmt: skip
    guardian.arm()
    clock.goes_on(2.0)
    guardian.beat()
    clock.jumps(held_up)
    clock.let_it_wake()
    clock.goes_on(went_on)
    if acted:
        acts(guardian, process, "zero")
    clock.is_patient = False
    failure, before = frozen(code), frozen(code)
    guardian.explain(failure)
    if cause:
        assert failure.message.endswith(f"the recorder was silent for 1 s; {cause}")
        assert (failure.code, failure.where) == ("guardian-acted", "guardian")
        assert failure.repair.startswith("see that the" if CHASSIS in cause else "give this computer less")
    else:
        assert str(failure) == str(before)
        assert failure.code == code


@pytest.mark.parametrize("call", ["beat", "explain"])
def test_after_a_pause_of_this_program_its_guardian_is_heard_first(
    guardian: Guardian, process: Process, clock: Clock, call: str
) -> None:
    """What it said meanwhile has not been read yet, however long that takes: an answer comes after it."""
    guardian.arm()
    clock.jumps(5.0)
    clock.meanwhile = lambda: process.say(ACTED) or process.answer()
    failure: IpmclabError = frozen()
    if call == "beat":
        with pytest.raises(IpmclabError) as told:
            guardian.beat()
        failure = told.value
    else:
        guardian.explain(failure)
    assert failure.code == "guardian-acted"
    assert "is bringing the output to 0 V" in failure.message
    assert f"{COMPUTER} for 5.0 s" in failure.message
    assert process.heard == ["arm 1.0", "ask 1"]


def test_a_failure_that_says_its_cause_itself_waits_for_nobody(
    guardian: Guardian, process: Process, clock: Clock
) -> None:
    """The output is to be brought to 0 V, whether the guardian answers or hangs."""
    guardian.arm()
    clock.goes_on(3.0)
    waited = list(clock.patience)
    failure = frozen("limit")
    guardian.explain(failure)
    assert (failure.code, clock.patience, process.heard) == ("limit", waited, ["arm 1.0"])


@pytest.mark.parametrize("call", ["beat", "explain"])
def test_one_that_did_not_act_says_so_at_once(guardian: Guardian, process: Process, clock: Clock, call: str) -> None:
    """The recorder was held up, and in time: it goes on, without waiting out a time."""
    guardian.arm()
    clock.jumps(0.75)
    failure = frozen()
    guardian.beat() if call == "beat" else guardian.explain(failure)
    assert failure.code == "bench-frozen"
    assert process.heard[1:] == (["ask 1", "beat"] if call == "beat" else ["ask 1"])


def test_one_that_answers_late_is_asked_by_each_beat(guardian: Guardian, process: Process, clock: Clock) -> None:
    """No beat keeps the rows waiting for long, and none forgets how long the recorder was silent before it."""
    guardian.arm()
    process.hears = clock.is_patient = False
    clock.jumps(5.0)
    clock.let_it_wake()
    clock.goes_on(1.0)
    process.say("alive")
    until(lambda: guardian._sign == clock.now)
    guardian.beat()
    process.hears = clock.is_patient = True

    def late() -> None:
        process.say("heard 1", ACTED)  # the answer to the beat before is none to this one
        process.answer()

    clock.meanwhile = late
    with pytest.raises(IpmclabError, match=f"{COMPUTER} for 6.0 s"):
        guardian.beat()
    assert process.heard == ["arm 1.0", "ask 1", "beat", "ask 2"]


def test_a_stop_within_a_beat_is_not_the_chassis_s(guardian: Guardian, process: Process, clock: Clock) -> None:
    """It had looked at the clock, and nothing was late then; its thread woke late meanwhile."""
    guardian.arm()

    def stopped() -> None:
        clock.jumps(5.0)
        clock.let_it_wake()

    clock.goes_on(0.625)
    clock.meanwhile = lambda: stopped() or process.answer()
    guardian.beat()
    acts(guardian, process, "zero")
    with pytest.raises(IpmclabError, match=f"{COMPUTER} for 5.0 s"):
        guardian.beat()


def test_a_failure_before_it_is_armed_is_left_as_it_is(guardian: Guardian, clock: Clock) -> None:
    clock.now += 5.0
    failure = frozen("bench-lost")
    guardian.explain(failure)
    assert failure.code == "bench-lost"
