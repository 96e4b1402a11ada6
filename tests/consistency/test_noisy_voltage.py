"""Noise of the recorded voltage moves the fast resistivity, and the fit says so and by how much."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ipmclab import Finding, Fit, Run, RunMetadata, identify, import_run, load_actuator, simulate
from ipmclab.consistency.noisy_voltage import CODE
from ipmclab.signals import Samples
from tests.identification.test_real_current import MAPS, after_the_edge, strip

FAST = "circuit.branches.0.resistivity"
SIGNALS = ("step 1 V delay=5 s", "sine 1 V 0.1 Hz delay=5 s")
STRIP = load_actuator("friend-2")
CLEAN = [simulate(STRIP, signal, duration=40.0, rate=50.0) for signal in SIGNALS]


def fitted(scatter: float, seed: int, *, quantum: float = 0.0, scale: float = 1.0) -> Fit:
    """A step and a sine with 0.1 mA of noise, whose voltage was read with noise and in the steps of a converter."""
    rng = np.random.default_rng(seed)
    runs = []
    for clean, signal in zip(CLEAN, SIGNALS, strict=True):
        voltage = clean.voltage + scatter * rng.standard_normal(len(clean))
        runs.append(
            Run.from_arrays(
                time=clean.time,
                voltage=np.round(voltage / quantum) * quantum if quantum else voltage,
                current=clean.channels["current"] + scale * 1e-4 * rng.standard_normal(len(clean)),
                hold=clean.hold,
                metadata=RunMetadata(signal=signal, starts_from_rest=True),
            )
        )
    return identify(STRIP, runs)


def told(fit: Fit) -> Finding | None:
    found = [one for one in fit.findings if one.code == CODE]
    assert len(found) <= 1
    return found[0] if found else None


@pytest.mark.parametrize("scatter", [2e-3, 5e-3])
def test_the_bias_is_told_as_large_as_it_is(scatter: float) -> None:
    """Drawn: the noise of the current is so small that what is off is the voltage's doing."""
    off, said = [], []
    for seed in range(6):
        fit = fitted(scatter, seed)
        one = fit.parameters[FAST]
        finding = told(fit)
        assert finding is not None
        assert finding.severity == "warning"
        assert finding.values["scatter"] == pytest.approx(scatter, rel=0.1)
        off.append((one.value - STRIP[FAST]) / one.standard_error)
        said.append(finding.values[FAST])
    # The mean of six is known to 1/sqrt(6) standard errors.
    assert np.mean(said) == pytest.approx(np.mean(off), abs=3.0 / np.sqrt(6.0))
    assert np.mean(said) > 1.0
    assert "commanded" in finding.repair
    assert FAST in finding.message


@pytest.mark.parametrize(
    ("scatter", "quantum"),
    [(0.0, 0.0), (0.0, 20.0 / 2**16), (1e-4, 20.0 / 2**16), (3e-4, 0.0)],
    ids=["exact", "16 bit", "16 bit with noise", "0.3 mV"],
)
def test_a_voltage_that_is_known_well_enough_is_not_blamed(scatter: float, quantum: float) -> None:
    assert [told(fitted(scatter, seed, quantum=quantum)) for seed in range(3)] == [None] * 3


def test_scatter_that_the_strip_felt_is_no_noise() -> None:
    """A supply that is not quiet: the current answers to it."""
    rng = np.random.default_rng(20261122)
    time = np.arange(2000) / 50.0
    applied = np.where(time >= 5.0, 1.0, 0.0) + 5e-3 * rng.standard_normal(2000)
    clean = simulate(STRIP, Samples(time, applied), duration=40.0, rate=50.0)
    run = Run.from_arrays(
        time=time,
        voltage=clean.voltage,
        current=clean.channels["current"] + 1e-4 * rng.standard_normal(2000),
        metadata=RunMetadata(starts_from_rest=True),
    )
    assert told(identify(STRIP, [run])) is None


def test_a_current_with_more_noise_hides_it() -> None:
    assert told(fitted(2e-3, 1, scale=1.0)) is not None
    assert told(fitted(2e-3, 1, scale=30.0)) is None


def test_the_real_step_is_not_blamed(real_runs: Path) -> None:
    """Its voltage stands still behind the edge but for the steps of its converter."""
    run = import_run(real_runs / "step_1V.csv.gz", MAPS / "step_1V.toml")
    assert told(identify(strip(56.9), [after_the_edge(run, "zero")])) is None
