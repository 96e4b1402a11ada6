"""The metrics of a run against closed forms, and the drift that a baseline takes out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ipmclab import load_actuator, simulate
from ipmclab.comparison.baseline import Drift, baseline_for, drift_of
from ipmclab.comparison.frequency_response import response_in_rows
from ipmclab.comparison.performance import performances
from ipmclab.comparison.run_metrics import metrics_of_run, surface_strain
from ipmclab.comparison.sine_response import bandwidth_of, sine_responses
from ipmclab.comparison.table import row_of, table_csv
from ipmclab.quality.check import check
from ipmclab.quality.metrics import Metric
from ipmclab.run import Run, RunMetadata
from ipmclab.sample import Sample

TIME = np.arange(0.0, 40.0, 0.02)


def metric(run: Run, name: str, channel: str = "current", **more: object) -> Metric:
    (found,) = [one for one in metrics_of_run(run, **more) if (one.channel, one.name) == (channel, name)]  # type: ignore[arg-type]
    return found


def test_charge_and_energy_of_a_capacitor_with_a_resistor() -> None:
    """1 V through 10 ohm into 0.5 F: C (1 - exp(-t / RC)), and as much energy as volts times it."""
    run = Run.from_arrays(time=TIME, voltage=np.ones(2000), current=0.1 * np.exp(-TIME / 5.0))
    charge = 0.5 * (1.0 - math.exp(-TIME[-1] / 5.0))
    assert metric(run, "charge").value == pytest.approx(charge, rel=1e-5)
    assert metric(run, "energy").value == pytest.approx(charge, rel=1e-5)
    assert metric(run, "energy").unit == "J"


def test_a_charge_is_what_went_in_before_the_rest_with_which_a_recording_ends() -> None:
    """The same capacitor, back at 0 V after 20 s: all of it flows out again."""
    voltage = np.where(TIME < 20.0, 1.0, 0.0)
    full = 1.0 - math.exp(-20.0 / 5.0)
    current = 0.1 * np.where(TIME < 20.0, np.exp(-TIME / 5.0), -full * np.exp(-(TIME - 20.0) / 5.0))
    run = Run.from_arrays(time=TIME, voltage=voltage, current=current)
    assert metric(run, "charge").value == pytest.approx(0.5 * full, rel=1e-3)


@pytest.mark.parametrize("shape", ["ramp", "half a sine"])
def test_what_went_in_ends_with_any_voltage_not_only_with_a_constant_one(shape: str) -> None:
    """10 mA at 1 V for 20 s, with a mean of 1/2 or 2 / pi; what flows at 0 V is no part of it."""
    drive = TIME / 20.0 if shape == "ramp" else np.sin(math.pi * TIME / 20.0)
    is_driven = TIME < 20.0
    run = Run.from_arrays(
        time=TIME,
        voltage=np.where(is_driven, drive, 0.0),
        current=np.where(is_driven, 0.01 * drive, -0.01 * np.exp(-(TIME - 20.0) / 5.0)),
    )
    mean = 0.5 if shape == "ramp" else 2.0 / math.pi
    assert metric(run, "charge").value == pytest.approx(0.01 * 20.0 * mean, rel=2e-3)


def test_mean_power_and_charge_of_half_a_period_of_a_sine() -> None:
    """1 V and 20 mA, 60 degrees apart: V I cos(60 deg) / 2, and I T / pi."""
    angle = math.tau * 0.1 * TIME
    run = Run.from_arrays(time=TIME, voltage=np.sin(angle), current=0.02 * np.sin(angle + math.pi / 3.0))
    assert metric(run, "mean_power").value == pytest.approx(0.02 * 0.25, rel=1e-6)
    assert metric(run, "charge_of_half_period").value == pytest.approx(0.02 * 10.0 / math.pi, rel=1e-4)
    gain = metric(run, "gain")
    assert gain.value == pytest.approx(0.02, rel=1e-9)
    assert gain.unit == "A/V"


def test_a_charge_counts_without_the_rows_that_check_masks() -> None:
    """Three rows of a spike made a tenth of the charge."""
    angle = math.tau * 0.1 * TIME
    rng = np.random.default_rng(20261124)
    current = 0.02 * np.sin(angle + 1.0) + 0.01 + 1e-5 * rng.standard_normal(len(TIME))
    run = Run.from_arrays(time=TIME, voltage=np.sin(angle), current=current)
    spiked = current.copy()
    spiked[500:503] = 0.4
    lost = Run.from_arrays(time=TIME, voltage=np.sin(angle), current=spiked)
    assert {one.effect for one in check(lost) if one.channel == "current"} >= {"mask"}
    for name in ("charge", "energy"):
        assert metric(lost, name).value == pytest.approx(metric(run, name).value, rel=1e-3)


@pytest.mark.parametrize(("missing", "there"), [(20, True), (21, False)])
def test_a_charge_needs_99_readings_of_100(missing: int, there: bool) -> None:
    current = np.sin(math.tau * 0.1 * TIME) + 2.0
    voltage = np.sin(math.tau * 0.1 * TIME)
    whole = {
        one.name: one.value for one in metrics_of_run(Run.from_arrays(time=TIME, voltage=voltage, current=current))
    }
    current[100 : 100 + missing] = np.nan
    found = {
        one.name: one.value for one in metrics_of_run(Run.from_arrays(time=TIME, voltage=voltage, current=current))
    }
    assert ("charge" in found) is there
    assert found.get("charge", whole["charge"]) == pytest.approx(whole["charge"], rel=1e-3)
    assert "mean_power" in whole
    assert "mean_power" not in found


@pytest.mark.parametrize(
    ("rows", "rate", "hertz", "there"),
    [(500, 50.0, 0.1, False), (501, 50.0, 0.1, True), (40, 40.0, 10.0, True), (30, 30.0, 10.0, False)],
)
def test_a_mean_power_needs_a_whole_period_of_four_intervals(rows: int, rate: float, hertz: float, there: bool) -> None:
    time = np.arange(rows) / rate
    wave = np.sin(math.tau * hertz * time + 0.5)
    named = RunMetadata(signal=f"sine 1 V {hertz} Hz")
    found = metrics_of_run(Run.from_arrays(time=time, voltage=wave, current=0.02 * wave, metadata=named))
    power = {one.name: one.value for one in found if one.name == "mean_power"}
    assert power == ({"mean_power": pytest.approx(0.01, rel=1e-6)} if there else {})


def test_a_gain_is_as_uncertain_as_its_phase() -> None:
    """Noise of 1 mA on 20 mA over 500 rows: each part of the fundamental scatters by 1 mA sqrt(2 / 500)."""
    angle = math.tau * 0.1 * TIME
    noise = 1e-3 * np.random.default_rng(4).normal(size=2000)
    run = Run.from_arrays(time=TIME, voltage=2.0 * np.sin(angle), current=0.02 * np.sin(angle + 0.3) + noise)
    gain = metric(run, "gain")
    half = 1.96 * 1e-3 * math.sqrt(2.0 / 500.0) / 2.0
    assert gain.interval == pytest.approx((gain.value - half, gain.value + half), abs=0.1 * half)
    assert gain.interval[0] < 0.01 < gain.interval[1]  # type: ignore[index]


@pytest.mark.parametrize(("of", "name"), [("largest", "strain"), ("amplitude", "strain_amplitude")])
def test_a_strain_has_the_interval_of_its_displacement(of: str, name: str) -> None:
    moved = 1e-3 * np.sin(math.tau * 0.1 * TIME) + 1e-5 * np.random.default_rng(5).normal(size=2000)
    run = Run.from_arrays(time=TIME, voltage=np.sin(math.tau * 0.1 * TIME), displacement=moved)
    bent, strain = metric(run, of, "displacement"), metric(run, name, "displacement", strip=load_actuator("friend-2"))
    expected = [surface_strain(one, 0.245e-3, 21e-3) for one in (bent.value, *(bent.interval or ()))]
    assert [strain.value, *(strain.interval or ())] == pytest.approx(expected, rel=1e-12)


def test_strain_is_that_of_the_circle_through_clamp_and_sensing_point() -> None:
    """A strip of 0.2 mm on a circle of 50 mm: strain h / (2 R), wherever it is measured."""
    radius, thickness = 50e-3, 0.2e-3
    for angle in (0.05, 0.4, 1.0):
        across, along = radius * (1.0 - math.cos(angle)), radius * math.sin(angle)
        assert surface_strain(across, thickness, along) == pytest.approx(thickness / (2.0 * radius))
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=20.0, rate=20.0)
    largest = metric(run, "largest", "displacement")
    strain = metric(run, "strain", "displacement", strip=strip)
    assert strain.value == pytest.approx(surface_strain(largest.value, 0.245e-3, 21e-3))
    assert "0.245 mm" in strain.definition


def curling(rate: float, response: float, **about: object) -> Run:
    metadata = RunMetadata(sample=Sample("s1"), **about)  # type: ignore[arg-type]
    voltage = np.where(TIME >= 2.0, 1.0 if response else 0.0, 0.0)
    noise = 1e-6 * np.random.default_rng(1).normal(size=len(TIME))
    moved = response * (1.0 - np.exp(-np.maximum(TIME - 2.0, 0.0) / 3.0)) + rate * TIME + noise
    return Run.from_arrays(time=TIME, voltage=voltage, displacement=moved, metadata=metadata)


def test_a_baseline_takes_out_the_curl() -> None:
    """20 um/s of curl beside 0.5 mm of response: without it the response is what it is, and the interval says more."""
    run = curling(2e-5, 5e-4)
    drift = drift_of(curling(2e-5, 0.0, purpose="baseline"))
    assert drift is not None
    assert drift.rate == pytest.approx(2e-5, abs=4.0 * drift.standard_error)
    plain, corrected = (metric(run, "largest", "displacement", drift=one) for one in (None, drift))
    assert plain.value > 1.2e-3
    assert corrected.value == pytest.approx(5e-4, rel=0.01)
    assert corrected.interval is not None
    assert corrected.interval[0] < 5e-4 < corrected.interval[1]
    assert "20 um/s" in corrected.definition
    assert row_of(run, drift=drift).baseline == drift.name


def test_gain_and_phase_are_those_of_the_strip_without_its_curl() -> None:
    """60 um/s beside a sine of 0.3 mm: in a period of 10 s the curl has twice the height of the sine."""
    sine = np.sin(math.tau * 0.1 * TIME)
    straight = Run.from_arrays(time=TIME, voltage=2.0 * sine, displacement=3e-4 * sine)
    curled = replace(straight, displacement=straight.displacement + 6e-5 * TIME)
    drift = Drift(6e-5, 1e-8, "still.nc")
    for name in ("gain", "phase", "amplitude"):
        plain, corrected = metric(straight, name, "displacement"), metric(curled, name, "displacement", drift=drift)
        assert corrected.value == pytest.approx(plain.value, abs=1e-9), name
        assert "still.nc" in corrected.definition
        assert corrected.of_drift == 0.0
    assert metric(straight, "gain", "displacement").value == pytest.approx(1.5e-4)


def test_what_a_baseline_may_be_wrong_by_goes_into_the_intervals() -> None:
    """By that rate times the length of the run; of a back relaxation, as a share of the peak."""
    moved = 1e-3 * (np.exp(-TIME / 10.0) - np.exp(-TIME))
    noise = 1e-6 * np.random.default_rng(3).normal(size=len(TIME))
    run = Run.from_arrays(time=TIME + 50.0, voltage=np.ones(len(TIME)), displacement=moved + noise)
    reach = 1.96 * 1e-6 * TIME[-1]
    for name in ("largest", "peak_at_first_edge", "mean_of_last_tenth", "back_relaxation"):
        sure, unsure = (metric(run, name, "displacement", drift=Drift(0.0, one, "still.nc")) for one in (0.0, 1e-6))
        expected = reach / metric(run, "peak_at_first_edge", "displacement").value if "back" in name else reach
        assert unsure.of_drift == pytest.approx(expected, rel=1e-4)
        for side in (0, 1):
            narrow, wide = (abs(one.interval[side] - one.value) for one in (sure, unsure) if one.interval)
            assert wide == pytest.approx(math.hypot(narrow, expected), rel=1e-4)
    strip = load_actuator("friend-2")
    strain = metric(run, "strain", "displacement", drift=Drift(0.0, 1e-6, "still.nc"), strip=strip)
    assert strain.of_drift == pytest.approx(reach * 0.245e-3 / 21e-3**2, rel=0.02)


def test_a_baseline_counts_without_the_rows_in_which_the_laser_was_lost() -> None:
    run = curling(1e-6, 0.0)
    lost = run.displacement.copy()  # type: ignore[union-attr]
    lost[1500:1600] = -0.0999999
    whole, part = drift_of(run), drift_of(replace(run, displacement=lost))
    assert whole is not None
    assert part is not None
    assert part.rate == pytest.approx(whole.rate, abs=4.0 * whole.standard_error)
    assert part.standard_error < 2.0 * whole.standard_error


def test_a_run_of_which_nobody_knows_when_it_was_has_the_drift_of_the_whole_baseline() -> None:
    drift = Drift(2e-6, 1e-6, "still.nc", None, "m1", "2026-03-02", first=(3e-6, 1e-7), last=(1e-6, 1e-7))
    timeless = replace(drift, recorded_at="")
    for known, mounting, when, rate in (
        (drift, "m1", "2026-03-03", 1e-6),
        (drift, "m1", "2026-03-01", 2e-6),
        (drift, "m1", None, 2e-6),
        (timeless, "m1", "2026-03-03", 2e-6),
        (timeless, "m1", None, 2e-6),
        (timeless, "m2", None, 3e-6),
        (drift, None, "2026-03-03", 2e-6),
    ):
        assert known.during(RunMetadata(mounting_id=mounting, recorded_at=when)).rate == rate, (mounting, when)


@pytest.mark.parametrize("peak", [300, 301, 333, 1200])
def test_the_energy_until_the_peak_is_counted_from_row_0_to_its_row(peak: int) -> None:
    """Also where the voltage is not quite zero before the first edge."""
    rows = np.arange(2000)
    voltage = np.where(rows >= 250, 1.0, 0.012)
    since = np.maximum(rows - 249, 0) / (peak - 249)
    moved = 1e-3 * since * np.exp(1.0 - since)
    current = np.where(rows >= 250, 0.05 - 1e-5 * rows, 5e-4)
    run = Run.from_arrays(time=TIME, voltage=voltage, displacement=moved, current=current)
    expected = float(np.trapezoid((voltage * current)[: peak + 1], TIME[: peak + 1]))
    assert metric(run, "energy_to_peak").value == pytest.approx(expected, rel=1e-12)


def test_of_an_answer_that_still_grows_the_energy_is_that_of_the_hold_and_says_so() -> None:
    rows = np.arange(2000)
    since = np.maximum(rows - 249, 0)
    voltage = np.where((rows >= 250) & (rows < 1250), 1.0, 0.0)
    moved = 1e-3 * np.where(rows < 1250, since, 1000.0) / 1000.0
    current = np.where(voltage > 0.0, 0.05 - 1e-5 * rows, 0.0)
    found = metric(Run.from_arrays(time=TIME, voltage=voltage, displacement=moved, current=current), "energy_to_peak")
    assert found.value == pytest.approx(float(np.trapezoid((voltage * current)[:1250], TIME[:1250])), rel=1e-12)
    assert "to the end of the hold" in found.definition


def test_a_strip_that_curls_ever_more_slowly() -> None:
    """As sample 1 in room air: 19 um/s at first, 7 um/s after 6 min. A run counts from its own place on that course."""
    time, noise = np.arange(0.0, 360.0, 0.1), np.random.default_rng(2)

    def course(since: float, response: float, **about: object) -> Run:
        rows = time if not response else time[time <= 40.0]
        moved = 7e-3 * (1.0 - np.exp(-(since + rows) / 360.0)) - 7e-3 * (1.0 - np.exp(-since / 360.0))
        voltage = np.where(rows >= 2.0, response, 0.0)
        metadata = RunMetadata(sample=Sample("s1"), **about)  # type: ignore[arg-type]
        moved = moved + 1e-3 * voltage + 1e-6 * noise.normal(size=len(rows))
        return Run.from_arrays(time=rows, voltage=voltage, displacement=moved, metadata=metadata)

    drift = drift_of(course(0.0, 0.0, mounting_id="m1", recorded_at="2026-01-01T10:00:00+00:00"))
    assert drift is not None
    for since, mounting in ((0.0, "m2"), (360.0, "m1"), (0.0, None), (180.0, None)):
        run = course(since, 1.0, mounting_id=mounting, recorded_at="2026-01-01T10:07:00+00:00")
        largest = metric(run, "largest", "displacement", drift=drift.during(run.metadata))
        assert largest.interval is not None
        assert largest.interval[0] < 1e-3 < largest.interval[1], (since, mounting)
        if mounting:
            assert largest.value == pytest.approx(1e-3, rel=0.1)


def test_the_baseline_of_the_mounting_that_came_last_before_the_run_counts() -> None:
    def baseline(mounting: str, when: str) -> Run:
        return replace(curling(1e-6, 0.0, mounting_id=mounting, recorded_at=when), file=f"{mounting}-{when}.nc")

    drifts = [
        drift
        for run in (baseline("m1", "2026-01-01"), baseline("m2", "2026-01-02"), baseline("m1", "2026-01-03"))
        if (drift := drift_of(run)) is not None
    ]
    names = []
    for mounting, when in (("m1", "2026-01-02"), ("m1", "2026-01-04"), ("m3", "2026-01-02")):
        found = baseline_for(curling(0.0, 1e-4, mounting_id=mounting, recorded_at=when).metadata, drifts)
        names.append(found.name if found else None)
    assert names == ["m1-2026-01-01.nc", "m1-2026-01-03.nc", "m2-2026-01-02.nc"]
    nameless = replace(curling(0.0, 1e-4), metadata=RunMetadata())
    assert baseline_for(nameless.metadata, drifts) is None


def test_times_of_baselines_are_moments_in_whatever_zone() -> None:
    """09:30 in Johannesburg is before 08:00 in London; of baselines that all came later the first one counts."""
    early, late = "2026-03-01T09:30:00+02:00", "2026-03-01T08:15:00+00:00"
    drifts = [drift_of(curling(rate, 0.0, recorded_at=when)) for rate, when in ((1e-6, early), (2e-6, late))]
    found = [
        baseline_for(curling(0.0, 1e-4, recorded_at=when).metadata, [one for one in drifts if one is not None])
        for when in ("2026-03-01T08:00:00+00:00", "2026-03-01T08:30:00+00:00", "2026-03-01T07:00:00+00:00", "yesterday")
    ]
    assert [round(1e6 * one.rate) for one in found if one is not None] == [1, 2, 1, 1]


def test_gains_of_sines_are_the_models_own_and_have_its_bandwidth() -> None:
    """Friend's figure 5.25, by the model of sample 2: 0.05 Hz to 1 Hz."""
    strip = load_actuator("friend-2")
    frequencies = np.array([0.05, 0.1, 0.2, 0.5, 1.0])
    rows = [row_of(simulate(strip, f"sine 1 V {one} Hz", duration=120.0, rate=50.0)) for one in frequencies]
    (response,) = [one for one in sine_responses(rows) if one.channel == "displacement"]
    own = response_in_rows(strip.system, frequencies, 50.0)
    assert response.gain == pytest.approx(np.abs(own), rel=2e-3)
    assert response.phase == pytest.approx(np.unwrap(np.angle(own)), abs=2e-3)
    fine = np.geomspace(0.05, 1.0, 500)
    expected = bandwidth_of(fine, np.abs(response_in_rows(strip.system, fine, 50.0)))
    assert response.bandwidth == pytest.approx(expected, rel=0.1)
    assert bandwidth_of([0.1, 1.0], [1.0, 0.9]) is None


def test_work_is_a_quarter_of_free_displacement_times_blocked_force() -> None:
    strip = load_actuator("friend-4-measured")
    row = row_of(simulate(strip, "step 1 V", duration=20.0, rate=20.0), strip=strip)
    (found,) = performances([row], {"friend-4": strip})
    expected = 0.25 * abs(row.metrics["displacement.largest"].value * row.metrics["force.largest"].value)
    assert found.work == pytest.approx(expected)
    volume = math.prod(strip.parameters()[f"geometry.{name}"].value for name in ("free_length", "width", "thickness"))
    assert found.work_density == pytest.approx(expected / volume)
    assert found.efficiency is not None
    assert 0.0 < found.efficiency < 1e-3
    assert performances([replace(row, sample="other")], {"friend-4": strip})[0].work_density is None


def test_a_foreign_step_is_known_by_its_voltage() -> None:
    voltage = np.where(TIME >= 2.0, 0.988, 0.0)
    row = row_of(Run.from_arrays(time=TIME, voltage=voltage, current=0.01 * voltage))
    assert (row.waveform, row.values["voltage"]) == ("step", pytest.approx(0.988))
    wave = row_of(Run.from_arrays(time=TIME, voltage=0.5 * np.sin(math.tau * 0.2 * TIME), current=voltage))
    assert (wave.waveform, wave.values["frequency"]) == ("periodic", pytest.approx(0.2, rel=1e-3))
    named = RunMetadata(signal="step 0 V", purpose="baseline")
    still = row_of(Run.from_arrays(time=TIME, voltage=0.0 * TIME, displacement=1e-6 * TIME, metadata=named))
    assert (still.waveform, still.values) == ("", {})
    assert table_csv([row, wave, still]).splitlines()[0].startswith("run,sample,mounting,date,signal,waveform")
