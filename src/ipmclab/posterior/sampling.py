"""Markov chains: two ensembles of walkers from apart, until they agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.posterior.convergence import Judgement, judge
from ipmclab.posterior.coordinates import Coordinates
from ipmclab.posterior.packages import bayes_package
from ipmclab.progress import stage, tick

FloatArray = npt.NDArray[np.float64]

ENSEMBLES: Final = 2
_LEAST_WALKERS: Final = 20
_WALKERS_EACH: Final = 3  # for each entry of the vector
_LEARN: Final = 2  # how often the independent proposals are taken from where the walkers were last
_CHUNK: Final = 100  # steps between two looks
LEAST_STEPS: Final = 2 * _LEARN * _CHUNK
"""Before them the later half of the chains still holds steps with which the proposals were learnt."""

_APART: Final = 1.5  # first draws scatter that much wider than the curvature says
_TAILS: Final = 5.0  # degrees of freedom of the independent proposals
_TRIES: Final = 200


@dataclass(frozen=True, eq=False)
class Chains:
    """What the walkers went through after they had forgotten where they started.

    Parameters
    ----------
    vectors : float array, shape (n_chain, n_draw, n_entry)
    log_density : float array, shape (n_chain, n_draw)
    judgement : Judgement
    steps : int
        Of each walker, those that were dropped included.
    accepted : float
        Part of the proposals that were accepted.
    """

    vectors: FloatArray
    log_density: FloatArray
    judgement: Judgement
    steps: int
    accepted: float


class _Independent:
    """Proposals of a multivariate t distribution, whatever the walker's own place (an independence sampler)."""

    def __init__(self, middle: FloatArray, root: FloatArray) -> None:
        self.set(middle, root)

    def set(self, middle: FloatArray, root: FloatArray) -> None:
        self._middle, self._root, self._back = middle, root, np.linalg.inv(root)

    def learn(self, points: FloatArray) -> None:
        """From where walkers have been."""
        scatter = np.cov(points.T) + 1e-12 * np.diag(points.var(axis=0) + 1e-300)
        try:
            self.set(points.mean(axis=0), np.linalg.cholesky(np.atleast_2d(scatter)))
        except np.linalg.LinAlgError:
            return  # as before

    def draw(self, count: int, rng: np.random.RandomState) -> FloatArray:
        normal = rng.standard_normal((count, len(self._middle)))
        wide = np.sqrt(_TAILS / rng.chisquare(_TAILS, size=(count, 1)))
        return np.asarray(self._middle + (normal * wide) @ self._root.T)

    def log_density(self, points: FloatArray) -> FloatArray:
        away = (points - self._middle) @ self._back.T
        size = len(self._middle)
        return np.asarray(-0.5 * (_TAILS + size) * np.log1p(np.sum(away * away, axis=1) / _TAILS))

    def __call__(self, points: FloatArray, rng: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Proposals, and the logarithm of how much more likely the way back is."""
        drawn = self.draw(len(points), rng)
        return drawn, self.log_density(points) - self.log_density(drawn)


def sample(
    density: Callable[[FloatArray], Any],
    coordinates: Coordinates,
    names: Sequence[str],
    *,
    seed: int,
    steps: int,
    others: Sequence[FloatArray] = (),
    at_once: bool = False,
) -> Chains:
    """Walk until the chains agree, or for so many steps.

    Most proposals are drawn from what the walkers have learnt by then, which crosses a posterior that is nearly normal
    in one step; the others are differences between walkers (ter Braak and Vrugt 2008), which follow one that bends.

    Parameters
    ----------
    density : function of a vector
        The logarithm, up to a constant.
    coordinates : Coordinates
        In which the walkers walk.
    names : sequence of str
        Of the first entries, those whose convergence is judged.
    seed : int
    steps : int
        Most steps of each walker.
    others : sequence of float array, shape (n,)
        Other places where it may be high, in these coordinates.
    at_once : bool
        Whether the density takes the vectors of several walkers, shape (n_walker, n), and gives as many numbers.
    """
    emcee = bayes_package("emcee")
    middle, root = coordinates.middle, coordinates.root
    size = len(middle)
    walkers = max(_LEAST_WALKERS, _WALKERS_EACH * size)
    walkers += walkers % 2
    children = np.random.SeedSequence(seed).spawn(ENSEMBLES)
    generators = [np.random.RandomState(int(child.generate_state(1)[0])) for child in children]
    proposals = [_Independent(middle, root) for _ in generators]
    samplers, states = [], []

    def stretched(point: FloatArray) -> tuple[float, FloatArray]:
        tick()
        vector, logarithm = coordinates(point)
        return (logarithm + density(vector) if math.isfinite(logarithm) else -math.inf), vector

    def all_stretched(points: FloatArray) -> list[tuple[float, FloatArray]]:
        placed = [coordinates(point) for point in points]
        logarithms = density(np.array([vector for vector, _ in placed]))
        return [
            (each + float(of), vector) for (vector, each), of in zip(placed, np.atleast_1d(logarithms), strict=True)
        ]

    def of_one(point: FloatArray) -> float:
        return (all_stretched(point[None, :])[0] if at_once else stretched(point))[0]

    for generator, proposal in zip(generators, proposals, strict=True):
        moves = [
            (emcee.moves.MHMove(proposal), 0.5),
            (emcee.moves.DEMove(), 0.3),
            (emcee.moves.DEMove(gamma0=1.0), 0.1),
            (emcee.moves.DESnookerMove(), 0.1),
        ]
        kept_as = [("vector", float, (size,))]
        asked = all_stretched if at_once else stretched
        samplers.append(
            emcee.EnsembleSampler(walkers, size, asked, moves=moves, blobs_dtype=kept_as, vectorize=at_once)
        )
        first = _first(of_one, middle, root, walkers, generator, others)
        states.append(emcee.State(first, random_state=generator.get_state()))
    done = 0
    stage("drawing samples until the chains agree", 0.0, 1.0, walkers * steps // 2)
    while True:
        for number, (sampler, proposal) in enumerate(zip(samplers, proposals, strict=True)):
            states[number] = sampler.run_mcmc(states[number], _CHUNK, skip_initial_state_check=True)
            if done < _LEARN * _CHUNK:
                proposal.learn(sampler.get_chain(discard=done + _CHUNK // 2, flat=True))
        done += _CHUNK
        if done < LEAST_STEPS or done % (2 * _CHUNK):
            continue
        kept = _kept(samplers, done, lambda sampler, begin: sampler.get_blobs(discard=begin)["vector"])
        judgement = judge(kept[:, :, : len(names)], names, ENSEMBLES)
        if judgement.agrees or done >= steps:
            logarithm = _kept(samplers, done, lambda sampler, begin: sampler.get_log_prob(discard=begin))
            accepted = float(np.mean([sampler.acceptance_fraction.mean() for sampler in samplers]))
            return Chains(kept, logarithm, judgement, done, accepted)


def _kept(samplers: Sequence[Any], done: int, of: Callable[[Any, int], FloatArray]) -> FloatArray:
    """The later half of what every walker went through, shape (n_chain, n_draw, ...)."""
    chains = np.concatenate([of(sampler, done // 2) for sampler in samplers], axis=1)
    return np.ascontiguousarray(np.swapaxes(chains, 0, 1))


def _first(
    density: Callable[[FloatArray], float],
    middle: FloatArray,
    root: FloatArray,
    walkers: int,
    generator: np.random.RandomState,
    others: Sequence[FloatArray],
) -> FloatArray:
    """Where walkers start: scattered about the fit, a few about other places, all where something is possible."""
    found = np.empty((walkers, len(middle)))
    for walker in range(walkers):
        about = others[walker % len(others)] if others and walker % 4 == 3 else middle
        width = _APART
        for _ in range(_TRIES):
            found[walker] = about + width * (root @ generator.standard_normal(len(middle)))
            if np.isfinite(density(found[walker])):
                break
            width *= 0.95
        else:
            found[walker] = middle + 1e-3 * (root @ generator.standard_normal(len(middle)))
    return found
