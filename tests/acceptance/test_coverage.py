"""Intervals hold the truth in 95 of 100 trials, under the noises that measurements have.

The long runs are ``benchmarks.trust`` (2,000 trials of each noise) and ``benchmarks.recovery`` (each richer model).
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import pytest

from benchmarks import recovery, trust

SEED = 20261121
PARTS = 2
TRIALS = 400

RICHER = {
    "leak, cubic": 24,
    "clamped section": 22,
    "line of 6 modes": 22,
    "viscoelastic modulus": 16,
    "leak, exponential": 8,
    "relaxation of the displacement": 8,
}
"""Trials of each model that is fitted fast enough: a hundred together."""


@pytest.fixture(scope="module")
def workers() -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(PARTS, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


@pytest.mark.parametrize("noise", trust.NOISES)
def test_intervals_of_the_circuit(noise: str, workers: ProcessPoolExecutor) -> None:
    every = [workers.submit(trust.run_trials, "circuit", noise, TRIALS // PARTS, part) for part in range(PARTS)]
    tally = sum((one.result() for one in every[1:]), every[0].result())
    assert len(tally.inside) == TRIALS
    assert tally.sharp.all()
    assert tally.misses(90.5, 98.5) == []
    if noise == "white":
        assert tally.naively_covered.min() > 90.5
    else:
        # Ordinary least squares that counts its residuals as white.
        assert tally.naively_covered.max() < 90.5


def test_intervals_of_the_richer_stages(workers: ProcessPoolExecutor) -> None:
    """A hundred trials, all parameters that are called determined taken together."""
    # The longest first, so that both workers end together.
    tasks = [
        workers.submit(recovery.recover, recovery.CASES[name], trials // PARTS, (SEED, part))
        for name, trials in reversed(RICHER.items())
        for part in range(PARTS)
    ]
    every = [task.result() for task in tasks]
    assert sum(tally.trials for tally in every) == sum(RICHER.values()) == 100
    determined = sum(tally.determined for tally in every)
    assert determined > 0.75 * sum(tally.counted for tally in every)
    assert 90.5 < 100.0 * sum(tally.inside_determined for tally in every) / determined < 98.5
