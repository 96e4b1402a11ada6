"""A line that has lost its place is listened to: a program that was held up has not listened meanwhile."""

from __future__ import annotations

import pytest

from ipmclab.rig.chambers import deadline, line, registers
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.dialogue import Dialogue
from ipmclab.rig.chambers.line import Line
from ipmclab.rig.chambers.registers import Registers


class Clock:
    """The time of the program, which stands still once, for a second, from so many looks on."""

    def __init__(self, held_up_at: int) -> None:
        self.now, self.looks, self._held_up_at = 100.0, 0, held_up_at

    def rules(self, patch: pytest.MonkeyPatch) -> None:
        """From now on it is the time of every line."""
        for module in (line, registers, deadline):
            patch.setattr(module, "time", self)

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.looks += 1
        self.now += 1.0 if self.looks == self._held_up_at else seconds


class Port(Line):
    """A serial port and a text line at which a late answer comes after so many looks."""

    def __init__(self, clock: Clock, comes_at: int) -> None:
        super().__init__("a chamber")
        self._clock, self._comes_at = clock, comes_at
        self.thrown_away = b""

    @property
    def in_waiting(self) -> int:
        return 0 if self._clock.looks < self._comes_at or self.thrown_away else 4

    def read(self, size: int) -> bytes:
        self.thrown_away = b"late"[:size]
        return self.thrown_away

    def _receive(self, deadline: Deadline) -> bytes:
        self._clock.sleep(deadline.left)
        return self.read(4) if self.in_waiting else b""

    def drop(self) -> None: ...

    def _open(self, deadline: Deadline) -> None: ...

    def _send(self, what: bytes, deadline: Deadline) -> None: ...


def listen(kind: str, port: Port) -> None:
    """Until it was quiet for half a second, or six are over."""
    if kind == "text":
        port.quieten(0.5, Deadline(6.0))
    else:
        Registers("a chamber", lambda _: port)._quieten(port, 0.5, Deadline(6.0))


@pytest.mark.parametrize("comes_after", [0, 1, 50])
@pytest.mark.parametrize("kind", ["registers", "text"])
def test_what_came_while_the_program_was_held_up_is_no_answer_to_the_next_question(
    monkeypatch: pytest.MonkeyPatch, kind: str, comes_after: int
) -> None:
    clock = Clock(held_up_at=10)
    port = Port(clock, comes_at=10 + comes_after)
    clock.rules(monkeypatch)
    listen(kind, port)
    assert port.thrown_away == b"late"
    quiet = clock.looks - 10 - comes_after
    assert 0.5 - 1e-9 <= quiet * line.LOOK <= 0.6


@pytest.mark.parametrize("kind", ["registers", "text"])
def test_a_line_that_never_falls_quiet_is_left_at_the_deadline(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    clock = Clock(held_up_at=-1)
    port = Port(clock, comes_at=0)
    port.read = lambda size: b"more"[:size]  # type: ignore[method-assign]
    clock.rules(monkeypatch)
    listen(kind, port)
    assert clock.now == pytest.approx(106.0, abs=0.02)


def test_a_text_line_that_was_not_listened_to_stays_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pause longer than all the time for listening: the next answer would be that to an earlier question."""
    clock = Clock(held_up_at=3)
    port = Port(clock, comes_at=5)
    clock.rules(monkeypatch)
    dialogue = Dialogue(port, 0.3)
    dialogue._lost = True
    asked: list[str] = []

    def ask(question: str, deadline: Deadline) -> str:
        assert port.thrown_away == b"late"
        asked.append(question)
        return "23.0"

    monkeypatch.setattr(port, "ask", ask)
    assert dialogue.ask("TEMP?", float, Deadline(6.0)) == 23.0
    assert asked == ["TEMP?"]
