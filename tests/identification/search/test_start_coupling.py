"""Where the search for the coupling begins: from readings without noise at the truth, but for straight lines."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Run, load_actuator, simulate
from ipmclab.identification.problem.record import PreparedRun, prepare
from ipmclab.identification.search.starts.start_coupling import coupling_starts, motion_series, of_output
from ipmclab.model import Actuator

COUPLING = ("coupling.gain", "coupling.zero", "coupling.p1", "coupling.p2")
STRIP = load_actuator("friend-2").replace(**{"coupling.zero": 8.0})  # below the Nyquist rate, so that it shows
THOUGHT = {"coupling.gain": 1e-9, "coupling.zero": 5.0, "coupling.p1": 2.0, "coupling.p2": 1.0}
"""What is believed before the search."""


def record(strip: Actuator, outputs: tuple[str, ...], place: int = 0) -> PreparedRun:
    clean = simulate(strip, "multisine 1 V 0.05 Hz 3 Hz", duration=40.0, rate=50.0, hold="first")
    readings = {output: getattr(clean, output) for output in outputs}
    return prepare(
        Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="first", **readings), place, outputs, ()
    )


@pytest.mark.parametrize("outputs", [("displacement",), ("force",), ("displacement", "force")])
def test_the_coupling_is_found_from_either_output_and_from_both(outputs: tuple[str, ...]) -> None:
    strip = STRIP.replace(**{"beam.density": 10.0})  # so light that its own resonance is far off
    start = coupling_starts(strip.replace(**THOUGHT), [record(strip, outputs)], {}, stiffness_is_free=False)[0]
    assert [start[name] / STRIP[name] for name in COUPLING] == pytest.approx([1.0] * 4, rel=0.04)
    assert "beam.modulus" not in start


@pytest.mark.parametrize("stiffer", [0.4, 3.0])
@pytest.mark.parametrize("apart", [False, True])
def test_displacement_tells_the_coupling_and_force_the_stiffness(stiffer: float, apart: bool) -> None:
    """In one run or in two; a modulus that was taken wrong does not move the coupling."""
    strip = STRIP.replace(**{"beam.density": 10.0})
    if apart:
        records = [record(strip, ("force",), 0), record(strip, ("displacement",), 1)]
    else:
        records = [record(strip, ("displacement", "force"))]
    believed = strip.replace(**THOUGHT, **{"beam.modulus": strip["beam.modulus"] / stiffer})
    start = coupling_starts(believed, records, {}, stiffness_is_free=True)[0]
    assert [start[name] / STRIP[name] for name in COUPLING] == pytest.approx([1.0] * 4, rel=0.04)
    assert start["beam.modulus"] == pytest.approx(strip["beam.modulus"], rel=0.02)


def test_series_know_their_output_and_their_run() -> None:
    records = [record(STRIP, ("displacement", "force"), 0), record(STRIP, ("force",), 1)]
    seen = motion_series(STRIP, records, {})
    assert [(one.record.place, one.output) for one in seen] == [(0, "displacement"), (0, "force"), (1, "force")]
    assert [id(one) for one in of_output(seen, "force")] == [id(one) for one in seen[1:]]
    assert [id(one) for one in of_output(seen, "displacement")] == [id(seen[0])]
    # Both are d(s) of the node voltage: over their static factors they are one series.
    light = STRIP.replace(**{"beam.density": 1.0})
    alike, pressed = (one.run for one in motion_series(light, [record(light, ("displacement", "force"))], {}))
    np.testing.assert_allclose(alike.readings, pressed.readings, atol=2e-3 * np.abs(pressed.readings).max())
