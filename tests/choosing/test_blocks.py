"""Blocks: all rows, each once, and the transient is not all in one of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.choosing.blocks import boundaries, run_blocks, time_blocks
from ipmclab.identification.problem.record import PreparedRun, prepare
from ipmclab.run import Run

SEED = 20261121


def record(rows: int, missing: float, place: int = 0) -> PreparedRun:
    """A current that decays after a step, some readings missing."""
    generator = np.random.default_rng([SEED, rows])
    time = np.arange(rows) * 0.02
    current = 0.06 * np.exp(-time / 0.1) + 1e-4 * generator.standard_normal(rows)
    current[generator.uniform(size=rows) < missing] = np.nan
    run = Run.from_arrays(time=time, voltage=np.ones(rows), current=current)
    return prepare(run, place, ["current"], [])


@given(rows=st.integers(20, 500), missing=st.floats(0.0, 0.8), count=st.integers(2, 40))
def test_blocks_are_all_rows_and_each_has_a_reading(rows: int, missing: float, count: int) -> None:
    one = record(rows, missing)
    edges = boundaries(one, count)
    assert edges[0] == 0
    assert edges[-1] == rows
    assert len(edges) <= count + 1
    assert all(a < b for a, b in pairwise(edges))
    if one.readings["current"].exact.any():
        assert all(one.readings["current"].exact[a:b].any() for a, b in pairwise(edges))


def test_the_transient_has_blocks_of_its_own() -> None:
    """Half of the blocks lie where the current moves, though that is a fortieth of the record."""
    edges = boundaries(record(1000, 0.0), 24)
    assert 10 <= sum(edge <= 25 for edge in edges) <= 14


def still(rows: int, place: int = 0, step: int | None = None, **channels: np.ndarray) -> PreparedRun:
    """A record in which nothing but noise moves; the voltage at one row, where that is given."""
    noise = 1e-4 * np.random.default_rng(SEED).uniform(-1.0, 1.0, rows)  # never a step of four deviations
    voltage = np.zeros(rows) if step is None else np.where(np.arange(rows) < step, 0.0, 1.0)
    run = Run.from_arrays(time=0.02 * np.arange(rows), voltage=voltage, **(channels or {"current": noise}))
    return prepare(run, place, list(channels) or ["current"], [])


def test_one_jump_is_one_event_and_leaves_the_transient_after_it_its_blocks() -> None:
    time = 0.02 * np.arange(1000)
    after = np.where(time < 2.0, 0.0, 1.0 + 0.06 * np.exp(-(time - 2.0) / 0.1))
    edges = boundaries(
        still(1000, step=100, current=after + 1e-4 * np.random.default_rng(SEED).standard_normal(1000)), 24
    )
    assert sum(101 < edge <= 125 for edge in edges) >= 6


def test_each_octave_of_time_since_an_edge_has_as_many_blocks() -> None:
    """A voltage that steps at row 100, a current of noise alone: half by rows, half by their logarithm."""
    edges = np.array(boundaries(still(1100, step=100), 40))
    after = edges[edges > 100] - 100
    within = [int(np.count_nonzero((after > 10.0**k) & (after <= 10.0 ** (k + 1)))) for k in range(3)]
    # Of the twenty blocks by logarithm a decade has about a third, of the twenty by rows its part of them.
    whole = np.cumsum(1.0 / np.arange(1, 1001))
    for k, count in enumerate(within):
        of_time = whole[10 ** (k + 1) - 1] - whole[10**k - 1]
        assert count == pytest.approx(20 * of_time / whole[-1] + 20 * 9 * 10**k / 1100, abs=1.5)


def test_a_row_counts_where_any_output_has_a_reading() -> None:
    first = np.arange(240) < 120
    noise = 1e-4 * np.random.default_rng(SEED).uniform(-1.0, 1.0, 240)
    current, displacement = np.where(first, noise, np.nan), np.where(first, np.nan, noise)
    assert boundaries(still(240, current=current, displacement=displacement), 24) == list(range(0, 241, 10))


@pytest.mark.parametrize(
    ("runs", "count", "folds", "of_time", "of_runs"),
    [(1, 24, 6, 24, 24), (3, 24, 2, 8, 8), (5, 24, 2, 5, 5), (3, 12, 6, 12, 4), (10, 24, 2, 4, 4)],
)
def test_every_run_has_its_part_of_as_many_blocks_as_were_asked_for(
    runs: int, count: int, folds: int, of_time: int, of_runs: int
) -> None:
    """Never fewer than asked; of blocks in time each run has two in every fold, of whole runs four."""
    records = [still(240, place) for place in range(runs)]
    for cut, each in ((time_blocks, of_time), (run_blocks, of_runs)):
        blocks = cut(records, count, folds)
        assert [sum(block.run == place for block in blocks) for place in range(runs)] == [each] * runs


@pytest.mark.parametrize("runs", [2, 3, 7])
def test_whole_runs_are_held_out_together(runs: int) -> None:
    records = [record(200, 0.0, place) for place in range(runs)]
    blocks = run_blocks(records, 24, min(runs, 6))
    folds = {place: {block.fold for block in blocks if block.run == place} for place in range(runs)}
    assert all(len(found) == 1 for found in folds.values())
    assert len({fold for found in folds.values() for fold in found}) == min(runs, 6)


def test_neighbours_are_not_held_out_together() -> None:
    blocks = time_blocks([record(1000, 0.0)], 24, 6)
    assert {block.fold for block in blocks} == set(range(6))
    assert all(a.fold != b.fold for a, b in pairwise(blocks))
