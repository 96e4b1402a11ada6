"""Curvature along the strip, against the displacement, the line's own profile and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import InputError, Run, RunMetadata, load_actuator, simulate
from ipmclab.model import curvature
from ipmclab.model.shape import shape
from tests.independent.thesis import FRIEND_2

RATE = 50.0
STIFF = {"beam.modulus": 1e13, "beam.density": 1.0, "beam.damping_ratio": 1e-6}
"""A beam whose first mode is far above everything: it follows its curvature at once."""

NAMES = (
    "friend-2",
    "friend-2+clamp",
    "friend-2+line.modes=3",
    "friend-2+clamp+line.modes=6",
    "friend-2+line.segments=6",
    "friend-2+clamp+line.segments=5+leak.exponential+leak.slow",
    "friend-2+leak.cubic+relaxation.displacement=2+relaxation.force",
    "friend-2+line.modes=3+relaxation.displacement",
)


@pytest.mark.parametrize("name", NAMES)
def test_the_lever_of_every_place_adds_up_to_the_displacement(name: str) -> None:
    """int_0^Ls (L_s - x) kappa(x) dx, piece by piece between the nodes of a ladder."""
    strip = load_actuator(name).replace(**STIFF)
    run = simulate(strip, "sine 2 V 0.2 Hz", duration=6.0, rate=RATE, hold="first")
    sensing = strip["geometry.sensing_length"]
    nodes, weights = np.polynomial.legendre.leggauss(12)
    # In pieces of 0.5 mm, on whose edges all the nodes of these ladders lie.
    edges = np.linspace(0.0, sensing, round(sensing / 0.5e-3) + 1)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    x = (middle[:, None] + half[:, None] * nodes).ravel()
    lever = (sensing - x) * (half[:, None] * weights).ravel()
    expected = lever @ curvature(strip, run, x)
    assert run.displacement is not None
    assert np.max(np.abs(run.displacement - expected)) < 1e-6 * np.max(np.abs(expected))


def test_lumped_electrodes_bend_the_strip_evenly() -> None:
    """kappa = 6 d(0) V_appl/h^2 in the end (Friend, eq. 4.7)."""
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=400.0, rate=1.0)
    found = curvature(load_actuator("friend-2"), run, [0.0, 0.01, 0.025])
    assert found.shape == (3, len(run))
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])
    node = FRIEND_2.dc_resistance / (FRIEND_2.dc_resistance + 2.0 * FRIEND_2.electrode_resistance)
    coupling = FRIEND_2.gain * FRIEND_2.zero / FRIEND_2.p2
    assert found[0, -1] == pytest.approx(6.0 * coupling * node / FRIEND_2.thickness**2, rel=1e-6)


@pytest.mark.parametrize("name", ["friend-2+line.modes=12", "friend-2+line.segments=100"])
def test_along_a_line_it_falls_like_the_voltage(name: str) -> None:
    """In the end u(x) = cosh(g (1 - place))/cosh(g) with g^2 = R/R_dc, whatever the capacitors hold."""
    strip = load_actuator(name).replace(**{"circuit.dc_resistivity": 2.0})
    run = Run.from_arrays(time=np.arange(9) * 100.0, voltage=np.ones(9))
    x = np.array([0.0, 0.004, 0.011, 0.025])
    dc_resistance = 2.0 * FRIEND_2.thickness / (FRIEND_2.total_length * FRIEND_2.width)
    gamma = np.sqrt(2.0 * FRIEND_2.electrode_resistance / dc_resistance)
    place = (FRIEND_2.clamped_length + x) / FRIEND_2.total_length
    voltage = np.cosh(gamma * (1.0 - place)) / np.cosh(gamma)
    coupling = FRIEND_2.gain * FRIEND_2.zero / FRIEND_2.p2
    expected = 6.0 * coupling * voltage / FRIEND_2.thickness**2
    assert np.allclose(curvature(strip, run, x)[:, -1], expected, rtol=2e-4, atol=0.0)


def test_early_on_only_the_clamped_end_bends() -> None:
    strip = load_actuator("friend-2+line.modes=24+clamp")
    run = simulate(strip, "step 1 V", duration=3.0, rate=RATE)
    found = curvature(strip, run, np.linspace(0.0, 0.025, 11))
    assert np.all(np.diff(found[:, 10]) < 0.0)
    assert found[-1, 10] < 0.2 * found[0, 10]
    assert found[-1, -1] > 0.5 * found[0, -1]


def test_it_gives_the_shape_of_the_strip() -> None:
    """Arcs end where the linear displacement says, as long as the strip bends little."""
    strip = load_actuator("friend-2+line.modes=6").replace(**STIFF)
    run = simulate(strip, "step 1 V", duration=4.0, rate=RATE)
    free, sensing, arcs = strip["geometry.free_length"], strip["geometry.sensing_length"], 400
    middles = (np.arange(arcs) + 0.5) * free / arcs
    bent = shape(curvature(strip, run, middles)[:, -1], free)
    assert run.displacement is not None
    assert bent.height_at(sensing) == pytest.approx(run.displacement[-1], rel=5e-3)


def test_a_shunt_upstream_is_in_series() -> None:
    strip = load_actuator("friend-2+line.modes=3")
    about = RunMetadata(voltage_sensed="upstream of shunt", shunt_resistance=2.0)
    sensed = Run.from_arrays(time=np.arange(50) / RATE, voltage=np.ones(50), metadata=about)
    plain = Run.from_arrays(time=sensed.time, voltage=sensed.voltage)
    expected = curvature(strip.replace(**{"circuit.contact_resistance": 2.0}), plain, [0.01])
    assert np.array_equal(curvature(strip, sensed, [0.01]), expected)


@pytest.mark.parametrize(
    ("positions", "said"),
    [
        ([0.0, 0.03], r"positions: place 1 is 0\.03 m, the free length goes from 0 to 0\.025 m"),
        ([-1e-3], r"place 0 is -0\.001 m"),
        ([np.nan], r"place 0 is nan m"),
        ([], r"is not a row of places"),
        ([[0.0]], r"is not a row of places"),
        ("middle", r"'middle' is a str, not an array of numbers; give a list or an array of numbers in m"),
    ],
)
def test_places_off_the_strip_are_refused(positions: object, said: str) -> None:
    run = Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0])
    with pytest.raises(InputError, match=said):
        curvature(load_actuator("friend-2"), run, positions)


def test_a_run_of_unknown_hold_is_refused() -> None:
    run = Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0], hold="unknown")
    with pytest.raises(InputError, match="does not say what its voltage did between rows"):
        curvature(load_actuator("friend-2"), run, [0.01])
