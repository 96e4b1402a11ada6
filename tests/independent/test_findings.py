"""Faults put into clean records of friend-2: each is found where it is, and a clean record has none."""

from __future__ import annotations

import numpy as np
import pytest

import ipmclab
from ipmclab import signals
from tests.independent.thesis import FRIEND_2, respond

RATE, ROWS = 50.0, 2000
NOISE = {"current": 1e-4, "displacement": 2e-6, "force": 1e-4}
TIME = np.arange(ROWS) / RATE
EDGE = 100
STEP = "step 1 V delay=2 s"


def columns(signal: str, *, seed: int = 20261121, hold: str = "zero", noise: float = 1.0) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    voltage = signals.parse(signal).voltage(TIME)
    clean = respond(FRIEND_2, voltage, RATE, hold)
    return {
        "time": TIME.copy(),
        "voltage": voltage,
        **{name: clean[name] + noise * level * generator.standard_normal(ROWS) for name, level in NOISE.items()},
    }


def found(data: dict[str, np.ndarray], channel: str | None, code: str, hold: str = "zero") -> list[ipmclab.Finding]:
    run = ipmclab.Run.from_arrays(**data, hold=hold)
    return [finding for finding in ipmclab.check(run) if finding.channel == channel and finding.code == code]


@pytest.mark.parametrize(
    "signal",
    [
        "step 1 V",
        STEP,
        "sine 1 V 0.1 Hz",
        "square 1 V 0.1 Hz",
        "triangle 1 V 0.2 Hz",
        "chirp 1 V 0.05 Hz 5 Hz",
        "prbs 1 V 0.5 s",
        "random 1 V 0.5 s",
    ],
)
@pytest.mark.parametrize("hold", ["zero", "first"])
def test_a_clean_record_has_no_findings(signal: str, hold: str) -> None:
    for seed in range(3):
        run = ipmclab.Run.from_arrays(**columns(signal, seed=seed, hold=hold), hold=hold)
        assert [finding.code for finding in ipmclab.check(run)] == []


def test_an_inrush_peak_is_not_a_spike_and_a_spike_is() -> None:
    data = columns(STEP)
    data["current"][700] += 0.01
    spikes = found(data, "current", "spike")
    assert [finding.samples for finding in spikes] == [((700, 701),)]
    assert spikes[0].effect == "mask"


@pytest.mark.parametrize("level", [20e-3, 30e-3, 33.3e-3])
def test_clipped_readings_are_bounds_on_both_sides(level: float) -> None:
    data = columns("sine 1 V 0.1 Hz")
    whole = data["current"].copy()
    data["current"] = np.clip(whole, -level, level)
    run = ipmclab.Run.from_arrays(**data)
    effects = {}
    for finding in ipmclab.check(run):
        if finding.channel != "current":
            continue
        for start, stop in finding.samples:
            for row in range(start, stop):
                effects.setdefault(row, set()).add(finding.effect)
    cut = np.flatnonzero(np.abs(whole) > level)
    bounded = [row for row in cut if effects.get(row, set()) & {"lower_bound", "upper_bound"}]
    assert len(bounded) > 0.9 * len(cut), "a reading at the range limit is censored"
    masked = [row for row in bounded if "mask" in effects[row]]
    assert not masked, "what is known as a bound must not be thrown away as well"


@pytest.mark.parametrize("level", [1.0e-3, 1.2e-3, 1.4e-3, 1.6e-3])
def test_a_load_cell_at_its_end_is_found_however_long_it_stays_there(level: float) -> None:
    data = columns(STEP)
    data["force"] = np.clip(data["force"], None, level)
    clipped = found(data, "force", "clipped")
    assert len(clipped) == 1
    assert clipped[0].effect == "lower_bound"
    assert clipped[0].count > 0.8 * np.sum(data["force"] == level)


def test_contact_that_never_comes() -> None:
    data = columns(STEP)
    data["current"] = NOISE["current"] * np.random.default_rng(1).standard_normal(ROWS)
    missing = found(data, "current", "contact-missing")
    assert [finding.samples for finding in missing] == [((EDGE, ROWS),)]


def test_contact_that_comes_late() -> None:
    data = columns(STEP)
    late = 90
    data["current"][EDGE + late :] = data["current"][EDGE:-late].copy()
    data["current"][EDGE : EDGE + late] = NOISE["current"] * np.random.default_rng(1).standard_normal(late)
    missing = found(data, "current", "contact-missing")
    assert [finding.samples for finding in missing] == [((EDGE, EDGE + late),)]


@pytest.mark.parametrize("channel", ["displacement", "force"])
def test_a_response_against_the_sign_convention(channel: str) -> None:
    data = columns(STEP)
    data[channel] = -data[channel]
    assert len(found(data, channel, "response-opposite")) == 1


def test_drift_before_the_step() -> None:
    data = columns(STEP)
    data["displacement"] += 1e-5 * TIME
    drift = found(data, "displacement", "drift-before-step")
    assert len(drift) == 1
    assert drift[0].values["slope"] == pytest.approx(1e-5, rel=0.15)


def test_a_slip() -> None:
    data = columns(STEP)
    data["displacement"][900:] += 5e-5
    slips = found(data, "displacement", "slip")
    assert len(slips) == 1
    assert slips[0].samples == ((900, 901),)


def test_a_channel_with_nothing_but_noise() -> None:
    data = columns(STEP)
    data["force"] = NOISE["force"] * np.random.default_rng(1).standard_normal(ROWS)
    assert len(found(data, "force", "noise-only")) == 1


def test_a_current_that_leads_by_a_row() -> None:
    data = columns(STEP)
    data["current"][:-1] = data["current"][1:].copy()
    skewed = found(data, "current", "channel-skew")
    assert [finding.values["lead_rows"] for finding in skewed] == [1]


def test_an_irregular_clock() -> None:
    data = columns(STEP)
    data["time"] = TIME + 0.004 * np.random.default_rng(1).random(ROWS)
    assert len(found(data, None, "sampling-irregular")) == 1


def test_stale_readings() -> None:
    data = columns(STEP)
    data["current"][1::2] = data["current"][0::2]
    stale = found(data, "current", "stale-values")
    assert len(stale) == 1
    assert stale[0].values["fraction"] == pytest.approx(0.5, abs=0.02)


def test_a_current_that_rises_at_constant_voltage() -> None:
    data = columns(STEP)
    data["current"] += 3e-4 * np.maximum(TIME - 10.0, 0.0)
    assert len(found(data, "current", "current-rises")) == 1


def test_runs_that_should_begin_alike_and_do_not() -> None:
    from ipmclab.quality import check_together

    step = columns("step 1 V")
    square = columns("square 1 V 0.1 Hz", seed=2)
    square["current"] = 0.6 * square["current"]
    same = columns("square 1 V 0.1 Hz", seed=3)

    def run(data: dict[str, np.ndarray]) -> ipmclab.Run:
        sample = ipmclab.Sample(id="strip-1")
        return ipmclab.Run.from_arrays(**data, metadata=ipmclab.RunMetadata(sample=sample, starts_from_rest=True))

    # For 5 s both voltages are 1 V: the responses must agree, or the strip has changed.
    def warnings(*runs: ipmclab.Run) -> list[ipmclab.Finding]:
        return [finding for finding in check_together(runs) if finding.severity != "info"]

    changed = warnings(run(step), run(square))
    assert [(finding.code, finding.channel) for finding in changed] == [("state-changed", "current")]
    assert changed[0].values["ratio"] == pytest.approx(0.6, abs=0.01)
    assert not warnings(run(step), run(same))
