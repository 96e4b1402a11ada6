"""Engines: the same answer from this process, from processes that die, and in any order of completion."""

from __future__ import annotations

import multiprocessing
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import (
    InputError,
    IpmclabError,
    Run,
    Sample,
    bootstrap,
    choose,
    identify,
    load_actuator,
    sample_posterior,
    simulate,
)
from ipmclab.engine import Here, Pace, in_order, opened
from ipmclab.engine import processes as engine_processes
from ipmclab.engine.processes import processes, share
from ipmclab.platform import PROCESSORS, processors
from ipmclab.workflows.many_strips import Asked, by_strip, fit_strips
from tests.engine import tasks
from tests.engine.awkward import Awkward

STRIP = load_actuator("friend-2")
CLEAN = simulate(STRIP, "step 1 V", duration=10, rate=10)


def noisy(seed: int, strip: str = "") -> Run:
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(CLEAN))
    run = Run.from_arrays(time=CLEAN.time, voltage=CLEAN.voltage, current=CLEAN.current + noise)
    return replace(run, metadata=replace(run.metadata, sample=Sample(strip))) if strip else run


def test_processes_that_die_are_replaced_and_their_tasks_done_again(tmp_path: Path) -> None:
    with processes(2) as engine:
        assert in_order(engine, tasks.dies_once, str(tmp_path), range(12)) == [number**2 for number in range(12)]
        with pytest.raises(InputError, match="exponent -1: it is below 0; give 0 or more"):
            list(engine.map(tasks.power, 2, [3, -1]))
        assert in_order(engine, tasks.power, 2, range(5)) == [1, 2, 4, 8, 16]  # and it goes on after an error
        assert in_order(engine, tasks.power, 3, iter([2, 0]), 2) == [9, 1]
        assert in_order(engine, tasks.processors_there, None, [0]) == [max(1, processors() // 2)]
        # A program that ends without closing them takes them along.
        assert [worker.daemon for worker in multiprocessing.active_children()] == [True, True]
        with pytest.raises(RuntimeError, match="cannot travel"):
            list(engine.map(tasks.no_way_back, None, [0]))
        with pytest.raises(InputError, match="4 workers died over the same task, the last with exit status 7"):
            list(engine.map(tasks.dies, 7, [0]))


def test_who_takes_no_more_results_ends_the_work() -> None:
    with processes(1) as engine:
        found = engine.map(tasks.power, 2, range(1000))
        assert next(found) == (0, 1)
        found.close()
        assert in_order(engine, tasks.power, 2, [5]) == [32]


def test_what_is_asked_for_wrongly_is_said() -> None:
    for asked, message in (
        ({"workers": 0}, "0 workers on this machine"),
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:1"}, "--scheduler or --workers, not both"),
    ):
        with pytest.raises(InputError, match=message), opened(**asked):
            pass
    with opened() as engine:
        assert isinstance(engine, Here)


def test_errors_travel_as_they_are() -> None:
    for error in (InputError("a", code="b", where="c", repair="d"), IpmclabError("a", code="b")):
        back = pickle.loads(pickle.dumps(error))
        assert type(back) is type(error)
        assert (str(back), back.as_dict()) == (str(error), error.as_dict())


def test_how_many_processors_there_are_can_be_told(monkeypatch: pytest.MonkeyPatch) -> None:
    every = processors()
    for told, expected in (("1", 1), ("0", 1), ("9999", every), ("many", every), ("", every)):
        monkeypatch.setenv(PROCESSORS, told)
        assert processors() == expected


def test_workers_share_the_processors_and_none_goes_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine_processes, "processors", lambda: 8)
    assert [share(workers) for workers in (1, 3, 4, 8, 9, 1000)] == [8, 2, 2, 1, 1, 1]


def test_chunks_last_as_long_as_the_overhead_of_so_many_workers_asks() -> None:
    pace = Pace(first=64, most=50_000)
    assert pace.size(10**9, 1000) == 64
    pace.learn(64, 0.064)
    assert pace.size(10**9, 1000) == 15_000  # 15 s: what one client hands out to 1,000 workers at a tenth of its time
    assert pace.size(10**9, 4) == 1000
    assert pace.size(2_000_000, 1000) == 1000  # the last chunks are short, so that workers end together
    for _ in range(20):
        pace.learn(1000, 1e-3)
    assert pace.size(10**9, 1000) == 50_000
    assert pace.size(1, 0) == 1


@pytest.fixture(scope="module")
def fit():
    return identify(STRIP, [noisy(1)], free="circuit.dc_resistivity")


def test_a_bootstrap_is_the_same_in_any_order(fit) -> None:
    one, other = bootstrap(fit, 40), bootstrap(fit, 40, engine=Awkward())
    for name, values in one.samples.items():
        assert np.array_equal(values, other.samples[name])
    assert one.intervals == other.intervals


def test_a_posterior_is_the_same_in_any_order(fit) -> None:
    one, other = sample_posterior(fit), sample_posterior(fit, engine=Awkward())
    assert np.array_equal(one.log_density, other.log_density)
    for name, values in one.samples.items():
        assert np.array_equal(values, other.samples[name])
    assert (one.accepted, one.steps) == (other.accepted, other.steps)


def test_a_choice_is_the_same_in_any_order() -> None:
    said: list[tuple[int, int]] = []
    one = choose(noisy(1), "branches=1,2", actuator="friend-2", folds=2, blocks=6)
    other = choose(
        noisy(1), "branches=1,2", actuator="friend-2", folds=2, blocks=6, engine=Awkward(),
        progress=lambda what, done, count: said.append((done, count)),
    )  # fmt: skip
    assert one.as_dict() == other.as_dict()
    assert said == [(done, 6) for done in range(6)]


def test_each_strip_has_its_own_fit_in_any_order() -> None:
    runs = [noisy(seed, strip) for seed, strip in ((1, "A"), (2, "B"), (3, "A"), (4, "C"))]
    strips: dict[str, list[Run]] = by_strip(runs)
    assert {name: len(its) for name, its in strips.items()} == {"A": 2, "B": 1, "C": 1}
    strips["twice"] = [runs[0], runs[0]]
    asked = Asked(STRIP, free=["circuit.dc_resistivity"])
    one, other = dict(fit_strips(strips, asked)), dict(fit_strips(strips, asked, engine=Awkward()))
    assert list(one) != list(other)
    assert str(one["twice"]) == str(other["twice"])
    for name in "ABC":
        assert one[name].parameters == other[name].parameters
        assert one[name].findings == other[name].findings
    with pytest.raises(InputError, match="does not say which strip"):
        by_strip([noisy(5)])
