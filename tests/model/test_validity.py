"""Where a model is asked beyond what it holds for, said in the run itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, Sample, check, identify, load_actuator, read_run, simulate, validate, write_run
from ipmclab.model.validity import highest_frequency, sentence, validity


def codes(actuator: str, signal: str, rate: float = 50.0, duration: float = 4.0, **change: float) -> list[str]:
    strip = load_actuator(actuator).replace(**change)
    run = simulate(strip, signal, duration=duration, rate=rate)
    return [finding.code for finding in run.metadata.findings]


# Friend, eq. 4.7 with table 4.2: the first mode of sample 2 lies near 38.3 Hz, a third of it near 12.8 Hz.
@pytest.mark.parametrize(
    ("actuator", "signal", "rate", "expected"),
    [
        ("friend-2", "step 1.23 V", 50.0, []),
        ("friend-2", "step -1.24 V", 50.0, ["above-electrolysis"]),
        ("friend-2+leak.cubic", "step 3 V", 50.0, []),
        ("friend-2+leak.exponential", "step 3 V", 50.0, []),
        ("friend-2", "sine 1 V 12.7 Hz", 500.0, []),
        ("friend-2", "sine 1 V 12.8 Hz", 500.0, ["near-resonance"]),
        ("friend-2", "chirp 1 V 1 Hz 30 Hz sweep_time=4 s", 500.0, ["near-resonance"]),
        ("friend-2", "prbs 1 V 0.1 s", 500.0, []),
        ("friend-2", "prbs 1 V 0.02 s", 500.0, ["near-resonance"]),
        ("friend-2", "step 1 V for 1 s then sine 1 V 14 Hz", 500.0, ["near-resonance"]),
    ],
)
def test_voltage_and_frequency(actuator: str, signal: str, rate: float, expected: list[str]) -> None:
    assert codes(actuator, signal, rate) == expected


def test_a_leak_that_is_switched_off_is_none() -> None:
    off = {"leak.exponential.current_density": 0.0}
    assert codes("friend-2+leak.exponential", "step 3 V", **off) == ["above-electrolysis"]
    assert codes("friend-2+leak.cubic", "step 3 V", **{"leak.cubic.cubic": 0.0}) == ["above-electrolysis"]


@pytest.mark.parametrize("form", ["exponential", "butler_volmer"])
def test_a_leak_that_begins_above_the_run_is_none(form: str) -> None:
    high = {f"leak.{form}.threshold": 3.0}
    assert codes(f"friend-2+leak.{form}", "step -3.01 V", **high) == []
    strip = load_actuator(f"friend-2+leak.{form}").replace(**high)
    (finding,) = simulate(strip, "step 2.99 V", duration=4.0, rate=50.0).metadata.findings
    assert finding.code == "above-electrolysis"
    assert "the leak of the model gives no current there" in finding.message


@pytest.mark.parametrize(
    ("solvent", "decomposes"),
    [
        *((one, False) for one in ("EMIM-TFSI", "ethylene glycol", "BMI-BF₄", "an ionic liquid", "ethanol")),
        *((one, True) for one in ("deionised water", "H₂O", "D2O", "ethanol and water", "PBS", "0.1 M LiCl", "", None)),
    ],
)
def test_where_no_water_is_none_decomposes(solvent: str | None, decomposes: bool) -> None:
    """An ionic liquid stands 4 V: a strip that says so is warned of nothing at 2 V, nor limited to its own voltages."""
    strip = replace(load_actuator("friend-2"), sample=Sample("strip-1", solvent=solvent))
    run = simulate(strip, "step 2 V", duration=4.0, rate=50.0)
    assert [finding.code for finding in run.metadata.findings] == ["above-electrolysis"] * decomposes
    # Where the run says of which strip it is, its sample counts: a fit and a validation ask it too.
    of_water = replace(strip, sample=Sample("strip-2", solvent="water"))
    found = [validity(of_water, run), identify(of_water, run).findings, validate(of_water, run).findings]
    assert ["above-electrolysis" in {finding.code for finding in one} for one in found] == [decomposes] * 3


def test_a_stiffer_modulus_moves_the_limit() -> None:
    stiff = {"viscoelastic.0.amplitude": 3.0, "viscoelastic.0.frequency": 1.0}  # at 40 Hz four times Y, twice the rate
    assert codes("friend-2+viscoelastic", "sine 1 V 20 Hz", 500.0, **stiff) == []
    assert codes("friend-2+viscoelastic", "sine 1 V 30 Hz", 500.0, **stiff) == ["near-resonance"]


@pytest.mark.parametrize(("frequency", "expected"), [(8.0, []), (20.0, ["near-resonance"])])
def test_voltages_without_a_signal_speak_for_themselves(frequency: float, expected: list[str]) -> None:
    time = np.arange(2000) / 500.0
    run = simulate(load_actuator("friend-2"), np.sin(2 * np.pi * frequency * time), duration=4.0, rate=500.0)
    assert [finding.code for finding in run.metadata.findings] == expected
    if expected:
        assert run.metadata.findings[0].values["frequency"] == pytest.approx(frequency, rel=1e-3)


def test_large_bending_and_a_laser_that_loses_the_strip() -> None:
    far = {"coupling.gain": 6.79e-8}
    bent = simulate(load_actuator("friend-2").replace(**far), "step 1 V", duration=40.0, rate=50.0)
    (said,) = bent.metadata.findings
    assert said.code == "large-bending"
    assert said.message.startswith("the predicted displacement reaches")  # beside a record it is not the record's
    assert codes("friend-2+laser", "step 1 V", duration=40.0, **far) == []
    strip = load_actuator("friend-2+laser").replace(**far)
    run = simulate(strip, "step 1.23 V delay=1 s", duration=40.0, rate=50.0)
    assert run.metadata.findings == ()
    strip = strip.replace(**{"laser.range": 5e-3})
    run = simulate(strip, "step 1.23 V delay=1 s", duration=40.0, rate=50.0)
    (finding,) = run.metadata.findings
    assert run.displacement is not None
    lost = np.isnan(run.displacement)
    assert (finding.code, finding.effect, finding.count) == ("laser-lost", "mask", lost.sum())
    assert finding.samples == ((int(np.argmax(lost)), 2000),)
    assert "beyond a height of 5 mm: it reads no further" in finding.message
    # The record shows the same as a real one would, and the fit leaves the rows out.
    (seen,) = [one for one in check(run) if one.severity != "info"]
    assert (seen.code, seen.effect, seen.samples) == ("laser-lost", "mask", finding.samples)


def test_each_time_that_the_laser_loses_the_strip_is_told() -> None:
    strip = load_actuator("friend-2+laser").replace(**{"coupling.gain": 6.79e-8, "laser.range": 5e-3})
    run = simulate(strip, "square 1.23 V 0.05 Hz", duration=40.0, rate=10.0)
    (finding,) = run.metadata.findings
    assert run.displacement is not None
    lost = np.isnan(run.displacement)
    assert len(finding.samples) > 1
    told = np.zeros(len(run), dtype=bool)
    for start, stop in finding.samples:
        assert not told[max(start - 1, 0)]
        told[start:stop] = True
    assert np.array_equal(told, lost)
    assert finding.values["first_time"] == run.time[lost][0]


def test_a_ring_that_the_rate_cannot_show() -> None:
    # An instant coupling, behind hardly any resistance: the beam rings by as much as it moves.
    quick = {"coupling.p1": 2000.0, "coupling.p2": 9e5, "coupling.zero": 1000.0, "circuit.sheet_resistance": 1e-3}
    slow = simulate(load_actuator("friend-2").replace(**quick), "square 1 V 1 Hz", duration=4.0, rate=50.0)
    (finding,) = slow.metadata.findings
    assert finding.code == "resonance-aliased"
    assert finding.values["apparent_frequency"] == pytest.approx(50.0 - 38.29, rel=1e-3)
    strip = load_actuator("friend-2").replace(**quick)
    light = strip.replace(**{"beam.density": 1.0})
    fast, still = (simulate(one, "square 1 V 1 Hz", duration=4.0, rate=5000.0) for one in (strip, light))
    assert fast.metadata.findings == ()
    assert fast.displacement is not None
    assert still.displacement is not None
    edge = slice(2500, 2800)  # the first edge by 2 V
    ring = np.abs(fast.displacement[edge] - still.displacement[edge]).max()
    assert finding.values["amplitude"] == pytest.approx(ring, rel=0.2)  # of which a half period is damped
    assert codes("friend-2", "square 1 V 1 Hz") == []  # 0.1 % of the displacement


def test_run_file_prediction_and_check_say_it(tmp_path: Path) -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "sine 2 V 14 Hz", duration=4.0, rate=500.0)
    assert [finding.code for finding in run.metadata.findings] == ["above-electrolysis", "near-resonance"]
    write_run(run, tmp_path / "run.nc")
    again = read_run(tmp_path / "run.nc")
    assert again.metadata.findings == run.metadata.findings
    told = [finding.code for finding in check(again)]
    assert {"above-electrolysis", "near-resonance"} <= set(told)
    validation = validate(strip, again)
    said = [finding for finding in validation.findings if finding.code in ("above-electrolysis", "near-resonance")]
    assert len(said) == 2
    assert all(finding.message.startswith("run.nc: ") for finding in said)
    # What was measured does not become a finding of the record.
    measured = Run.from_arrays(time=run.time, voltage=run.voltage, displacement=run.displacement)
    assert not {finding.code for finding in check(measured)} & {"above-electrolysis", "near-resonance"}
    assert [finding.code for finding in validity(strip, measured)] == ["above-electrolysis", "near-resonance"]


def test_a_run_without_findings_reads_in_an_older_version(tmp_path: Path) -> None:
    from ipmclab.store.document import to_document

    strip = load_actuator("friend-2")
    assert "findings" not in to_document(simulate(strip, "step 1 V", duration=4.0, rate=50.0))
    assert "findings" in to_document(simulate(strip, "step 2 V", duration=4.0, rate=50.0))


def test_what_a_signal_tells_of_its_frequencies() -> None:
    assert highest_frequency("step 1 V") == 0.0
    assert highest_frequency("multisine 1 V 0.05 Hz 5 Hz") == 5.0
    assert highest_frequency("file there-is-none.csv") is None
    assert highest_frequency(None) is None


def test_a_finding_in_a_line() -> None:
    (finding,) = simulate(load_actuator("friend-2"), "step 2 V", duration=4.0, rate=50.0).metadata.findings
    assert sentence(finding) == f"{finding.message}; {finding.repair}"


def test_extreme_runs_are_judged_too() -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, [0.0, 9e4, -9e4, 9e4], duration=4.0, rate=1.0)
    assert "above-electrolysis" in {finding.code for finding in run.metadata.findings}
    assert simulate(strip, [0.0] * 4, duration=4.0, rate=1.0).metadata.findings == ()
    # A laser at the very end of the strip loses it at the first motion.
    at_end = load_actuator("friend-2+laser").replace(**{"geometry.sensing_length": 0.025})
    run = simulate(at_end, [1.0] * 400, duration=8.0, rate=50.0)
    assert run.displacement is not None
    assert np.isnan(run.displacement[1:]).all()
    (finding,) = run.metadata.findings
    assert finding.code == "laser-lost"
    assert "the end of the strip has then come nearer to the clamp than the laser" in finding.message


def test_a_leak_far_beyond_what_was_measured_is_told() -> None:
    for stage in ("leak.cubic", "leak.exponential"):
        assert codes(f"friend-2+{stage}", "step 3.5 V") == []
        assert "leak-extrapolated" in codes(f"friend-2+{stage}", "step 30 V")
    # Without a leak there is nothing to extrapolate; 15 mm are a fifth of 25 mm and more.
    assert codes("friend-2", "step 30 V") == ["above-electrolysis", "large-bending"]
