"""Walkers find what is known in closed form, and are not believed where they disagree."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy.signal import lfilter

from ipmclab.posterior.convergence import judge
from ipmclab.posterior.coordinates import Straight
from ipmclab.posterior.packages import bayes_package
from ipmclab.posterior.sampling import sample, snooker_move

Array = npt.NDArray[np.float64]
MIDDLE = np.array([1.0, -2.0, 30.0])
SCATTER = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.2], [0.0, 0.2, 9.0]])


def normal(vectors: Array) -> Array:
    away = np.linalg.solve(np.linalg.cholesky(SCATTER), (vectors - MIDDLE).T)
    return np.asarray(-0.5 * (away * away).sum(axis=0))


def test_a_normal_density_is_found_from_a_bad_guess_of_it() -> None:
    """Within four standard errors of Monte-Carlo, from a middle and a scatter that are both wrong."""
    chains = sample(
        normal, Straight(MIDDLE + 1.0, np.diag([2.0, 0.5, 1.0])), ["a", "b", "c"], seed=20261121, steps=4000
    )
    assert chains.judgement.agrees
    points = chains.vectors.reshape(-1, 3)
    size = np.array([one.bulk for one in chains.judgement.of.values()])
    deviation = np.sqrt(SCATTER.diagonal())
    assert (np.abs(points.mean(axis=0) - MIDDLE) < 4.0 * deviation / np.sqrt(size)).all()
    found = np.cov(points.T) / np.outer(deviation, deviation)
    assert found == pytest.approx(SCATTER / np.outer(deviation, deviation), abs=4.0 * np.sqrt(2.0 / size.min()))
    assert (np.diff([one.r_hat for one in chains.judgement.of.values()]) < 0.01).all()


@pytest.mark.parametrize(("size", "deviation"), [(1, 1.0), (3, 0.1), (5, 1.0)])
def test_the_snooker_update_leaves_a_normal_density_as_it_is(size: int, deviation: float) -> None:
    """That of emcee alone finds 1.04, 0.63 and 0.84 of the deviation."""
    emcee, random = bayes_package("emcee"), np.random.RandomState(20261128)

    def density(vectors: Array) -> Array:
        return -0.5 * ((vectors / deviation) ** 2).sum(axis=1)

    sampler = emcee.EnsembleSampler(40, size, density, moves=[(snooker_move(), 1.0)], vectorize=True)
    sampler.run_mcmc(emcee.State(deviation * random.standard_normal((40, size)), random_state=random.get_state()), 3000)
    found = sampler.get_chain(discard=300, flat=True)
    assert found.std(axis=0) / deviation == pytest.approx(np.ones(size), abs=0.03)


def test_the_same_seed_gives_the_same_samples() -> None:
    straight = Straight(MIDDLE, np.linalg.cholesky(SCATTER))
    one, same, other = (sample(normal, straight, ["a"], seed=seed, steps=400).vectors for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


def test_chains_that_do_not_agree_are_told() -> None:
    """A long thin bow (Haario's banana, bent ten times more than it is thick) needs more than these steps.

    They are enough for what is as long and as thin without its bend.
    """

    def density(bend: float) -> Callable[[Array], Array]:
        def of(vectors: Array) -> Array:
            along, across = vectors.T
            return -0.5 * ((along / 30.0) ** 2 + ((across - bend * (along**2 - 900.0)) / 0.1) ** 2)

        return of

    straight = Straight(np.array([0.0, 0.0]), np.diag([1.0, 1.0]))
    level = sample(density(0.0), straight, ["along", "across"], seed=20261121, steps=600).judgement
    assert level.agrees, level.complaints
    straight = Straight(np.array([0.0, -270.0]), np.diag([1.0, 1.0]))
    bent = sample(density(0.3), straight, ["along", "across"], seed=20261121, steps=600).judgement
    assert not bent.agrees
    for word in ("R-hat of", "effective samples (", "effective samples in the tails", "autocorrelation times of"):
        assert any(word in text for text in bent.complaints), word


@pytest.mark.parametrize("count", [1, 2])
def test_walkers_that_begin_where_nothing_is_possible_are_told_by_the_chains_alone(count: int) -> None:
    """emcee warned of each comparison of two impossible places, on the terminal of its user."""

    def narrow(vectors: Array) -> Array:
        return np.where(np.abs(vectors).max(axis=1) < 3e-6, 0.0, -np.inf)

    names = ["a", "b"][:count]
    found = sample(narrow, Straight(np.zeros(count), np.eye(count)), names, seed=20261127, steps=400)
    assert not found.judgement.agrees


def test_two_ensembles_in_two_places_do_not_agree_and_neither_does_one_walker_that_is_stuck() -> None:
    generator = np.random.default_rng(20261121)
    chains = generator.standard_normal((20, 500, 1))
    assert judge(chains, ["a"], 2).agrees
    apart = chains + np.where(np.arange(20) < 10, 0.0, 0.5)[:, None, None]
    assert any(text.startswith("R-hat of a is 1.0") for text in judge(apart, ["a"], 2).complaints)
    stuck = chains.copy()
    stuck[3] = 4.0 + 1e-3 * stuck[3]
    assert not judge(stuck, ["a"], 2).agrees


@pytest.mark.parametrize(("lengths", "complaints"), [(25, 1), (150, 0)])
def test_chains_are_fifty_autocorrelation_times_long(lengths: int, complaints: int) -> None:
    """Of a walk that keeps 0.8 of the last step the time is (1 + 0.8)/(1 - 0.8) = 9 steps; all else holds here."""
    generator = np.random.default_rng(20261121)
    chains = lfilter([0.6], [1.0, -0.8], generator.standard_normal((400, 9 * lengths + 100)), axis=1)[:, 100:, None]
    found = judge(chains, ["a"], 2)
    assert found.lengths == pytest.approx(lengths, rel=0.5)  # of few of them the time is found too short
    assert ["autocorrelation times" in text for text in found.complaints] == [True] * complaints
