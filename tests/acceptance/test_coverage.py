"""Intervals hold the truth in 95 of 100 trials, under the noises that measurements have.

The long runs are ``benchmarks.trust`` (2,000 trials of each noise) and ``benchmarks.richer`` (500 of each stage); these
are their small twins.
"""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
import pytest

from benchmarks import richer, trust
from tests.identification.brief import brief

TRIALS = 40
"""Of each noise."""

LEAST = 82.5
"""33 of 40: an interval that holds the truth in 95 of 100 trials does so less often in 7 of 10,000 such tests."""

RICHER = {
    "relaxation in a pair": 1,
    "leak, exponential and slow": 1,
    "line of 6 segments that leak": 1,
    "relaxation of both": 1,
    "relaxation of the displacement": 2,
    "leak, exponential": 3,
    "leak, Butler-Volmer": 3,
    "viscoelastic modulus": 5,
    "line of 6 modes": 5,
    "clamped section": 6,
    "leak, cubic": 6,
    "three branches": 6,
}
"""Trials of each stage, forty together; few of those that are fitted slowly."""


@pytest.fixture(scope="module")
def circuit() -> dict[str, trust.Tally]:
    """The trials of the circuit under each noise."""
    return {noise: trust.run_trials("circuit", noise, TRIALS, identify=brief) for noise in trust.NOISES}


@pytest.mark.parametrize("noise", trust.NOISES)
def test_intervals_of_the_circuit(noise: str, circuit: dict[str, trust.Tally]) -> None:
    tally = circuit[noise]
    assert len(tally.inside) == TRIALS
    assert tally.sharp.all()
    assert tally.misses(noise, LEAST, 100.0) == []
    if noise == "white":
        assert tally.naively_covered.mean() > 90.5
    else:
        # Ordinary least squares that counts its residuals as white.
        assert tally.naively_covered.max() < 90.5


def test_intervals_of_the_circuit_under_all_noises(circuit: dict[str, trust.Tally]) -> None:
    """All trials together: each of the two bounds of one parameter is missed by chance in less than 3 of 10,000."""
    covered = reduce(add, circuit.values()).covered
    assert 87.5 <= covered.min() <= covered.max() < 100.0
    assert 90.5 < covered.mean() < 98.5


def test_intervals_of_the_richer_stages() -> None:
    """Forty trials, the parameters of all stages taken together."""
    assert set(RICHER) == set(richer.CASES)
    assert sum(RICHER.values()) == 40
    tallies = {name: richer.run_trials(name, trials, identify=brief) for name, trials in RICHER.items()}
    determined = np.concatenate([np.ravel(tally.determined) for tally in tallies.values()])
    inside = np.concatenate([np.ravel(tally.inside) for tally in tallies.values()])
    sharp = np.concatenate([np.ravel(np.array(tally.determined)[:, tally.sharp]) for tally in tallies.values()])
    assert 90.5 < 100.0 * inside[determined].mean() < 98.5
    assert len(sharp) > 0.9 * len(determined)
    assert sharp.mean() >= 0.95
    for name, tally in tallies.items():
        if RICHER[name] >= 5:
            assert tally.widths.max() < 1.3, name
