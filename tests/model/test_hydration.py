"""Water content: isotherm, vapour, films and diffusion against tables computed elsewhere, and against stiff solvers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ipmclab import InputError, load_actuator
from ipmclab.model.environment import Environment, WaterState, equilibrium, transport_loop
from ipmclab.model.environment.conditions import ABSOLUTE
from ipmclab.model.environment.hydration import STANDARD
from ipmclab.model.environment.sorption import (
    GAS,
    activity,
    dew_point,
    saturation_concentration,
    saturation_pressure,
    slope,
    water_content,
)
from ipmclab.model.environment.transport import (
    FARADAY,
    EnvironmentHistory,
    bare_edge,
    content_by_mass,
    curl_displacement,
    electrolysed,
    mass_transfer,
    time_constants,
    water_course,
)

STRIP = {**load_actuator("friend-2").parameter_values, **STANDARD, "geometry.thickness": 0.2e-3}
FILM_ONLY = {**STRIP, "hydration.diffusivity": 1.0}
"""Through which water diffuses at once."""


def test_isotherm_vapour_and_times_are_those_of_the_table() -> None:
    table = {  # RH: content, slope, time of the film at 25 degC
        30: (2.771500, 3.6200, 102.0),
        50: (3.485500, 4.9600, 139.7),
        70: (5.331500, 14.9400, 420.8),
        80: (7.219000, 23.1700, 652.6),
        90: (10.037500, 33.5600, 945.2),
        100: (14.003000, 46.1100, None),
    }
    for humidity, (content, steep, film) in table.items():
        a = humidity / 100.0
        assert water_content(STANDARD, a) == pytest.approx(content, rel=1e-6)
        assert slope(STANDARD, a) == pytest.approx(steep, rel=1e-6)
        assert activity(STANDARD, content) == pytest.approx(a, abs=1e-12)
        if film is not None:
            found = time_constants(STRIP, equilibrium(STANDARD, Environment(25.0, humidity)))
            assert found.film == pytest.approx(film, abs=0.05)
    for temperature, vapour in ((15.0, 0.711731), (20.0, 0.959364), (25.0, 1.278171), (40.0, 2.835363)):
        assert saturation_concentration(temperature) == pytest.approx(vapour, rel=1e-6)
    for diffusivity, seconds in ((1e-11, 405.3), (1e-10, 40.53), (5e-10, 8.106)):
        constants = time_constants({**STRIP, "hydration.diffusivity": diffusivity}, WaterState(7.0, 25.0))
        assert constants.diffusion == pytest.approx(seconds, rel=2e-4)
    assert saturation_pressure(20.0) / saturation_pressure(25.0) == pytest.approx(0.73799, abs=5e-6)
    assert dew_point(25.0, 73.799) == pytest.approx(20.0, abs=1e-4)
    assert 1e9 * electrolysed(1.0) == pytest.approx(93.356, rel=1e-5)
    assert mass_transfer({**STRIP, "hydration.coating.transfer": 1e9, "hydration.coating.bare_edge": 0.0}) == (
        pytest.approx(5e-3)
    )
    assert bare_edge(load_actuator("friend-2").parameter_values) == pytest.approx(0.0539, abs=1e-4)


def test_the_strips_of_the_thesis_hold_what_their_masses_say() -> None:
    """30 x 5 mm of N117 (samples 1 to 4) and N1110, dry and after a day in water."""
    masses = [(90, 107), (103, 113), (89, 101), (86, 99), (120, 128), (105, 120), (87, 101)]
    found = [
        content_by_mass(STRIP, 1e-6 * wet, 1e-6 * dry, 1.5e-4, 183e-6 if number < 4 else 254e-6).water_content
        for number, (dry, wet) in enumerate(masses)
    ]
    assert found == pytest.approx([19.10, 11.23, 13.48, 14.60, 6.48, 12.14, 11.33], abs=0.006)


def test_the_dew_point_is_the_inverse_of_saturation() -> None:
    for temperature in (-20.0, 0.0, 25.0, 80.0):
        for humidity in (0.1, 5.0, 50.0, 99.9):
            found = saturation_pressure(dew_point(temperature, humidity))
            assert found == pytest.approx(0.01 * humidity * saturation_pressure(temperature), rel=1e-9)
    assert (dew_point(20.0, 100.0), dew_point(20.0, 0.0)) == (20.0, -200.0)


def test_the_compiled_loop_has_the_constants_of_the_laws() -> None:
    assert transport_loop.vapour(31.0) == pytest.approx(saturation_concentration(31.0), rel=1e-14)
    assert (transport_loop._KELVIN, transport_loop._GAS, transport_loop._FARADAY) == (ABSOLUTE, GAS, FARADAY)


def test_a_drying_strip_goes_as_the_table() -> None:
    minutes = 60.0 * np.array([1.0, 2.0, 5.0, 10.0, 20.0])
    table = {
        (80.0, 50.0): (6.755945, 6.326428, 5.242157, 4.104724, 3.519616),
        (100.0, 40.0): (13.060421, 12.152043, 9.642563, 6.257184, 3.224025),
    }
    for (first, last), contents in table.items():
        start = equilibrium(STANDARD, Environment(20.0, first))
        air = EnvironmentHistory.of(Environment(20.0, last))
        course = water_course(FILM_ONLY, air, 1200.0, start=start)
        assert course.contents(minutes) == pytest.approx(contents, rel=1e-6)
        slow = water_course({**FILM_ONLY, "hydration.film": 3e-3}, air, 2000.0, start=start)
        assert slow.contents(minutes * 5.0 / 3.0) == pytest.approx(contents, rel=1e-6)


def test_everything_at_once_equals_a_stiff_solver() -> None:
    """Films, asymmetry, a leak, air that changes, a strip that warms up, and the antisymmetric mode."""
    values = {
        **STRIP,
        "hydration.asymmetry": 4.0,
        "hydration.face_difference": 0.5,
        "hydration.diffusivity": 3e-11,
        "hydration.thermal_time": 45.0,
        "hydration.linear_swelling": 0.01,
    }
    air = EnvironmentHistory.of([(0.0, "20 degC, 80 %RH"), (200.0, "28 degC, 55 %RH"), (600.0, "25 degC, 85 %RH")])
    leak = 30.0
    sites, inner = 1800.0 * 0.2e-3, 0.5 * 1800.0 * math.pi**2 * 3e-11 / 0.2e-3
    mixing = (0.2e-3) ** 2 / (math.pi**2 * 3e-11)

    def outflow(film: float, content: float, saturated: float, around: float) -> float:
        from scipy.optimize import brentq

        def flow(a: float) -> float:
            entering = a * saturated < around
            return (film / 4.0 if entering else film) * (a * saturated - around)

        return flow(
            brentq(lambda a: inner * (float(water_content(STANDARD, a)) - content) + flow(a), -0.05, 1.0, xtol=1e-14)
        )

    def rates(t: float, x: list[float]) -> list[float]:
        outside = air.at(t)
        around = outside.relative_humidity / 100.0 * float(saturation_concentration(outside.temperature))
        saturated = float(saturation_concentration(x[1]))
        anode, cathode = outflow(2.5e-3, x[0], saturated, around), outflow(5e-3, x[0], saturated, around)
        split = leak / (2.0 * 96485.33212)
        drag = 2.5 * x[0] / 22.0 * leak / 96485.33212
        return [
            -(anode + cathode + split) / sites,
            (outside.temperature - x[1]) / 45.0,
            -x[2] / mixing + 2.0 * (cathode - anode - split - 2.0 * drag) / sites,
        ]

    x, checks = [7.219, 20.0, 0.0], np.array([100.0, 200.0, 400.0, 600.0, 900.0])
    expected = []
    for begin, end in ((0.0, 200.0), (200.0, 600.0), (600.0, 900.0)):
        inside = checks[(checks > begin) & (checks <= end)]
        found = solve_ivp(rates, (begin, end), x, method="LSODA", rtol=1e-9, atol=1e-11, t_eval=inside)
        expected.append(found.y)
        x = found.y[:, -1].tolist()
    exact = np.hstack(expected)
    course = water_course(values, air, 900.0, start=WaterState(7.219, 20.0), leak=np.array([[0.0], [leak]]))
    # The step in which sorption turns from leaving to entering is the coarsest.
    assert course.contents(checks) == pytest.approx(exact[0], rel=1e-5)
    assert course.temperatures(checks) == pytest.approx(exact[1], rel=1e-6)
    scale = np.abs(course.gradient).max()
    assert np.abs(course.gradients(checks) - exact[2]).max() <= 2e-3 * scale
    assert curl_displacement(values, 0.1) == pytest.approx(-0.5 * 0.01 * 0.1 / 0.2e-3 * 0.021**2)


def test_a_wet_strip_dries_as_a_free_surface_and_never_below_nothing() -> None:
    course = water_course(FILM_ONLY, EnvironmentHistory.of("20 degC, 0 %RH"), 4000.0, start=WaterState(22.0, 20.0))
    early = (course.contents(0.0) - course.contents(30.0)) / 30.0
    assert early == pytest.approx(2.0 * 5e-3 * 0.959364 / (1800.0 * 0.2e-3), rel=1e-6)
    assert np.all(course.water_content > 0.0)
    assert np.all(np.diff(course.water_content) <= 1e-12)
    starved = water_course(FILM_ONLY, EnvironmentHistory.of("20 degC, 5 %RH"), 4000.0, leak=np.array([[0.0], [2000.0]]))
    assert 0.0 < starved.water_content[-1] < 0.1


def test_a_content_is_measured_by_mass_and_bad_histories_are_refused() -> None:
    area, water = 125e-6, 10e-6
    found = content_by_mass(STRIP, 70e-6 + water, 70e-6, area)
    assert found.origin == "measured"
    assert found.water_content == pytest.approx(10e-6 / 18.015e-3 / (1800.0 * 0.2e-3 * 125e-6))
    with pytest.raises(InputError, match="give the wet mass first"):
        content_by_mass(STRIP, 70e-6, 80e-6, area)
    with pytest.raises(InputError, match="do not increase"):
        EnvironmentHistory.of([(1.0, "20 degC, 80 %RH"), (0.0, "20 degC, 50 %RH")])
    with pytest.raises(InputError, match="as many times"):
        EnvironmentHistory(np.arange(2.0), np.array([20.0]), np.array([50.0, 60.0]))
