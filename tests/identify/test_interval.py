"""Intervals from the walk along a profile, against closed forms."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ipmclab.identify.problem import Evaluation
from ipmclab.identify.solve import Solution
from ipmclab.identify.uncertainty.covariance import Uncertainty
from ipmclab.identify.uncertainty.interval import _shortest, as_determined, beside_bounds
from ipmclab.identify.uncertainty.profile import Walk
from ipmclab.identify.unknowns import actuator_unknown
from ipmclab.model import load_actuator

SEED = 20261121
TAILS = (0.025, 0.03, 0.035, 0.04)


class Gain:
    """A gain K, seen as itself with an error of 1, beside a nuisance; the entry is the logarithm of K or of 1/K.

    With c = 1 the best nuisance leaves the height |K - seen|/(sigma sqrt 2).
    """

    lower = np.array([-20.0, -50.0])
    upper = np.array([20.0, 50.0])
    unknowns = (SimpleNamespace(base="coupling.gain"), SimpleNamespace(base="coupling.p1"))

    def __init__(self, seen: float, sigma: float, sign: float = 1.0) -> None:
        self.seen, self.scale, self.sign = seen, sigma / math.sqrt(2.0), sign

    def evaluate(self, theta: Any) -> Evaluation:
        gain = math.exp(self.sign * theta[0])
        slope = self.sign * gain / self.scale
        missed = (gain - self.seen) / self.scale + theta[1]
        return Evaluation(np.array([[slope, 0.0], [1.0, 1.0], [missed, theta[1]]]))

    def spared(self, theta: Any) -> float:  # the protocol's signature
        return 0.0

    def walks(self) -> tuple[Walk, Walk]:
        theta = np.array([self.sign * math.log(self.seen), 0.0])
        solution = Solution(theta, self.evaluate(theta), True, "", 1)
        error = self.scale * math.sqrt(2.0) / self.seen
        return tuple(Walk(self, solution, 0, side * error) for side in (-1.0, 1.0))  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.26, 0.4])
@pytest.mark.parametrize("height", [1.0, 1.75, 1.96, 2.33])
def test_a_walk_finds_where_the_profile_crosses_a_height(sigma: float, height: float) -> None:
    down, up = Gain(1.0, sigma).walks()
    assert down.distance(height) == pytest.approx(-math.log1p(-sigma * height), rel=0.01)
    assert up.distance(height) == pytest.approx(math.log1p(sigma * height), rel=0.01)
    # Once more, another height, from the same points.
    assert up.distance(1.1 * height) == pytest.approx(math.log1p(1.1 * sigma * height), rel=0.01)
    assert len(up.points) < 10


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
        down, up = _shortest(walks, 1e6, 1.0, TAILS)
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
    found = Uncertainty(covariance, covariance, np.zeros((0, 2)), np.ones(2), {}, (), np.full(2, 100.0))
    errors = np.sqrt(covariance.diagonal())
    sharper = as_determined(found, errors, np.array([0.4, 0.5]))
    assert np.sqrt(sharper.covariance.diagonal()) == pytest.approx([0.4, 0.6])
    assert as_determined(found, errors, np.full(2, math.inf)) is found


def test_where_the_search_ends_a_side_is_open_and_where_something_is_known_it_is_not() -> None:
    declared = load_actuator("friend-2+clamp").parameters()
    resistivity = actuator_unknown(declared["circuit.branches.0.resistivity"], None)
    ends = resistivity.entry(declared["circuit.branches.0.resistivity"].upper)
    assert beside_bounds(resistivity, 0.0, ends) == (1.0, math.inf)
    assert beside_bounds(resistivity, -1000.0, 0.0) == (0.0, 1.0)
    # A resistance may be nothing, a share everything, and neither is what a search ends at.
    contact = actuator_unknown(declared["circuit.contact_resistance"], None)
    assert beside_bounds(contact, -1.0, 2.0) == (0.0, 2.0)
    assert beside_bounds(contact, 1e-4, 1e9) == (1e-4, math.inf)
    share = actuator_unknown(declared["clamp.direct_share"], None)
    assert beside_bounds(share, 5e-4, 2.0) == (5e-4, 1.0)
    # What is known beforehand ends an interval wherever that is.
    measured = resistivity.known(2e-6, 1e-7)
    assert beside_bounds(measured, measured.entry(1e-6), 0.0)[0] == pytest.approx(1e-6)
