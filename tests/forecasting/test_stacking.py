"""Weights and bands against a general optimiser and against walks whose spread is known."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.forecasting.stacking import Pairs, half_width, weigh

SEED = 20261121


def pairs(seed: int, count: float = 0.02, before: float = 1.0, forecasters: int = 3) -> Pairs:
    """What came is a part of what some said, and noise."""
    generator = np.random.default_rng([SEED, seed])
    lead = generator.choice([1.0, 2.0, 4.0], 200)
    said = lead[:, None] * generator.standard_normal((200, forecasters))
    came = said @ np.array([0.5, 0.3, -0.4, 0.0][:forecasters]) + lead * generator.standard_normal(200)
    return Pairs(lead, count * generator.uniform(0.1, 1.0, 200), said, came, before)


@given(seed=st.integers(0, 50), count=st.sampled_from([1e-4, 0.02, 5.0]), before=st.sampled_from([0.0, 0.5, 4.0]))
def test_the_weights_are_the_best_there_are(seed: int, count: float, before: float) -> None:
    given_pairs = pairs(seed, count, before)

    def loss(weights: np.ndarray) -> float:
        said, came, lead = given_pairs.said, given_pairs.came, given_pairs.lead
        missed = np.sum(given_pairs.count * ((came - said @ weights) / lead) ** 2)
        usual = np.average((said / lead[:, None]) ** 2, axis=0, weights=given_pairs.count)
        return float(missed + before * np.sum(weights**2 * usual))

    found = weigh(given_pairs)
    assert (found >= 0.0).all()
    assert found.sum() <= 1.0 + 1e-6
    best = scipy.optimize.minimize(
        lambda weights: loss(weights) / loss(np.zeros(3)),
        np.full(3, 0.2),
        bounds=[(0.0, 1.0)] * 3,
        constraints={"type": "ineq", "fun": lambda weights: 1.0 - weights.sum()},
        options={"ftol": 1e-12},
    )
    assert loss(found) <= loss(best.x) * (1.0 + 1e-6)


def test_where_little_was_seen_the_last_value_is_held() -> None:
    assert weigh(pairs(1, count=1e-5, before=4.0)).sum() < 0.01
    assert weigh(pairs(1, count=1.0, before=0.0)).sum() > 0.5


def test_forecasters_that_say_nothing_have_no_weight() -> None:
    one = pairs(2)
    silent = Pairs(one.lead, one.count, np.zeros_like(one.said), one.came, one.before)
    assert weigh(silent).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("level", [0.5, 0.8, 0.95])
def test_the_band_of_a_long_record_is_the_quantile_of_its_misses(level: float) -> None:
    # Normal misses that grow as the lead to 3/4, 40000 of them: their quantile is the normal's.
    generator = np.random.default_rng(SEED)
    lead = generator.uniform(1.0, 10.0, 40_000)
    came = 0.3 * lead**0.75 * generator.standard_normal(40_000)
    observed = Pairs(lead, np.ones(40_000), np.zeros((40_000, 1)), came, 0.0)
    half = half_width(observed, np.zeros(1), np.array([2.0, 20.0]), level)
    inside = scipy.stats.norm.ppf(0.5 + 0.5 * level)
    np.testing.assert_allclose(half, 0.3 * np.array([2.0, 20.0]) ** 0.75 * inside, rtol=0.03)


def test_a_band_from_little_is_wider() -> None:
    much, little = (Pairs(one.lead, one.count, one.said, one.came, 0.0) for one in (pairs(3, 5.0), pairs(3, 1e-4)))
    lead = np.array([3.0])
    assert half_width(little, np.zeros(3), lead, 0.8) > 1.15 * half_width(much, np.zeros(3), lead, 0.8)
