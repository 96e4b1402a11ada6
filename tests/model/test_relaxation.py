"""Slow modes against their closed forms: peak time, final value, merging and complex poles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ipmclab import Actuator, load_actuator
from ipmclab.errors import InputError
from ipmclab.model import actuator_from_text, actuator_to_text, sensitivities, simulate, simulate_outputs
from ipmclab.model.numerics.discretise import transitions
from ipmclab.model.set_point import drive_system

FAST = 1.7  # [s]


def single_fast(*stages: str, drive: str = "displacement", **values: float) -> Actuator:
    """A coupling of one mode: its zero stands on one of its poles, so that d(s) = 1/(1 + 1.7 s)."""
    actuator = load_actuator("+".join(["friend-2", *stages]))
    coupling = {"coupling.zero": 50.0, "coupling.p1": 1.0 / FAST + 50.0, "coupling.p2": 50.0 / FAST}
    named = {f"relaxation.{drive}.0.{name}": value for name, value in values.items()}
    return actuator.replace(**coupling, **{"coupling.gain": 1.0 / FAST}, **named)


def step_of_drive(actuator: Actuator, times: np.ndarray, drive: str = "displacement") -> np.ndarray:
    system = drive_system(actuator, "force" if drive == "force" else "displacement")
    return (transitions([system], times).constant[0, :, :, 0] @ system.c[0]) + system.d[0, 0]


@pytest.mark.parametrize("drive", ["displacement", "force"])
@pytest.mark.parametrize("ratio", [0.4, 1.0, 1.6])
def test_peak_time_and_final_value(drive: str, ratio: float) -> None:
    slow = 14.0
    actuator = single_fast(f"relaxation.{drive}", drive=drive, ratio=ratio, time_constant=slow)
    # Dossier 1.8: tp = tau1 tau2/(tau2 - tau1) ln(tau2/(r tau1)), final value G (1 - r).
    peak = FAST * slow / (slow - FAST) * math.log(slow / (ratio * FAST))
    near = step_of_drive(actuator, np.array([0.999 * peak, peak, 1.001 * peak]), drive)
    assert near[1] > near[0]
    assert near[1] > near[2]
    assert abs((near[2] - near[0]) / (2e-3 * peak)) < 1e-5 * near[1]
    expected = (1.0 - math.exp(-peak / FAST)) - ratio * (1.0 - math.exp(-peak / slow))
    assert near[1] == pytest.approx(expected, rel=1e-11)
    assert step_of_drive(actuator, np.array([1e4]), drive)[0] == pytest.approx(1.0 - ratio, abs=1e-12)


def test_the_other_output_keeps_its_own_slow_mode() -> None:
    strip = load_actuator("friend-2+relaxation.displacement+relaxation.force")
    strip = strip.replace(**{"relaxation.displacement.0.time_constant": 30.0, "relaxation.force.0.time_constant": 4.0})
    frequency = np.array([0.0, 0.01, 0.1, 1.0])
    plain = load_actuator("friend-2").frequency_response(frequency, ["displacement", "force"])
    s = 2j * np.pi * frequency
    fast = (s + 210.5) / (s**2 + 15.897 * s + 41.097) * 41.097 / 210.5
    for row, slow in ((0, 30.0), (1, 4.0)):
        own = strip.frequency_response(frequency, ["displacement", "force"])[row]
        np.testing.assert_allclose(own, plain[row] * (1.0 - 0.5 / (1.0 + slow * s) / fast), rtol=1e-12)


@pytest.mark.parametrize("drive", ["displacement", "force"])
def test_a_pair_is_its_two_modes(drive: str) -> None:
    r1, tau1, r2, tau2 = 0.3, 6.0, 0.5, 40.0
    two = load_actuator(f"friend-2+relaxation.{drive}=2")
    modes = {"0.ratio": r1, "0.time_constant": tau1, "1.ratio": r2, "1.time_constant": tau2}
    two = two.replace(**{f"relaxation.{drive}.{name}": value for name, value in modes.items()})
    pair = load_actuator(f"friend-2+relaxation.{drive}_pair")
    time_constant = math.sqrt(tau1 * tau2)
    same = {
        "ratio": r1 + r2,
        "lead": r1 * tau2 + r2 * tau1,
        "time_constant": time_constant,
        "damping_ratio": (tau1 + tau2) / (2.0 * time_constant),
    }
    pair = pair.replace(**{f"relaxation.{drive}_pair.0.{name}": value for name, value in same.items()})
    one, other = (simulate(strip, "square 1 V 0.02 Hz", duration=100.0, rate=20.0) for strip in (two, pair))
    np.testing.assert_allclose(one.channels[drive], other.channels[drive], rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("damping", [0.3, 1.0, 1.0 + 1e-9, 2.5])
def test_a_pair_is_regular_where_its_time_constants_meet(damping: float) -> None:
    tau, ratio, lead = 8.0, 0.6, -3.0
    name = "relaxation.displacement_pair.0"
    given = {"ratio": ratio, "lead": lead, "time_constant": tau, "damping_ratio": damping}
    strip = single_fast("relaxation.displacement_pair").replace(**{f"{name}.{key}": v for key, v in given.items()})
    times = np.array([0.5, 4.0, 20.0, 60.0])
    # Step of (r + lead s)/(1 + 2 zeta tau s + tau^2 s^2), in closed form.
    turn = np.sqrt(complex(1.0 - damping**2)) * times / tau
    sine = (
        np.where(np.abs(turn) < 1e-3, 1.0 - turn**2 / 6.0, np.sin(turn) / np.where(turn == 0, 1.0, turn)) * times / tau
    )
    decay = np.exp(-damping * times / tau)
    slow = ratio * (1.0 - decay * (np.cos(turn) + damping * sine)) + lead / tau * decay * sine
    expected = (1.0 - np.exp(-times / FAST)) - slow.real
    np.testing.assert_allclose(step_of_drive(strip, times), expected, rtol=1e-7, atol=1e-12)


def test_derivatives_of_a_pair_where_its_time_constants_meet() -> None:
    name = "relaxation.displacement_pair.0"
    strip = load_actuator("friend-2+relaxation.displacement_pair").replace(**{f"{name}.damping_ratio": 1.0})
    names = [f"{name}.{key}" for key in ("ratio", "lead", "time_constant", "damping_ratio")]
    time = np.arange(0.0, 40.0, 0.5)
    volts = np.ones_like(time)
    found = sensitivities(strip, names, time, volts, "zero", outputs=["displacement"])
    for place, parameter in enumerate(names):
        step = 1e-4 * strip[parameter]
        ends = [
            simulate_outputs(strip.replace(**{parameter: strip[parameter] + by}), time, volts, "zero")[2]
            for by in (-step, step)
        ]
        slope = (ends[1] - ends[0]) / (2.0 * step)
        np.testing.assert_allclose(found.parameters[0, :, place], slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())


def test_ratio_0_is_friend_2() -> None:
    plain = simulate(load_actuator("friend-2"), "square 1 V 0.1 Hz", duration=30.0, rate=50.0)
    stages = "relaxation.displacement=2+relaxation.force+relaxation.displacement_pair+relaxation.force_pair=2"
    strip = load_actuator(f"friend-2+{stages}")
    off = {name: 0.0 for name in strip.parameter_values if name.endswith((".ratio", ".lead"))}
    run = simulate(strip.replace(**off), "square 1 V 0.1 Hz", duration=30.0, rate=50.0)
    for name in ("current", "applied_voltage", "displacement", "force"):
        expected = plain.channels[name]
        np.testing.assert_allclose(run.channels[name], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_files_carry_pairs() -> None:
    strip = load_actuator("friend-2+relaxation.displacement_pair=2+relaxation.force")
    text = actuator_to_text(strip)
    assert "[[relaxation.displacement_pair]]" in text
    assert actuator_from_text(text).parameter_values == strip.parameter_values


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("relaxation.displacement_pair.0.damping_ratio", -0.1),
        ("relaxation.displacement_pair.0.time_constant", 0.0),
        ("relaxation.displacement.0.time_constant", -3.0),
    ],
)
def test_what_would_be_unstable_is_refused_by_name(parameter: str, value: float) -> None:
    strip = load_actuator("friend-2+relaxation.displacement+relaxation.displacement_pair")
    with pytest.raises(InputError) as caught:
        strip.replace(**{parameter: value})
    assert caught.value.where == parameter
    assert "0.001" in f"{caught.value} {caught.value.repair}"


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_a_ratio_that_is_no_number_is_refused(value: float) -> None:
    strip = load_actuator("friend-2+relaxation.displacement=1")
    with pytest.raises(InputError, match="is no finite number"):
        strip.replace(**{"relaxation.displacement.0.ratio": value})
