"""Which law is told from which: where the truth is one of them, and where nothing can tell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ipmclab.comparison.factors import FACTORS
from ipmclab.comparison.trends import LAWS, Trend, trend_of
from tests.comparison.campaigns import row

COURSES = {
    "linear": lambda v: 1.0 + 4.0 * (v - 1.0),
    "exponential": lambda v: math.exp(0.8 * (v - 1.0)),
    "power": lambda v: v**2.5,
    "logarithmic": lambda v: 1.0 + 4.0 * math.log(v),
    "constant": lambda v: 1.0,
}


def seen(course: str, volts: tuple[float, ...], scatter: float, seed: int = 1) -> Trend:
    draw = np.random.default_rng(seed)
    rows = [
        row(size * COURSES[course](volt) * math.exp(scatter * draw.normal()), sample=sample, voltage=volt)
        for sample, size in (("a", 1e-3), ("b", 3e-4))
        for volt in volts
        for _ in range(2)
    ]
    found = trend_of("displacement.largest", "step", rows, FACTORS["voltage"])
    assert found is not None
    return found


@pytest.mark.parametrize("course", COURSES)
def test_a_law_that_holds_is_found(course: str) -> None:
    """Six levels, two strips of different size, 1 % of scatter."""
    found = seen(course, (1.0, 1.4, 1.8, 2.2, 2.6, 3.0), 0.01)
    best = found.laws[0]
    if course == "constant":
        assert course in found.not_excluded  # a flat course is one of every law
        assert best.change == pytest.approx(1.0, abs=0.02)
        return
    assert best.law == course
    assert found.not_excluded == (course,)
    assert best.change == pytest.approx(COURSES[course](3.0), rel=0.02)
    assert best.held_out == min(one.held_out for one in found.laws)
    assert best.held_out < 0.03
    assert str(found) == f"{course}: every other law is excluded"


@pytest.mark.parametrize("course", ["linear", "power"])
def test_a_law_that_is_true_is_seldom_excluded(course: str) -> None:
    """Two strips at five levels with 20 % of scatter, twice each: in 18 and 15 of these 100 campaigns it was."""
    volts = (1.0, 1.25, 1.5, 1.75, 2.0)
    assert sum(course not in seen(course, volts, 0.2, seed).not_excluded for seed in range(100)) <= 5


def test_the_thesis_three_humidities_tell_no_law_from_another() -> None:
    """Friend, figure 5.21: 3.83, 1.27 and 1.0 mm at 80, 70 and 60 %RH."""
    rows = [row(value, humidity=humid) for humid, value in ((80.0, 3.83e-3), (70.0, 1.27e-3), (60.0, 1.0e-3))]
    found = trend_of("displacement.largest", "step", rows, FACTORS["humidity"])
    assert found is not None
    assert set(found.not_excluded) == {law.name for law in LAWS}
    assert str(found) == "3 runs at 3 levels do not distinguish the laws"


def test_only_runs_that_differ_in_the_factor_alone_are_held_against_each_other() -> None:
    """Another temperature is another group: its one level says nothing."""
    rows = [row(volt, voltage=volt, temperature=20.0) for volt in (1.0, 2.0, 3.0)]
    rows += [row(100.0, voltage=3.0, temperature=40.0)]
    found = trend_of("displacement.largest", "step", rows, FACTORS["voltage"])
    assert found is not None
    assert found.runs == 3
    assert trend_of("displacement.largest", "step", rows, FACTORS["temperature"]) is None
    assert trend_of("displacement.largest", "sine", rows, FACTORS["voltage"]) is None


def test_a_constant_excludes_no_law() -> None:
    """Five strips of one run each: AICc asks 20 for one number of shape more, which is no evidence against a law."""
    draw = np.random.default_rng(1)
    volts = (1.0, 1.0, 2.0, 2.0, 3.0)
    rows = [row(2e-3 * volt * math.exp(0.5 * draw.normal()), sample="", voltage=volt) for volt in volts]
    found = trend_of("displacement.largest", "step", rows, FACTORS["voltage"])
    assert found is not None
    assert found.laws[0].law == "constant"
    assert min(one.aicc for one in found.laws[1:]) > 2.0
    assert set(found.not_excluded) == {law.name for law in LAWS}
