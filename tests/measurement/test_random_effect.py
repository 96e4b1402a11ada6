"""The next of several members, against Student's interval and against drawn members."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.measurement.random_effect import random_effect

SEED = 20261121


@pytest.mark.parametrize("count", [3, 4, 10])
def test_without_errors_it_is_students_interval(count: int) -> None:
    values = np.random.default_rng(SEED).normal(2.0, 0.7, count)
    found = random_effect(values, np.full(count, 1e-9))
    deviation = values.std(ddof=1)
    reach = scipy.stats.t.ppf(0.975, count - 1) * deviation * np.sqrt(1.0 + 1.0 / count)
    assert found.mean == pytest.approx(values.mean())
    assert found.between == pytest.approx(deviation, rel=1e-6)
    assert found.next_one == pytest.approx((values.mean() - reach, values.mean() + reach), rel=2e-4)


def test_two_members_tell_no_next_one() -> None:
    found = random_effect([1.0, 2.0], [0.1, 0.1])
    assert found.next_one is None
    assert found.p_value == pytest.approx(scipy.stats.chi2.sf(0.5 / 0.01, 1))


def test_members_that_are_equal() -> None:
    assert random_effect([3.0, 3.0, 3.0], [0.0, 0.0, 0.0]).next_one == (3.0, 3.0)
    found = random_effect([3.0, 3.01, 2.99], [0.1, 0.1, 0.1])
    assert found.between == 0.0
    assert found.p_value > 0.9


def test_a_member_of_which_nothing_is_known_does_not_count() -> None:
    with_it, without = (random_effect([1.0, 1.4, 0.7, 1e6][:count], [0.05, 0.1, 0.08, 1e6][:count]) for count in (4, 3))
    assert with_it.mean == pytest.approx(without.mean, rel=1e-2)
    assert with_it.between == pytest.approx(without.between, rel=0.3)


@pytest.mark.parametrize("count", [3, 6])
@pytest.mark.parametrize("between", [0.0, 1.0, 10.0])
def test_the_interval_holds_the_next_member(count: int, between: float) -> None:
    """Members drawn about nothing, each with an error of its own size; the next one is drawn too."""
    generator = np.random.default_rng([SEED, count, int(between)])
    trials, inside, p_value = 400, 0, 0
    for _ in range(trials):
        errors = np.exp(generator.uniform(-0.7, 0.7, count))
        members = between * generator.standard_normal(count + 1)
        found = random_effect(members[:count] + errors * generator.standard_normal(count), errors)
        assert found.next_one is not None
        inside += found.next_one[0] <= members[count] <= found.next_one[1]
        p_value += found.p_value < 0.05
    # Where nothing differs, that is not known from a few members: the interval is wider than it needs to be.
    assert 0.92 <= inside / trials <= (1.0 if between == 0.0 else 0.985)
    if between == 0.0:
        assert 0.02 <= p_value / trials <= 0.085


@given(
    st.lists(st.tuples(st.floats(-5.0, 5.0), st.floats(0.01, 2.0)), min_size=3, max_size=6),
    st.floats(0.1, 10.0),
    st.floats(-10.0, 10.0),
)
def test_units_and_zero_do_not_matter(members: list[tuple[float, float]], scale: float, shift: float) -> None:
    values, errors = np.array(members).T
    one, other = random_effect(values, errors), random_effect(scale * values + shift, scale * errors)
    assert one.next_one is not None
    size = np.ptp(values) + errors.max()
    expected = [scale * end + shift for end in one.next_one]
    assert other.next_one == pytest.approx(expected, abs=1e-4 * scale * size)
    assert other.p_value == pytest.approx(one.p_value, abs=1e-6)


@pytest.mark.parametrize("unit", [1e-300, 1e-150, 1e-9, 1e9, 1e150, 1e300])
def test_the_unit_of_the_members_changes_nothing(unit: float) -> None:
    """Their squares are no numbers in every unit; the answer, which is theirs in another unit, is."""
    values, errors = np.array([1.0, 1.4, 0.7, 2.0]), np.array([0.05, 0.1, 0.3, 0.1])
    usual, found = (
        random_effect(values, errors, common=0.2),
        random_effect(unit * values, unit * errors, common=0.2 * unit),
    )
    assert usual.next_one is not None
    assert found.next_one is not None
    assert found.p_value == pytest.approx(usual.p_value)
    assert (found.mean, found.between, *found.next_one) == pytest.approx(
        (unit * usual.mean, unit * usual.between, *(unit * end for end in usual.next_one)), rel=1e-6
    )


def test_members_without_errors_that_lie_next_to_each_other() -> None:
    """A spread of which the square is no number is still a spread: the smallest that a float can have, and one of 1."""
    assert random_effect([0.0, 0.0, 5e-324], np.zeros(3), common=1.0).next_one == pytest.approx((-1.96, 1.96), abs=1e-3)
    assert random_effect([0.0, 1e-160, 3e-160], np.full(3, 1e-161)).between == pytest.approx(1.5e-160, rel=0.05)
