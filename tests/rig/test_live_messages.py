"""What a run tells while it is recorded, with a clock that stands where the test puts it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from ipmclab.rig.experiments import live as live_module
from ipmclab.rig.experiments.live import Live
from ipmclab.rig.experiments.steps import Question
from ipmclab.rig.process.messages import Message
from ipmclab.rig.recording.keeping import Rows
from ipmclab.rig.recording.slow import Air
from ipmclab.run import Mark


class Desk:
    """Somebody who is told."""

    def __init__(self) -> None:
        self.told: list[Message] = []

    def tell(self, message: Message) -> None:
        self.told.append(message)

    def ask(self, question: Question, ended: object) -> str:
        raise AssertionError(question)

    @property
    def last(self) -> tuple[str, dict[str, object]]:
        return self.told[-1].kind, dict(self.told[-1].values)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    clock = SimpleNamespace(now=1000.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(live_module, "time", clock)
    return clock


def block(first: int, rows: int) -> Rows:
    volts = np.ones(rows)
    return Rows(first, {"voltage": volts, "current": 1e-3 * volts}, {}, {"output": volts})


def test_each_block_is_told_and_how_far_the_run_came_five_times_a_second(clock: SimpleNamespace) -> None:
    desk = Desk()
    live = Live(desk, 500)
    for place in range(101):
        live.block(block(10 * place, 10))
        clock.now += 0.01
    blocks = [one for one in desk.told if one.kind == "block"]
    assert [one.values["first_row"] for one in blocks] == [10 * place for place in range(101)]
    assert sorted(blocks[0].arrays) == ["current", "voltage"]
    told = [one.values for one in desk.told if one.kind == "progress"]
    assert told[0] == {"rows": 10, "acknowledged": 0, "of": 500}
    assert len(told) == pytest.approx(1.0 / 0.2, abs=1)
    assert [one["rows"] for one in told] == sorted({one["rows"] for one in told})


def test_rows_on_the_disk_are_told_at_once(clock: SimpleNamespace) -> None:
    desk = Desk()
    live = Live(desk, 500)
    live.block(block(20, 10))
    live.committed(25)
    assert desk.last == ("progress", {"rows": 30, "acknowledged": 25, "of": 500})
    live.committed(30)
    assert desk.last == ("progress", {"rows": 30, "acknowledged": 30, "of": 500})


def test_a_mark_is_told_and_an_ending_with_the_rows_that_the_run_will_have(clock: SimpleNamespace) -> None:
    desk = Desk()
    live = Live(desk, 500)
    live.mark(Mark(1.5, "knocked", "note"))
    assert desk.told == [Message("event", {"event": "note", "time": 1.5, "text": "knocked"})]
    live.ends(Mark(2.0, "too hot", "limit"), "limit", 120)
    event, progress = desk.told[1:]
    assert dict(event.values) == {"event": "limit", "time": 2.0, "text": "too hot", "ending": "limit"}
    assert dict(progress.values) == {"rows": 0, "acknowledged": 0, "of": 120}


def test_the_air_is_told_where_it_was_read(clock: SimpleNamespace) -> None:
    desk = Desk()
    live = Live(desk, 500)
    live.air(Air(12.0, {"temperature": 21.5, "relative_humidity": math.nan}))
    assert desk.last == ("air", {"time": 12.0, "temperature": 21.5})
