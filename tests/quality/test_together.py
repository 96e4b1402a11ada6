"""Runs of one sample held against each other, without a model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from ipmclab.model import load_actuator, simulate
from ipmclab.quality import check_together
from ipmclab.quality.change import _variance_of_mean
from ipmclab.run import Run
from ipmclab.sample import Sample

Read = Callable[..., Run]


def test_a_square_that_starts_as_its_step(read: Read) -> None:
    step, square = read("step 1 V", seed=1), read("square 1 V 0.1 Hz", seed=2)
    findings = check_together([step, square])
    assert {finding.code for finding in findings} == {"state-unchanged"}
    assert {finding.channel for finding in findings} == {"current", "displacement", "force"}
    assert findings[0].values["until"] == pytest.approx(5.0, abs=0.05)
    for finding in findings:
        difference, noise = finding.values["difference"], finding.values["noise"]
        assert isinstance(difference, float)
        assert isinstance(noise, float)
        assert difference == pytest.approx(noise, rel=0.15)


@pytest.mark.parametrize("ratio", [0.32, 0.87])
def test_a_changed_state(read: Read, ratio: float) -> None:
    step, square = read("step 1 V", seed=1), read("square 1 V 0.1 Hz", seed=2)
    assert square.displacement is not None
    weaker = replace(square, displacement=ratio * square.displacement)
    changed = [finding for finding in check_together([step, weaker]) if finding.code == "state-changed"]
    assert [finding.channel for finding in changed] == ["displacement"]
    assert changed[0].values["ratio"] == pytest.approx(ratio, abs=0.01)
    assert "run 1 (square 1 V 0.1 Hz) reads" in changed[0].message
    assert (changed[0].values["first"], changed[0].values["second"]) == (0, 1)


def test_what_cannot_be_compared_is_not(read: Read) -> None:
    step = read("step 1 V")
    assert check_together([step]) == ()
    assert check_together([step, read("step 2 V")]) == ()
    assert check_together([step, read("sine 1 V 0.1 Hz")]) == ()
    assert check_together([step, read("step 1 V", rate=100.0)]) == ()
    one = replace(step, metadata=replace(step.metadata, sample=Sample(id="a")))
    other = replace(step, metadata=replace(step.metadata, sample=Sample(id="b")))
    assert check_together([one, other]) == ()


def test_runs_that_wait_differently_before_the_step_and_have_gaps(read: Read) -> None:
    early, late = read("step 1 V delay=2 s", seed=1), read("step 1 V delay=9 s", seed=2)
    assert late.current is not None
    gaps = late.current.copy()
    gaps[700:720] = np.nan
    findings = check_together([early, replace(late, current=gaps)])
    assert {finding.code for finding in findings} == {"state-unchanged"}
    assert len(findings) == 3


def test_the_same_record_twice_is_no_agreement_of_two(read: Read) -> None:
    step = read("step 1 V")
    (finding,) = check_together([step, replace(step, file="copy.nc")])
    assert (finding.code, finding.severity) == ("same-run-twice", "warning")
    assert "run 1 (copy.nc) is the same record as run 0" in finding.message


def test_rows_that_are_missing_are_no_change_of_state() -> None:
    """Rows were compared by their numbers: behind a gap those of other times stood side by side."""
    time = np.arange(1500) / 25.0
    current = np.where(time >= 2.0, 2e-3 + 8e-2 * np.exp(-(time - 2.0) / 3.0), 0.0)
    current += 2e-4 * np.random.default_rng(20261128).standard_normal(1500)
    whole = Run.from_arrays(time=time, voltage=np.where(time >= 2.0, 1.0, 0.0), current=current)
    there = np.ones(1500, dtype=bool)
    there[100:140] = there[700] = False
    part = Run(time=time[there], voltage=whole.voltage[there], current=current[there], file="part.nc")
    for pair in ([whole, part], [part, whole]):
        (finding,) = check_together(pair)
        assert finding.code == "state-unchanged"
        assert finding.values["difference"] == 0.0
        assert "(part.nc)" in finding.message


def held(level: float, noise: float, seed: int) -> Run:
    """At rest for 5 s, then 40 s at 1 V, through which the displacement stands at a level."""
    time = np.arange(2250) / 50.0
    on = time >= 5.0
    scatter = noise * np.random.default_rng(seed).standard_normal(len(time))
    return Run.from_arrays(time=time, voltage=1.0 * on, displacement=level * on + scatter)


@pytest.mark.parametrize(("ratio", "code"), [(1.03, "state-changed"), (1.01, "state-unchanged")])
def test_a_state_changes_by_two_percent_of_the_response(ratio: float, code: str) -> None:
    (finding,) = check_together([held(1e-3, 1e-8, 1), held(ratio * 1e-3, 1e-8, 2)])
    assert finding.code == code


@pytest.mark.parametrize(("errors", "code"), [(8.0, "state-changed"), (2.0, "state-unchanged")])
def test_and_by_six_standard_errors_of_a_twentieth_of_the_record(errors: float, code: str) -> None:
    noise = 2e-4
    error = np.sqrt(2.0) * noise / np.sqrt(2000 / 20)
    (finding,) = check_together([held(1e-3, noise, 1), held(1e-3 + errors * error, noise, 2)])
    assert finding.code == code


def read_with(noise: float, follows: float, seed: int, *, signal: str = "step 1 V", gain: float = 1.0) -> Run:
    """20 s of current and displacement, in noise of a share of their peak that follows itself."""
    clean = simulate(load_actuator("friend-2"), signal, duration=20.0, rate=25.0)
    generator = np.random.default_rng(seed)
    channels = {}
    for name in ("current", "displacement"):
        values = clean.channels[name]
        new = (1.0 - follows**2) ** 0.5 * generator.standard_normal(len(values) + 200)
        error = lfilter([1.0], [1.0, -follows], new)[200:]
        channels[name] = gain * values + noise * float(np.abs(values).max()) * error
    return Run.from_arrays(
        time=clean.time, voltage=clean.voltage, current=channels["current"], displacement=channels["displacement"]
    )


@pytest.mark.parametrize("follows", [0.6, 0.9, 0.97])
@pytest.mark.parametrize("signal", ["step 1 V", "step 1 V delay=3 s", "sine 1 V 0.1 Hz"])
def test_noise_that_follows_itself_is_no_change_of_state(signal: str, follows: float) -> None:
    """Means of neighbours that are alike were taken to be as well known as those of independent readings."""
    findings = [
        finding
        for seed in range(0, 20, 2)
        for finding in check_together([read_with(0.03, follows, seed + one, signal=signal) for one in (0, 1)])
    ]
    assert len(findings) == 20
    assert [finding.code for finding in findings].count("state-changed") <= 1


@pytest.mark.parametrize("follows", [0.0, 0.6, 0.9])
def test_a_change_that_turns_with_the_voltage_is_one(follows: float) -> None:
    """Over whole periods its means are none."""
    same, weaker = (
        read_with(0.01, follows, seed, signal="sine 1 V 1 Hz", gain=gain) for seed, gain in ((1, 1.0), (2, 0.9))
    )
    found = check_together([same, weaker])
    assert [(one.code, one.channel) for one in found] == [
        ("state-changed", "current"),
        ("state-changed", "displacement"),
    ]


def test_rest_has_an_error_too() -> None:
    """Few rows at rest before many others: their mean is off by more than the means of what follows."""
    time = np.arange(4000) / 50.0
    on = time >= 0.4

    def held(seed: int) -> Run:
        scatter = 2e-4 * np.random.default_rng(seed).standard_normal(len(time))
        return Run.from_arrays(time=time, voltage=1.0 * on, displacement=1e-3 * on + scatter)

    codes = [check_together([held(seed), held(seed + 1)])[0].code for seed in range(0, 40, 2)]
    assert codes == ["state-unchanged"] * 20


@pytest.mark.parametrize(
    ("follows", "moving", "count"), [(0.0, 0.0, 7), (0.9, 0.0, 25), (0.97, -0.8, 40), (0.4, -0.2, 1)]
)
def test_the_variance_of_a_mean_is_that_of_the_whole_covariance(follows: float, moving: float, count: int) -> None:
    weights = np.array([1.0, *((follows + moving) * follows ** np.arange(6000))])  # of news, by their age
    covariance = np.array([weights[: len(weights) - k] @ weights[k:] for k in range(count)])
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    assert _variance_of_mean(follows, moving, count) == pytest.approx(covariance[apart].mean(), rel=1e-9)
