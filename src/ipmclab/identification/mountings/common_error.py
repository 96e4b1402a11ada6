"""What the errors of several mountings have in common, and what each has for itself.

A fixed parameter with a stated uncertainty, a prior, and what all runs of a joint fit share are wrong by the same
amount in every mounting. Such an error does not show in how far mountings differ, nor average out over them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.fit.fit import Fit, FittedParameter
from ipmclab.identification.problem.unknowns import actuator_unknown
from ipmclab.identification.solved import solved
from ipmclab.named_matrix import matrix_of
from ipmclab.run import FloatArray

_NOTHING = 1e-12  # of the largest eigenvalue
_ALIKE = 1e-8  # of a variance: more than rounding takes from a covariance of numbers that are all but one


@dataclass(frozen=True, eq=False)
class Parted:
    """Standard errors of the same quantity in several mountings, parted.

    Parameters
    ----------
    own : float array, shape (n_mounting,)
        Independent from one to the next.
    common : float
        Standard error that all of them share.
    """

    own: FloatArray
    common: float


def parted(errors: npt.ArrayLike, loadings: npt.ArrayLike) -> Parted:
    """Part standard errors by what moves all mountings together.

    What the mean loading explains is common. By how much a mounting's own loading differs from it counts as error of
    its own: the loadings come from a fit to first order, and a weight that made use of small differences between them
    would believe in the linearisation (Peelle's puzzle).

    Parameters
    ----------
    errors : float array, shape (n_mounting,)
        Standard errors, everything counted.
    loadings : float array, shape (n_mounting, n_cause)
        Change of each mounting's estimate, with its sign, as each cause moves by one standard deviation.

    Examples
    --------
    >>> found = parted([0.5, 0.5], [[0.4], [0.4]])
    >>> found.own.round(3).tolist(), round(found.common, 3)
    ([0.3, 0.3], 0.4)
    """
    total = np.square(np.asarray(errors, dtype=np.float64))
    if not len(total):
        return Parted(total, 0.0)
    moved = np.asarray(loadings, dtype=np.float64).reshape(len(total), -1)
    middle = moved.mean(axis=0)
    own = np.maximum(total - (moved**2).sum(axis=1), 0.0) + ((moved - middle) ** 2).sum(axis=1)
    return Parted(np.sqrt(own), float(np.sqrt(middle @ middle)))


def loadings_of(fit: Fit) -> dict[str, dict[str, float]]:
    """By how much each parameter of a fit moves [SI] as what it took from elsewhere moves by its standard uncertainty.

    Elsewhere is a fixed parameter with a stated uncertainty, and what was known beforehand of a free one. Of fixed
    parameters that an earlier fit found together, each counts with what it says in addition to those before it. A
    prior of standard deviation s about c moves an estimate by covariance/s^2 for each unit of c; one that follows
    others is wrong by itself in what it says with them.
    """
    table, fitted = fit.covariance, fit.parameters
    stated = {name: math.sqrt(row[name]) for name, row in table.items() if name not in fitted and row[name] > 0.0}
    # Their covariance with what was fitted is its leverage.
    found = {
        name: {cause: table[name][cause] / deviation for cause, deviation in stated.items()}
        for name in table
        if name in fitted
    }
    root = _beside_others(fit, list(stated))
    if root is not None:
        found = {
            name: dict(zip(stated, np.linalg.solve(root, list(moved.values())).tolist(), strict=True))
            for name, moved in found.items()
        }
    pulls: dict[str, dict[str, float]] = {name: {} for name in found}
    for cause, one in fitted.items():
        if one.prior is None or cause not in found:
            continue
        deviation, slopes = _prior_of(fit, one)
        for name, moved in found.items():
            from_readings = {
                other: table[name][other] - sum(moved[known] * found[other][known] for known in stated)
                for other in (cause, *slopes)
            }
            explained = sum(slope * from_readings[other] for other, slope in slopes.items())
            pulls[name][f"prior {cause}"] = (from_readings[cause] - explained) / deviation
    return {name: moved | pulls[name] for name, moved in found.items()}


def loadings_of_joint(fit: Fit, names: Sequence[str]) -> FloatArray:
    """The same for what each mounting has for itself in a fit of all [SI], shape (n_name, n_cause).

    What the covariance of two of them consists of is what the fit says of all runs together, its shared parameters
    among it, and what was stated: their regression on these.
    """
    table = fit.covariance
    causes = [name for name in table if "[" not in name]
    between = matrix_of(table, names, causes)
    moved = np.zeros((len(names), 0))
    if causes:
        shared = matrix_of(table, causes)
        # Units differ by many powers of ten.
        scale = np.sqrt(np.maximum(shared.diagonal(), np.finfo(float).tiny))
        size, vectors = np.linalg.eigh(shared / np.outer(scale, scale))
        kept = size > _NOTHING * max(float(size[-1]), 0.0)
        moved = (between / scale) @ vectors[:, kept] / np.sqrt(size[kept])
    pulls = np.zeros((len(names), 1))
    for row, name in enumerate(names):
        one = fit.parameters[name]
        if one.prior is not None:
            left = max(table[name][name] - float(moved[row] @ moved[row]), 0.0)
            pulls[row] = left / _prior_deviation(fit, one)
    return np.hstack([moved, pulls])


def common_covariance(
    fit: Fit, loadings: Sequence[Mapping[str, Mapping[str, float]]], values: Sequence[Mapping[str, float]]
) -> tuple[tuple[str, ...], FloatArray]:
    """Parameters, free and stated, and their covariance [SI] from what the errors of all mountings have in common.

    Parameters
    ----------
    fit : Fit
        Of all mountings together.
    loadings, values : sequence of mapping
        Of each mounting by itself.
    """
    known = fit.actuator.parameters()
    causes = list(dict.fromkeys(cause for one in loadings for moved in one.values() for cause in moved))
    free = [name for name in dict.fromkeys(name for one in loadings for name in one) if name in known]
    names = (*free, *(cause for cause in causes if cause in known))
    columns = np.zeros((len(names), len(causes)))
    stated = [cause for cause in causes if cause in known]
    deviations = np.diag([known[cause].standard_uncertainty for cause in stated])
    root = _beside_others(fit, stated)
    place = np.ix_(range(len(free), len(names)), [causes.index(cause) for cause in stated])
    columns[place] = deviations if root is None else deviations @ root
    for row, name in enumerate(names):
        for column, cause in enumerate(causes):
            if name in free:
                entry = actuator_unknown(known[name], None)
                moved = [
                    one[name].get(cause, 0.0) / entry.chain(own[name])
                    for one, own in zip(loadings, values, strict=True)
                    if name in one
                ]
                columns[row, column] = sum(moved) / len(moved) * entry.chain(fit.actuator[name])
    return names, columns @ columns.T


def _beside_others(fit: Fit, stated: Sequence[str]) -> FloatArray | None:
    """By how many deviations each stated parameter is off for one of what each says in addition to those before it.

    None where they are independent.
    """
    if not all(name in fit.covariance for name in stated):
        return None
    together = matrix_of(fit.covariance, stated)
    if not np.count_nonzero(together - np.diag(together.diagonal())):
        return None
    size = np.sqrt(together.diagonal())
    return np.asarray(np.linalg.cholesky(together / np.outer(size, size) + _ALIKE * np.eye(len(stated))))


def _prior_of(fit: Fit, one: FittedParameter) -> tuple[float, dict[str, float]]:
    """Standard deviation of a prior by itself [SI], and by how much its centre moves with other parameters [SI]."""
    unknowns = {} if fit.estimate is None else {u.name: u for u in solved(fit).problem.unknowns}
    unknown = unknowns.get(one.name)
    if unknown is None or unknown.prior is None or not unknown.follows:
        return _prior_deviation(fit, one), {}
    chain = unknown.chain(one.value)
    slopes = {
        other: slope * chain / unknowns[other].chain(fit.parameters[other].value)
        for other, (slope, _) in unknown.follows.items()
    }
    return unknown.prior[1] * chain, slopes


def _prior_deviation(fit: Fit, one: FittedParameter) -> float:
    """Standard deviation of a prior [SI], a log-normal one's about the fitted value."""
    assert one.prior is not None
    value, deviation = one.prior
    log = actuator_unknown(fit.actuator.parameters()[one.name.partition("[")[0]], None).log
    return deviation * one.value / value if log else deviation
