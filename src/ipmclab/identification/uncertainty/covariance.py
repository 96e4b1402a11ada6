"""How sure a fit is: information, colour of the residuals, and what fixed values pass on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import REJECT
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.growing import Growth, growth
from ipmclab.identification.noise.searched_outputs import FLOOR
from ipmclab.identification.noise.weighted_covariance import covariance_of_weighted, degrees_of_freedom
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.tangent import rank_threshold
from ipmclab.identification.uncertainty.unshown_zero import hidden_zeros
from ipmclab.named_matrix import Table, matrix_of, table_of
from ipmclab.normal_equations import root
from ipmclab.run import FloatArray
from ipmclab.statespace.long_run import long_run
from ipmclab.statespace.screen import of_neighbours

MOVED: Final = 1e-3
"""Part of a direction of which the readings say nothing from which an entry moves along it: less is rounding."""

_GROWS: Final = 1.1  # times as large, from which noise is said to grow: a tenth changes no interval to speak of


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of the unknowns that were asked for (states at the start are averaged out).

    All in the entries of the vector: logarithms, or values over their scale.

    Parameters
    ----------
    covariance : float array, shape (n, n)
        Without the null directions, with colour and fixed values passed on.
    of_readings : float array, shape (n,)
        Variances with every fixed value exact.
    plain : float array, shape (n, n)
        As if the residuals were white and every fixed value exact.
    null : float array, shape (n_null, n)
        Unit vectors along which the readings say nothing at all.
    singular_values : float array, shape (n,)
        Of the weighted Jacobian, largest first.
    leverage : mapping of name to float array, shape (n,)
        Change of each entry for 1 % of a fixed parameter; of one that is 0, for its stated uncertainty.
    coloured : tuple of (place, output)
        Residuals that the noise that was found does not make white.
    freedom : float array, shape (n,)
        Degrees of freedom with which each variance is known.
    growing : mapping of (place, output) to Growth
        Noise that is larger where the answer is, as the covariance allows for where the noise does not drift.
    slopes : mapping of name to float array, shape (n,) [1/SI]
        Change of each entry with a fixed parameter.
    zero : frozenset of str
        Fixed parameters that are 0.
    """

    covariance: FloatArray
    of_readings: FloatArray
    plain: FloatArray
    null: FloatArray
    singular_values: FloatArray
    leverage: Mapping[str, FloatArray]
    coloured: tuple[tuple[int, str], ...]
    freedom: FloatArray
    growing: Mapping[tuple[int, str], Growth] = field(default_factory=dict)
    slopes: Mapping[str, FloatArray] = field(default_factory=dict)
    zero: frozenset[str] = frozenset()

    @property
    def rank(self) -> int:
        """Number of combinations that the readings determine at all."""
        return len(self.singular_values) - len(self.null)


def is_coloured(residual: FloatArray) -> bool:
    """Ljung and Box's test at 0.1 %: whether neighbouring residuals belong together."""
    return len(residual) > 0 and of_neighbours(residual - np.mean(residual)) < REJECT


def uncertainty(correlated: Correlated, fixed: Table, exact: Sequence[str]) -> Uncertainty:
    """Covariance, rank and leverage at a solution.

    The solution is that of least squares, with the pseudo-inverse A of its Jacobian; the readings have noise of
    covariance V, as it was found. The covariance is A V A', whatever V is (White 1980). Where residuals are
    autocorrelated beyond V and do not drift, the sum of their own autocovariances takes its place if it is larger
    (Newey and West 1987); where they are larger for a larger answer, each row has its own variance. What rounding hides
    of a zero at rest is added.

    Parameters
    ----------
    correlated : Correlated
        The solution, and the noise found in its residuals.
    fixed : mapping of name to mapping of name to float [SI]
        Covariance of fixed parameters with a stated standard uncertainty.
    exact : sequence of str
        Fixed parameters without one, whose leverage is to be known.
    """
    problem, solution = correlated.problem, correlated.solution
    theta, evaluation = solution.theta, solution.evaluation
    readings = max(len(evaluation.residual) - len(theta), 1)
    nuisance = np.array([unknown.nuisance for unknown in problem.unknowns], dtype=bool)
    if nuisance.all():
        nothing = np.zeros((0, 0))
        none = dict.fromkeys((*fixed, *exact), np.zeros(0))
        return Uncertainty(nothing, np.zeros(0), nothing, nothing, np.zeros(0), none, (), np.zeros(0), slopes=none)
    # Of the Jacobian of the unknowns that are asked for, the others averaged out.
    singular, directions = evaluation.spectrum
    if nuisance.any():
        _, singular, directions = np.linalg.svd(left_of_the_asked(evaluation, nuisance))
    asked = len(directions)
    determined = singular > rank_threshold(evaluation, singular[0]) if singular[0] > 0 else np.zeros(asked, dtype=bool)
    inverse = directions[determined].T / singular[determined]
    plain = inverse @ inverse.T

    own = evaluation.jacobian
    if nuisance.any():
        # With everything else projected out: J_a - J_n (J_n^+ J_a).
        own, others = own[:, ~nuisance], own[:, nuisance]
        own = own - others @ np.linalg.lstsq(others, own, rcond=1e-12)[0]
    pieces = problem.pieces
    noisy = [key for key in pieces if problem.noise[key] > FLOOR * problem.floors[key]]
    found = {key: growth(correlated, key) for key in noisy}
    growing = {key: one for key, one in found.items() if one is not None and one.times > _GROWS}
    white = correlated.whitened.residual
    # Large ones that stand together are else taken for autocorrelated ones.
    even = {key: white[pieces[key]] / (np.sqrt(growing[key].variance) if key in growing else 1.0) for key in noisy}
    coloured = tuple(key for key in noisy if is_coloured(even[key]))
    freedom = np.full(asked, float(readings))
    added = np.zeros_like(plain)
    if correlated.is_weighted:
        added, known = covariance_of_weighted(correlated)
        added, freedom = added[np.ix_(~nuisance, ~nuisance)], np.minimum(known[~nuisance], freedom)
    elif correlated.shapes:
        freedom = np.minimum(degrees_of_freedom(correlated, own, plain), freedom)
    covariance = plain
    if correlated.shapes or correlated.zeros or coloured or growing:
        drifting = {key for key, noise in correlated.noise.items() if noise.terms.drifts}
        beforehand = own[problem.beforehand]
        middle = beforehand.T @ beforehand
        for key, piece in pieces.items():
            # What a walk adds is not of the row where it shows: no variance of a row stands for it.
            uneven = growing[key].variance if key in growing and key not in drifting else None
            of_noise = correlated.covariance_of(own[piece], key, uneven)
            if key in coloured and key not in drifting:
                of_sums = long_run(own[piece], evaluation.residual[piece])
                of_noise = max(of_noise, of_sums, key=lambda one: float(np.sum(plain * one)))
            middle += of_noise
        moved = plain @ root(middle)
        covariance = moved @ moved.T
    covariance = covariance + added

    moved = plain @ (own.T @ hidden_zeros(problem, len(own)))
    covariance = covariance + moved @ moved.T
    of_readings = covariance.diagonal()
    names = [*fixed, *exact]
    leverage: dict[str, FloatArray] = {}
    slopes: dict[str, FloatArray] = {}
    if names:
        answer = -plain @ (own.T @ problem.fixed_jacobian(theta, names))
        for column, name in enumerate(names):
            slopes[name], value = answer[:, column], problem.base[name]
            uncertain = math.sqrt(fixed[name][name]) if name in fixed else 0.0
            leverage[name] = slopes[name] * (0.01 * abs(value) if value else uncertain)
        passed_on = answer[:, : len(fixed)]
        covariance = covariance + passed_on @ matrix_of(fixed, fixed) @ passed_on.T
    zero = frozenset(name for name in names if problem.base[name] == 0.0)
    return Uncertainty(
        covariance,
        of_readings,
        plain,
        directions[~determined],
        singular,
        leverage,
        coloured,
        freedom,
        growing,
        slopes,
        zero,
    )


def left_of_the_asked(evaluation: Evaluation, nuisance: npt.NDArray[np.bool_]) -> FloatArray:
    """A triangle of the Jacobian of the asked unknowns, the others averaged out."""
    order = np.concatenate([np.flatnonzero(nuisance), np.flatnonzero(~nuisance)])
    first = int(np.count_nonzero(nuisance))
    # With the others in front, the lower right block is what is left of the asked ones.
    return np.asarray(np.linalg.qr(evaluation.triangle[:, order], mode="r"))[first:, first:]


def covariance_table(
    names: Sequence[str], entries: FloatArray, chains: Sequence[float], slopes: Mapping[str, FloatArray], stated: Table
) -> dict[str, dict[str, float]]:
    """Covariance [SI] of what was fitted and of what was held at a stated uncertainty, which moves with it.

    Parameters
    ----------
    names : sequence of str
        What was fitted.
    entries : float array, shape (n, n)
        Covariance of their entries in the vector of the fit.
    chains : sequence of float
        Derivative of each value by its entry.
    slopes : mapping of name to float array, shape (n,)
        Derivative of each entry by a held parameter [1/SI].
    stated : mapping of name to mapping of name to float [SI]
        Covariance of the held parameters.
    """
    every = [*names, *stated]
    count = len(names)
    scaled = np.zeros((len(every), len(every)))
    scaled[:count, :count] = entries * np.outer(chains, chains)
    if stated:
        held = matrix_of(stated, stated)
        moved = np.array([slopes[name] for name in stated]) * chains
        scaled[count:, count:] = held
        scaled[count:, :count] = held @ moved
        scaled[:count, count:] = scaled[count:, :count].T
    return table_of(every, scaled)
