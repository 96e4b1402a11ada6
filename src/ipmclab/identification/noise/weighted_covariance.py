"""How well the noise itself is known, and what that adds to the uncertainty of the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.pieces import Key, System
from ipmclab.normal_equations import inverse, root_of_inverse
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import without
from ipmclab.statespace.shape import Shape

_STEP: Final = 0.05  # of the entries of a noise
_FARTHEST: Final = 1.5  # standard deviation of an entry of the noise that the readings do not show
_FEWEST: Final = 2.0  # degrees of freedom


def covariance_of_weighted(under: Correlated) -> tuple[FloatArray, FloatArray]:
    """What not knowing the noise adds to the covariance where it weighs the readings, and degrees of freedom.

    The estimate moves with the noise that is assumed, and its variance does: both by differences, weighted by the
    covariance of the noise's own values (the inverse of the restricted likelihood's curvature). The first is Kackar
    and Harville's term, counted twice as by Kenward and Roger (1997), since the variance at the estimated noise is too
    small by as much; the second gives Satterthwaite's degrees of freedom.

    Returns
    -------
    added : float array, shape (n_unknown, n_unknown)
    freedom : float array, shape (n_unknown,)
    """
    noises = _Noises(under)
    directions = noises.system.directions

    def answer(key: Key, shape: Shape) -> FloatArray:
        total = noises.others(key) + noises.system.part(key, shape)
        middle = inverse(total[:-1, :-1])
        moved = directions @ (middle @ total[:-1, -1])
        return np.array([moved, np.einsum("ij,jk,ik->i", directions, middle, directions)])

    _, variance = answer(*next(iter(under.shapes.items())))
    added, unsure = np.zeros((len(directions), len(directions))), np.zeros(len(directions))
    for covariance, by_noise in noises.derivatives(answer):
        moved, changed = by_noise[:, 0], by_noise[:, 1]
        added += 2.0 * moved.T @ covariance @ moved
        unsure += np.einsum("ij,ik,kj->j", changed, covariance, changed)
    return added, _freedom(variance, unsure)


def degrees_of_freedom(under: Correlated, own: FloatArray, plain: FloatArray) -> FloatArray:
    """Degrees of freedom with which the variance of each unknown is known (Satterthwaite 1946).

    The variance moves with the noise that is assumed: by differences, weighted by the covariance of the noise's own
    values (the inverse of the restricted likelihood's curvature).

    Parameters
    ----------
    under : Correlated
        With some noise that is not white.
    own : float array, shape (n_residual, n)
        Derivatives of the residuals, all else projected out.
    plain : float array, shape (n, n)
        Pseudo-inverse of its products.
    """
    turned = own @ plain

    def of_piece(key: Key, shape: Shape) -> FloatArray:
        noisy = replace(under, shapes={**under.shapes, key: shape})
        return np.asarray(noisy.covariance_of(turned[under.problem.pieces[key]], key).diagonal())

    total = under.covariance_of_all(turned).diagonal()
    unsure = np.zeros(len(total))
    for covariance, changed in _Noises(under).derivatives(of_piece):
        unsure += np.einsum("ij,ik,kj->j", changed, covariance, changed)
    return _freedom(total, unsure)


def _freedom(variance: FloatArray, unsure: FloatArray) -> FloatArray:
    """Degrees of freedom of a chi-square whose variance relative to its mean is that of an estimate of a variance."""
    return np.asarray(np.maximum(2.0 * variance**2 / np.maximum(unsure, 1e-300), _FEWEST))


class _Noises:
    """The noises of a fit, and what not knowing their values does."""

    def __init__(self, under: Correlated) -> None:
        self._shapes = under.shapes
        self.system = System(under.problem.plain, under.plain, [under.pieces[key] for key in under.shapes])
        self._parts = {key: self.system.part(key, shape) for key, shape in under.shapes.items()}

    def others(self, key: Key) -> FloatArray:
        """What all readings but those of one output of one run add to the normal equations."""
        return self.system.others(self._parts, key)

    def derivatives(self, answer: Callable[[Key, Shape], FloatArray]) -> Iterator[tuple[FloatArray, FloatArray]]:
        """For each noise the covariance of its values, and the derivatives of an answer by them, by differences."""
        for key, shape in self._shapes.items():
            covariance = _covariance(self.system, key, shape, self.others(key))
            sides = [(_moved(shape, step), _moved(shape, -step)) for step in _STEP * np.eye(len(covariance))]
            changes = [answer(key, ahead) - answer(key, behind) for ahead, behind in sides]
            yield covariance, np.stack(changes) / (2.0 * _STEP)


def _moved(shape: Shape, step: FloatArray) -> Shape:
    """A shape beside another: its entries, then the logarithm of its variance."""
    return replace(shape, entries=shape.entries + step[:-1], variance=shape.variance * math.exp(step[-1]))


def _covariance(system: System, key: Key, shape: Shape, others: FloatArray) -> FloatArray:
    """Of the values of one noise: the inverse of half the curvature of the deviance."""
    count, columns = shape.terms.shapes + 1, system.columns[key]
    steps = _STEP * np.eye(count)

    def height(step: FloatArray) -> float:
        """Minus twice the restricted log likelihood beside these values, scale included."""
        there = _moved(shape, step)
        every, logarithm = columns.products(there.terms, there.entries)
        own, of_constants = without(every, there.terms)
        total = others + own / there.variance
        root, of_directions = root_of_inverse(total[:-1, :-1])
        right = total[:-1, -1] @ root
        misfit = float(total[-1, -1] - right @ right)
        freedom = columns.count - there.terms.constants
        return freedom * math.log(there.variance) + logarithm + of_constants + of_directions + misfit

    middle = height(np.zeros(count))
    curvature = np.zeros((count, count))
    ahead, behind = [height(step) for step in steps], [height(-step) for step in steps]
    for i in range(count):
        curvature[i, i] = (ahead[i] - 2.0 * middle + behind[i]) / _STEP**2
        for j in range(i):
            both = height(steps[i] + steps[j]) + height(-steps[i] - steps[j])
            crossed = both - ahead[i] - behind[i] - ahead[j] - behind[j] + 2.0 * middle
            curvature[i, j] = curvature[j, i] = 0.5 * crossed / _STEP**2
    values, vectors = np.linalg.eigh(0.5 * curvature)
    return np.asarray((vectors / np.maximum(values, _FARTHEST**-2)) @ vectors.T)
