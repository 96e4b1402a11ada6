"""What the recorder says to its guardian and when, by a clock that a test moves: no process of its own is there."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from ipmclab.errors import IpmclabError
from ipmclab.platform import detached, python_child
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian import Guardian
from ipmclab.rig.safety.own_clock import Lateness
from tests.rig.guardian_stand_in import Clock, Process
from tests.rig.guardian_stand_in import clock as clock
from tests.rig.guardian_stand_in import guardian as guardian
from tests.rig.guardian_stand_in import process as process
from tests.waiting import HANGS, Started, in_background, until
from tests.waiting import threads_of as threads_of


def beats(process: Process) -> int:
    return process.heard.count("beat")


def has_ended(thread: threading.Thread) -> bool:
    thread.join(HANGS / 6.0)
    return not thread.is_alive()


@pytest.mark.parametrize("block_time", [[], [0.2]], ids=["unsaid", "0.2 s"])
def test_between_blocks_that_are_close_nothing_beats_for_the_recorder(
    guardian: Guardian, process: Process, clock: Clock, block_time: list[float]
) -> None:
    """A recorder that hangs after its last beat is noticed after the silence, and not a moment later."""
    guardian.arm(*block_time)
    clock.let_it_wake()
    clock.goes_on(1.0)
    assert process.heard == ["arm 1.0"]
    guardian.beat()
    clock.let_it_wake()
    assert process.heard == ["arm 1.0", "ask 1", "beat"]
    assert clock.periods == {0.1}  # where it has to beat: ten times a second


@pytest.mark.parametrize("block_time", [0.0, 0.25, 2.0])
def test_what_it_is_asked_to_wait_for_ends(
    guardian: Guardian, process: Process, clock: Clock, block_time: float
) -> None:
    """A task that takes two seconds, or three times between two blocks: so long a thread beats, no longer."""
    guardian.arm(block_time)
    if not block_time:
        guardian.hold(2.0)
    clock.now += (3.0 * block_time or 2.0) - 0.125
    clock.let_it_wake()
    assert beats(process) == 1
    clock.now += 0.125
    clock.let_it_wake()
    assert beats(process) == 1


def test_what_it_was_asked_to_wait_for_ends_with_the_next_beat(
    guardian: Guardian, process: Process, clock: Clock
) -> None:
    guardian.arm()
    guardian.hold(60.0)
    guardian.beat()
    clock.let_it_wake()
    assert beats(process) == 1


def test_once_it_acted_nothing_beats_for_the_recorder(guardian: Guardian, process: Process, clock: Clock) -> None:
    guardian.arm(2.0)
    process.say("acted the recorder was silent for 1 s", "zero")
    until(lambda: guardian.outcome, HANGS / 6.0)
    assert guardian.acted == "the recorder was silent for 1 s"
    clock.let_it_wake()
    assert process.heard == ["arm 1.0"]


def test_what_was_never_armed_is_neither_disarmed_nor_beaten_for(guardian: Guardian, process: Process) -> None:
    guardian.wait()
    guardian.disarm()
    assert process.heard == []
    with pytest.raises(IpmclabError, match="there is no guardian: it is not armed"):
        guardian.beat()


def test_it_is_let_go_of_once_it_says_so(
    threads_of: Started, guardian: Guardian, process: Process, clock: Clock
) -> None:
    """A beat between its word and its answer would be one to a guardian that still watches."""
    guardian.arm()
    [thread] = threads_of("heartbeat")
    assert thread.daemon  # a program that ends is not kept by it
    del process.answers["disarm"]
    clock.meanwhile = lambda: process.say("disarmed")
    guardian.disarm()
    with pytest.raises(IpmclabError, match="it is not armed"):
        guardian.beat()
    assert process.heard == ["arm 1.0", "disarm"]
    assert has_ended(thread)


def test_of_two_runs_the_second_alone_is_beaten_for(
    threads_of: Started, guardian: Guardian, process: Process, clock: Clock
) -> None:
    """The first ended with an output that could not be brought to 0 V: it was not let go of."""
    guardian.arm(20.0)
    [first] = threads_of("heartbeat")
    guardian.arm()
    assert has_ended(first)
    assert len(threads_of("heartbeat")) == 1
    clock.let_it_wake()
    assert beats(process) == 0


def test_one_that_gives_no_sign_of_life_is_taken_as_gone(guardian: Guardian, process: Process, clock: Clock) -> None:
    guardian.arm()
    process.hears = clock.is_patient = False
    clock.goes_on(3.0)
    guardian.beat()
    clock.goes_on(0.125)
    with pytest.raises(IpmclabError, match=r"it has given no sign of life for 3\.1 s"):
        guardian.beat()
    assert beats(process) == 1
    assert clock.patience[-2:] == [0.3, 0.3]  # for its answer


def test_only_after_half_of_its_silence_is_it_asked(guardian: Guardian, process: Process, clock: Clock) -> None:
    """Sooner it has not acted; a beat that waited each time would keep the recorder from its rows."""
    guardian.arm()
    for silent in (0.5, 0.625, 0.125):
        clock.goes_on(silent)
        guardian.beat()
    assert process.heard == ["arm 1.0", "beat", "ask 1", "beat", "beat"]


def test_a_sign_of_life_is_heard(guardian: Guardian, process: Process, clock: Clock) -> None:
    guardian.arm()
    clock.goes_on(3.0)
    process.say("alive")
    until(lambda: guardian._sign == clock.now)
    clock.goes_on(2.0)
    guardian.beat()
    assert (guardian.acted, guardian.outcome) == ("", "")


def test_a_guardian_that_does_not_answer_is_not_waited_for_for_ever(
    guardian: Guardian, process: Process, clock: Clock
) -> None:
    guardian.wait()
    clock.is_patient = False
    process.answers.clear()
    with pytest.raises(IpmclabError, match="there is no guardian: it does not answer"):
        guardian.arm()
    process.say("armed")
    clock.is_patient = True
    guardian.arm()
    clock.is_patient = False
    guardian.disarm()
    assert clock.patience == [30.0, 30.0, 2.0, 30.0, 2.0, 2.0]


def test_before_it_is_connected_it_cannot_be_armed(process: Process, clock: Clock) -> None:
    clock.is_patient = False
    with Guardian(Target("file", "output.txt")) as guardian:
        with pytest.raises(IpmclabError, match="there is no guardian: it was not ready within 30 s") as told:
            guardian.arm()
        assert (told.value.code, told.value.where) == ("guardian-lost", "guardian")
        assert process.heard == []
        guardian.disarm()
        assert process.heard == []


def test_one_that_could_not_connect_is_told_by_what_it_said(process: Process, clock: Clock) -> None:
    with Guardian(Target("file", "output.txt")) as guardian:
        process.say("failed no chassis at 127.0.0.1")
        process.end()
        with pytest.raises(IpmclabError, match=r"there is no guardian: no chassis at 127\.0\.0\.1"):
            guardian.arm()


@pytest.mark.parametrize("comes", ["ready", "its end"])
def test_whoever_waits_is_told_at_once(process: Process, clock: Clock, comes: str) -> None:
    guardian = Guardian(Target("file", "output.txt"))
    waiting = in_background(lambda: guardian.wait(HANGS))
    until(lambda: guardian._told._waiters)  # type: ignore[attr-defined]
    if comes == "ready":
        process.say("ready")
        waiting.result(HANGS / 9.0)  # on whatever machine long before the wait would end
    else:
        process.end()
        with pytest.raises(IpmclabError, match="there is no guardian: it has ended"):
            waiting.result(HANGS / 9.0)
    guardian.close()


def test_it_is_started_with_what_it_guards_and_where_it_writes(process: Process, clock: Clock, tmp_path: Path) -> None:
    target, log, status = Target("file", "output.txt"), tmp_path / "guardian.log", tmp_path / "status"
    with Guardian(target, log=log, status=str(status)) as guardian:
        files = (target.to_json(), str(log), str(status))
        assert process.command == python_child("ipmclab.rig.safety.guardian_process", *files)
        # Each word goes out as it is said; what ends the recorder's group or console does not end its guardian.
        assert process.how == {"stdin": -1, "stdout": -1, "bufsize": 0, **detached()}
        assert (guardian.status, guardian.pid) == (status, process.pid)


def test_unless_it_is_told_otherwise_it_writes_nothing_and_acts_after_half_a_second(
    process: Process, clock: Clock
) -> None:
    with Guardian(Target("file", "output.txt")) as guardian:
        assert process.command[-2:] == ["", ""]
        assert guardian.status is None
        process.say("ready")
        guardian.arm()
        assert process.heard == ["arm 0.5"]


def test_one_that_is_let_go_of_while_it_is_armed_is_heard_to_its_end(
    threads_of: Started, guardian: Guardian, process: Process, clock: Clock
) -> None:
    guardian.arm()
    [beating], [listener] = threads_of("heartbeat"), threads_of("guardian")
    assert listener.daemon
    guardian.close()
    assert guardian.outcome == "zero"
    assert process.stdout.closed
    assert process.waited == [6.0]
    assert has_ended(beating)
    assert has_ended(listener)
    guardian.close()  # a second time is no error


def test_one_that_still_tries_is_not_waited_for_but_its_end_is_taken_note_of(
    threads_of: Started, process: Process, clock: Clock
) -> None:
    process.ends = False
    with Guardian(Target("file", "output.txt"), silence=1.0) as guardian:
        process.say("ready")
        guardian.arm()
    [taking_note] = threads_of("guardian's end")
    assert taking_note.daemon
    process.say("acted the recorder is gone", "failed the output could not be brought to 0 V")
    until(lambda: guardian.outcome or process.stdout.closed)
    assert not process.stdout.closed
    process.end()
    assert has_ended(taking_note)
    assert process.stdout.closed
    assert process.waited == [6.0, None]


def test_a_thread_is_late_by_what_it_wakes_too_late(clock: Clock) -> None:
    lateness = Lateness(0.1)
    assert lateness.at(clock.now) == 0.0  # it does not wait yet
    lateness.begin()
    assert lateness.at(clock.now + 0.5) == pytest.approx(0.4)
    clock.now += 1.0
    lateness.woke()
    assert lateness.at(clock.now) == pytest.approx(0.9)
    asked = clock.now
    clock.now += 3.1
    lateness.woke()
    lateness.forget(asked)  # by a thread that was stopped after it had looked at the clock
    assert lateness.at(clock.now) == pytest.approx(3.0)
    lateness.forget(clock.now)
    assert lateness.at(clock.now) == 0.0
    lateness.end()
    assert lateness.at(1e9) == 0.0
