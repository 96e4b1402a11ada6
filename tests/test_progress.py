"""What a long fit tells, and how it is ended."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.progress import aside, part, reporting_to, stage, tick, unreported


class Stopped(Exception):
    pass


@pytest.fixture(scope="module")
def noisy() -> Run:
    actuator = load_actuator("friend-2")
    run = simulate(actuator, "step 1 V", duration=20, rate=50)
    noise = np.random.default_rng(20261121).normal(0.0, 2e-4, len(run.time))
    assert run.current is not None
    return Run.from_arrays(time=run.time, voltage=run.voltage, current=run.current + noise)


def test_a_fit_tells_its_stages_and_a_fraction_that_only_grows(noisy: Run) -> None:
    told: list[tuple[str, float]] = []
    fit = identify(load_actuator("friend-2"), noisy, progress=lambda *one: told.append(one))
    fractions = [fraction for _, fraction in told]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
    sentences = list(dict.fromkeys(sentence for sentence, _ in told))
    assert sentences[0] == "reading the runs"
    assert any(sentence.startswith("searching from start 1 of ") for sentence in sentences)
    assert sentences[-1] == "errors and intervals"
    silent = identify(load_actuator("friend-2"), noisy)
    assert {name: one.value for name, one in silent.parameters.items()} == {
        name: one.value for name, one in fit.parameters.items()
    }


@pytest.mark.parametrize("after", [1, 2, 4, 6])
def test_what_the_function_raises_ends_the_fit_and_reaches_the_caller(noisy: Run, after: int) -> None:
    told: list[str] = []

    def stop(sentence: str, _: float) -> None:
        told.append(sentence)
        if len(told) == after:
            raise Stopped(sentence)

    with pytest.raises(Stopped):
        identify(load_actuator("friend-2"), noisy, progress=stop)
    assert len(told) == after
    tick()  # nobody is told any more


def test_what_was_ended_stays_ended_even_if_somebody_caught_it() -> None:
    def stop(sentence: str, _: float) -> None:
        raise Stopped(sentence)

    with reporting_to(stop):
        with pytest.raises(Stopped):
            stage("searching", 0.0, 1.0)
        with pytest.raises(Stopped):
            tick()


def test_a_part_stays_within_its_own_share_of_the_whole() -> None:
    told: list[tuple[str, float]] = []
    with reporting_to(lambda *one: told.append(one)):
        with part("without the first run", 0.5, 0.7), reporting_to(None):
            stage("searching", 0.0, 0.5)
            stage("done", 1.0, 1.0)
        stage("at the end", 0.9, 1.0)
    assert told == [
        ("without the first run: searching", 0.5),
        ("without the first run: done", pytest.approx(0.7)),
        ("at the end", 0.9),
    ]


def test_what_is_said_aside_gives_way_to_the_stage_and_ends_nothing_where_it_stands() -> None:
    told: list[str] = []

    def tell(sentence: str, _: float) -> None:
        told.append(sentence)
        if sentence.endswith("compiling") and len(told) > 3:
            raise Stopped

    with reporting_to(tell), part("first", 0.0, 1.0):
        stage("searching", 0.0, 1.0)
        aside("compiling")
        stage("noise", 0.5, 1.0)
        aside("compiling")
        with pytest.raises(Stopped):
            tick()
    assert told == ["first: searching", "first: compiling", "first: noise", "first: compiling"]


def test_what_is_raised_aside_reaches_the_caller_where_no_tick_follows() -> None:
    class Ended(BaseException):
        """As a page ends a job."""

    def tell(sentence: str, _: float) -> None:
        if sentence == "compiling":
            raise Ended

    def work() -> None:
        with reporting_to(tell):
            stage("searching", 0.0, 1.0)
            aside("compiling")

    with pytest.raises(Ended):
        work()


def test_an_interrupt_aside_is_raised_by_the_next_tick_and_where_none_follows_by_nobody() -> None:
    """As who keeps a fit while a kernel is compiled: there nothing can be kept."""

    def tell(sentence: str, _: float) -> None:
        if sentence == "compiling":
            raise KeyboardInterrupt

    with reporting_to(tell):
        stage("searching", 0.0, 1.0)
        aside("compiling")
        with pytest.raises(KeyboardInterrupt):
            tick()
        tick()
        with unreported():
            aside("compiling")
            tick()
            stage("keeping what was found", 0.5, 1.0)


def test_what_is_waited_for_is_said_also_where_nothing_else_is() -> None:
    told: list[str] = []
    with reporting_to(lambda sentence, _: told.append(sentence)), unreported():
        stage("keeping what was found", 0.5, 1.0)
        tick()
        aside("compiling")
    assert told == ["compiling"]


PROGRAM = """
import numba
import numpy as np
from ipmclab.choosing.kernels import filter_covariance
from ipmclab.progress import stage, reporting_to

with reporting_to(lambda sentence, _: print(sentence)):
    stage("searching", 0.0, 1.0)
    numba.njit(lambda x: x)(1.0)  # of the user: nobody waits for the model
    stage("filtering", 0.5, 1.0)
    filter_covariance(np.zeros(3), np.zeros((3, 1)), np.zeros(1), np.eye(1), np.empty(3), np.empty(3))
"""


def test_who_waits_for_the_compiler_is_told(tmp_path: Path) -> None:
    elsewhere = {**os.environ, "IPMCLAB_CACHE": str(tmp_path)}
    first, second = (
        subprocess.run(
            [sys.executable, "-c", PROGRAM], env=elsewhere, capture_output=True, text=True, check=True
        ).stdout.splitlines()
        for _ in range(2)
    )
    assert first[:3] == ["searching", "filtering", "compiling the model, once on this machine"]
    assert second == ["searching", "filtering"]
