"""Edges of foreign records whose voltage hardly shows between which rows they lie."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.run import Hold

SLOW = ("multisine 0.8 V 0.1 Hz 2 Hz delay=2 s", "triangle 0.8 V 0.328 Hz delay=2 s")


@pytest.mark.parametrize("hold", ["zero", "zero-before"])
def test_slow_voltages_show_together_between_which_rows_their_edges_lie(hold: Hold) -> None:
    """By itself each allows several rows, and a search does not get past a row: it left 10 times the noise."""
    strip = load_actuator("friend-2")
    generator = np.random.default_rng(20261121)
    runs, squares = [], 0.0
    for signal in SLOW:
        clean = simulate(strip, signal, duration=25, rate=10, hold=hold)
        noise = 1e-3 * generator.standard_normal(len(clean))
        squares += float(noise @ noise)
        runs.append(
            Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="unknown")
        )
    fit = identify(strip, runs, free="electrical")
    assert sum(float(np.sum(left["current"] ** 2)) for left in fit.residuals) < squares
    for run, one in zip(runs, fit.observations, strict=True):
        assert -1.0 <= one.delay * run.rate <= 0.0
    for name, found in fit.parameters.items():
        if name in strip.parameter_values:
            assert found.interval[0] < strip[name] < found.interval[1]
