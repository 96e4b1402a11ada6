"""How well the noise itself is known, and what that adds to the uncertainty of the parameters."""

from __future__ import annotations

import math
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


def spread_of_weighted(under: Correlated) -> tuple[FloatArray, FloatArray]:
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
    system = System(under.problem.plain, under.plain, [under.pieces[key] for key in under.shapes])
    parts = {key: system.part(key, shape) for key, shape in under.shapes.items()}
    directions = system.directions
    middle = inverse((system.rest + sum(parts.values()))[:-1, :-1])
    variance = np.einsum("ij,jk,ik->i", directions, middle, directions)
    added = np.zeros((len(directions), len(directions)))
    unsure = np.zeros(len(directions))
    for key, shape in under.shapes.items():
        others = system.others(parts, key)
        covariance = _covariance(system, key, shape, others)
        sides = [_answers(system, key, shape, others, place) for place in range(len(covariance))]
        moved = np.stack([directions @ answer for answer, _ in sides])
        changed = np.stack([np.einsum("ij,jk,ik->i", directions, across, directions) for _, across in sides])
        added += 2.0 * moved.T @ covariance @ moved
        unsure += np.einsum("ij,ik,kj->j", changed, covariance, changed)
    return added, np.maximum(2.0 * variance**2 / np.maximum(unsure, 1e-300), _FEWEST)


def _answers(system: System, key: Key, shape: Shape, others: FloatArray, place: int) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the answer and of its covariance by one value of a noise."""
    step = np.zeros(shape.terms.shapes + 1)
    step[place] = _STEP
    answers, inverses = [], []
    for side in (step, -step):
        total = others + system.part(key, _moved(shape, side))
        inverses.append(inverse(total[:-1, :-1]))
        answers.append(-inverses[-1] @ total[:-1, -1])
    return (answers[0] - answers[1]) / (2.0 * _STEP), (inverses[0] - inverses[1]) / (2.0 * _STEP)


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
    pieces = [under.pieces[key] for key in under.shapes]
    system = System(under.problem.plain, under.plain, pieces)
    turned = own @ plain
    variances = {key: _variances(under, turned, key) for key in under.problem.pieces}
    beyond = turned[under.problem.beforehand]
    total = np.asarray(sum(variances.values())) + np.sum(beyond * beyond, axis=0)
    parts = {key: system.part(key, shape) for key, shape in under.shapes.items()}
    unsure = np.zeros(len(total))
    for key, shape in under.shapes.items():
        covariance = _covariance(system, key, shape, system.others(parts, key))
        changed = np.stack([_two_sides(under, turned, key, shape, place) for place in range(len(covariance))])
        unsure += np.einsum("ij,ik,kj->j", changed, covariance, changed)
    return np.asarray(np.maximum(2.0 * total**2 / np.maximum(unsure, 1e-300), _FEWEST))


def _variances(under: Correlated, turned: FloatArray, key: Key) -> FloatArray:
    return np.asarray(under.spread(turned[under.problem.pieces[key]], key).diagonal())


def _moved(shape: Shape, step: FloatArray) -> Shape:
    """A shape beside another: its entries, then the logarithm of its variance."""
    return replace(shape, entries=shape.entries + step[:-1], variance=shape.variance * math.exp(step[-1]))


def _two_sides(under: Correlated, turned: FloatArray, key: Key, shape: Shape, place: int) -> FloatArray:
    """Derivative of the variances by one value of a noise."""
    step = np.zeros(shape.terms.shapes + 1)
    step[place] = _STEP
    ahead, behind = (
        _variances(replace(under, shapes={**under.shapes, key: _moved(shape, side)}), turned, key)
        for side in (step, -step)
    )
    return np.asarray((ahead - behind) / (2.0 * _STEP))


def _covariance(system: System, key: Key, shape: Shape, others: FloatArray) -> FloatArray:
    """Of the values of one noise: the inverse of half the curvature of the deviance."""
    count = shape.terms.shapes + 1
    steps = _STEP * np.eye(count)

    def height(step: FloatArray) -> float:
        return _deviance(system, key, _moved(shape, step), others)

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


def _deviance(system: System, key: Key, shape: Shape, others: FloatArray) -> float:
    """Minus twice the restricted log likelihood at any values, scale included."""
    columns = system.columns[key]
    every, logarithm = columns.products(shape.terms, shape.entries)
    own, of_constants = without(every, shape.terms)
    total = others + own / shape.variance
    root, of_directions = root_of_inverse(total[:-1, :-1])
    right = total[:-1, -1] @ root
    misfit = float(total[-1, -1] - right @ right)
    freedom = columns.count - shape.terms.constants
    return freedom * math.log(shape.variance) + logarithm + of_constants + of_directions + misfit
