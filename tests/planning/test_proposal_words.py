"""What is said of proposed runs, from what was computed of them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from ipmclab.planning.proposal import Expected, Proposal
from ipmclab.planning.proposal_words import bench_time, interval, of_draws, of_goal, of_limits

NOTHING = Proposal("model", runs=(), best_of_kind=(), expected=(), rank_before=5, rank_after=5)


def test_a_plan_without_rivals_says_how_well_it_predicts() -> None:
    plan = replace(NOTHING, predicted={"current": (0.0312, 0.0121), "force": (1.0, 0.25)})
    assert list(of_goal(plan)) == [
        "Error of what is predicted for the inputs, of the size of the answer: current 3.1 % to 1.2 %, force unknown "
        "to 25 %."
    ]


def test_a_rival_is_shown_by_standard_errors_or_by_the_least_of_it() -> None:
    """A stage whose size nobody knows has no standard errors; one that no run would show has no least either."""
    plan = replace(
        NOTHING,
        evidence={"eq_4": (2.31, 4.56), "leak": (1.0, 3.0), "relaxation": (0.0, 0.0)},
        shows={"leak": {"leak.rate": (0.01234, "A/m^2"), "leak.level": (2.0, "V")}, "relaxation": {}},
    )
    assert list(of_goal(plan))[1:] == [
        "If eq_4 is true, the first run shows it by 2.3 standard errors, all of them by 4.6.",
        "These runs would show a stage leak from leak.rate of 0.012 A/m^2, leak.level of 2 V on, at two standard "
        "errors.",
    ]


def test_limits_and_draws_are_told_where_there_are_any() -> None:
    assert of_limits(NOTHING) == of_draws(NOTHING) == ""
    plan = replace(NOTHING, refused={"current": 3, "energy": 1}, tried=20, draws=12)
    assert of_limits(plan) == "Of 20 runs that were tried some would pass a limit: current 3, energy 1."
    assert of_draws(plan).startswith("Gains are averages over 12 values that the strip may have")


def test_an_interval_has_as_many_digits_as_tell_its_ends_apart() -> None:
    known = Expected("p", "s", 1.5, 0.1, 0.01, (1 / 3, 2 / 3), (1.499991, 1.500009), True, True)
    assert interval(known, now=True) == "0.3333 to 0.6667"
    assert interval(known, now=False) == "1.49999 to 1.50001"
    assert interval(replace(known, interval_after=(1.23452, 1.23461)), now=False) == "1.2345 to 1.2346"
    same = replace(known, interval_after=(1.23456789, 1.23456789))
    assert interval(same, now=False) == "1.2345679 to 1.2345679"
    opened = replace(known, before=math.inf, determined_before=False)
    assert interval(opened, now=True) == "not determined"
    assert interval(opened, now=False) == interval(known, now=False)
    assert interval(replace(known, determined_after=False), now=False) == "not determined"


@pytest.mark.parametrize(("seconds", "said"), [(90.0, "1.5 min"), (0.0, "0.0 min"), (3600.0, "60.0 min")])
def test_bench_time_is_told_in_minutes(seconds: float, said: str) -> None:
    assert bench_time(seconds) == said
