"""The dc resistance from the steady state, against the circuit's own numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import InputError, Run, load_actuator, simulate
from ipmclab.measurement.uncertain import exact
from ipmclab.procedure.dc import dc_resistance
from ipmclab.procedure.procedure_file import _Reader
from ipmclab.run import QUALITY_FLAGS
from ipmclab.store.run_file import write_run

TRUTH = load_actuator("friend-2")
R_DC = TRUTH.circuit_elements().dc
KNOWN = {name: exact(value) for name, value in TRUTH.parameter_values.items()}


def held(duration: float, *, amplitude: float = 1.0, noise: float = 3e-5, seed: int = 20261121, **about) -> Run:
    clean = simulate(TRUTH, f"step {amplitude} V delay=5 s", duration=duration, rate=50.0)
    current = clean.current + noise * np.random.default_rng(seed).standard_normal(len(clean))
    metadata = replace(clean.metadata, origin="measured", parameters={}, **about)
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, hold=clean.hold, metadata=metadata)


def test_a_strip_that_has_settled() -> None:
    step = dc_resistance([("step", held(125.0))], KNOWN)
    assert step.done
    assert not step.findings
    found = step.also["R_dc"].amount
    assert found.value == pytest.approx(R_DC, rel=2e-3)
    assert abs(found.value - R_DC) < 3.0 * found.uncertainty
    assert step.results["circuit.dc_resistivity"].amount.value == pytest.approx(
        TRUTH["circuit.dc_resistivity"], rel=2e-3
    )


def test_a_rest_after_the_step_changes_nothing() -> None:
    """A recording ends with 5 s at 0 V unless its experiment says otherwise."""
    whole = simulate(TRUTH, "step 1 V delay=5 s", duration=125.0, rate=50.0)
    rested = simulate(TRUTH, np.concatenate((whole.voltage, np.zeros(250))), duration=130.0, rate=50.0)
    noise = 3e-5 * np.random.default_rng(20261121).standard_normal(len(rested))
    run = Run.from_arrays(
        time=rested.time,
        voltage=rested.voltage,
        current=rested.current + noise,
        hold=rested.hold,
        metadata=rested.metadata,
    )
    found, expected = (dc_resistance([("step", one)], KNOWN) for one in (run, held(125.0)))
    assert found.done
    assert found.also["R_dc"].amount.value == pytest.approx(expected.also["R_dc"].amount.value, rel=1e-9)


def test_the_thesiss_forty_seconds_are_not_steady() -> None:
    run = held(45.0)
    step = dc_resistance([("step", run)], KNOWN)
    (finding,) = step.findings
    assert (finding.code, finding.severity) == ("not-steady", "warning")
    # Read off at the end, as V/I - 2 R_e, it is too small by what still flows into the slow branch.
    end = float(np.mean(run.current[-225:]))
    assert finding.values["read_off"] == pytest.approx(1.0 / end - 16.0, rel=1e-2)
    assert finding.values["read_off"] < 0.93 * R_DC
    assert "hold the voltage for" in finding.repair
    found = step.also["R_dc"].amount
    assert abs(found.value - R_DC) < 3.0 * found.uncertainty
    # The slow mode has 15.76 s: the current is within 1 % of its limit some 60 s after the step.
    needed = -15.76 * np.log(0.01 * 11.505 / (13.572 - 11.505)) + 30.0
    assert finding.values["needed"] == pytest.approx(needed, rel=0.15)


@pytest.mark.parametrize("duration", [7.0, 9.0, 13.0, 20.0])
def test_a_record_that_does_not_show_the_limit_gives_no_number(duration: float) -> None:
    step = dc_resistance([("short", held(duration))], KNOWN)
    assert not step.done
    assert not step.results
    assert [one.code for one in step.findings] == ["not-steady"]
    assert "hold a constant voltage" in step.advice


def test_intervals_hold_the_truth() -> None:
    inside = []
    for seed in range(60):
        found = dc_resistance([("step", held(85.0, seed=seed))], KNOWN).also["R_dc"].amount
        inside.append(found.interval[0] <= R_DC <= found.interval[1])
    assert np.mean(inside) >= 0.88


def test_a_shunt_and_the_calibration_are_counted() -> None:
    clean = held(125.0, noise=1e-7)
    plain = dc_resistance([("step", clean)], KNOWN).also["R_dc"].amount
    about = replace(
        clean.metadata,
        voltage_sensed="upstream of shunt",
        shunt_resistance=1.0,
        uncertainties={"current": 1.15e-4},
    )
    found = dc_resistance([("step", replace(clean, metadata=about))], KNOWN).also["R_dc"].amount
    assert found.value == pytest.approx(plain.value - 1.0)
    assert found.shares["calibration of the current"] > 0.99
    assert found.uncertainty == pytest.approx(86.9 * 0.01, rel=0.02)  # 1 % of 11.5 mA moves V/I by 1 %


def test_two_states_of_a_strip_are_told() -> None:
    other = TRUTH.replace(**{"circuit.dc_resistivity": 30.0})
    clean = simulate(other, "step 1 V", duration=120.0, rate=50.0)
    drier = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current, hold=clean.hold)
    step = dc_resistance([("today", held(125.0)), ("yesterday", drier)], KNOWN)
    assert "states-differ" in [one.code for one in step.findings]


def test_a_current_that_is_only_the_drift_of_its_zero() -> None:
    run = held(125.0)
    gone = replace(run, current=run.current - run.current[-1] * (run.time > 5.0) - 1.7e-4 * (run.time / 125.0))
    step = dc_resistance([("step", gone)], KNOWN)
    assert not step.done
    (finding,) = step.findings
    assert finding.code == "no-dc-current"
    assert "the dc resistance is above some 5500 ohm" in finding.repair


def test_a_current_of_which_nothing_shows_the_limit_is_not_called_zero() -> None:
    time = np.arange(0.0, 100.0, 0.02)
    after = time >= 5.0
    current = np.where(after, 20e-3 + 1e-4 * (time - 5.0), 0.0)
    current = current + 3e-5 * np.random.default_rng(20261121).standard_normal(len(time))
    step = dc_resistance([("ramp", Run.from_arrays(time=time, voltage=1.0 * after, current=current))], KNOWN)
    assert not step.done
    (finding,) = step.findings
    assert finding.code == "not-steady"
    assert "nothing shows towards what" in finding.message
    assert finding.repair == "hold the voltage for 380 s or longer"
    assert "inf" not in finding.message


@pytest.mark.parametrize(("offset", "noise"), [(0.0, 2e-4), (0.0, 0.0), (3e-3, 1e-5)])
def test_a_voltage_that_ends_at_zero_is_refused(offset: float, noise: float) -> None:
    """By its noise, exactly, or but for the zero of its sensor."""
    run = held(65.0)
    voltage = np.where(run.time < 30.0, run.voltage, offset)
    voltage = voltage + noise * np.random.default_rng(20261121).standard_normal(len(run))
    with pytest.raises(InputError) as error:
        dc_resistance([("pulse", replace(run, voltage=voltage))], KNOWN)
    assert error.value.code == "no-steady-state"
    assert "0 V" in str(error.value)


def test_above_electrolysis() -> None:
    assert "steady-above-electrolysis" in [
        one.code for one in dc_resistance([("step", held(125.0, amplitude=2.0))], KNOWN).findings
    ]


def test_what_gives_no_dc_resistance() -> None:
    sine = simulate(TRUTH, "sine 1 V 0.1 Hz", duration=20.0, rate=50.0)
    with pytest.raises(InputError) as error:
        dc_resistance([("sine", sine)], KNOWN)
    assert error.value.code == "no-steady-state"
    with pytest.raises(InputError) as error:
        dc_resistance([("step", held(125.0))], {**KNOWN, "circuit.sheet_resistance": exact(20.0)})
    assert error.value.code == "no-dc-resistance"
    assert "measure the sheet resistance again" in error.value.repair


def test_runs_that_are_called_alike_have_a_noise_each(tmp_path: Path) -> None:
    """Two files ``step.nc`` of two folders shared one source of noise: their mean was as uncertain as one of them."""
    for place, name in enumerate(("a/step.nc", "b/step.nc", "b/other.nc")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_run(held(125.0, seed=place), tmp_path / name)
    alike, outlier = (
        dc_resistance(_Reader("p.toml", tmp_path).runs(names, "dc_resistance.runs"), KNOWN).also["R_dc"].amount
        for names in (["a/step.nc", "b/step.nc"], ["a/step.nc", "b/other.nc"])
    )
    assert {"noise of a/step.nc", "noise of b/step.nc"} <= alike.parts.keys()
    assert {"noise of other.nc", "noise of step.nc"} <= outlier.parts.keys()
    assert alike.uncertainty == pytest.approx(outlier.uncertainty, rel=0.3)


@pytest.mark.parametrize("rows", [slice(4000, 4400), slice(5900, 6100)])
def test_rows_that_are_masked_are_no_current(rows: slice) -> None:
    """Somebody touched the clamp, and masked what was read meanwhile: it counted in the limit."""
    run = held(125.0)
    flags = np.zeros(len(run), dtype=np.uint8)
    flags[rows] = QUALITY_FLAGS["masked_by_operator"]
    current = np.array(run.current)
    current[rows] += 2e-3
    touched = Run.from_arrays(
        time=run.time,
        voltage=run.voltage,
        current=current,
        quality={"current": flags},
        hold=run.hold,
        metadata=run.metadata,
    )
    found, expected = (dc_resistance([("step", one)], KNOWN).also["R_dc"].amount for one in (touched, run))
    assert abs(found.value - expected.value) < 2.0 * expected.uncertainty
