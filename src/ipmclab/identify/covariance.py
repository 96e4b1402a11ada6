"""How sure a fit is: information, colour of the residuals, and what fixed values pass on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.problem import Evaluation, Problem
from ipmclab.identify.solve import STRUCTURAL

FloatArray = npt.NDArray[np.float64]

_COLOUR_LAGS: Final = 20
_REJECT: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of the unknowns that were asked for (states at the start are averaged out).

    All in the entries of the vector: logarithms, or values over their scale.

    Parameters
    ----------
    covariance : float array, shape (n, n)
        Without the null directions, with colour and fixed values passed on.
    plain : float array, shape (n, n)
        As if the residuals were white and every fixed value exact.
    null : float array, shape (n_null, n)
        Unit vectors along which the readings say nothing at all.
    singular_values : float array, shape (n,)
        Of the weighted Jacobian, largest first.
    leverage : mapping of name to float array, shape (n,)
        Change of each entry for 1 % of a fixed parameter.
    coloured : tuple of (place, output)
        Residuals that are not white.
    """

    covariance: FloatArray
    plain: FloatArray
    null: FloatArray
    singular_values: FloatArray
    leverage: Mapping[str, FloatArray]
    coloured: tuple[tuple[int, str], ...]

    @property
    def rank(self) -> int:
        """Number of combinations that the readings determine at all."""
        return len(self.singular_values) - len(self.null)


def is_coloured(residual: FloatArray) -> bool:
    """Ljung and Box's test at 0.1 %: whether neighbouring residuals belong together."""
    from scipy.special import chdtrc

    count = len(residual)
    lags = min(_COLOUR_LAGS, count // 5)
    if lags < 1:
        return False
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    if power == 0.0:
        return False
    found = np.correlate(centred, centred[: count - lags], "valid")[1:] / power
    statistic = count * (count + 2.0) * float(np.sum(found**2 / (count - np.arange(1, lags + 1))))
    return bool(chdtrc(lags, statistic) < _REJECT)


def uncertainty(
    problem: Problem, theta: FloatArray, evaluation: Evaluation, fixed: Mapping[str, float], exact: Sequence[str]
) -> Uncertainty:
    """Covariance, rank and leverage at a solution.

    Parameters
    ----------
    problem : Problem
        With the noise found in the residuals.
    theta : float array, shape (n_unknown,)
    evaluation : Evaluation
        At ``theta``.
    fixed : mapping of name to float [SI]
        Fixed parameters with a stated standard uncertainty.
    exact : sequence of str
        Fixed parameters without one, whose leverage is to be known.
    """
    nuisance = np.array([unknown.nuisance for unknown in problem.unknowns], dtype=bool)
    if nuisance.all():
        nothing = np.zeros((0, 0))
        return Uncertainty(nothing, nothing, nothing, np.zeros(0), dict.fromkeys((*fixed, *exact), np.zeros(0)), ())
    singular, directions = _of_the_asked(evaluation, nuisance)
    asked = len(directions)
    seen = singular > STRUCTURAL * singular[0] if singular[0] > 0 else np.zeros(asked, dtype=bool)
    inverse = directions[seen].T / singular[seen]
    plain = inverse @ inverse.T

    own = evaluation.jacobian
    if nuisance.any():
        # With everything else projected out: J_a - J_n (J_n^+ J_a).
        own, others = own[:, ~nuisance], own[:, nuisance]
        own = own - others @ np.linalg.lstsq(others, own, rcond=1e-12)[0]
    pieces = problem.pieces
    # At the floor the residuals are rounding of the model itself, which is never white.
    coloured = tuple(
        key
        for key, piece in pieces.items()
        if problem.noise[key] > 1.01 * problem.floors[key] and is_coloured(evaluation.residual[piece])
    )
    covariance = plain
    if coloured:
        beforehand = own[max(piece.stop for piece in pieces.values()) :]
        middle = beforehand.T @ beforehand
        for key, piece in pieces.items():
            middle += (
                _long_run(own[piece], evaluation.residual[piece]) if key in coloured else own[piece].T @ own[piece]
            )
        covariance = plain @ middle @ plain

    names = [*fixed, *exact]
    leverage: dict[str, FloatArray] = {}
    if names:
        answer = -plain @ (own.T @ problem.fixed_jacobian(theta, names))
        for column, name in enumerate(names):
            leverage[name] = answer[:, column] * 0.01 * abs(problem.base[name])
            if name in fixed:
                covariance = covariance + np.outer(answer[:, column], answer[:, column]) * fixed[name] ** 2
    return Uncertainty(covariance, plain, directions[~seen], singular, leverage, coloured)


def _of_the_asked(evaluation: Evaluation, nuisance: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Singular values and directions of the Jacobian of the asked unknowns, the others averaged out."""
    triangle = evaluation.triangle[:, :-1]
    asked = int(np.count_nonzero(~nuisance))
    if asked == len(nuisance) <= len(triangle):
        return evaluation.spectrum
    order = np.concatenate([np.flatnonzero(nuisance), np.flatnonzero(~nuisance)])
    first = len(order) - asked
    # With the others in front, the lower right block is what is left of the asked ones.
    block = np.asarray(np.linalg.qr(triangle[:, order], mode="r"))[first:, first:]
    # With fewer readings than unknowns the block has too few rows: the rest are zero.
    block = np.vstack([block, np.zeros((max(0, asked - len(block)), asked))])
    _, singular, directions = np.linalg.svd(block)
    return singular, directions


def _long_run(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Newey and West's sum of score covariances, with Andrews' bandwidth for an AR(1)."""
    score = jacobian * residual[:, None]
    power = float(residual @ residual)
    neighbour = float(residual[1:] @ residual[:-1]) / power if power else 0.0
    neighbour = min(max(neighbour, -0.97), 0.97)
    alpha = 4.0 * neighbour**2 / (1.0 - neighbour**2) ** 2
    lags = min(len(residual) // 3, int(1.1447 * (alpha * len(residual)) ** (1.0 / 3.0)) + 1)
    total = score.T @ score
    for lag in range(1, lags + 1):
        weight = 1.0 - lag / (lags + 1.0)
        part = score[lag:].T @ score[:-lag]
        total = total + weight * (part + part.T)
    return np.asarray(total)
