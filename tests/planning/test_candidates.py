"""Which runs are tried."""

from __future__ import annotations

import math

import pytest

from ipmclab import Allowance, InputError
from ipmclab.model.environment import Environment
from ipmclab.planning.candidates import REST_BEFORE, Candidate, candidates
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.signals import Step


@pytest.mark.parametrize("most", [1.996, 0.0119996, 9.999, 1.2, 0.1 + 0.2, 1.1, 3.5])
def test_no_amplitude_is_rounded_beyond_the_largest(most: float) -> None:
    """A limit of 1.996 V refused every run of 2 V, and half of it was all that was proposed."""
    found = {one.signal.amplitude for one in candidates(most, 50.0, 20.0)}
    assert 0.99 * most <= max(found) <= most
    assert all(len(f"{one:.12g}".strip("0.").replace(".", "")) <= 3 for one in found)


def test_nothing_above_electrolysis_is_tried_unless_it_is_allowed() -> None:
    every = list(Allowance().candidates(50.0))
    assert max(one.signal.amplitude for one in every) == 1.2
    assert {one.duration for one in every} == {10.0, 20.0, 40.0, 80.0, 160.0}
    plain = {"sample": "a", "signal": "step 1 V", "rate": "50 Hz", "duration": "40 s"}
    assert experiment_from_table(plain).rest_before == REST_BEFORE


@pytest.mark.parametrize(("longest", "durations"), [(5.0, {5.0}), (10.0, {10.0}), (39.9, {10.0, 20.0})])
def test_no_signal_is_longer_than_it_may_be_and_each_shows_a_whole_period(
    longest: float, durations: set[float]
) -> None:
    found = list(candidates(1.0, 20.0, longest))
    assert {one.duration for one in found} == durations
    assert {one.signal.amplitude for one in found} == {1.0, 0.5}
    periodic = [one for one in found if hasattr(one.signal, "frequency")]
    assert all(one.signal.frequency * one.duration >= 1.0 for one in periodic)
    assert max(one.signal.frequency for one in periodic) == 2.0  # ten rows draw a period
    assert min(one.signal.frequency for one in periodic) == {5.0: 0.2, 10.0: 0.1, 39.9: 0.05}[longest]
    ends = {(one.signal.word, one.duration) for one in found if one.signal.word in ("chirp", "multisine")}
    assert ends == {(word, one) for word in ("chirp", "multisine") for one in durations if one >= 20.0}


def test_the_time_of_a_run_has_what_it_needs_beside_its_signal() -> None:
    cold, warm = Environment(20.0, 80.0), Environment(30.0, 80.0)
    allowed = Allowance(rest=60.0, hydration=300.0, soak=1000.0, conditions=(cold, warm))
    assert allowed.time(Candidate(Step(1.0), 40.0, cold), cold) == 400.0
    assert allowed.time(Candidate(Step(1.0), 40.0, warm), cold) == 1400.0
    assert allowed.time(Candidate(Step(1.0), 40.0), cold) == 400.0
    every = list(allowed.candidates(50.0))
    assert [one.condition for one in every] == [cold] * (len(every) // 2) + [warm] * (len(every) // 2)
    wet = Allowance(rest=60.0, wet=100.0).candidates(50.0)
    assert {one.duration for one in wet} == {10.0, 20.0, 40.0}  # 40 s and their rests end as it dries


@pytest.mark.parametrize("name", ["rest", "hydration", "wet", "soak"])
def test_a_time_that_cannot_be_is_refused(name: str) -> None:
    assert getattr(Allowance(**{name: 0.0}), name) == 0.0
    for wrong in (-1.0, math.nan, None, "60 s", *([math.inf] if name != "wet" else [])):
        with pytest.raises(InputError) as caught:
            Allowance(**{name: wrong})
        assert caught.value.where == name


@pytest.mark.parametrize("name", ["rate", "longest"])
@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf, "10 Hz"])
def test_a_rate_or_a_length_that_cannot_be_is_refused(name: str, wrong: object) -> None:
    with pytest.raises(InputError) as caught:
        Allowance(**{name: wrong})
    assert caught.value.where == name
