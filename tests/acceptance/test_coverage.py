"""Intervals hold the truth in 95 of 100 trials, under the noises that measurements have.

The long runs are ``benchmarks.trust`` (2,000 trials of each noise) and ``benchmarks.richer`` (500 of each stage).
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from benchmarks import richer, trust

SEED = 20261121
PARTS = 2
TRIALS = 400

RICHER = {
    "relaxation in a pair": 2,
    "leak, exponential and slow": 2,
    "line of 6 segments that leak": 2,
    "relaxation of both": 2,
    "relaxation of the displacement": 8,
    "leak, exponential": 8,
    "leak, Butler-Volmer": 8,
    "viscoelastic modulus": 12,
    "line of 6 modes": 14,
    "clamped section": 14,
    "leak, cubic": 14,
    "three branches": 14,
}
"""Trials of each stage, a hundred together; those that are fitted slowly first, so that both workers end together."""


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
    """A hundred trials, the parameters of all stages taken together."""
    assert set(RICHER) == set(richer.CASES)
    assert sum(RICHER.values()) == 100
    tasks = {
        name: [workers.submit(richer.run_trials, name, trials // PARTS, part) for part in range(PARTS)]
        for name, trials in RICHER.items()
    }
    tallies = {name: sum((one.result() for one in every[1:]), every[0].result()) for name, every in tasks.items()}
    determined = np.concatenate([np.ravel(tally.determined) for tally in tallies.values()])
    inside = np.concatenate([np.ravel(tally.inside) for tally in tallies.values()])
    sharp = np.concatenate([np.ravel(np.array(tally.determined)[:, tally.sharp]) for tally in tallies.values()])
    assert 90.5 < 100.0 * inside[determined].mean() < 98.5
    assert len(sharp) > 0.9 * len(determined)
    assert sharp.mean() >= 0.95
    for name, tally in tallies.items():
        if RICHER[name] >= 8:
            assert tally.widths.max() < 1.3, name
