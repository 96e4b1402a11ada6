"""A zero of the current that no row shows: said with what it would do, and it does that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Finding, Fit, Run, RunMetadata, identify, load_actuator, simulate

FRIEND = load_actuator("friend-2")
DC = "circuit.dc_resistivity"
FREE = (DC, "circuit.branches.1.permittivity")
CODE = "zero-not-shown"


def measured(signal: str, *, zero: float = 0.0, origin: str = "measured") -> Run:
    """A record of friend-2 over 20 s with 0.1 mA of noise, and a zero [A] that its amplifier adds."""
    clean = simulate(FRIEND, signal, duration=20.0, rate=50.0)
    noise = 1e-4 * np.random.default_rng(20261122).standard_normal(len(clean.time))
    assert clean.current is not None
    about = RunMetadata(signal=signal, origin=origin)  # type: ignore[arg-type]
    return replace(clean, current=clean.current + zero + noise, metadata=about)


def said(fit: Fit) -> list[Finding]:
    return [finding for finding in fit.findings if finding.code == CODE]


@pytest.mark.parametrize("signal", ["step 1 V", "square 1 V 0.1 Hz"])
def test_a_zero_as_large_as_is_said_moves_the_parameters_as_far_as_is_said(signal: str) -> None:
    plain = identify(FRIEND, measured(signal), free=FREE)
    (finding,) = said(plain)
    assert finding.severity == "warning"
    assert finding.channel == "current"
    away = identify(FRIEND, measured(signal, zero=finding.values["zero"]), free=FREE)
    told = {name: size for name, size in finding.values.items() if name != "zero"}
    assert told
    for name, size in told.items():
        moved = abs(np.log(away.parameters[name].value / plain.parameters[name].value))
        assert moved == pytest.approx(size, rel=0.2)
        assert moved > plain.parameters[name].standard_error / plain.parameters[name].value


def test_rows_at_zero_volt_show_the_zero() -> None:
    assert not said(identify(FRIEND, measured("step 1 V delay=5 s"), free=FREE))


@pytest.mark.parametrize(("delay", "is_said"), [(0.6, True), (5.0, False)])
def test_a_few_rows_at_zero_volt_hardly_show_it(delay: float, is_said: bool) -> None:
    """A zero that these rows allow moves the parameters as far as is said, and freeing it tells by how much."""
    signal = f"step 1 V delay={delay} s"
    plain = identify(FRIEND, measured(signal), free=FREE)
    assert not said(plain)
    found = [finding for finding in plain.findings if finding.code == "zero-hardly-shown"]
    assert [finding.severity for finding in found] == (["warning"] if is_said else [])
    for finding in found:
        zero = finding.values["zero"]
        assert zero == pytest.approx(1.96 * 1e-4 / np.sqrt(50 * delay), rel=0.1)
        away = identify(FRIEND, measured(signal, zero=zero), free=FREE)
        moved = abs(np.log(away.parameters[DC].value / plain.parameters[DC].value))
        assert moved == pytest.approx(finding.values[DC], rel=0.2)
        freed = identify(FRIEND, measured(signal, zero=zero), free=[*FREE, "observation.offset.current"])
        assert freed.parameters[DC].interval[0] < FRIEND[DC] < freed.parameters[DC].interval[1]
        assert not [one for one in freed.findings if one.code == finding.code]


def test_where_the_zero_is_free_its_uncertainty_is_in_every_interval() -> None:
    fit = identify(FRIEND, measured("square 1 V 0.1 Hz"), free=[*FREE, "observation.offset.current"])
    assert not said(fit)
    alone = identify(FRIEND, measured("square 1 V 0.1 Hz"), free=FREE)
    assert fit.parameters[DC].standard_error > alone.parameters[DC].standard_error


def test_a_simulated_current_reads_zero() -> None:
    assert not said(identify(FRIEND, measured("step 1 V", origin="simulated"), free=FREE))
