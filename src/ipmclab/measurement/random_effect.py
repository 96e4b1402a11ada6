"""Several estimates of what differs from one to the next: how far it strays, and where the next one will lie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.run import FloatArray

FEWEST: Final = 3
"""Members from which a next one is predicted: two show no standard deviation that could be relied on."""

_NODES: Final = 600
_BELOW, _ABOVE = 80.0, 28.0  # about the logarithm of what the estimates show: where the variance between is looked for
_NEGLIGIBLE: Final = 1e-9  # confidence


@dataclass(frozen=True)
class RandomEffect:
    """Members of a group that are distributed normally, each estimated with an error of its own.

    Parameters
    ----------
    mean : float
        Of the group.
    between : float
        Standard deviation from one member to the next, the errors taken off.
    p_value : float
        Probability of estimates as far apart as these if all members were equal.
    next_one : pair of float or None
        Where the next member's true value lies with a probability of 95 %; None with fewer than three members.
    """

    mean: float
    between: float
    p_value: float
    next_one: tuple[float, float] | None


def random_effect(values: npt.ArrayLike, errors: npt.ArrayLike, *, common: float = 0.0) -> RandomEffect:
    """The group behind some estimates, and its next member.

    With weights 1/(errors^2 + t) the weighted squares Q(t) about the weighted mean follow chi-square with one degree
    fewer than there are members where t is the variance between, whatever that is. So P(chi-square > Q(t)) is the
    confidence that the variance is below t (Viechtbauer 2007), and Q(t) equals its degrees at the estimate (Paule and
    Mandel 1982). The next member is the mixture, over that confidence, of normal distributions about the weighted
    mean with variance t + 1/sum of weights (the way of Nagashima, Noma and Furukawa 2019, with mean and variance under
    the same t). Without errors this is Student's interval, mean +- t s sqrt(1 + 1/n).

    An error that all estimates share moves them together: it leaves Q(t) and the weights as they are, and adds its
    variance to that of the mean. So each normal distribution of the mixture is wider by it: the two are convolved,
    which is exact, where adding squares of half widths is not, with tails as unlike as Student's and the normal one's.
    No interval of such a sum is narrower than that of the common error alone.

    Parameters
    ----------
    values, errors : float array, shape (n_member,)
        At least two estimates with the standard errors that are independent from one to the next.
    common : float
        Standard error that all estimates share.

    Examples
    --------
    >>> found = random_effect([1.0, 2.0, 4.0], [1e-9, 1e-9, 1e-9])
    >>> round(found.mean, 3), round(found.between, 3), [round(end, 2) for end in found.next_one]
    (2.333, 1.528, [-5.26, 9.92])
    """
    from scipy.optimize import brentq
    from scipy.special import chdtrc

    y, own = np.asarray(values, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    freedom = len(y) - 1
    rounding = 8.0 * np.finfo(np.float64).eps * float(np.abs(y).max())
    scale = float(max(np.ptp(y), own.max()))
    if scale <= rounding:
        alone = float(y[0])
        reach = NORMAL_95 * common
        return RandomEffect(alone, 0.0, 1.0, (alone - reach, alone + reach) if len(y) >= FEWEST else None)
    # In units of what they show, from the first of them: squares then stay numbers whatever the estimates are.
    beyond, within = (y - y[0]) / scale, np.square(own / scale)
    size = float(np.log(float(np.ptp(beyond)) ** 2 + float(within.max())))
    ends = size - _BELOW, size + _ABOVE

    def excess(exponent: float) -> float:
        return float(_squares(beyond, within, np.array([np.exp(exponent)]))[2][0]) - freedom

    variance = float(np.exp(brentq(excess, *ends))) if excess(ends[0]) > 0.0 else 0.0
    mean = float(_squares(beyond, within, np.array([max(variance, np.exp(ends[0]))]))[0][0])
    p_value = float(chdtrc(freedom, excess(ends[0]) + freedom))
    next_one = None
    if len(y) >= FEWEST:
        share, means, deviations = _next_one(beyond, within, ends)
        unit = max(scale, common)
        deviations = np.hypot(deviations * (scale / unit), common / unit)
        low, high = _quantiles(share, means * (scale / unit), deviations)
        next_one = float(y[0]) + unit * low, float(y[0]) + unit * high
    return RandomEffect(float(y[0]) + scale * mean, scale * float(np.sqrt(variance)), p_value, next_one)


def _squares(y: FloatArray, within: FloatArray, between: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weighted mean, its variance, and the weighted squares about it, for each variance between."""
    weights = 1.0 / (within + between[:, None])
    total = weights.sum(axis=1)
    means = weights @ y / total
    return means, 1.0 / total, (weights * (y - means[:, None]) ** 2).sum(axis=1)


def _next_one(
    y: FloatArray, within: FloatArray, ends: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The next member as a mixture of normal distributions: their shares, means and standard deviations."""
    from scipy.special import chdtrc

    def below(edges: FloatArray) -> FloatArray:
        return np.asarray(chdtrc(len(y) - 1, _squares(y, within, edges)[2]))

    coarse = np.exp(np.linspace(*ends, _NODES))
    log_below = below(coarse)
    first = min(max(int(np.searchsorted(log_below, log_below[0] + _NEGLIGIBLE)) - 1, 0), _NODES - 2)
    last = max(min(int(np.searchsorted(log_below, 1.0 - _NEGLIGIBLE)), _NODES - 1), first + 1)
    edges = np.geomspace(coarse[first], coarse[last], _NODES)
    # What lies below the first edge is as good as none.
    nodes = np.concatenate([coarse[:1], np.sqrt(edges[:-1]) * np.sqrt(edges[1:]), edges[-1:]])
    share = np.diff(np.concatenate([[0.0], below(edges), [1.0]]))
    means, errors, _ = _squares(y, within, nodes)
    return share, means, np.sqrt(nodes + errors)


def _quantiles(share: FloatArray, means: FloatArray, deviations: FloatArray) -> tuple[float, float]:
    """Between which a mixture of normal distributions lies with a probability of 95 %."""
    from scipy.optimize import brentq
    from scipy.special import ndtr

    def missing(end: float, part: float) -> float:
        return float(share @ ndtr((end - means) / deviations)) - part

    reach = 40.0 * float(deviations.max())
    bracket = float(means.min()) - reach, float(means.max()) + reach
    near = 1e-9 * float(share @ deviations)
    low, high = (float(brentq(missing, *bracket, args=(part,), xtol=near)) for part in (0.025, 0.975))
    return low, high
