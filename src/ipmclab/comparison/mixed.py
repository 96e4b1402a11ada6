"""A linear model with random intercepts, by restricted maximum likelihood, whose intervals hold for few strips.

The covariance of the readings is a sum ``V = s_0 I + s_1 Z_1 Z_1' + ...``, one term for the scatter of repeats and one
for each grouping (strip, mounting). The components of variance are free to come out negative as long as V stays
positive definite: in a balanced design the tests are then exactly those of the analysis of variance. Held at zero they
would be too narrow wherever chance makes the groups more alike than repeats are.

Covariance of the coefficients: Kenward and Roger, Biometrics 53 (1997) 983, which for one contrast is Student's t with
the degrees of freedom of Giesbrecht and Burns, J. Stat. Comput. Simul. 23 (1985) 47.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, qr
from scipy.special import stdtr, stdtrit

FloatArray = npt.NDArray[np.float64]

RESIDUAL: Final = "repeats"
"""What the scatter within the finest group is called."""

_STEPS: Final = 100
_CLOSE: Final = 1e-9
_LEAST: Final = 1e-6
"""Share of the scatter of the repeats that the covariance has in every direction."""

_SINGULAR: Final = 1e-10
"""Share of an eigenvalue of the information below which a grouping cannot be told from the others."""


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval by Student's t.

    Parameters
    ----------
    value, standard_error : float
    freedom : float
        Degrees of freedom.
    """

    value: float
    standard_error: float
    freedom: float

    @cached_property
    def interval(self) -> tuple[float, float]:
        """95 %."""
        reach = float(stdtrit(self.freedom, 0.975)) * self.standard_error
        return self.value - reach, self.value + reach

    @property
    def p_value(self) -> float:
        """How often chance alone gives a value at least as far from 0."""
        if self.standard_error == 0.0:
            return 0.0 if self.value else 1.0
        return 2.0 * float(stdtr(self.freedom, -abs(self.value) / self.standard_error))


@dataclass(frozen=True, eq=False)
class MixedFit:
    """What a mixed model found.

    Parameters
    ----------
    coefficients : float array, shape (n_columns,)
    covariance : float array, shape (n_columns, n_columns)
        Of the coefficients, after Kenward and Roger.
    variances : mapping of name to float
        Of the repeats and of each grouping; one may be negative (see the module).
    unseen : tuple of str
        Groupings whose scatter these readings cannot tell from another's.
    """

    coefficients: FloatArray
    covariance: FloatArray
    variances: Mapping[str, float]
    unseen: tuple[str, ...]
    _plain: FloatArray
    _slopes: tuple[FloatArray, ...]
    _spread: FloatArray

    def contrast(self, weights: npt.ArrayLike) -> Estimate:
        """A weighted sum of the coefficients.

        Parameters
        ----------
        weights : float array, shape (n_columns,)
        """
        c = np.asarray(weights, dtype=np.float64)
        return Estimate(
            float(c @ self.coefficients), math.sqrt(max(float(c @ self.covariance @ c), 0.0)), self._freedom(c)
        )

    def new_reading(self, weights: npt.ArrayLike, shares: Mapping[str, float] | None = None) -> Estimate:
        """What a reading of a strip that was not among these will be.

        Parameters
        ----------
        weights : float array, shape (n_columns,)
            The condition of the reading, as a row of the design.
        shares : mapping of name to float, optional
            How much of each component of variance it has; all of each where left out. A mean of four readings in one
            mounting has 0.25 of that of the repeats.

        Returns
        -------
        estimate : Estimate
            Its interval is that of the reading (prediction interval).
        """
        c = np.asarray(weights, dtype=np.float64)
        share = np.array([1.0 if shares is None else shares.get(name, 1.0) for name in self.variances])
        size = np.array(list(self.variances.values()))
        added = float(share @ size)
        variance = float(c @ self.covariance @ c) + max(added, share[0] * size[0])
        return Estimate(float(c @ self.coefficients), math.sqrt(variance), self._freedom(c, share))

    def _freedom(self, c: FloatArray, shares: FloatArray | None = None) -> float:
        """Degrees of freedom by which the variance of a contrast, or of a new reading, is known (Satterthwaite)."""
        variance = float(c @ self._plain @ c)
        slope = np.array([c @ self._plain @ each @ self._plain @ c for each in self._slopes])
        if shares is not None:
            size = np.array(list(self.variances.values()))
            variance += max(float(shares @ size), float(shares[0] * size[0]))
            slope = slope + shares
        uncertain = float(slope @ self._spread @ slope)
        return max(2.0 * variance**2 / uncertain, 1.0) if uncertain > 0.0 else math.inf


def fit_mixed(readings: npt.ArrayLike, design: npt.ArrayLike, groupings: Mapping[str, Sequence[Any]]) -> MixedFit:
    """Fit a linear model whose readings share what their groups share.

    Parameters
    ----------
    readings : float array, shape (n,)
    design : float array, shape (n, n_columns)
        Of full column rank, with fewer columns than readings.
    groupings : mapping of name to sequence, length n
        The group of each reading: its strip, its mounting.

    Returns
    -------
    fit : MixedFit

    Examples
    --------
    Two strips, two readings each: the interval of the mean is that of the two means, with one degree of freedom.

    >>> fit = fit_mixed([1.0, 1.2, 2.0, 2.2], np.ones((4, 1)), {"strip": ["a", "a", "b", "b"]})
    >>> mean = fit.contrast([1.0])
    >>> round(mean.value, 3), round(mean.standard_error, 3), round(mean.freedom, 3)
    (1.6, 0.5, 1.0)
    """
    y, x = np.asarray(readings, dtype=np.float64), np.asarray(design, dtype=np.float64)
    named = {name: _indicators(members) for name, members in groupings.items()}
    unseen: list[str] = []
    while True:
        problem = _Problem.of(y, x, list(named.values()))
        information = problem.at(problem.start()).information
        vague = _vague(information)
        if vague is None:
            break
        # The finest grouping that cannot be told goes first: its scatter is then part of that of the repeats.
        name = list(named)[vague - 1]
        unseen.append(name)
        del named[name]
    found = problem.solve()
    covariance = found.adjusted()
    return MixedFit(
        coefficients=found.coefficients,
        covariance=covariance,
        variances=dict(zip([RESIDUAL, *named], found.components.tolist(), strict=True)),
        unseen=tuple(unseen),
        _plain=found.covariance,
        _slopes=tuple(found.bent),
        _spread=_inverse(found.information),
    )


def _indicators(members: Sequence[Any]) -> FloatArray:
    order = {member: place for place, member in enumerate(dict.fromkeys(members))}
    z = np.zeros((len(members), len(order)))
    z[np.arange(len(members)), [order[member] for member in members]] = 1.0
    return z


def _inverse(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _vague(information: FloatArray) -> int | None:
    """The last component that the others explain; None where all can be told."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(scale, scale)
    weakest = np.linalg.eigh(scaled)
    if len(information) == 1 or weakest.eigenvalues[0] > _SINGULAR:
        return None
    part = np.abs(weakest.eigenvectors[1:, 0])
    return int(np.flatnonzero(part > 0.1 * part.max())[-1]) + 1


@dataclass(frozen=True, eq=False)
class _At:
    """The likelihood's derivatives and the coefficients for some components of variance."""

    components: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    bent: list[FloatArray]
    twice: list[list[FloatArray]]
    score: FloatArray
    information: FloatArray
    loss: float

    def adjusted(self) -> FloatArray:
        """The covariance with what not knowing the components adds (Kenward and Roger, eq. 3)."""
        spread = _inverse(self.information)
        phi = self.covariance
        count = len(self.bent)
        more = sum(
            spread[i, j] * (self.twice[i][j] - self.bent[i] @ phi @ self.bent[j])
            for i in range(count)
            for j in range(count)
        )
        wider: FloatArray = phi + 2.0 * phi @ more @ phi
        # Far from its asymptotics the correction may fall below 0; it never makes an interval narrower.
        return wider if np.all(np.diag(wider) >= np.diag(phi) * (1.0 - 1e-9)) else phi


@dataclass(frozen=True, eq=False)
class _Problem:
    """The readings in the space of the groups, and sums of what is orthogonal to it.

    Orthogonal to all groups the covariance is ``s_0 I``, so that only sums count there: the cost hangs on the number
    of mountings, not of readings.
    """

    y: FloatArray
    x: FloatArray
    kernels: list[FloatArray]
    rest: int
    xx: FloatArray
    xy: FloatArray
    yy: float

    @classmethod
    def of(cls, y: FloatArray, x: FloatArray, groups: list[FloatArray]) -> _Problem:
        if groups:
            q, r, _ = qr(np.hstack(groups), mode="economic", pivoting=True)
            diagonal = np.abs(np.diag(r))
            q = q[:, diagonal > 1e-9 * diagonal[0]]
        else:
            q = np.zeros((len(y), 0))
        y1, x1 = q.T @ y, q.T @ x
        y2, x2 = y - q @ y1, x - q @ x1
        inside = [q.T @ z for z in groups]
        return cls(
            y=y1,
            x=x1,
            kernels=[np.eye(q.shape[1]), *(z @ z.T for z in inside)],
            rest=len(y) - q.shape[1],
            xx=x2.T @ x2,
            xy=x2.T @ y2,
            yy=float(y2 @ y2),
        )

    def start(self) -> FloatArray:
        """No scatter but that of the repeats."""
        a = self.x.T @ self.x + self.xx
        b = self.x.T @ self.y + self.xy
        left = float(self.y @ self.y) + self.yy - float(b @ np.linalg.solve(a, b))
        freedom = len(self.y) + self.rest - len(a)
        size = max(left / freedom, 1e-12 * (float(self.y @ self.y) + self.yy), 1e-300)
        return np.array([size, *([0.0] * (len(self.kernels) - 1))])

    def solve(self) -> _At:
        """Fisher's scoring, each step no further than the likelihood rises."""
        now = self.at(self.start())
        least = _LEAST**2 * float(now.components[0])  # simulated repeats do not scatter at all
        for _ in range(_STEPS):
            step = np.linalg.solve(now.information, now.score)
            length = 1.0
            while length > 1e-6:
                there = now.components + length * step
                if self._is_positive(there, least):
                    found = self.at(there)
                    if found.loss <= now.loss + 1e-12 * abs(now.loss):
                        break
                length *= 0.5
            else:
                return now
            gain, now = now.loss - found.loss, found
            if gain < _CLOSE and length == 1.0:
                break
        return now

    def _is_positive(self, components: FloatArray, least: float) -> bool:
        if components[0] < least:
            return False
        v = sum(size * kernel for size, kernel in zip(components, self.kernels, strict=True))
        try:
            np.linalg.cholesky(v - _LEAST * components[0] * np.eye(len(self.y)))
        except np.linalg.LinAlgError:
            return False
        return True

    def at(self, components: FloatArray) -> _At:
        size = float(components[0])
        v = sum(each * kernel for each, kernel in zip(components, self.kernels, strict=True))
        factor = cho_factor(v, lower=True) if len(self.y) else None
        w = cho_solve(factor, np.eye(len(self.y))) if factor is not None else np.zeros((0, 0))
        wx = w @ self.x
        a = self.x.T @ wx + self.xx / size
        phi = _inverse(a)
        beta = phi @ (wx.T @ self.y + self.xy / size)
        we = w @ (self.y - self.x @ beta)
        beyond = self.yy - 2.0 * float(beta @ self.xy) + float(beta @ self.xx @ beta)
        wk = [w @ kernel for kernel in self.kernels]
        kwx = [kernel @ wx for kernel in self.kernels]
        bent = [wx.T @ each for each in kwx]
        bent[0] = bent[0] + self.xx / size**2
        twice = [[kwx[i].T @ w @ kwx[j] for j in range(len(wk))] for i in range(len(wk))]
        twice[0][0] = twice[0][0] + self.xx / size**3
        traces = np.array([np.trace(each) for each in wk])
        traces[0] += self.rest / size
        quadratic = np.array([float(we @ kernel @ we) for kernel in self.kernels])
        quadratic[0] += beyond / size**2
        score = 0.5 * (quadratic - traces + np.array([np.sum(phi * each) for each in bent]))
        information = np.empty((len(wk), len(wk)))
        for i, first in enumerate(wk):
            for j, second in enumerate(wk):
                both = float(np.sum(first * second.T)) + (self.rest / size**2 if i == j == 0 else 0.0)
                both -= 2.0 * float(np.sum(phi * twice[i][j].T))
                information[i, j] = 0.5 * (both + float(np.sum((phi @ bent[i]) * (phi @ bent[j]).T)))
        logs = 2.0 * float(np.sum(np.log(np.diag(factor[0])))) if factor is not None else 0.0
        loss = logs + self.rest * math.log(size) + float(np.linalg.slogdet(a)[1])
        loss += float((self.y - self.x @ beta) @ we) + beyond / size
        return _At(components, beta, phi, bent, twice, score, 0.5 * (information + information.T), loss)
