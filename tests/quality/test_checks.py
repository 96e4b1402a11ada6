"""Each fault, made here, is found where it is, with its numbers; nothing else is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from ipmclab import identify
from ipmclab.model import load_actuator
from ipmclab.quality import censored, check, usable
from ipmclab.quality.record import Record
from ipmclab.quality.skew import is_far_off
from ipmclab.run import QUALITY_FLAGS, Finding, Run

Read = Callable[..., Run]
STEP = "step 1 V delay=4 s"
EDGE = 200


def only(run: Run, code: str, **more: Any) -> Finding:
    """The one finding that is no information, which must be of that code."""
    findings = [finding for finding in check(run, **more) if finding.severity != "info"]
    assert [finding.code for finding in findings] == [code], [finding.message for finding in findings]
    return findings[0]


def changed(run: Run, channel: str, rows: int | slice | np.ndarray, values: Any, *, add: bool = False) -> Run:
    readings = getattr(run, channel).copy()
    readings[rows] = readings[rows] + values if add else values
    return replace(run, **{channel: readings})


# -- readings that are not there


@pytest.mark.parametrize("as_nan", [True, False])
def test_a_lost_laser(read: Read, as_nan: bool) -> None:
    run = read(STEP)
    lost = np.zeros(2000, dtype=bool)
    lost[700:760] = lost[800:1900] = True
    run = changed(run, "displacement", lost, np.nan if as_nan else -0.0999999)
    run = changed(run, "displacement", np.array([698, 699, 800]), [-0.0801688, -0.0801686, -0.0801682])
    finding = only(run, "laser-lost")
    assert finding.samples == ((698, 760), (800, 1900))
    assert finding.effect == "mask"
    assert finding.values["first_row"] == 698
    assert finding.values["count"] == 1162
    assert finding.values["sentinel_count"] == 1159
    assert finding.values["out_of_range_count"] == 3
    assert "row 698 (13.96 s)" in finding.message
    assert not usable(run, [finding])["displacement"][lost].any()


@pytest.mark.parametrize("missing", [[0], [4], [7, 8], [9, 10], [4, 8, 9]])
def test_a_missing_row_leaves_the_others_at_rest(missing: list[int]) -> None:
    """Nine rows at exactly one value before a step: the missing one neither begins nor ends what is no sentinel."""
    time = np.arange(200) / 50.0
    displacement = np.where(time < 0.18, 0.0, 5e-3 + 1e-3 * (1.0 - np.exp(-(time - 0.18) / 0.4)))
    displacement[missing] = np.nan
    run = Run.from_arrays(time=time, voltage=np.where(time < 0.18, 0.0, 1.0), displacement=displacement)
    (finding,) = [finding for finding in check(run) if finding.effect == "mask"]
    assert [row for start, stop in finding.samples for row in range(start, stop)] == missing
    lost = changed(changed(run, "displacement", 55, np.nan), "displacement", np.array([50, 51, 60, 61, 62]), -0.1)
    assert set(np.flatnonzero(~usable(lost, check(lost))["displacement"])) == {*missing, 50, 51, 55, 60, 61, 62}


def test_a_sentinel_that_the_importer_marked(read: Read) -> None:
    run = read(STEP)
    bits = np.zeros(2000, dtype=np.uint8)
    bits[500:510] = QUALITY_FLAGS["sentinel"]
    assert only(replace(run, quality={"displacement": bits}), "laser-lost").samples == ((500, 510),)


def test_a_laser_that_never_saw_its_target(read: Read) -> None:
    finding = only(changed(read(STEP), "displacement", slice(None), np.nan), "laser-lost")
    assert finding.severity == "error"
    assert finding.count == 2000


def test_missing_current_and_rows_known_at_recording(read: Read) -> None:
    run = changed(read(STEP), "current", slice(900, 950), np.nan)
    bits = np.zeros(2000, dtype=np.uint8)
    bits[300:310] = QUALITY_FLAGS["masked_by_operator"]
    bits[400:402] = QUALITY_FLAGS["contact_lost"]
    run = replace(run, quality={"force": bits})
    assert only(run, "reading-missing").samples == ((900, 950),)
    notes = {finding.code: finding for finding in check(run) if finding.severity == "info"}
    assert notes["masked-by-operator"].samples == ((300, 310),)
    assert notes["contact-flagged"].samples == ((400, 402),)
    assert np.flatnonzero(~usable(run, check(run))["force"]).tolist() == [*range(300, 310), 400, 401]


# -- the end of the range


def test_a_clipped_sine_is_censored_on_both_sides(read: Read) -> None:
    run = read("sine 1 V 0.1 Hz")
    assert run.current is not None
    run = replace(run, current=run.current.clip(-0.03, 0.03))
    assert run.current is not None
    findings = check(run)
    assert {(finding.code, finding.effect) for finding in findings} == {
        ("clipped", "lower_bound"),
        ("clipped", "upper_bound"),
    }
    bound = censored(run, findings)["current"]
    assert np.array_equal(bound, np.where(run.current == 0.03, 1, np.where(run.current == -0.03, -1, 0)))
    assert np.array_equal(usable(run, findings)["current"], bound == 0)


@pytest.mark.parametrize("level", [0.058, 0.05, 0.03])
def test_a_clipped_inrush(read: Read, level: float) -> None:
    run = read(STEP)
    assert run.current is not None
    whole = run.current
    finding = only(replace(run, current=whole.clip(None, level)), "clipped")
    assert finding.samples[0][0] == EDGE
    assert finding.count == np.count_nonzero(whole > level)
    assert finding.values["level"] == level


def test_rows_flagged_as_clipped_become_bounds(read: Read) -> None:
    bits = np.zeros(2000, dtype=np.uint8)
    bits[EDGE : EDGE + 2] = QUALITY_FLAGS["clipped"]
    finding = only(replace(read(STEP), quality={"current": bits}), "clipped")
    assert (finding.samples, finding.effect) == (((EDGE, EDGE + 2),), "lower_bound")


def test_readings_within_two_percent_of_a_stated_range(read: Read) -> None:
    run = read("square 1 V 0.1 Hz")
    run = replace(run, metadata=replace(run.metadata, ranges={"current": (-0.1, 0.1), "force": (0.0, 0.09807)}))
    assert run.current is not None
    finding = only(run, "range-limit")
    near = run.current <= -0.098
    assert near.any()
    assert np.array_equal(censored(run, [finding])["current"] == -1, near)
    assert "lower limit of the range, -100 mA" in finding.message


@pytest.mark.parametrize(("quantum", "peak"), [(1e-4, 0.0499), (1e-4, 0.2048), (1e-5, 0.02)])
def test_an_inrush_peak_at_a_full_scale_is_kept_and_marked(read: Read, quantum: float, peak: float) -> None:
    run = read(STEP)
    assert run.current is not None
    counts = np.minimum(np.rint(run.current / quantum), np.rint(0.5 * peak / quantum))
    counts[EDGE] = np.rint(peak / quantum)
    run = replace(run, current=counts * quantum)
    finding = next(finding for finding in check(run) if finding.code == "possible-range-limit")
    assert (finding.samples, finding.effect) == (((EDGE, EDGE + 1),), "none")
    assert usable(run, check(run))["current"][EDGE]
    assert not any(finding.code == "spike" for finding in check(run))


# -- sudden changes


def test_spikes_of_one_to_three_rows(read: Read) -> None:
    run = changed(read(STEP), "current", np.array([700, 900, 901, 1200, 1201, 1202]), 4e-3, add=True)
    finding = only(run, "spike")
    assert finding.samples == ((700, 701), (900, 902), (1200, 1203))
    assert finding.effect == "mask"
    assert "3 isolated spikes" in finding.message


@pytest.mark.parametrize("signal", ["sine 1 V 0.1 Hz", "square 1 V 0.1 Hz", STEP])
def test_many_spikes_are_not_how_the_current_is(read: Read, signal: str) -> None:
    """Beyond one row in a hundred none was found, however large."""
    run, rng = read(signal), np.random.default_rng(20261121)
    rows = np.sort(rng.choice(np.arange(20, 1980, 8), 40, replace=False))
    (finding,) = [one for one in check(changed(run, "current", rows, 0.2, add=True)) if one.code == "spike"]
    found = [row for first, stop in finding.samples for row in range(first, stop)]
    assert set(found) <= set(rows.tolist())
    assert len(found) > 36  # none is looked for within three rows of an edge


def test_an_inrush_is_no_spike_even_when_pulses_are_one_row_long(read: Read) -> None:
    assert not [finding.message for finding in check(read("prbs 1 V 0.02 s")) if finding.code == "spike"]


@pytest.mark.parametrize(
    ("channel", "code"), [("displacement", "slip"), ("force", "slip"), ("current", "contact-changed")]
)
def test_a_jump_without_the_voltage(read: Read, channel: str, code: str) -> None:
    run = read(STEP)
    height = 0.2 * float(np.ptp(getattr(run, channel)))
    finding = only(changed(run, channel, slice(1300, None), -height, add=True), code)
    assert finding.samples == ((1300, 1301),)
    assert finding.values["height"] == pytest.approx(-height, rel=0.1)


@pytest.mark.parametrize(("part", "slips"), [(0.007, True), (0.0035, False)])
def test_a_slip_is_half_a_percent_of_the_range_or_more(read: Read, part: float, slips: bool) -> None:
    run = read(STEP, noise=0.01, round_off=False)
    assert run.displacement is not None
    lower = changed(run, "displacement", slice(1300, None), -part * float(np.ptp(run.displacement)), add=True)
    assert ("slip" in {finding.code for finding in check(lower)}) is slips


# -- contact


@pytest.mark.parametrize("rows", [5, 40, 300])
def test_a_contact_that_comes_late(read: Read, rows: int) -> None:
    clean = read("step 1 V delay=4 s")
    late = read(f"step 1 V delay={4 + rows / 50} s")
    run = replace(late, voltage=clean.voltage)
    finding = only(run, "contact-missing")
    assert finding.severity == "error"
    assert finding.samples == ((EDGE, EDGE + rows),)
    assert finding.values["count"] == rows
    masks = usable(run, [finding])
    assert all(np.flatnonzero(~mask).tolist() == list(range(EDGE, EDGE + rows)) for mask in masks.values())


@pytest.mark.parametrize("shape", ["step", "square"])
@pytest.mark.parametrize("milliampere", [1.0, 9.6, 10.0])
def test_a_resistor_in_coarse_steps_has_contact(shape: str, milliampere: float) -> None:
    """Its readings are two numbers, a jump apart: that is no resolution, and no noise."""
    time = np.arange(2000) / 50.0
    voltage = np.where(time >= 4.0, 1.0, 0.0) if shape == "step" else np.sign(np.sin(0.2 * np.pi * time + 1e-6))
    current = 1e-3 * np.round(milliampere * voltage)
    assert not check(Run.from_arrays(time=time, voltage=voltage, current=current))


@pytest.mark.parametrize("signal", [STEP, "sine 1 V 0.1 Hz"])
def test_a_gap_of_the_time_is_a_gap_alone(read: Read, signal: str) -> None:
    """What changed slowly meanwhile is no jump."""
    run = read(signal)
    kept = np.r_[0:230, 600:2000]
    arrays = {name: values[kept] for name, values in run.channels.items() if len(values) == len(run)}
    only(Run.from_arrays(time=run.time[kept], hold=run.hold, metadata=run.metadata, **arrays), "rows-missing")


def test_a_contact_that_opens_and_closes_again(read: Read) -> None:
    run = read("step 1 V delay=4 s")
    later = read("step 1 V delay=20 s")
    assert run.current is not None
    assert later.current is not None
    current = run.current.copy()
    current[800:1000] = later.current[800:1000]
    current[1000:] += later.current[1000:]
    finding = only(replace(run, current=current), "contact-lost")
    ((start, stop),) = finding.samples
    assert abs(start - 800) <= 2
    assert stop == 1000
    assert finding.effect == "none"  # what follows is as wrong as what it covers


# -- before the step, and the clock


def test_drift_before_the_step(read: Read) -> None:
    run = read(STEP)
    finding = only(changed(run, "displacement", slice(None), 2e-5 * run.time, add=True), "drift-before-step")
    error = finding.values["standard_error"]
    assert isinstance(error, float)
    assert finding.values["slope"] == pytest.approx(2e-5, abs=4 * error)
    assert error < 1e-6


def test_a_current_that_is_not_zero_before_the_step(read: Read) -> None:
    run = changed(read(STEP), "current", slice(None), 5e-4, add=True)
    finding = only(run, "offset-before-step")
    assert finding.values["offset"] == pytest.approx(5e-4, abs=3e-5)
    assert "instead of zero" in finding.message


@pytest.mark.parametrize("follows", [0.0, 0.7])
def test_the_error_of_a_drift_is_honest(follows: float) -> None:
    """For white noise, and for noise of which each reading keeps a part of the one before."""
    rng = np.random.default_rng(20261121)
    slopes, errors = [], []
    for _ in range(60):
        time = np.arange(600) / 50.0
        voltage = np.where(time >= 4.0, 1.0, 0.0)
        noise = lfilter([2e-6], [1.0, -follows], rng.standard_normal(700))[100:]
        displacement = 1e-5 * time + 1e-4 * (1 - np.exp(-np.maximum(time - 4.0, 0.0))) + noise
        run = Run.from_arrays(time=time, voltage=voltage, displacement=displacement)
        finding = next(finding for finding in check(run) if finding.code == "drift-before-step")
        slopes.append(finding.values["slope"])
        errors.append(finding.values["standard_error"])
    assert np.std(slopes) == pytest.approx(np.mean(errors), rel=0.3)


@pytest.mark.parametrize("short", [False, True])
def test_a_gap_in_which_the_voltage_moves_is_said_by_check_and_by_a_fit(read: Read, short: bool) -> None:
    """6 s of a sine of 10 s, whose course the fit cannot know; one row at its peak, which a straight line meets."""
    run = read("sine 1 V 0.1 Hz")
    kept = np.r_[0:1125, 1126:2000] if short else np.r_[0:1000, 1300:2000]
    lost = Run.from_arrays(time=run.time[kept], voltage=run.voltage[kept], current=run.channels["current"][kept])
    (finding,) = [one for one in check(lost) if one.code == "rows-missing"]
    assert finding.values["moving"] == (not short)
    assert ("its course in between is lost" in finding.message) == (not short)
    fit = identify(load_actuator("friend-2"), lost, free="circuit.dc_resistivity")
    assert any(one.code == "rows-missing" for one in fit.findings) == (not short)


def test_the_clock(read: Read) -> None:
    run = read(STEP)
    unknown = replace(run, metadata=replace(run.metadata, sampling_period_known=False))
    assert "0.02 s was assumed" in only(unknown, "sampling-period-unknown").message
    keep = np.r_[0:500, 503:2000]
    gaps = replace(
        run, **{name: getattr(run, name)[keep] for name in ("time", "voltage", "current")}, displacement=None
    )
    gaps = replace(gaps, force=None, applied_voltage=None)
    assert only(gaps, "rows-missing").values["rows"] == 3
    assert "about 3 rows missing in 1 gap of the time" in only(gaps, "rows-missing").message
    assert only(gaps, "rows-missing").values["moving"] == 0
    jitter = np.random.default_rng(20261121).uniform(-0.1, 0.1, 2000) * 0.02
    assert only(replace(run, time=run.time + jitter), "sampling-irregular").values["largest_deviation"] > 0.1
    rounded = check(replace(run, time=np.round(np.arange(2000) / 30.0, 3)))
    assert [(finding.code, finding.severity) for finding in rounded] == [("sampling-irregular", "info")]


# -- old readings, and channels apart


@pytest.mark.parametrize("fraction", [0.15, 0.3])
def test_stale_values(read: Read, fraction: float) -> None:
    run = read(STEP)
    assert run.current is not None
    repeat = np.random.default_rng(20261121).random(2000) < fraction
    repeat[: EDGE + 5] = False
    rows = np.maximum.accumulate(np.where(repeat, 0, np.arange(2000)))
    finding = only(replace(run, current=run.current[rows]), "stale-values")
    assert finding.values["fraction"] == pytest.approx(repeat.mean(), abs=0.03)
    assert finding.effect == "none"


def test_a_stuck_reading(read: Read) -> None:
    run = read(STEP)
    assert run.current is not None
    finding = only(changed(run, "current", slice(1500, 1540), run.current[1500]), "stuck")
    assert finding.effect == "mask"
    assert finding.samples == ((1501, 1540),)


@pytest.mark.parametrize("rows", [-2, -1, 1, 2])
@pytest.mark.parametrize("signal", [STEP, "square 1 V 0.1 Hz delay=1 s", "prbs 1 V 0.5 s delay=1 s"])
def test_a_current_beside_the_voltage(read: Read, signal: str, rows: int) -> None:
    run = read(signal)
    assert run.current is not None
    place = (np.arange(2000) + rows).clip(0, 1999)
    finding = only(replace(run, current=run.current[place]), "channel-skew")
    assert finding.values["lead_rows"] == rows
    assert ("leads" if rows > 0 else "lags behind") in finding.message
    assert "give the run the hold 'unknown'" in finding.repair
    # What is read before the edge that it answers to is no reading of the strip at rest.
    assert finding.effect == ("mask" if rows > 0 else "none")
    assert all(stop - start == rows for start, stop in finding.samples)
    assert ("or the hold 'zero' is not right" in finding.message) == (rows > 0)
    foreign = only(replace(run, current=run.current[place], hold="unknown"), "channel-skew")
    assert "is not right" not in foreign.message
    assert "give the run" not in foreign.repair  # it has that hold already
    assert foreign.effect == "none"  # a fit finds when the edge was


@pytest.mark.parametrize("rows", [-9, -5, -4, 3, 4, 5, 9])
@pytest.mark.parametrize("signal", ["square 1 V 0.1 Hz delay=1 s", "square 1 V 0.5 Hz", "prbs 1 V 2 s delay=1 s"])
def test_a_current_far_off_is_no_missing_contact(read: Read, signal: str, rows: int) -> None:
    """Each edge had a contact that was missing, and a fit took the voltage as 0 V after it."""
    run = read(signal)
    assert run.current is not None
    for hold in ("zero", "unknown"):
        place = (np.arange(2000) + rows).clip(0, 1999)
        finding = only(replace(run, current=run.current[place], hold=hold), "channel-skew")
        assert finding.values["lead_rows"] == rows
        assert f"rows_late = {-rows}" in finding.repair
        assert is_far_off(finding)
        assert finding.severity == "error"  # no delay of a fit follows it
        # Between the edge and the jump the current is of another voltage.
        edges = Record.of(run).edges
        first, stop = finding.samples[-1]
        assert (first, stop) == (edges[-1] - max(rows, 0), edges[-1] + max(-rows, 0))
        assert finding.effect == "mask"


def test_a_laser_before_the_voltage(read: Read) -> None:
    run = read(STEP, change={"coupling.gain": 6.79e-8})
    assert run.displacement is not None
    shifted = np.concatenate((run.displacement[4:], run.displacement[-4:]))
    finding = only(replace(run, displacement=shifted), "channel-skew")
    assert finding.channel == "displacement"
    assert finding.values["lead_rows"] in (1, 2, 3)


def test_half_updated_rows_at_an_edge_are_left_out(read: Read) -> None:
    run = changed(read(STEP), "current", slice(EDGE - 1, EDGE + 1), 0.027)
    findings = {finding.code: finding for finding in check(run)}
    assert set(findings) == {"channel-skew", "edge-reading-partial"}
    assert findings["edge-reading-partial"].samples == ((EDGE - 1, EDGE + 1),)
    assert np.flatnonzero(~usable(run, findings.values())["current"]).tolist() == [EDGE - 1, EDGE]


# -- the response as a whole


@pytest.mark.parametrize("signal", [STEP, "step -1 V", "square 1 V 0.1 Hz", "sine 1 V 0.1 Hz"])
@pytest.mark.parametrize("channel", ["current", "displacement", "force"])
def test_a_response_against_the_convention(read: Read, signal: str, channel: str) -> None:
    run = read(signal)
    opposite = replace(run, **{channel: -getattr(run, channel)})
    finding = only(opposite, "response-opposite")
    assert (finding.channel, finding.severity) == (channel, "error")
    explained = check(replace(opposite, metadata=replace(run.metadata, polarity="reversed")))
    assert [finding.severity for finding in explained] == ["info"]


def test_nothing_but_noise_and_no_excitation(read: Read) -> None:
    rng = np.random.default_rng(20261121)
    run = read(STEP)
    assert only(replace(run, force=rng.normal(0.0, 1e-4, 2000)), "noise-only").channel == "force"
    digits = np.where(rng.random(2000) < 0.1, 1e-4, 0.0)
    assert only(replace(run, force=digits), "noise-only").channel == "force"
    assert only(replace(run, force=np.zeros(2000)), "noise-only").message == "the force reads 0 mN in every row"
    baseline = Run.from_arrays(time=run.time, voltage=np.zeros(2000), current=rng.normal(0.0, 1e-4, 2000))
    assert only(baseline, "no-excitation").channel == "voltage"


@pytest.mark.parametrize("lower", [-3.6e-6, 0.0, -4.48e-3])
def test_a_load_cell_that_nothing_presses(read: Read, lower: float) -> None:
    """A fingerprint with the tip clear of the cell said that its range was too small: 228 readings at -0.0036 mN."""
    run = read(STEP)
    noise = np.random.default_rng(20261121).normal(0.0, 1e-4, 2000)
    metadata = replace(run.metadata, ranges={"force": (lower, 98.07e-3 + lower)})
    found = check(replace(run, force=noise, metadata=metadata))
    assert [one.code for one in found if one.channel == "force"] == ["noise-only"]
    (told,) = [one for one in found if one.channel == "force"]
    assert ("is the tip on the cell?" in told.repair) == (lower > -1e-3)
    assert told.message.startswith(
        "no force is seen: the load cell reads" if lower > -1e-3 else "the force holds nothing"
    )
    pressed = replace(run, force=run.force + noise + 1e-3, metadata=metadata)
    assert "noise-only" not in {one.code for one in check(pressed)}


def test_a_current_that_rises(read: Read) -> None:
    run = read(STEP)
    rise = 4e-3 * (1.0 - np.exp(-np.maximum(run.time - 25.0, 0.0) / 5.0))
    finding = only(changed(run, "current", slice(None), rise, add=True), "current-rises")
    low, high = finding.values["low"], finding.values["high"]
    assert isinstance(low, float)
    assert isinstance(high, float)
    assert 1.5e-3 < high - low < 4.0e-3
    assert "constant voltage" in finding.message


# -- resonance


def test_a_ring_after_the_edge_is_seen(read: Read) -> None:
    run = read(STEP, round_off=False)
    after = np.maximum(run.time - 4.0, 0.0)
    ring = np.where(run.time >= 4.0, 6e-5 * np.exp(-6.0 * after) * np.cos(2 * np.pi * 38.3 * after), 0.0)
    finding = only(
        changed(run, "displacement", slice(EDGE + 1, None), ring[EDGE + 1 :], add=True), "resonance-may-alias"
    )
    assert finding.values["apparent_frequency"] == pytest.approx(50.0 - 38.3, abs=0.6)
    assert finding.values["image_frequency"] == pytest.approx(38.3, abs=0.6)


def test_an_aliased_resonance_is_predicted_only_above_the_noise(read: Read) -> None:
    actuator = load_actuator("friend-2")
    run = read("square 1 V 0.1 Hz")
    assert not [finding for finding in check(run, actuator) if finding.severity != "info"]
    change = {"coupling.gain": 3.5e-6, "coupling.p1": 1e3, "coupling.p2": 1e5, "coupling.zero": 1e3}  # follows at once
    fast = actuator.replace(**change)
    finding = next(f for f in check(read("square 1 V 0.1 Hz", change=change), fast) if f.code == "resonance-aliased")
    omega = 1.875**2 / 0.025**2 * np.sqrt(1.45e9 * 0.245e-3**2 / (12 * 3965.0))
    assert finding.values["resonance"] == pytest.approx(omega / (2 * np.pi))
    assert finding.values["apparent_frequency"] == pytest.approx(50.0 - omega / (2 * np.pi))
    assert not [
        f for f in check(read("square 1 V 0.1 Hz", rate=500.0, change=change), fast) if f.code == "resonance-aliased"
    ]
