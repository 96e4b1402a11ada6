"""The interval of a parameter: from the curvature where that describes the likelihood, else from its profile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.fit import DETERMINED
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.descent import shorter
from ipmclab.identification.search.solve import AT_BOUND
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.uncertainty.covariance import Uncertainty
from ipmclab.identification.uncertainty.profile import Walk
from ipmclab.model.declared import is_curved, is_of_circuit
from ipmclab.run import FloatArray

_CURVED: Final = 0.05  # standard error of a logarithm above which the likelihood's profile is followed
_BENT: Final = 0.15  # the same for what is no logarithm, as a part of its value
_COSTLY: Final = 0.7  # and above which, with more than a circuit, whose runs are costly, it is open without asking
_TWO_ERRORS: Final = 2.0 * DETERMINED  # how far apart minima lie that are still the same answer
_SURE_AT_BOUNDS: Final = 0.995  # of the probability, up to each end
_OPEN_EDGE: Final = 0.3  # part of what is known of an edge beforehand that the readings leave of it
_LEFT_OUT: Final = 0.05  # of the probability, beyond both ends together
_TAILS: Final = (0.025, 0.03, 0.035, 0.04)  # of it beyond the end that lies farther off
_EVEN: Final = 1.1  # ratio of the two sides below which they count as equal
_FIRST: Final = 1.0  # of an entry: the first step away from a bound
_WIDENED: Final = 4  # times at most that the noise along a way makes it longer


@dataclass(frozen=True)
class Interval:
    """What is known of one unknown.

    Parameters
    ----------
    low, high : float
        Values [SI], or of its scale; infinite, or the end of what is possible, on an open side.
    error : float
        Standard error of the entry towards the side on which the likelihood falls faster: of its
        logarithm. Infinite where a side is open, where the profile was not followed, and for what is no logarithm.
    ends : tuple of float array, shape (n_unknown,)
        All entries where the profile of an undetermined parameter of the circuit ends, every fixed value exact. That of
        a coupling ends at a zero beside a pole slower than every record; d(0) is a product of powers and needs none.
    allowed : tuple of float
        Values that the profile allows where 2.5 % lie beyond either end, and the interval itself: another fit as good
        between them says nothing new. Left out: the interval.
    """

    low: float
    high: float
    error: float = math.inf
    ends: tuple[FloatArray, ...] = ()
    allowed: tuple[float, float] = (math.inf, -math.inf)

    def is_left_by(self, unknown: Unknown, rival: Rival) -> bool:
        """Whether another fit that is as good leaves what this one allows: one within it says nothing new."""
        if unknown.name not in rival.entries:
            return False
        entry, reach = rival.entries[unknown.name], rival.reach[unknown.name]
        low, high = values_within_bounds(unknown, entry - reach, entry + reach)
        return low < min(self.low, self.allowed[0]) or high > max(self.high, self.allowed[1])


def interval_of(
    correlated: Correlated, found: Uncertainty, number: int, error: float, *, open_edges: bool, followed: bool = True
) -> Interval:
    """The 95 % interval of one unknown.

    Parameters
    ----------
    correlated : Correlated
        The solution, and the noise found in its residuals.
    found : Uncertainty
    number : int
        Of it among those that were asked for.
    error : float
        Its relative standard error, infinite where an open direction moves it.
    open_edges : bool
        Whether an edge lies anywhere between its rows.
    followed : bool
        Whether a bent one is followed along its profile, which takes half of the time of a fit; else its curvature
        counts.
    """
    from scipy.special import stdtrit

    problem, solution = correlated.problem, correlated.solution
    place, unknown = problem.asked[number]
    entry = float(solution.theta[place])
    variance, freedom = float(found.covariance[number, number]), float(found.freedom[number])
    # The standard error of a logarithm above which an interval is open without asking. Runs of a circuit alone take
    # little time; of all else a walk takes seconds, and where it is that long its end is no answer. What a strip shows
    # whatever its parameters are (d(0), a stiffness, a resonance) is a product of powers of these: its error needs no
    # profile. What is known beforehand ends every profile.
    ends = problem.is_circuit or any(one.beforehand is not None for one in problem.unknowns)
    hopeless = math.inf if ends else _COSTLY
    if followed and unknown.log and is_at_bound(unknown, entry) and math.isinf(hopeless):
        return _from_its_bound(correlated, unknown, place, float(stdtrit(freedom, 1.0 - 0.5 * _LEFT_OUT)))
    if math.isinf(error) or (unknown.log and found.plain[number, number] > hopeless**2):
        return Interval(*open_ends(unknown))
    # An edge that lies just where its rows still allow it (on a row) is no rare case: nearer to 99 % of the others.
    level = _SURE_AT_BOUNDS if unknown.log and open_edges else 1.0 - 0.5 * _LEFT_OUT
    reach = float(stdtrit(freedom, level)) * math.sqrt(variance)
    curved = math.sqrt(variance) > (_CURVED if unknown.log else _BENT * abs(entry))
    if not followed or not curved or not (unknown.log or is_curved(unknown.base)):
        return Interval(*values_within_bounds(unknown, entry - reach, entry + reach))
    if not unknown.log and math.sqrt(variance) > DETERMINED * unknown.size(unknown.value(entry)):
        return Interval(*values_within_bounds(unknown, -math.inf, math.inf))
    plain = float(found.plain[number, number])
    # How the squares rise on either side of the value shows in means of the rows as well.
    walks = tuple(Walk(*shorter(problem, solution), place, side * math.sqrt(plain)) for side in (-1.0, 1.0))
    wider = math.sqrt(max(variance / plain, 1.0))
    tails = _TAILS if level < _SURE_AT_BOUNDS else (1.0 - level,)
    (down, up), even = _shortest(walks, freedom, wider, tails)
    low, high = values_within_bounds(unknown, entry - down, entry + up)
    allowed = values_within_bounds(unknown, entry - even[0], entry + even[1])
    is_open = not unknown.log or math.isinf(down) or math.isinf(up)
    nearer = math.inf if is_open else min(walk.crossed(wider) for walk in walks)
    is_known = nearer <= DETERMINED and not is_too_wide(unknown, (low, high))
    if is_known or not is_of_circuit(unknown.base):
        return Interval(low, high, nearer, allowed=allowed)
    # What else is uncertain (a fixed value) does not move along the profile.
    height = float(stdtrit(freedom, 1.0 - 0.5 * _LEFT_OUT)) * math.sqrt(max(found.of_readings[number] / plain, 1.0))
    return Interval(low, high, nearer, tuple(walk.end(walk.distance(height)) for walk in walks), allowed)


def _from_its_bound(correlated: Correlated, unknown: Unknown, place: int, height: float) -> Interval:
    """The interval of a parameter that went to where the search ends: from there to where the readings object.

    At its bound it is not felt, so that no curvature says how far it may come back. How much the noise moves the
    readings along the way is asked where the way ends. Fixed values are taken as exact.
    """
    problem, solution = correlated.problem, correlated.solution
    entry = float(solution.theta[place])
    inwards = 1.0 if entry - unknown.limits[0] < unknown.limits[1] - entry else -1.0
    # Means are a guide; what they end at is asked of all rows.
    walk = Walk(*shorter(problem, solution), place, inwards * _FIRST, farthest=math.inf)
    wider = 1.0
    away, end = math.inf, solution.theta
    for _ in range(_WIDENED):
        away = walk.distance(height * wider)
        end = walk.end(away)
        found = math.sqrt(correlated.inflation(problem.evaluate(end).residual - solution.evaluation.residual))
        if math.isinf(away) or found < _EVEN * wider:
            break
        wider = found
    low, high = sorted((entry, entry + inwards * away))
    return Interval(*values_within_bounds(unknown, low, high), ends=(end,))


def _shortest(
    walks: Sequence[Walk], freedom: float, wider: float, tails: Sequence[float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """How far down and up the shortest interval reaches that holds 95 %, and the one of equal tails.

    The root of the excess is distributed as a standard normal (here as Student's t) whatever the parameter is called,
    so any two of its quantiles that leave out 5 % together make an interval. Where the likelihood falls slowly to one
    side, as that of a reciprocal does, equal tails would spend most of the length there; the shortest gives that side
    less of the probability (the shortest interval of a pivot: Casella and Berger, Statistical Inference, 9.3.1).
    """
    from scipy.special import stdtrit

    def end(walk: Walk, tail: float) -> float:
        return walk.distance(-float(stdtrit(freedom, tail)) * wider)

    even = end(walks[0], tails[0]), end(walks[1], tails[0])
    if len(tails) == 1 or math.isinf(min(even)) or max(even) < _EVEN * min(even):
        return even, even
    turned = even[0] > even[1]
    near, far = walks[::-1] if turned else walks
    if math.isinf(end(far, tails[-1])):
        return even, even  # open, however much of the probability lies beyond that end
    nearer, farther = min(((end(near, _LEFT_OUT - tail), end(far, tail)) for tail in reversed(tails)), key=sum)
    return ((farther, nearer) if turned else (nearer, farther)), even


def open_ends(unknown: Unknown) -> tuple[float, float]:
    """The interval of a parameter of which nothing is known; a share ends at one."""
    return (
        0.0 if unknown.log or unknown.lower == 0.0 else -math.inf,
        unknown.upper if unknown.upper == 1.0 and not unknown.log else math.inf,
    )


def has_open_end(unknown: Unknown, interval: tuple[float, float]) -> bool:
    """Whether nothing limits a parameter on one side: a value would say more than is known."""
    return math.isinf(interval[0]) or math.isinf(interval[1]) or (unknown.log and interval[0] == 0.0)


def is_too_wide(unknown: Unknown, interval: tuple[float, float]) -> bool:
    """Whether the ends of an interval lie further apart than those of a reciprocal that is just determined.

    The side on which the likelihood falls faster decides whether a parameter is determined, since some are known evenly
    as their reciprocal. Of that with an error of ``DETERMINED`` the ends have this ratio.
    """
    even = NORMAL_95 * DETERMINED
    low, high = interval
    return unknown.log and high * (1.0 - even) > low * (1.0 + even)


def values_within_bounds(unknown: Unknown, low: float, high: float) -> tuple[float, float]:
    """The values of two entries, of which an infinite one leaves that side open, up to a bound that means something.

    How far a fit looks for a parameter (1e9 ohm m) means nothing: an entry there is an open side too. What is known
    beforehand, and the rows between which an edge lies, do mean something.
    """
    open_low, open_high = open_ends(unknown)
    least, most = unknown.limits
    if unknown.log:
        least, most = least + AT_BOUND, most - AT_BOUND
    if unknown.prior is not None or unknown.base.startswith("observation."):
        least, most = -math.inf, math.inf
    return (open_low if low <= least else unknown.value(low), open_high if high >= most else unknown.value(high))


def edges_are_open(asked: Sequence[Unknown], found: Uncertainty) -> bool:
    """Whether an edge lies anywhere between its rows for all that the readings show."""
    return any(
        unknown.base == "observation.delay"
        and unknown.prior is not None
        and math.sqrt(variance) > _OPEN_EDGE * unknown.prior[1]
        for unknown, variance in zip(asked, found.plain.diagonal(), strict=True)
    )


def is_at_bound(unknown: Unknown, entry: float) -> bool:
    """Whether an entry is where the search ends."""
    lower, upper = unknown.limits
    return entry - lower < AT_BOUND or upper - entry < AT_BOUND


def with_rivals(
    unknown: Unknown, entry: float, interval: tuple[float, float], others: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], bool]:
    """The interval widened to other fits that are as good and as far as each reaches, and whether they agree."""
    ends = [values_within_bounds(unknown, other - reach, other + reach) for other, reach in others]
    size = unknown.size(unknown.value(entry))
    distances = [abs(other - entry) / size for other, _ in others if unknown.log or is_curved(unknown.base)]
    low, high = min([interval[0], *(low for low, _ in ends)]), max([interval[1], *(high for _, high in ends)])
    return (low, high), all(gap <= _TWO_ERRORS for gap in distances)


def half_width(unknown: Unknown, interval: tuple[float, float]) -> float:
    """Of an interval, in entries."""
    low, high = interval
    if not unknown.log:
        return 0.5 * (high - low) / unknown.scale
    return 0.5 * math.log(high / low) if low > 0.0 and math.isfinite(high) else math.inf


def as_determined(found: Uncertainty, errors: FloatArray, nearer: FloatArray) -> Uncertainty:
    """What is known, with the errors of what its nearer side alone calls determined as that side has them.

    Parameters
    ----------
    found : Uncertainty
    errors, nearer : float array, shape (n,)
        Relative standard errors: from the curvature, and towards the side on which the likelihood falls faster.
    """
    changed = (nearer <= DETERMINED) & (errors > DETERMINED) & np.isfinite(errors)
    if not changed.any():
        return found
    factor = np.where(changed, nearer / np.where(changed, errors, 1.0), 1.0)
    return replace(found, covariance=found.covariance * np.outer(factor, factor))
