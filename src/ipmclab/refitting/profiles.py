"""The profile of the likelihood of every parameter of a fit: what the readings say of it, whatever its shape."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.errors import InputError, suggest
from ipmclab.fit.fit import Fit, FittedParameter
from ipmclab.fit.fit_table import changed
from ipmclab.fit.profile import Profile
from ipmclab.identification.problem.stated import stated_covariance
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.solved import Estimate, solved
from ipmclab.identification.uncertainty.covariance import uncertainty
from ipmclab.identification.uncertainty.interval import values_within_bounds
from ipmclab.identification.uncertainty.profile import Point, Walk, held_at
from ipmclab.kinds import tell_kinds
from ipmclab.model.order import Order
from ipmclab.one_thread import on_one_thread
from ipmclab.progress import OnProgress, reporting_to, stage

_BETWEEN: Final = 0.5  # of the way to the crossing: one more point
WHY_NOT_PROFILE: Final = (
    "it is the shortest that leaves out 5 %, reaches to every other minimum that is as good, and allows for what does "
    "not show; a profile is followed from the best fit alone"
)
"""Why a profile may end elsewhere than the interval of a parameter, which is the one to quote."""

_BEYOND: Final = 1.2  # times the way: where a curve ends


@tell_kinds
def profile(fit: Fit, names: str | Iterable[str] | None = None, *, progress: OnProgress | None = None) -> Fit:
    """Follow the likelihood's profile of every parameter of a fit to where its 95 % interval ends.

    A parameter is held at one value after the other, and all others are fitted again, under the noise that the fit
    found. Where the excess of chi-square stays below the threshold within a factor of a thousand, or up to a bound, the
    interval is open on that side. It is followed from the best fit outwards: another minimum is not found so, but the
    intervals of the fit reach over those that it knows.

    Parameters
    ----------
    fit : Fit
        What ``identify`` returned.
    names : str or iterable of str, optional
        One or some of its parameters; all of the actuator's where left out. What belongs to one run (a delay, a zero)
        is followed where it is named.
    progress : function of (str, float), optional
        Called with what is being done, and the fraction that is done.

    Returns
    -------
    fit : Fit
        With ``profiles``, by name. A parameter that an open direction moves has its profile's interval: it ends where
        another parameter would have to become negative.

    Raises
    ------
    InputError
        A fit that was read from a file, or a name that was not free.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> actuator = load_actuator("friend-2")
    >>> run = simulate(actuator, "step 1 V", duration=20, rate=50)
    >>> fit = profile(identify(actuator, run, free="circuit.dc_resistivity"))
    >>> fit.profiles["circuit.dc_resistivity"].is_open
    (False, False)
    """
    if names is None:
        names = [name for name in fit.parameters if not name.startswith("observation.")]
    wanted = [names] if isinstance(names, str) else list(names)
    for name in wanted:
        if name not in fit.parameters:
            raise InputError(
                f"{name!r} is no parameter of this fit",
                code="unknown-parameter",
                where="names",
                repair=suggest(name, list(fit.parameters)),
            )
    solved(fit)
    with reporting_to(progress):
        found = _profiles(fit, wanted)
    in_order = {name: found[name] for name in fit.parameters if name in found}
    return changed(fit, profiles=in_order, parameters=_ended(fit, in_order))


def _ended(fit: Fit, found: Mapping[str, Profile]) -> dict[str, FittedParameter]:
    """Parameters that an open direction moves, with the intervals in which it can move them.

    Along it the likelihood is flat, but not without end: where another parameter would have to become negative the
    readings are no longer explained. Only the profile sees that. It does not see stages that do not show: where there
    are such, the interval stays open. The other fits as good that are known lie along the direction, or widen it.
    """
    estimate = solved(fit)
    problem, theta = estimate.problem, estimate.solution.theta
    open_directions = [
        {name for name, part in one.coefficients.items() if abs(part) > 1e-3}
        for one in fit.undetermined
        if math.isinf(one.error)
    ]
    # What nothing limits by itself has an open interval already.
    moved = {name for names in open_directions if len(names) > 1 for name in names}
    ended = dict(fit.parameters)
    if estimate.with_unseen is not None:
        return ended
    reference = problem.in_reference(theta, problem.records[0].place)
    order = Order(reference)
    rivals = [rival.sorted_as(problem, reference) for rival in estimate.rivals]
    for unknown in problem.unknowns:
        name = order(unknown.name)
        if name not in moved or name not in found or ended[name].determined or ended[name].at_bound:
            continue
        low, high = found[name].interval
        for rival in rivals:
            entry, reach = rival.entries[unknown.name], rival.reach[unknown.name]
            least, most = values_within_bounds(unknown, entry - reach, entry + reach)
            low, high = min(low, least), max(high, most)
        ended[name] = replace(ended[name], interval=(low, high))
    return ended


def flat_within(fit: Fit, name: str) -> bool:
    """Whether every value within the interval of a parameter explains the readings about as well as every other.

    So it is along a direction of which the readings say nothing at all. Where other minima are as good, or a parameter
    went to its bound, the readings still distinguish the values between.
    """
    one = fit.parameters[name]
    least = -math.inf if one.interval[0] == 0.0 else one.interval[0]
    if one.determined or fit.practical is None or not (math.isfinite(least) or math.isfinite(one.interval[1])):
        return False
    return math.isinf(fit.practical.collinearity.get(name, 0.0))


@on_one_thread
def _profiles(fit: Fit, wanted: Iterable[str]) -> dict[str, Profile]:
    estimate = solved(fit)
    problem, solution = estimate.problem, estimate.solution
    free = {unknown.base for unknown in problem.unknowns}
    order = Order(problem.in_reference(solution.theta, problem.records[0].place))
    held = {order(name): name for name, one in estimate.parameters.items() if one.standard_uncertainty > 0.0}
    held = {now: name for now, name in held.items() if name not in free and now in fit.actuator.standard_uncertainties}
    together = stated_covariance(fit.actuator, list(held))
    stated = {held[one]: {held[other]: value for other, value in row.items()} for one, row in together.items()}
    known = uncertainty(estimate.correlated, stated, ())
    places = [place for place, unknown in enumerate(problem.unknowns) if not unknown.nuisance]
    asked = [(number, place) for number, place in enumerate(places) if order(problem.unknowns[place].name) in wanted]
    found: dict[str, Profile] = {}
    for turn, (number, place) in enumerate(asked):
        unknown = problem.unknowns[place]
        name = order(unknown.name)
        stage(f"profile of {name}", turn / len(asked), (turn + 1) / len(asked), usual=20)
        plain, variance = float(known.plain[number, number]), float(known.covariance[number, number])
        moved = bool(np.any(np.abs(known.null[:, number]) > 1e-3))
        ratio = 1.0 if moved or plain <= 0.0 else max(variance / plain, 1.0)
        error = math.inf if moved else math.sqrt(max(plain, 0.0))
        found[name] = _profile(estimate, unknown, place, error, ratio, float(known.freedom[number]))
    return found


def _profile(estimate: Estimate, unknown: Unknown, place: int, error: float, ratio: float, freedom: float) -> Profile:
    from scipy.special import stdtrit

    problem, solution = estimate.problem, estimate.solution
    threshold = float(stdtrit(freedom, 0.975)) ** 2
    scaled = threshold * ratio
    middle = float(solution.theta[place])
    best = Point(middle, 0.0, solution.theta, solution.evaluation)
    points = [best]
    ends = []
    for sign in (-1.0, 1.0):
        walk = Walk(problem, solution, place, sign * error)
        crossing = middle + sign * walk.distance(math.sqrt(scaled))
        found = walk.points[1:]
        ends.append(crossing)
        for part in (_BETWEEN, _BEYOND) if math.isfinite(crossing) else ():
            entry = middle + part * (crossing - middle)
            if problem.lower[place] < entry < problem.upper[place]:
                warm = min([best, *found], key=lambda point: abs(point.entry - entry))
                more = held_at(problem, solution, place, entry, warm, scaled)
                found += [more] if more is not None else []
        points += _as_far_as_it_matters(found, middle, crossing, scaled)
    points = sorted({point.entry: point for point in points}.values(), key=lambda point: point.entry)
    return Profile(
        values=tuple(unknown.value(point.entry) for point in points),
        excess=tuple(point.height**2 / ratio for point in points),
        threshold=threshold,
        interval=values_within_bounds(unknown, ends[0], ends[1]),
        is_open=(math.isinf(ends[0]), math.isinf(ends[1])),
        parabola=error * math.sqrt(ratio) * unknown.chain(unknown.value(middle)),
    )


def _as_far_as_it_matters(points: Sequence[Point], middle: float, crossing: float, threshold: float) -> list[Point]:
    """The points of one side up to where it crosses the threshold, and those a little beyond, at least one."""
    reach = abs(crossing - middle)
    inside = [point for point in points if abs(point.entry - middle) <= reach]
    beyond = [point for point in points if abs(point.entry - middle) > reach]
    beyond.sort(key=lambda point: point.height)
    return [*inside, *beyond[:1], *(point for point in beyond[1:] if point.height**2 < _BEYOND**3 * threshold)]
