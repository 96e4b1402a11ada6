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
    assert sum(edge <= 25 for edge in edges) >= 6


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
