"""What counts as one number of a run: under which voltage it was measured, for how long, and in which air."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ipmclab import InputError, Run, RunMetadata, load_actuator, simulate
from ipmclab.consistency import Fact, cross_check, facts_of_runs
from ipmclab.consistency.flick import flicks
from ipmclab.consistency.prefix import in_one_environment
from ipmclab.consistency.push import pushes
from ipmclab.run import Finding, FloatArray
from ipmclab.signals import Samples

STRIP = load_actuator("friend-2")


def recorded(voltage: FloatArray, *, about: RunMetadata | None = None, times: float = 1.0) -> Run:
    """What a noisy instrument reads of the strip at 50 Hz."""
    time, rng = np.arange(len(voltage)) / 50.0, np.random.default_rng(20261124)
    clean = simulate(STRIP, Samples(time, voltage), duration=len(voltage) / 50.0, rate=50.0)
    noise = {"current": 1e-5, "displacement": 1e-6, "force": 1e-6}
    read = {name: times * clean.channels[name] + size * rng.standard_normal(len(time)) for name, size in noise.items()}
    return Run.from_arrays(time=time, voltage=voltage, hold="zero", metadata=about or RunMetadata(), **read)


@pytest.mark.parametrize(("before", "expected"), [(0.0, "step 1 V"), (0.5, None)])
def test_a_run_has_the_amplitude_of_a_step_where_it_steps_from_rest(before: float, expected: str | None) -> None:
    """From 0.5 V on, a strip answers to a step of 0.5 V and to what was before."""
    facts = facts_of_runs([recorded(np.where(np.arange(500) < 100, before, 1.0))])
    assert {fact.signal for fact in facts} == ({expected} if expected else set())


@pytest.mark.parametrize("wave", ["sine", "square"])
def test_a_rest_after_a_wave_changes_none_of_its_numbers(wave: str) -> None:
    """After 30 s at 0 V a square was called one of 0 V: any current was then more than it could draw."""
    turn = np.sin(2.0 * np.pi * 0.1 * np.arange(2000) / 50.0 + (1e-9 if wave == "square" else 0.0))
    voltage = turn if wave == "sine" else np.sign(turn)
    whole = facts_of_runs([recorded(voltage)])
    assert {fact.signal for fact in whole} == {f"{wave} 1 V 0.1 Hz"}
    for rest in (150, 1500):
        rested = facts_of_runs([recorded(np.concatenate([voltage, np.zeros(rest)]))])
        assert [fact.metric for fact in rested] == [fact.metric for fact in whole]
        for one, other in zip(rested, whole, strict=True):
            assert one.like(other)
            assert one.value == pytest.approx(other.value, rel=0.01)
            assert one.time == pytest.approx(40.0, abs=0.02)


AIR = {"temperature": 20.0, "relative_humidity": 80.0}


@pytest.mark.parametrize(
    ("other", "is_told"),
    [
        ({}, True),
        ({"relative_humidity": 81.0}, True),
        ({"relative_humidity": 78.9}, False),
        ({"relative_humidity": None}, True),
        ({"temperature": 19.0}, True),
        ({"temperature": 18.9}, False),
        ({"temperature": 45.0}, False),
        ({"temperature": 45.0, "relative_humidity": None}, False),
    ],
)
def test_runs_in_another_air_do_not_contradict_each_other(other: dict[str, float | None], is_told: bool) -> None:
    """At 30 %RH a strip draws less than at 80 %RH: that is no second state."""
    voltage = np.where(np.arange(1000) < 100, 0.0, 1.0)
    first = recorded(voltage, about=RunMetadata(**AIR))
    second = recorded(voltage, times=0.5, about=RunMetadata(**{**AIR, **other}))
    codes = {one.code for one in cross_check(STRIP, [first, second])}
    assert bool(codes & {"two-states", "prefix-disagrees"}) is is_told
    pair = Finding("state-changed", "info", "", values={"first": 0, "second": 1})
    assert in_one_environment(pair, [first, second]) is is_told


def test_a_push_a_ring_and_a_wave_say_in_which_air_they_were() -> None:
    time = np.arange(2000) / 50.0
    way = 2e-4 * np.abs(np.sin(np.pi * time / 20.0))
    push = Run.from_arrays(
        time=time, voltage=0.0 * time, displacement=way, force=3.0 * way, metadata=RunMetadata(**AIR)
    )
    ring = 1e-3 * np.exp(-time) * np.cos(2.0 * np.pi * 2.0 * time)
    flick = Run.from_arrays(time=time, voltage=0.0 * time, displacement=ring, metadata=RunMetadata(**AIR))
    facts = [*pushes([push]), *flicks([flick]), *facts_of_runs([recorded(np.sin(time), about=RunMetadata(**AIR))])]
    assert {fact.waveform for fact in facts} == {"push", "flick", "sine"}
    assert {(fact.temperature, fact.relative_humidity) for fact in facts} == {(20.0, 80.0)}


def test_a_push_is_held_against_a_motion_of_its_own_air_alone() -> None:
    step = {"waveform": "step", "amplitude": 1.0, "time": 5.0, "temperature": 20.0}
    force = Fact("mine", metric="max_force", value=1.6e-3, uncertainty=1e-5, where="a", **step)
    motion = Fact("mine", metric="max_displacement", value=0.6e-3, uncertainty=1e-5, where="b", **step)
    push = Fact("mine", "push", "stiffness", 20.0, 0.1, where="c", temperature=20.0)
    for warmer, is_told in ((0.0, True), (10.0, False)):
        facts = [force, motion, replace(push, temperature=20.0 + warmer)]
        codes = {one.code for one in cross_check(STRIP, facts=facts)}
        assert ("push-against-motion" in codes) is is_told


@pytest.mark.parametrize(
    ("fact", "message"),
    [
        ({"amplitude": None}, "a: the amplitude of the step is missing; give amplitude, in V"),
        ({"waveform": "sine"}, "a: the frequency of the sine is missing; give frequency, in Hz"),
        ({"waveform": "sinus", "frequency": 1.0}, "a: unknown waveform 'sinus'; did you mean 'sine'?"),
        ({"value": 0.0}, "a: the max_force is 0 with a standard uncertainty of 1e-05"),
        ({"value": -1e-3}, "a: the max_force is -0.001"),
        ({"value": float("nan")}, "a: the max_force is nan"),
        ({"value": float("inf")}, "a: the max_force is inf"),
        ({"uncertainty": -1e-5}, "uncertainty of -1e-05; give the size"),
        ({"where": "", "value": 0.0}, "max_force of the step: the max_force is 0"),
    ],
)
def test_a_fact_that_nothing_can_be_held_against_is_refused(fact: dict[str, Any], message: str) -> None:
    """The checks ended in a division by zero, a square root of less than 0, or in silence."""
    whole = {"waveform": "step", "metric": "max_force", "value": 1e-3, "uncertainty": 1e-5, "amplitude": 1.0}
    assert Fact("mine", **{**whole, "uncertainty": 0.0}, where="a").value == 1e-3
    with pytest.raises(InputError) as caught:
        Fact("mine", **{**whole, "where": "a", **fact})
    assert message in str(caught.value)


def test_signals_are_the_same_within_two_percent() -> None:
    sine = Fact("mine", "sine", "max_force", 1e-3, 1e-5, 1.0, 0.1)
    for amplitude, frequency, is_same in (
        (1.019, 0.1, True),
        (1.021, 0.1, False),
        (1.0, 0.1019, True),
        (1.0, 0.103, False),
    ):
        other = replace(sine, amplitude=amplitude, frequency=frequency)
        assert sine.like(other) is other.like(sine) is is_same
    assert not sine.like(replace(sine, waveform="square"))
    assert not sine.like(replace(sine, conditions="20 degC, 80 %RH"))


@pytest.mark.parametrize(("waveform", "swing"), [("step", 2.0), ("sine", 4.0), ("square", 4.0)])
def test_a_wave_reverses_a_charged_strip(waveform: Any, swing: float) -> None:
    assert Fact("mine", waveform, "peak_current", 0.1, 1e-3, -2.0, 0.1).swing == swing


@pytest.mark.parametrize(("mean", "is_fact"), [(0.19, True), (0.21, False)])
def test_a_wave_about_another_voltage_than_zero_is_no_fact(mean: float, is_fact: bool) -> None:
    """A strip that is charged on the average answers otherwise: a tenth of the height is allowed."""
    voltage = mean + np.sin(2.0 * np.pi * 0.1 * np.arange(2000) / 50.0)
    voltage[:1] = 0.0
    assert bool(facts_of_runs([recorded(voltage)])) is is_fact
