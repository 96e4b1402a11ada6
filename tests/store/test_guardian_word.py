"""What a guardian wrote of the output: it is read as it stands, and waited for where it may still come."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from ipmclab.store.journal import guardian_word
from ipmclab.store.journal.guardian_word import Word, read_word


class Clock(SimpleNamespace):
    """Time that goes on only where somebody sleeps; who looks a thousand times without sleep waits for ever."""

    def __init__(self, now: float) -> None:
        self.now, self.looks, self.slept = now, 0, 0

    def time(self) -> float:
        self.looks += 1
        assert self.looks < 1000, "it waits without sleep"
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept += 1
        self.now += 0.5


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock(1000.0)
    monkeypatch.setattr(guardian_word, "time", made)
    return made


def saying(folder: Path, state: str) -> Path:
    word = folder / "a.guardian"
    word.write_text(json.dumps({"state": state, "text": "", "time": 1.0}))
    return word


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ('{"state": "zero", "text": "it is gone", "time": 7.5}', Word("zero", "it is gone", 7.5)),
        ('{"state": "failed", "text": "no answer"}', Word("failed", "no answer", 0.0)),  # believed without its time
        (None, Word("", "", 0.0)),
    ],
)
def test_a_word_is_read_as_it_was_written(tmp_path: Path, content: str | None, word: Word) -> None:
    file = tmp_path / "a.guardian"
    if content is not None:
        file.write_text(content)
    assert read_word(file) == word


@pytest.mark.parametrize("content", ["", '{"state": "ze', "[]", '{"text": "", "time": 1.0}', '{"state": "zero"}'])
def test_what_is_no_word_never_says_that_the_output_is_at_0_v(tmp_path: Path, content: str) -> None:
    file = tmp_path / "a.guardian"
    file.write_text(content)
    found = read_word(file)
    assert (found.state, found.time) == ("unknown", 0.0)
    assert str(found) == "its guardian never said that the output is at 0 V"


def test_a_guardian_that_is_about_to_act_is_waited_for(tmp_path: Path) -> None:
    word = saying(tmp_path, "armed")
    threading.Timer(0.3, lambda: saying(tmp_path, "zero")).start()
    assert read_word(word, since=time.time()).state == "zero"


@pytest.mark.parametrize("state", ["armed", "unknown"])
def test_a_guardian_that_says_no_more_is_waited_for_for_six_seconds(tmp_path: Path, clock: Clock, state: str) -> None:
    """Six seconds after its recorder's last row are over only when more than six are."""
    word = saying(tmp_path, state)
    assert read_word(word, since=1000.0).state == state
    assert clock.now == 1006.5
    assert read_word(word, since=900.0).state == state  # its recorder wrote long ago: at once
    assert clock.now == 1006.5


@pytest.mark.parametrize("state", ["zero", "disarmed", "unread", "failed"])
def test_a_guardian_that_has_acted_is_not_waited_for(tmp_path: Path, clock: Clock, state: str) -> None:
    assert read_word(saying(tmp_path, state), since=1000.0).state == state
    assert clock.slept == 0


def test_who_only_looks_waits_for_nobody(tmp_path: Path, clock: Clock) -> None:
    clock.now = 0.0  # a computer whose clock was never set
    assert read_word(saying(tmp_path, "armed")).state == "armed"
    assert clock.slept == 0
