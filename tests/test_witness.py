"""The witness that tells a pause of the machine from a slow program."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import pytest

from tests.witness import Witness

LATE = 1.0  # a machine that is only busy wakes a sleeper within this


@pytest.fixture
def witness() -> Iterator[Witness]:
    witness = Witness(LATE)
    time.sleep(0.5)  # until it sleeps
    witness.begin()
    yield witness
    witness.end()


def test_a_busy_program_is_no_pause(witness: Witness) -> None:
    began = time.thread_time()
    while time.thread_time() - began < 1.5 * LATE:
        pass
    assert not witness.saw_a_pause()


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system cannot stop a process")
def test_a_witness_that_could_not_wake_tells_so_until_the_next_beginning(witness: Witness) -> None:
    os.kill(witness.pid, signal.SIGSTOP)
    time.sleep(1.5 * LATE)
    os.kill(witness.pid, signal.SIGCONT)
    assert witness.saw_a_pause()
    witness.begin()
    assert not witness.saw_a_pause()
