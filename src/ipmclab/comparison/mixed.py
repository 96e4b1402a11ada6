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
from scipy.special import stdtr, stdtrit

from ipmclab.comparison.mixed_blocks import FloatArray, blocks_of, padded, rotated, turned

RESIDUAL: Final = "repeats"
"""What the scatter within the finest group is called."""

_STEPS: Final = 100
_CLOSE: Final = 1e-9
_LEAST: Final = 1e-3
"""Share of the scatter of the repeats that the covariance has in every direction.

Where chance makes groups far more alike than repeats are, the likelihood rises up to a singular covariance, and every
interval depends on how near to it the search came: by 1e-6, one campaign in 25 had intervals that rounding decided. By
1e-3 they are the same to 1e-7 of their width, and hold the truth as often.
"""

_SINGULAR: Final = 1e-10
"""Share of an eigenvalue of the information below which a grouping cannot be distinguished from the others."""


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
        Groupings whose scatter these readings cannot distinguish from another's.
    """

    coefficients: FloatArray
    covariance: FloatArray
    variances: Mapping[str, float]
    unseen: tuple[str, ...]
    _plain: FloatArray
    _slopes: tuple[FloatArray, ...]
    _covariance: FloatArray

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
        uncertain = float(slope @ self._covariance @ slope)
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
        vague = problem.vague()
        if vague is None:
            break
        # The finest grouping that cannot be determined goes first: its scatter is then part of that of the repeats.
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
        _covariance=_covariance_of(found.information),
    )


def _indicators(members: Sequence[Any]) -> FloatArray:
    order = {member: place for place, member in enumerate(dict.fromkeys(members))}
    z = np.zeros((len(members), len(order)))
    z[np.arange(len(members)), [order[member] for member in members]] = 1.0
    return z


def _covariance_of(information: FloatArray) -> FloatArray:
    """Covariance of the components; where nothing distinguishes two of them, of what is reported."""
    return np.asarray(np.linalg.pinv(information, hermitian=True), dtype=np.float64)


def _step(information: FloatArray, score: FloatArray) -> FloatArray:
    """Where the score leads, and nowhere along a direction of which the readings say nothing.

    Where the covariance is nearly singular along a direction that two components share, as a strip with one mounting
    has, both have the same information to the last digit: only their sum can move. Eigenvalues of a symmetric matrix
    exist always, and their scale is that of information about one component alone.
    """
    own = np.diag(information)
    scale = np.zeros(len(own))
    scale[own > 0.0] = 1.0 / np.sqrt(own[own > 0.0])
    size, ways = np.linalg.eigh(information * np.outer(scale, scale))
    known = size > _SINGULAR * max(size[-1], 0.0)
    return np.asarray(scale * (ways[:, known] @ (ways[:, known].T @ (scale * score) / size[known])), dtype=np.float64)


def _inverse(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


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
        covariance = _covariance_of(self.information)
        phi = self.covariance
        count = len(self.bent)
        more = sum(
            covariance[i, j] * (self.twice[i][j] - self.bent[i] @ phi @ self.bent[j])
            for i in range(count)
            for j in range(count)
        )
        wider: FloatArray = phi + 2.0 * phi @ more @ phi
        # Far from its asymptotics the correction may fall below 0; it never makes an interval narrower.
        return wider if np.all(np.diag(wider) >= np.diag(phi) * (1.0 - 1e-9)) else phi


@dataclass(frozen=True, eq=False)
class _Problem:
    """The readings in the space of the groups, block by block, and sums of what is orthogonal to it.

    Blocks are runs that share a group with each other and with no others: strips. Orthogonal to all groups the
    covariance is ``s_0 I``, so that only sums count there: the cost depends on the number of mountings, not of
    readings. Blocks have as many rows as the largest; what they have too many are zeros, which ``rest`` counts off.
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
        blocks = [rotated(y[rows], x[rows], [z[rows] for z in groups]) for rows in blocks_of(len(y), groups)]
        most = max(len(block.y) for block in blocks)
        filled = [[padded(part, most) for part in (block.y[:, None], block.x, *block.inside)] for block in blocks]
        inside = [np.stack([block[2 + place] for block in filled]) for place in range(len(groups))]
        return cls(
            y=np.stack([block[0][:, 0] for block in filled]),
            x=np.stack([block[1] for block in filled]),
            kernels=[np.broadcast_to(np.eye(most), (len(blocks), most, most)), *(z @ turned(z) for z in inside)],
            rest=len(y) - len(blocks) * most,
            xx=sum((block.xx for block in blocks), np.zeros((x.shape[1], x.shape[1]))),
            xy=sum((block.xy for block in blocks), np.zeros(x.shape[1])),
            yy=sum(block.yy for block in blocks),
        )

    def start(self) -> FloatArray:
        """No scatter but that of the repeats."""
        a = np.einsum("bij,bik->jk", self.x, self.x) + self.xx
        b = np.einsum("bij,bi->j", self.x, self.y) + self.xy
        whole = float(np.sum(self.y**2)) + self.yy
        left = whole - float(b @ np.linalg.solve(a, b))
        size = max(left / (self.y.size + self.rest - len(a)), 1e-12 * whole, 1e-300)
        return np.array([size, *([0.0] * (len(self.kernels) - 1))])

    def vague(self) -> int | None:
        """The last component that the design or the other components explain; None where all can be determined."""
        at = self.at(self.start())
        if len(self.kernels) == 1:
            return None
        whole = np.array([0.5 * float(np.sum(kernel**2)) for kernel in self.kernels]) / at.components[0] ** 2
        whole[0] += 0.5 * self.rest / at.components[0] ** 2
        explained = np.flatnonzero(np.diag(at.information)[1:] < _SINGULAR * whole[1:])
        if len(explained):
            return int(explained[-1]) + 1
        scale = np.sqrt(whole)
        weakest = np.linalg.eigh(at.information / np.outer(scale, scale))
        if weakest.eigenvalues[0] > _SINGULAR:
            return None
        part = np.abs(weakest.eigenvectors[1:, 0])
        return int(np.flatnonzero(part > 0.1 * part.max())[-1]) + 1

    def solve(self) -> _At:
        """Fisher's scoring, each step no further than the likelihood rises."""
        now = self.at(self.start())
        least = _LEAST**2 * float(now.components[0])  # simulated repeats do not scatter at all
        for _ in range(_STEPS):
            step, length = _step(now.information, now.score), 1.0
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
        return bool(np.all(np.linalg.eigvalsh(self._covariance(components)) > _LEAST * components[0]))

    def _covariance(self, components: FloatArray) -> FloatArray:
        covariance: FloatArray = np.einsum("k,kbij->bij", components, np.stack(self.kernels))
        return covariance

    def at(self, components: FloatArray) -> _At:
        size = float(components[0])
        v = self._covariance(components)
        w = _inverse(v)
        wx = w @ self.x
        a = np.einsum("bij,bik->jk", self.x, wx) + self.xx / size
        phi = _inverse(a)
        beta = phi @ (np.einsum("bij,bi->j", wx, self.y) + self.xy / size)
        left = self.y - self.x @ beta
        we = np.einsum("bij,bj->bi", w, left)
        beyond = max(self.yy - 2.0 * float(beta @ self.xy) + float(beta @ self.xx @ beta), 0.0)
        wk = [w @ kernel for kernel in self.kernels]
        kwx = [kernel @ wx for kernel in self.kernels]
        bent = [np.einsum("bij,bik->jk", wx, each) for each in kwx]
        bent[0] = bent[0] + self.xx / size**2
        twice = [[np.einsum("bij,bik->jk", first, w @ second) for second in kwx] for first in kwx]
        twice[0][0] = twice[0][0] + self.xx / size**3
        traces = np.array([float(np.einsum("bii->", each)) for each in wk])
        traces[0] += self.rest / size
        quadratic = np.array([float(np.einsum("bi,bij,bj->", we, kernel, we)) for kernel in self.kernels])
        quadratic[0] += beyond / size**2
        score = 0.5 * (quadratic - traces + np.array([float(np.sum(phi * each)) for each in bent]))
        information = np.empty((len(wk), len(wk)))
        for i, first in enumerate(wk):
            for j, second in enumerate(wk):
                both = float(np.sum(first * turned(second))) + (self.rest / size**2 if i == j == 0 else 0.0)
                both -= 2.0 * float(np.sum(phi * twice[i][j].T))
                information[i, j] = 0.5 * (both + float(np.sum((phi @ bent[i]) * (phi @ bent[j]).T)))
        loss = float(np.sum(np.linalg.slogdet(v)[1])) + self.rest * math.log(size)
        loss += float(np.linalg.slogdet(a)[1]) + float(np.sum(left * we)) + beyond / size
        return _At(components, beta, phi, bent, twice, score, 0.5 * (information + information.T), loss)
