"""A fit says where its runs ask more of the actuator than it holds for, once for each run, wherever a fit is shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, identify, load_actuator, read_fit, report, simulate, write_fit
from ipmclab.fit.fit import Fit
from ipmclab.fit.in_brief import in_brief
from ipmclab.model.stages.beam import resonance

SEED = 20261121
FRIEND = load_actuator("friend-2")
RESONANCE = resonance(FRIEND.parameter_values).frequency


def measured(signal: str, *, displacement: bool = False, zero: float = 0.0, rate: float = 50.0) -> Run:
    """A noisy record of friend-2, its laser's zero anywhere [m]."""
    generator = np.random.default_rng([SEED, len(signal)])
    clean = simulate(FRIEND, signal, duration=1000.0 / rate, rate=rate)
    assert clean.displacement is not None
    moved = clean.displacement + zero + 1e-6 * generator.standard_normal(len(clean)) if displacement else None
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + 1e-4 * generator.standard_normal(len(clean)),
        displacement=moved,
        metadata=RunMetadata(signal=signal, starts_from_rest=True),
    )


def told(fit: Fit) -> list[tuple[str, str]]:
    codes = ("above-electrolysis", "large-bending", "laser-lost", "near-resonance", "resonance-aliased")
    return [(finding.code, finding.message.partition(":")[0]) for finding in fit.findings if finding.code in codes]


def test_every_run_above_electrolysis_is_told_once(tmp_path) -> None:
    runs = [measured("step 1 V"), measured("step 2 V delay=1 s"), measured("step 3 V")]
    fit = identify(FRIEND, runs)
    assert told(fit) == [("above-electrolysis", "step 2 V delay=1 s"), ("above-electrolysis", "step 3 V")]
    (warning, _) = (finding for finding in fit.findings if finding.code == "above-electrolysis")
    assert (warning.severity, warning.effect, warning.samples) == ("warning", "none", ())
    write_fit(fit, tmp_path / "fit.toml")
    assert told(read_fit(tmp_path / "fit.toml")) == told(fit)


def test_a_simulated_run_that_says_so_itself_is_told_once_on_the_page(tmp_path) -> None:
    run = simulate(FRIEND, "step 2 V", duration=20.0, rate=50.0)
    fit = identify(FRIEND, [run])
    assert told(fit) == [("above-electrolysis", "step 2 V")]
    report(fit, runs=[run], path=tmp_path / "fit.html")
    assert (tmp_path / "fit.html").read_text("utf-8").count("the voltage reaches 2 V") == 1


def test_a_leak_or_a_low_voltage_has_nothing_to_say() -> None:
    leaking = load_actuator("friend-2+leak.exponential")
    assert told(identify(leaking, [measured("step 2 V")])) == []
    assert told(identify(FRIEND, [measured("step 1 V", displacement=True)], free="electrical,coupling.gain")) == []


@pytest.mark.parametrize(("displacement", "severity"), [(True, "warning"), (False, "info")])
def test_near_resonance_is_a_warning_where_the_beam_is_asked(displacement: bool, severity: str) -> None:
    run = measured(f"sine 1 V {0.5 * RESONANCE:.6g} Hz", displacement=displacement, rate=16.0 * RESONANCE)
    fit = identify(FRIEND, [run], free="coupling.gain" if displacement else "circuit.dc_resistivity")
    assert [code for code, _ in told(fit)] == ["near-resonance"]
    (finding,) = (finding for finding in fit.findings if finding.code == "near-resonance")
    assert finding.severity == severity


def test_bending_is_that_of_the_model_and_not_the_zero_of_the_sensor() -> None:
    far = FRIEND["geometry.free_length"]
    run = measured("step 1 V delay=4 s", displacement=True, zero=far)
    assert told(identify(FRIEND, [run], free="coupling.gain")) == []
    assert run.displacement is not None
    bending = 0.3 * far / np.nanmax(np.abs(run.displacement - far))
    further = replace(run, displacement=far + bending * (run.displacement - far))
    assert told(identify(FRIEND, [further], free="coupling.gain")) == [("large-bending", "step 1 V delay=4 s")]


@pytest.mark.parametrize("drift", [0.0, 1e-3])
def test_bending_is_told_without_the_drift_of_its_sensor_which_a_figure_shows(drift: float) -> None:
    """A laser that moves by 1 mm/s while the strip bends by 0.3 of its length, as the rows at 0 V show."""
    run = measured("step 1 V delay=8 s", displacement=True)
    assert run.displacement is not None
    bending = 0.3 * FRIEND["geometry.free_length"] / np.nanmax(np.abs(run.displacement))
    moving = replace(run, displacement=bending * run.displacement + drift * run.time)
    fit = identify(FRIEND, [moving], free="coupling.gain")
    (said,) = (finding for finding in fit.findings if finding.code == "large-bending")
    reached = said.values["largest_displacement"]
    assert reached == pytest.approx(0.3 * FRIEND["geometry.free_length"], rel=0.02)
    assert ("without the drift of its sensor the predicted displacement" in said.message) is bool(drift)
    (line,), _ = in_brief([said], ["displacement"], [fit.observations[0].label])
    assert ("without its sensor's drift" in line.text) is bool(drift)
    assert f"reaches {1e3 * float(str(reached)):.4g} mm" in line.text
