"""Markov chains: two ensembles of walkers from different places, until they agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.engine import Engine, Here, in_order
from ipmclab.posterior.convergence import Judgement, judge
from ipmclab.posterior.coordinates import Coordinates
from ipmclab.posterior.packages import bayes_package
from ipmclab.progress import stage, tick

FloatArray = npt.NDArray[np.float64]

ENSEMBLES: Final = 2  # the fewest that can be compared with each other (convention)
_LEAST_WALKERS: Final = 20
"""Of an ensemble (convention)."""

_WALKERS_EACH: Final = 3  # for each entry of the vector
_LEARN: Final = 2  # how often the independent proposals are taken from where the walkers were last
_CHUNK: Final = 100  # steps between two looks
LEAST_STEPS: Final = 2 * _LEARN * _CHUNK
"""Before them the later half of the chains still holds steps with which the proposals were learnt."""

_APART: Final = 1.5  # first draws scatter that much wider than the curvature says
_TAILS: Final = 5.0  # degrees of freedom of the independent proposals
_SNOOKER: Final = 1.7  # of what two walkers differ by along a line (ter Braak and Vrugt 2008)
_NO_DISTANCE: Final = 1e-300  # between walkers in one place, which stay there
_TRIES: Final = 200  # draws for a walker inside the bounds (a limit)


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
    density: Callable[[FloatArray], FloatArray],
    coordinates: Coordinates,
    names: Sequence[str],
    *,
    seed: int,
    steps: int,
    others: Sequence[FloatArray] = (),
    engine: Engine | None = None,
) -> Chains:
    """Walk until the chains agree, or for so many steps.

    Most proposals are drawn from what the walkers have learnt by then, which crosses a posterior that is nearly normal
    in one step; the others are differences between walkers (ter Braak and Vrugt 2008), which follow one that bends.

    Parameters
    ----------
    density : function of vectors, shape (n_walker, n_entry) to (n_walker,)
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
    engine : Engine, optional
        Who walks: a task for each ensemble and some steps.
    """
    emcee = bayes_package("emcee")
    middle, root = coordinates.middle, coordinates.root
    size = len(middle)
    walkers = max(_LEAST_WALKERS, _WALKERS_EACH * size)
    walkers += walkers % 2
    children = np.random.SeedSequence(seed).spawn(ENSEMBLES)
    generators = [np.random.RandomState(int(child.generate_state(1)[0])) for child in children]
    stretched = _Stretched(density, coordinates)
    ensembles = []
    for generator in generators:
        first = _first(stretched.of_one, middle, root, walkers, generator, others)
        state = emcee.State(first, random_state=generator.get_state())
        ensembles.append(_Ensemble(state, _Independent(middle, root)))
    walks: list[list[_Walk]] = [[] for _ in ensembles]
    done = 0
    stage("drawing samples until the chains agree", 0.0, 1.0, steps // 3)
    while True:
        rounds = in_order(engine or Here(), _walk, stretched, [replace(one, done=done) for one in ensembles])
        for number, (ensemble, walk) in enumerate(rounds):
            ensembles[number] = ensemble
            walks[number].append(walk)
        done += _CHUNK
        if done < LEAST_STEPS or done % (2 * _CHUNK):
            continue
        kept = _kept([[walk.vectors for walk in one] for one in walks], done)
        judgement = judge(kept[:, :, : len(names)], names, ENSEMBLES)
        if judgement.agrees or done >= steps:
            logarithm = _kept([[walk.log_density for walk in one] for one in walks], done)
            accepted = float(np.mean([np.mean(sum(walk.accepted for walk in one) / done) for one in walks]))
            return Chains(kept, logarithm, judgement, done, accepted)


class _Stretched:
    """The density in the coordinates in which walkers walk."""

    def __init__(self, density: Callable[[FloatArray], FloatArray], coordinates: Coordinates) -> None:
        self._density, self._coordinates = density, coordinates

    def __call__(self, points: FloatArray) -> list[tuple[float, FloatArray]]:
        """For each point the logarithm, and the vector that it stands for."""
        tick()
        with np.errstate(invalid="warn", divide="warn"):  # what is ignored is emcee's alone
            vectors, logarithms = self._coordinates(points)
            there = np.isfinite(logarithms)
            if there.any():
                logarithms[there] += self._density(vectors[there])
        return list(zip(logarithms.tolist(), vectors, strict=True))

    def of_one(self, point: FloatArray) -> float:
        """The logarithm at one point."""
        return self(point[None])[0][0]


@dataclass(frozen=True, eq=False)
class _Ensemble:
    """Walkers where they are, what they propose, and after how many steps."""

    state: Any
    proposal: _Independent
    done: int = 0


@dataclass(frozen=True, eq=False)
class _Walk:
    """What the walkers of an ensemble went through in some steps."""

    vectors: FloatArray
    log_density: FloatArray
    accepted: FloatArray


def _walk(stretched: _Stretched, ensemble: _Ensemble) -> tuple[_Ensemble, _Walk]:
    """Some steps of all walkers of an ensemble; in the first of them it learns what to propose."""
    emcee = bayes_package("emcee")
    walkers, size = ensemble.state.coords.shape
    moves = [
        (emcee.moves.MHMove(ensemble.proposal), 0.5),
        (emcee.moves.DEMove(), 0.3),
        (emcee.moves.DEMove(gamma0=1.0), 0.1),
        (snooker_move(), 0.1),
    ]
    kept_as = [("vector", float, (size,))]
    sampler = emcee.EnsembleSampler(walkers, size, stretched, moves=moves, blobs_dtype=kept_as, vectorize=True)
    # A walker where nothing is possible stays until a proposal is; emcee compares two such places as inf - inf.
    with np.errstate(invalid="ignore", divide="ignore"):
        state = sampler.run_mcmc(ensemble.state, _CHUNK, skip_initial_state_check=True)
    if ensemble.done < _LEARN * _CHUNK:
        ensemble.proposal.learn(sampler.get_chain(discard=_CHUNK // 2, flat=True))
    walk = _Walk(sampler.get_blobs()["vector"], sampler.get_log_prob(), sampler.backend.accepted)
    return replace(ensemble, state=state), walk


def snooker_move() -> Any:
    """The snooker update (ter Braak and Vrugt 2008), as a move of emcee.

    That of emcee 3.1 multiplies a step by the distance of the two walkers, and takes the root of what balances it. So
    walkers draw together: alone it finds 0.6 of the standard deviation of a normal density.
    """
    move = bayes_package("emcee").moves.DESnookerMove()
    move.get_proposal = _along_lines
    return move


def _along_lines(
    points: FloatArray, others: Sequence[FloatArray], rng: np.random.RandomState
) -> tuple[FloatArray, FloatArray]:
    """Each walker along its line to another, by what two more differ along it; and the logarithm that balances it."""
    end, one, two = (walkers[rng.randint(len(walkers), size=len(points))] for walkers in others)
    away = points - end
    size = np.maximum(np.linalg.norm(away, axis=1), _NO_DISTANCE)
    line = away / size[:, None]
    moved = points + _SNOOKER * line * np.sum(line * (one - two), axis=1)[:, None]
    then = np.maximum(np.linalg.norm(moved - end, axis=1), _NO_DISTANCE)
    return moved, (points.shape[1] - 1.0) * np.log(then / size)


def _kept(walks: Sequence[Sequence[FloatArray]], done: int) -> FloatArray:
    """The later half of what every walker went through, shape (n_chain, n_draw, ...)."""
    chains = np.concatenate([np.concatenate(one)[done // 2 :] for one in walks], axis=1)
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
