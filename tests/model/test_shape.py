"""The shape of a strip against arcs, the elastica and small bending."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk, ellipkinc

from ipmclab import load_actuator
from ipmclab.errors import InputError, IpmclabError
from ipmclab.model.shape import (
    bending_rigidity,
    blocked_torque,
    curvature_from_height,
    loaded_shape,
    shape,
)

LENGTH, LASER = 0.025, 0.021


@pytest.mark.parametrize("curvature", [0.0, 1e-6, 12.0, -40.0, 90.0])
@pytest.mark.parametrize("segments", [1, 7])
def test_a_uniform_curvature_is_an_arc(curvature: float, segments: int) -> None:
    arc = shape([curvature] * segments, LENGTH)
    turn = curvature * LENGTH
    # Dossier 1.4: tip x = sin(kL)/k, y = (1 - cos kL)/k; written so that a small k does not cancel.
    x, y = LENGTH * np.sinc(turn / np.pi), LENGTH * 0.5 * turn * np.sinc(0.5 * turn / np.pi) ** 2
    assert (arc.x[-1], arc.y[-1], arc.angle[-1]) == pytest.approx((x, y, turn), rel=1e-12, abs=1e-18)


def test_any_curvature_against_an_integrator() -> None:
    def rates(s: float, state: np.ndarray) -> list[float]:
        return [60.0 * math.exp(-80.0 * s), math.cos(state[0]), math.sin(state[0])]

    solved = solve_ivp(rates, (0.0, LENGTH), [0.0, 0.0, 0.0], rtol=1e-12, atol=1e-15)
    errors = []
    for segments in (50, 100):
        edges = np.linspace(0.0, LENGTH, segments + 1)
        mean = 60.0 * -np.diff(np.exp(-80.0 * edges)) / 80.0 / np.diff(edges)
        found = shape(mean, LENGTH)
        assert found.angle[-1] == pytest.approx(solved.y[0, -1], rel=1e-11)
        errors.append(math.hypot(found.x[-1] - solved.y[1, -1], found.y[-1] - solved.y[2, -1]))
    assert errors[0] < 1e-4 * LENGTH
    assert errors[1] < 0.27 * errors[0]  # second order


@pytest.mark.parametrize("curvature", [3.0, -30.0, 38.0])
def test_height_at_a_laser(curvature: float) -> None:
    found = shape([curvature] * 40, LENGTH).height_at(LASER)
    exact = (1.0 - math.sqrt(1.0 - (curvature * LASER) ** 2)) / curvature
    assert found == pytest.approx(exact, rel=1e-12)
    assert curvature_from_height(found, LASER) == pytest.approx(curvature, rel=1e-12)


def test_the_strip_leaves_the_laser() -> None:
    # Dossier 4: at kappa L_t of about 1 rad, 11.4 mm, for a laser at 21 mm of 25 mm.
    assert not math.isnan(shape([1.0 / LENGTH] * 30, LENGTH).height_at(LASER))
    assert math.isnan(shape([1.02 / LENGTH] * 30, LENGTH).height_at(LASER))
    assert shape([0.0] * 3, LASER).height_at(LASER) == 0.0


def test_blocked_torque_and_force() -> None:
    strip = load_actuator("friend-2").parameter_values
    thickness, width, modulus = 0.245e-3, 5e-3, 1.45e9
    d, volts = 6.79e-9 * 210.5 / 41.097, 0.81592
    curvature = 6.0 * d * volts / thickness**2
    # Dossier 0: the blocked moment is Y w h d V/2.
    assert blocked_torque(curvature, strip) == pytest.approx(modulus * width * thickness * d * volts / 2.0, rel=1e-12)
    # Eq. 4.9 is the force at L_s that takes back the free displacement: 1.8001 mN for 1 V at the electrodes.
    force = 1.8001e-3
    held = loaded_shape([curvature] * 20, LASER, rigidity=bending_rigidity(strip), force=force)
    assert abs(held.y[-1]) < 2e-4 * 0.6254e-3


@pytest.mark.parametrize("load", [0.2, 1.0, 5.0])
def test_a_large_load_is_the_elastica(load: float) -> None:
    """Bisshopp and Drucker (1945): the angle at the end from elliptic integrals, F L^2/(Y I) = (K(m) - F(phi, m))^2."""
    from scipy.optimize import brentq

    def excess(end: float) -> float:
        m = 0.5 * (1.0 + math.sin(end))
        start = math.asin(1.0 / math.sqrt(2.0 * m))
        return float(ellipk(m) - ellipkinc(start, m)) - math.sqrt(load)

    end = brentq(excess, 1e-6, 0.5 * math.pi - 1e-6, xtol=1e-14)
    across = math.sqrt(2.0 * math.sin(end) / load)  # x of the end, as a part of the length
    rigidity = 8.9e-6
    found = loaded_shape([0.0] * 10, LENGTH, rigidity=rigidity, force=-load * rigidity / LENGTH**2)
    assert found.angle[-1] == pytest.approx(end, rel=1e-6)
    assert found.x[-1] / LENGTH == pytest.approx(across, rel=1e-6)
    if load == 1.0:
        assert found.y[-1] / LENGTH == pytest.approx(0.30172, rel=1e-4)  # their table


def test_a_load_on_a_bent_strip_holds_the_moment_in_every_place() -> None:
    rigidity, force, curvature = 8.9e-6, 4e-3, 45.0
    found = loaded_shape([curvature] * 200, LENGTH, rigidity=rigidity, force=force)
    bent = np.diff(found.angle) / np.diff(found.along)
    middle_x = 0.5 * (found.x[1:] + found.x[:-1])
    expected = curvature - force * (found.x[-1] - middle_x) / rigidity
    np.testing.assert_allclose(bent, expected, rtol=2e-4)


def test_what_cannot_be_a_strip_is_refused() -> None:
    for call, where in (
        (lambda: shape([], LENGTH), "curvature"),
        (lambda: shape([1.0, math.nan], LENGTH), "curvature"),
        (lambda: shape([1.0], 0.0), "length"),
        (lambda: curvature_from_height(1e-3, -1.0), "x"),
        (lambda: loaded_shape([1.0], LENGTH, rigidity=0.0, force=1.0), "rigidity"),
        (lambda: loaded_shape([1.0], LENGTH, rigidity=1e-5, force=math.inf), "force"),
    ):
        with pytest.raises(InputError) as caught:
            call()
        assert caught.value.where == where
    with pytest.raises(IpmclabError, match="no equilibrium"):
        loaded_shape([40.0] * 10, LENGTH, rigidity=1e-9, force=50.0)
