"""Find the noise under which residuals are most likely, with as few terms as Bayes's criterion calls for."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.run import FloatArray
from ipmclab.statespace.columns import CONSTANTS, Columns
from ipmclab.statespace.likelihood import Likelihood, Others, likelihood
from ipmclab.statespace.terms import MOST_ORDER, Terms

_EACH: Final = 5  # readings for each lag, as for the test of the colour: with fewer a noise fits whatever there is
_WALKS: Final = (0.003, 0.01, 0.03, 0.1, 0.4)
"""Steps of a walk over the noise from which searches start, half a decade apart (convention)."""

_FADING: Final = (math.atanh(0.5), math.atanh(0.9), math.atanh(0.99))
"""Poles from which they start, as entries (convention)."""

_WHITES: Final = (0.3, 1.0, 3.0)  # white noise over the fading one from which they start (convention)
_CLOSE: Final = 3.0  # penalties of one term: covariances that far above the best are tried with fewer constants
_STEP: Final = 2e-3  # of the error of an entry
_ENOUGH: Final = 1e-5  # part of what was gained: the deviance is then known to a hundredth
_FLAT: Final = 0.02  # of the deviance for an error of an entry: the lowest is then not a hundredth below
_WIDE: Final = 0.05  # of the error of an entry: wide enough for rounding, near enough for a parabola
_LOOSE: Final = 0.01  # curvature in these units below which an entry is hardly known: 1 or 2 where it is known
_NEAR: Final = 1.0  # of the error of an entry: a search that ends farther from the lowest point is not near it
_SETTLED: Final = 1e-7  # of the error of an entry: a shorter step is rounding
_NO_NEARER: Final = 0.5  # of the step before: Newton's steps near the lowest point are much shorter (convention)
_ROUNDING: Final = 1e-3  # of the error of an entry: a step that is no shorter than the one before, but that short
_BENT: Final = 2  # steps after which the curvature is that of the lowest point (convention)
MOST_STEPS: Final = 8
"""Newton's steps to the lowest point: each leaves a hundredth of the way."""

NEARLY: Final = 1
"""Steps where the deviance alone counts: one leaves it a ten-thousandth above the lowest."""
_IMPOSSIBLE: Final = 1e9  # height of a shape under which the readings cannot be


class Allowed(NamedTuple):
    """What may be a term.

    Parameters
    ----------
    offset, trend : bool
        Not where they are unknowns of the fit already.
    walk : bool
        Not where rows that hold nothing but the noise do not walk.
    """

    offset: bool = True
    trend: bool = True
    walk: bool = True


@dataclass(frozen=True, eq=False)
class Found:
    """Terms, and the shape that makes the readings most likely."""

    terms: Terms
    entries: FloatArray
    likelihood: Likelihood

    @property
    def criterion(self) -> float:
        """Bayes's information criterion."""
        return self.likelihood.criterion


def refine(
    columns: Columns, others: FloatArray, terms: Terms, starts: Iterable[FloatArray], steps: int = MOST_STEPS
) -> Found:
    """The most likely shape of given terms, from the best of some starts.

    Parameters
    ----------
    columns : Columns
    others : float array, shape (n_directions + 1, n_directions + 1)
        What all other readings add to the normal equations.
    terms : Terms
    starts : iterable of float array, shape (terms.shapes,)
    steps : int
        Of Newton's at most, from where the search ends to the lowest point itself.
    """
    beside = Others(others)
    return _to_the_end(columns, beside, _refine(columns, beside, terms, starts), steps)


def _refine(columns: Columns, others: Others, terms: Terms, starts: Iterable[FloatArray]) -> Found:
    tried = [(likelihood(columns, others, terms, start), start) for start in starts]
    first, entries = min(tried, key=lambda pair: pair[0].deviance)
    if not terms.shapes or not math.isfinite(first.deviance):
        return Found(terms, entries, first)
    entries = _descend(_heights(columns, others, terms, first), entries, terms.bounds, math.sqrt(columns.count))
    return Found(terms, entries, likelihood(columns, others, terms, entries, first.variance))


def _to_the_end(columns: Columns, others: Others, found: Found, steps: int = MOST_STEPS) -> Found:
    """The lowest point itself: where near it a search has stopped depends on the last bits of the arithmetic."""
    if not len(found.entries) or not math.isfinite(found.likelihood.deviance):
        return found
    height = _heights(columns, others, found.terms, found.likelihood)
    entries = settled(height, found.entries, found.terms.bounds, math.sqrt(columns.count), steps)
    own = likelihood(columns, others, found.terms, entries, found.likelihood.variance)
    return Found(found.terms, entries, own)


def _heights(columns: Columns, others: Others, terms: Terms, first: Likelihood) -> Callable[[FloatArray], float]:
    """By how much the deviance of other shapes is above that of a first one."""

    def above(point: FloatArray) -> float:
        height = likelihood(columns, others, terms, point, first.variance).deviance - first.deviance
        return height if height < _IMPOSSIBLE else _IMPOSSIBLE  # differences of infinities are no numbers

    return above


def _descend(
    height: Callable[[FloatArray], float], start: FloatArray, bounds: list[tuple[float, float]], sharp: float
) -> FloatArray:
    """The lowest point, in units in which an entry is known to 1, as of correlations; of a walk it is known less."""
    from scipy.optimize import minimize

    options = {"eps": _STEP, "ftol": _ENOUGH, "gtol": _FLAT, "maxiter": 40}
    found = minimize(
        lambda point: height(point / sharp),
        start * sharp,
        method="L-BFGS-B",
        bounds=[(low * sharp, high * sharp) for low, high in bounds],
        options=options,
    )
    return np.asarray(found.x / sharp)


def settled(
    height: Callable[[FloatArray], float],
    start: FloatArray,
    bounds: list[tuple[float, float]],
    sharp: float,
    steps: int = MOST_STEPS,
) -> FloatArray:
    """The lowest point, from one near it, by Newton's steps on parabolas through heights around.

    An entry at its bound stays there, and so does what hardly changes the height. A start that turns out not to be near
    is the answer.

    Parameters
    ----------
    height : function of float array
    start : float array, shape (n,)
    bounds : list of (float, float)
    sharp : float
        One over the error of an entry.
    steps : int
        At most.

    Examples
    --------
    >>> bowl = lambda point: float(np.sum((point - 1.0) ** 4 + (point - 1.0) ** 2))
    >>> found = settled(bowl, np.array([1.3]), [(0, 2)], 1)
    >>> found.round(6).tolist()
    [1.0]
    """
    low, high = (np.array(side) * sharp for side in zip(*bounds, strict=True))
    point = start * sharp
    free = np.flatnonzero((point > low) & (point < high))
    before = math.inf
    for number in range(steps):
        around = _Around(lambda moved: height(moved / sharp), point, free)
        slope = around.slope
        if number < _BENT:
            values, vectors = np.linalg.eigh(around.curvature)
            felt = values > _LOOSE
        step = np.zeros(len(point))
        step[free] = -vectors[:, felt] @ ((vectors[:, felt].T @ slope) / values[felt])
        length = float(np.linalg.norm(step))
        if not length < _NEAR or ((point + step < low) | (point + step > high)).any():
            return start
        if length > _NO_NEARER * before:
            return start if length > _ROUNDING else np.asarray(point / sharp)
        point, before = point + step, length
        if length < _SETTLED:
            break
    return np.asarray(point / sharp)


class _Around:
    """Slopes and curvatures by some entries, from heights around a point."""

    def __init__(self, height: Callable[[FloatArray], float], point: FloatArray, free: npt.NDArray[np.intp]) -> None:
        self._height, self._point = height, point
        self._moves = _WIDE * np.eye(len(point))[free]
        self._above = np.array([height(point + move) for move in self._moves])
        self._below = np.array([height(point - move) for move in self._moves])

    @property
    def slope(self) -> FloatArray:
        """By each entry."""
        return np.asarray((self._above - self._below) / (2.0 * _WIDE))

    @property
    def curvature(self) -> FloatArray:
        """By each two of them."""
        middle, moves, above = self._height(self._point), self._moves, self._above
        found = np.diag((above - 2.0 * middle + self._below) / _WIDE**2)
        for i, j in itertools.combinations(range(len(moves)), 2):
            both = self._height(self._point + moves[i] + moves[j]) - above[i] - above[j] + middle
            found[i, j] = found[j, i] = both / _WIDE**2
        return found


def rough_noise(columns: Columns, others: FloatArray, allowed: Allowed) -> Found:
    """A noise that comes near to most: offset, trend, and white noise in addition to a correlation that fades."""
    terms = Terms(order=1, white=True, offset=allowed.offset, trend=allowed.trend)
    starts = [np.array([one, math.log(white)]) for one, white in itertools.product(_FADING, _WHITES)]
    return refine(columns, others, terms, starts)


def choose_terms(columns: Columns, others: FloatArray, allowed: Allowed) -> Found:
    """The terms that Bayes's criterion prefers.

    First covariances with every constant that is allowed, so that no drift passes for correlation; then the good ones
    among them with fewer constants.

    Parameters
    ----------
    columns : Columns
    others : float array, shape (n_directions + 1, n_directions + 1)
    allowed : Allowed
    """
    search = _Search(columns, others)
    every = Terms(offset=allowed.offset, trend=allowed.trend)
    found = [search.refine(every, [np.zeros(0)])]
    partials = _partials(columns)
    for order in range(1, min(MOST_ORDER, columns.count // _EACH) + 1):
        starts = [np.arctanh(partials[:order])] + ([np.append(found[-1].entries, 0.0)] if order > 1 else [])
        found.append(search.refine(replace(every, order=order), starts))
        if found[-1].criterion > found[-2].criterion:
            break
    best = _best(found)
    for base in {one.terms.order: one for one in (found[0], best)}.values() if allowed.walk else ():
        starts = [np.append(base.entries, math.log(walk)) for walk in _WALKS]
        found += search.if_promising(replace(base.terms, walk=True), starts, base)
    if best.terms.order:
        slow = [*found[1].entries, *_FADING[1:]]
        starts = [np.array([one, math.log(white)]) for one, white in itertools.product(slow, _WHITES)]
        mixed = search.if_promising(replace(every, order=1, white=True), starts, _best(found))
        found += mixed
        for base in mixed if allowed.walk else ():
            starts = [np.array([base.entries[0], math.log(walk), base.entries[1]]) for walk in _WALKS]
            found += search.if_promising(replace(base.terms, walk=True), starts, base)
    limit = _best(found).criterion + _CLOSE * search.penalty
    for one in [one for one in found if one.criterion < limit]:
        found += [search.refine(fewer, [one.entries]) for fewer in _fewer(one.terms)]
    return _to_the_end(columns, search.others, _best(found))


class _Search:
    """Tries terms on one output of one run."""

    def __init__(self, columns: Columns, others: FloatArray) -> None:
        self.columns, self.others = columns, Others(others)
        self.penalty = math.log(columns.count)

    def refine(self, terms: Terms, starts: Iterable[FloatArray]) -> Found:
        """Terms at their best."""
        return _refine(self.columns, self.others, terms, starts)

    def if_promising(self, terms: Terms, starts: Iterable[FloatArray], base: Found) -> list[Found]:
        """Terms at their best, if some start is as likely as what there is."""
        tried = [(likelihood(self.columns, self.others, terms, start).deviance, start) for start in starts]
        deviance, start = min(tried, key=lambda pair: pair[0])
        same = terms.constants == base.terms.constants
        return [] if same and deviance > base.likelihood.deviance else [self.refine(terms, [start])]


def _fewer(terms: Terms) -> list[Terms]:
    """The same covariance with fewer constants; a walk keeps its offset, which is where it starts."""
    less = []
    if terms.trend:
        less.append(replace(terms, trend=False))
    if terms.offset and not terms.walk:
        less.append(replace(terms, trend=False, offset=False))
    return less


def _best(found: Iterable[Found]) -> Found:
    return min(found, key=lambda one: one.criterion)


def _partials(columns: Columns) -> FloatArray:
    """Partial autocorrelations of the residual as it is, for a start (Durbin's recursion on the autocovariances)."""
    residual = columns.matrix[:, -1]
    constants = columns.matrix[:, :CONSTANTS]
    residual = residual - constants @ np.linalg.lstsq(constants, residual, rcond=None)[0]
    longer = np.concatenate([residual, np.zeros(MOST_ORDER)])  # of three readings no two are four steps apart
    covariances = np.array([longer[lag : lag + len(residual)] @ residual for lag in range(MOST_ORDER + 1)])
    correlations = covariances / max(covariances[0], 1e-300)
    coefficients = np.zeros(0)
    partials = np.zeros(MOST_ORDER)
    for order in range(MOST_ORDER):
        above = correlations[order + 1] - coefficients @ correlations[order:0:-1]
        below = 1.0 - coefficients @ correlations[1 : order + 1]
        partial = float(np.clip(above / max(below, 1e-9), -0.99, 0.99))
        coefficients = np.append(coefficients - partial * coefficients[::-1], partial)
        partials[order] = partial
    return partials
