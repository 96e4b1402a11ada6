"""Intervals from the walk along a profile, against closed forms."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ipmclab import Run, identify, simulate
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.growing import Growth
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.unknowns import Unknown, actuator_unknown
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.uncertainty import covariance as covariance_of
from ipmclab.identification.uncertainty import profile
from ipmclab.identification.uncertainty.covariance import Uncertainty
from ipmclab.identification.uncertainty.interval import (
    Interval,
    _shortest,
    as_determined,
    has_open_end,
    interval_of,
    is_too_wide,
    values_within_bounds,
    with_rivals,
)
from ipmclab.identification.uncertainty.profile import Walk
from ipmclab.model import load_actuator
from ipmclab.model.stages.circuit import DC

SEED = 20261121
TAILS = (0.025, 0.03, 0.035, 0.04)


class Gain:
    """A gain K, seen as itself with an error of 1, beside a nuisance; the entry is the logarithm of K or of 1/K.

    With c = 1 the best nuisance leaves the height |K - seen|/(sigma sqrt 2). What draws K to where it was seen and is
    no evidence adds to the cost, and is spared: the height stays the same.
    """

    lower = np.array([-20.0, -50.0])
    upper = np.array([20.0, 50.0])
    linear = np.zeros(2, dtype=bool)
    added = linear
    unknowns = (SimpleNamespace(base="coupling.gain"), SimpleNamespace(base="coupling.p1"))
    on_means = None
    is_circuit = False

    def __init__(self, seen: float, sigma: float, sign: float = 1.0, drawn: float = 0.0) -> None:
        self.seen, self.scale, self.sign, self.drawn = seen, sigma / math.sqrt(2.0), sign, drawn

    def evaluate(self, theta: Any) -> Evaluation:
        gain = math.exp(self.sign * theta[0])
        slope = self.sign * gain / self.scale
        missed = (gain - self.seen) / self.scale + theta[1]
        pull, away = self.drawn * self.sign * gain, self.drawn * (gain - self.seen)
        return Evaluation(np.array([[slope, 0.0, pull], [1.0, 1.0, 0.0], [missed, theta[1], away]]))

    def spared(self, theta: Any) -> float:
        return (self.drawn * (math.exp(self.sign * theta[0]) - self.seen)) ** 2

    def walks(self) -> tuple[Walk, Walk]:
        theta = np.array([self.sign * math.log(self.seen), 0.0])
        solution = Solution(theta, self.evaluate(theta), True, "", 1)
        error = self.scale * math.sqrt(2.0) / self.seen
        return tuple(Walk(self, solution, 0, side * error) for side in (-1.0, 1.0))  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.26, 0.4])
@pytest.mark.parametrize("height", [1.0, 1.75, 1.96, 2.33])
@pytest.mark.parametrize("drawn", [0.0, 2.0])
def test_a_walk_finds_where_the_profile_crosses_a_height(sigma: float, height: float, drawn: float) -> None:
    down, up = Gain(1.0, sigma, drawn=drawn).walks()
    assert down.distance(height) == pytest.approx(-math.log1p(-sigma * height), rel=0.01)
    assert up.distance(height) == pytest.approx(math.log1p(sigma * height), rel=0.01)
    # Once more, another height, from the same points.
    assert up.distance(1.1 * height) == pytest.approx(math.log1p(1.1 * sigma * height), rel=0.01)
    assert len(up.points) < 10


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_side_of_a_profile_has_every_point_on_the_way_and_not_the_minimum(side: float) -> None:
    gain, theta = Gain(1.0, 0.1), np.zeros(2)
    solution = Solution(theta, gain.evaluate(theta), True, "", 1)
    walk = Walk(cast(Any, gain), solution, 0, side * 0.1)
    assert side * walk.distance(1.96) == pytest.approx(math.log1p(side * 0.196), rel=0.01)
    assert walk.points[0].height == 0.0
    assert [point.height > 0.0 for point in walk.points[1:]] == [True] * (len(walk.points) - 1)
    assert len(walk.points) > 1


def test_a_side_on_which_the_cost_stays_low_is_open() -> None:
    down, up = Gain(1.0, 0.6).walks()
    assert math.isinf(down.distance(1.96))
    assert up.distance(1.96) == pytest.approx(math.log1p(0.6 * 1.96), rel=0.01)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_shortest_interval_holds_the_truth_as_often_and_is_shorter(sign: float) -> None:
    generator = np.random.default_rng(SEED)
    trials, sigma = 800, 0.2
    inside, shorter, even = 0, [], []
    for seen in 1.0 + sigma * generator.standard_normal(trials):
        walks = Gain(seen, sigma, sign).walks()
        (down, up), _ = _shortest(walks, 1e6, 1.0, TAILS)
        middle = sign * math.log(seen)
        inside += middle - down <= 0.0 <= middle + up
        shorter.append(down + up)
        even.append(walks[0].distance(1.96) + walks[1].distance(1.96))
    # 95 % of 800 within 2.6 standard errors.
    assert 0.93 < inside / trials < 0.97
    assert (np.array(shorter) <= 1.005 * np.array(even)).all()
    assert np.median(shorter) < 0.99 * np.median(even)


def test_what_its_nearer_side_calls_determined_is_known_as_well_as_that() -> None:
    covariance = np.array([[0.25, 0.2], [0.2, 0.36]])
    found = Uncertainty(
        covariance, covariance.diagonal(), covariance, np.zeros((0, 2)), np.ones(2), {}, (), np.full(2, 100.0)
    )
    errors = np.sqrt(covariance.diagonal())
    sharper = as_determined(found, errors, np.array([0.4, 0.5]))
    assert np.sqrt(sharper.covariance.diagonal()) == pytest.approx([0.4, 0.6])
    assert as_determined(found, errors, np.full(2, math.inf)) is found


def test_where_the_search_ends_a_side_is_open_and_where_something_is_known_it_is_not() -> None:
    declared = load_actuator("friend-2+clamp").parameters()
    resistivity = actuator_unknown(declared["circuit.branches.0.resistivity"], None)
    ends = resistivity.entry(declared["circuit.branches.0.resistivity"].upper)
    assert values_within_bounds(resistivity, 0.0, ends) == (1.0, math.inf)
    assert values_within_bounds(resistivity, -1000.0, 0.0) == (0.0, 1.0)
    # A resistance may be nothing, a share everything, and neither is what a search ends at.
    contact = actuator_unknown(declared["circuit.contact_resistance"], None)
    assert values_within_bounds(contact, -1.0, 2.0) == (0.0, 2.0)
    assert values_within_bounds(contact, 1e-4, 1e9) == (1e-4, math.inf)
    share = actuator_unknown(declared["clamp.direct_share"], None)
    assert values_within_bounds(share, 5e-4, 2.0) == (5e-4, 1.0)
    # What is known beforehand ends an interval wherever that is.
    measured = resistivity.known(2e-6, 1e-7)
    assert values_within_bounds(measured, measured.entry(1e-6), 0.0)[0] == pytest.approx(1e-6)


class Drawn(Gain):
    """The same beside an entry that is drawn to where it was found, of which the cost makes no evidence."""

    def evaluate(self, theta: Any) -> Evaluation:
        there = super().evaluate(theta)
        by = self._away(theta)
        return Evaluation(np.column_stack([there.rows, [2.0, 0.0, by]]))

    def spared(self, theta: Any) -> float:
        return self._away(theta) ** 2

    def _away(self, theta: Any) -> float:
        return 2.0 * float(theta[0] - self.sign * math.log(self.seen))


def test_what_is_no_evidence_moves_no_end_of_an_interval() -> None:
    for plain, drawn in zip(Gain(1.0, 0.3).walks(), Drawn(1.0, 0.3).walks(), strict=True):
        assert drawn.distance(1.96) == pytest.approx(plain.distance(1.96), rel=0.01)


def _gain_known_to(error: float, sign: float) -> tuple[Interval, Unknown, Any]:
    problem: Any = Gain(1.0, error, sign)
    problem.unknowns = tuple(SimpleNamespace(base=one.base, beforehand=None) for one in Gain.unknowns)
    problem.base = {}
    theta = np.array([0.0, 0.0])
    covariance = np.array([[error**2]])
    found = Uncertainty(
        covariance, covariance.diagonal(), covariance, np.zeros((0, 1)), np.ones(1), {}, (), np.array([1e6])
    )
    unknown = actuator_unknown(load_actuator("friend-2").parameters()["circuit.branches.0.resistivity"], None)
    problem.asked = ((0, unknown),)
    solution = Solution(theta, problem.evaluate(theta), True, "", 1)
    correlated = Correlated(problem, solution, solution.evaluation)
    return interval_of(correlated, found, 0, error, open_edges=False), unknown, problem


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_interval_is_the_shortest_that_its_profile_allows(sign: float) -> None:
    """Where one side falls slowly: shorter than between the ends that leave 2.5 % out each."""
    interval, _, problem = _gain_known_to(0.3, sign)
    even = sum(walk.distance(1.96) for walk in problem.walks())
    assert math.log(interval.high / interval.low) < 0.98 * even


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_fit_as_good_that_the_profile_reached_says_nothing_new(sign: float) -> None:
    """The shortest interval leaves out more on the side that falls slowly: what lies there is allowed all the same."""
    interval, unknown, problem = _gain_known_to(0.3, sign)
    even = {side: walk.distance(1.96) for side, walk in zip((-1.0, 1.0), problem.walks(), strict=True)}
    slow = max(even, key=even.__getitem__)
    assert math.exp(slow * even[slow]) == pytest.approx(interval.allowed[slow > 0.0], rel=1e-3)
    assert not interval.low <= math.exp(slow * 0.999 * even[slow]) <= interval.high
    for part, leaves in ((0.999, False), (1.001, True)):
        entry = slow * part * even[slow]
        assert interval.is_left_by(unknown, Rival({unknown.name: entry}, {unknown.name: 0.0})) is leaves
    assert not interval.is_left_by(unknown, Rival({"another": 9.0}, {"another": 0.0}))


@pytest.mark.parametrize(("apart", "same"), [(0.8, True), (0.9, False), (-0.9, False)])
def test_minima_are_one_answer_up_to_two_errors_of_what_counts_as_determined(apart: float, same: bool) -> None:
    unknown = actuator_unknown(load_actuator("friend-2").parameters()["circuit.branches.0.resistivity"], None)
    interval, agree = with_rivals(unknown, 0.0, (0.9, 1.1), [(apart, 0.1)])
    assert agree is same
    assert interval == pytest.approx((min(0.9, math.exp(apart - 0.1)), max(1.1, math.exp(apart + 0.1))))


@pytest.mark.parametrize(("times", "grows"), [(1.0, False), (1.05, False), (1.2, True), (80.0, True)])
def test_uneven_noise_counts_as_it_is(monkeypatch: pytest.MonkeyPatch, times: float, grows: bool) -> None:
    """White's covariance of a straight line through readings whose variances are known: (X'X)^-1 X'WX (X'X)^-1.

    Noise of nearly one size everywhere does not grow: nothing is said of it.
    """
    rows = 400
    columns = np.column_stack([np.ones(rows), np.linspace(0.0, 1.0, rows)])
    variance = np.linspace(0.05, 4.0, rows) ** 2
    residual = np.sqrt(variance) * np.random.default_rng(SEED).standard_normal(rows)
    key = (0, "current")
    problem = SimpleNamespace(
        unknowns=[SimpleNamespace(nuisance=False)] * 2,
        pieces={key: slice(0, rows)},
        beforehand=slice(rows, rows),
        noise={key: 1.0},
        floors={key: 0.0},
    )
    solution = Solution(np.zeros(2), Evaluation(np.vstack([columns.T, residual])), True, "", 1)
    correlated = Correlated(cast(Any, problem), solution, solution.evaluation)
    monkeypatch.setattr(covariance_of, "growth", lambda *_: Growth(variance, times))
    monkeypatch.setattr(covariance_of, "hidden_zeros", lambda _, count: np.zeros((count, 1)))
    found = covariance_of.uncertainty(correlated, {}, ())
    assert bool(found.growing) is grows
    inverse = np.linalg.inv(columns.T @ columns)
    if grows:
        np.testing.assert_allclose(found.covariance, inverse @ (columns.T * variance) @ columns @ inverse, rtol=1e-9)


def test_an_interval_that_nothing_limits_on_one_side_determines_nothing() -> None:
    parameters = load_actuator("friend-2").parameters()
    resistivity, contact = (
        actuator_unknown(parameters[f"circuit.{name}"], None) for name in ("dc_resistivity", "contact_resistance")
    )
    assert resistivity.log
    assert not contact.log
    assert has_open_end(resistivity, (122.0, math.inf))
    assert has_open_end(resistivity, (0.0, 122.0))
    assert not has_open_end(resistivity, (122.0, 400.0))
    assert not has_open_end(contact, (0.0, 3.0))  # it is known to 3 ohm: a contact may have none
    assert has_open_end(contact, (0.0, math.inf))


@pytest.mark.parametrize(("error", "wide"), [(0.41, False), (0.43, True)])
def test_a_reciprocal_that_is_just_determined_is_just_narrow_enough(error: float, wide: bool) -> None:
    unknown = actuator_unknown(load_actuator("friend-2").parameters()["circuit.dc_resistivity"], None)
    reach = 1.959963984540054 * error
    assert is_too_wide(unknown, (1.0 / (1.0 + reach), 1.0 / (1.0 - reach))) == wide


@pytest.mark.parametrize("seed", [1, 3])
def test_what_went_to_its_bound_comes_back_as_far_as_the_readings_allow(seed: int) -> None:
    """A strip without a dc path: where its interval ends, a fit that holds it there is worse by 3.84 of chi-square."""
    strip = load_actuator("friend-2").replace(**{DC: 1e7})
    clean = simulate(strip, "step 1 V delay=1 s", duration=60, rate=25)
    assert clean.current is not None
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="zero")
    fit = identify(strip, run)
    found = fit.parameters[DC]
    assert found.at_bound
    assert not found.determined
    assert math.isinf(found.interval[1])
    branches = [name for name in fit.parameters if name.startswith("circuit.branches")]
    at_end = identify(strip.replace(**{DC: found.interval[0]}), run, free=branches)
    squares = [float(np.nansum(one.residuals[0]["current"] ** 2)) for one in (fit, at_end)]
    assert (squares[1] - squares[0]) / (squares[0] / (len(run) - 5)) == pytest.approx(3.84, rel=0.05)
    # What is known of the charge holds what that fit has for it.
    charge, there = ({q.name: q for q in one.known}["circuit.capacitance"] for one in (fit, at_end))
    assert charge.interval[0] <= there.value * (1 + 1e-4)  # a walk ends within some hundredths of its height


@pytest.mark.parametrize(("found_up_to", "height", "away"), [(10.0, 3.0, 3.0), (4.0, 3.0, 3.0), (2.0, 3.0, math.inf)])
def test_no_interval_ends_where_the_others_have_not_found_their_minimum(
    found_up_to: float, height: float, away: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A profile whose height is the distance; beyond some distance a search ends far above it, as where poles meet."""
    problem = Gain(1.0, 0.1)
    asked: list[float] = []

    def held(*given: Any) -> profile.Point:
        entry = float(given[3])
        asked.append(entry)
        is_found = entry <= found_up_to
        theta = np.array([entry, 0.0])
        return profile.Point(entry, entry if is_found else 1e4, theta, problem.evaluate(theta), is_found)

    monkeypatch.setattr(profile, "held_at", held)
    monkeypatch.setattr(profile, "_pull", lambda _, point, __: 2.0 * point.height)
    start = np.zeros(2)
    solution = Solution(start, problem.evaluate(start), True, "", 1)
    walk = Walk(cast("Any", problem), solution, 0, 1.0)
    assert walk.distance(height) == pytest.approx(away, rel=0.02)
    assert max(asked) >= min(found_up_to, height)
    assert walk.crossed(1.0) == pytest.approx(1.0, rel=0.02)  # what was found before stands
