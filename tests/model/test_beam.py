"""The beam with a viscoelastic modulus against eqs 4.7, 4.9 and 4.10 in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import load_actuator, simulate
from ipmclab.errors import InputError
from ipmclab.model import sensitivities, simulate_outputs
from ipmclab.model.stages.beam import natural_frequency, resonance, tip_stiffness

FREQUENCY = np.array([0.0, 0.003, 0.1, 1.0, 7.0, 38.3, 45.0, 300.0, 5000.0])
MODES = ((0.4, 2.5, 20.0), (1.5, 0.3, 400.0))


def viscoelastic(modes: tuple[tuple[float, float, float], ...] = MODES) -> dict[str, float]:
    keys = ("amplitude", "damping_ratio", "frequency")
    return {f"viscoelastic.{i}.{k}": v for i, mode in enumerate(modes) for k, v in zip(keys, mode, strict=True)}


def eq_4_10(s: np.ndarray) -> np.ndarray:
    return 1.0 + sum(k * (s**2 + 2 * z * w * s) / (s**2 + 2 * z * w * s + w**2) for k, z, w in MODES)


def test_displacement_and_force_follow_the_equations() -> None:
    plain = load_actuator("friend-2")
    strip = load_actuator("friend-2+viscoelastic=2").replace(**viscoelastic())
    s = 2j * np.pi * FREQUENCY
    y = eq_4_10(s)
    found = strip.frequency_response(FREQUENCY, ["displacement", "force", "applied_voltage", "current"])
    base = plain.frequency_response(FREQUENCY, ["displacement", "force", "applied_voltage", "current"])
    # Eq. 4.9: the force is that of Y(s).
    np.testing.assert_allclose(found[1], base[1] * y, rtol=1e-12)
    # Eq. 4.7: Y(s) stands in s^2 12 L_f^4 rho/(Gamma^4 Y h^2), and so in the damping, whose dashpot does not stiffen.
    d = 6.79e-9 * (s + 210.5) / (s**2 + 15.897 * s + 41.097)
    omega = 1.875**2 * np.sqrt(1.45e9 * 0.245e-3**2 / (12.0 * 3965.0)) / 0.025**2
    factor = 1.0 / (1.0 + 2.0 * 0.05 * s / (omega * y) + s**2 / (omega**2 * y))
    np.testing.assert_allclose(found[0], 3.0 * d * 0.021**2 / 0.245e-3**2 * factor * base[2], rtol=1e-11)
    np.testing.assert_allclose(found[2:], base[2:], rtol=1e-14)


def test_free_curvature_does_not_know_the_modulus_and_force_does() -> None:
    # Without inertia the displacement of a stiff, of a soft and of a viscoelastic strip is the same; the force is not.
    light = {"beam.density": 1.0, "beam.damping_ratio": 1e-6}
    frequency = np.array([0.01, 0.1, 1.0])
    hard = load_actuator("friend-2").replace(**light)
    soft = hard.replace(**{"beam.modulus": 1.45e8})
    slow = load_actuator("friend-2+viscoelastic=2").replace(**light, **viscoelastic())
    bent = [one.frequency_response(frequency, ["displacement"])[0] for one in (hard, soft, slow)]
    pressed = [one.frequency_response(frequency, ["force"])[0] for one in (hard, soft, slow)]
    for other in bent[1:]:
        np.testing.assert_allclose(other, bent[0], rtol=1e-5)
    np.testing.assert_allclose(pressed[1], 0.1 * pressed[0], rtol=1e-12)
    np.testing.assert_allclose(pressed[2] / pressed[0], eq_4_10(2j * np.pi * frequency), rtol=1e-12)


def test_amplitude_0_is_friend_2() -> None:
    off = {f"viscoelastic.{i}.amplitude": 0.0 for i in range(2)}
    strip = load_actuator("friend-2+viscoelastic=2").replace(**off)
    one, other = (
        simulate(each, "square 1 V 0.2 Hz", duration=12.0, rate=200.0) for each in (load_actuator("friend-2"), strip)
    )
    for name in ("current", "applied_voltage", "displacement", "force"):
        expected = one.channels[name]
        np.testing.assert_allclose(other.channels[name], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_the_force_relaxes_from_the_stiffness_at_once_to_the_static_one() -> None:
    strip = load_actuator("friend-2+viscoelastic").replace(
        **{"viscoelastic.0.amplitude": 0.8, "viscoelastic.0.frequency": 0.01, "viscoelastic.0.damping_ratio": 1.0}
    )
    plain = simulate(load_actuator("friend-2"), "step 1 V", duration=4000.0, rate=1.0)
    run = simulate(strip, "step 1 V", duration=4000.0, rate=1.0)
    assert plain.force is not None
    assert run.force is not None
    assert run.force[1] / plain.force[1] == pytest.approx(1.8, rel=0.03)
    assert run.force[-1] == pytest.approx(1.8001e-3, rel=1e-3)  # the published t -> infinity limit


def test_derivatives_also_at_amplitude_0() -> None:
    strip = load_actuator("friend-2+viscoelastic=2").replace(**viscoelastic() | {"viscoelastic.1.amplitude": 0.0})
    names = ["viscoelastic.0.amplitude", "viscoelastic.0.damping_ratio", "viscoelastic.1.amplitude", "beam.modulus"]
    time = np.arange(0.0, 2.0, 0.005)
    volts = np.sign(np.sin(7.0 * time)) + 0.0
    found = sensitivities(strip, names, time, volts, "zero", outputs=["displacement", "force"])
    for place, name in enumerate(names):
        # Of a value of zero too: rounding is divided by the step, and 1e-7 left the bound no room on some processors.
        step = 1e-5 * max(strip[name], 1.0)
        up = simulate_outputs(strip.replace(**{name: strip[name] + 2 * step}), time, volts, "zero")[2:]
        middle = simulate_outputs(strip.replace(**{name: strip[name] + step}), time, volts, "zero")[2:]
        here = simulate_outputs(strip, time, volts, "zero")[2:]
        slope = (-up + 4.0 * middle - 3.0 * here) / (2.0 * step)
        for row in range(2):
            scale = np.abs(slope[row]).max()
            np.testing.assert_allclose(found.parameters[row, :, place], slope[row], rtol=0, atol=2e-5 * scale)


def test_resonance_with_damping() -> None:
    plain = resonance(load_actuator("friend-2").parameter_values)
    assert plain.frequency == pytest.approx(38.29, rel=1e-3)  # dossier A5
    assert plain.damping_ratio == 0.05
    strip = load_actuator("friend-2+viscoelastic=2").replace(**viscoelastic())
    found = resonance(strip.parameter_values)
    # The pole is where 1 + 2 zeta s/(w y) + s^2/(w^2 y) vanishes.
    angular = 2.0 * np.pi * found.frequency
    pole = angular * complex(-found.damping_ratio, np.sqrt(1.0 - found.damping_ratio**2))
    omega = 2.0 * np.pi * plain.frequency
    residue = eq_4_10(np.array([pole]))[0] + 0.1 * pole / omega + pole**2 / omega**2
    assert abs(residue) < 1e-9
    assert found.damping_ratio > 0.06
    stiff = resonance(load_actuator("friend-2+viscoelastic").parameter_values)  # relaxes far below the resonance
    assert stiff.frequency == pytest.approx(plain.frequency * np.sqrt(1.3), rel=1e-2)


@pytest.mark.parametrize("damping_ratio", [0.3, 1.5, 3.0])
@pytest.mark.parametrize(
    ("stages", "changes", "stiffer"),
    [
        ("viscoelastic=2", {"viscoelastic.0.amplitude": 0.0, "viscoelastic.1.amplitude": 0.0}, 1.0),
        ("viscoelastic", {"viscoelastic.0.amplitude": 0.6, "viscoelastic.0.frequency": 1e-3}, 1.6),  # far below
        ("load", {"load.stiffness": 3.0}, 4.0),  # in stiffnesses of the strip
    ],
)
def test_a_beam_that_does_not_ring_keeps_its_frequency_and_its_damper(
    stages: str, changes: dict[str, float], stiffer: float, damping_ratio: float
) -> None:
    """d'' + 2 zeta w d' + w^2 (1 + k) d: stiffer by 1 + k it is faster by the root, and by the root less damped."""
    plain = load_actuator("friend-2").parameter_values
    strip = load_actuator(f"friend-2+{stages}")
    if "load.stiffness" in changes:
        changes = {"load.stiffness": changes["load.stiffness"] * float(abs(tip_stiffness(plain)))}
    found = resonance(strip.replace(**changes, **{"beam.damping_ratio": damping_ratio}).parameter_values)
    assert found.frequency == pytest.approx(resonance(plain).frequency * np.sqrt(stiffer), rel=1e-3)
    assert found.damping_ratio == pytest.approx(damping_ratio / np.sqrt(stiffer), rel=1e-3)


@pytest.mark.parametrize("damping_ratio", [0.05, 3.0])
def test_a_strip_a_thousand_times_slower_rings_a_thousand_times_slower(damping_ratio: float) -> None:
    strip = load_actuator("friend-2+viscoelastic=2").replace(**viscoelastic(), **{"beam.damping_ratio": damping_ratio})
    rates = {name: 1e-3 * strip[name] for name in strip.parameter_values if name.endswith(".frequency")}
    slow = strip.replace(**rates, **{"beam.modulus": 1e-6 * strip["beam.modulus"]})
    fast, found = resonance(strip.parameter_values), resonance(slow.parameter_values)
    assert found.frequency == pytest.approx(1e-3 * fast.frequency, rel=1e-6)
    assert found.damping_ratio == pytest.approx(fast.damping_ratio, rel=1e-6)


@pytest.mark.parametrize(
    "modes",
    [
        ((2.0, 0.01, 240.6),),  # the modulus and the beam at one frequency: two resonances, far apart
        ((2.0, 0.1, 240.6),),
        ((0.1, 0.01, 100.0),),
        ((100.0, 0.01, 240.0),),  # of which the lower one hardly shows
        ((0.01, 0.01, 239.0),),
        ((0.3, 2.0, 10.0),),
        MODES,
    ],
)
def test_the_first_resonance_is_where_the_response_first_peaks(modes: tuple[tuple[float, float, float], ...]) -> None:
    strip = load_actuator(f"friend-2+viscoelastic={len(modes)}").replace(**viscoelastic(modes))
    frequency = np.geomspace(1.0, 1000.0, 20_000)
    s = 2j * np.pi * frequency
    # The factor of eq. 4.7 with y of eq. 4.10.
    y = 1.0 + sum(k * (s**2 + 2 * z * w * s) / (s**2 + 2 * z * w * s + w**2) for k, z, w in modes)
    omega = 1.875**2 * np.sqrt(1.45e9 * 0.245e-3**2 / (12.0 * 3965.0)) / 0.025**2
    height = np.abs(1.0 / (1.0 + 0.1 * s / (omega * y) + s**2 / (omega**2 * y)))
    peaks = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] > height[2:])) + 1
    first = frequency[peaks[height[peaks] > 1.2][0]]
    assert resonance(strip.parameter_values).frequency == pytest.approx(first, rel=0.13)


@pytest.mark.parametrize(("name", "value"), [("amplitude", -0.1), ("damping_ratio", 0.0), ("frequency", -1.0)])
def test_a_modulus_that_would_be_unstable_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(InputError) as caught:
        load_actuator("friend-2+viscoelastic").replace(**{f"viscoelastic.0.{name}": value})
    assert caught.value.where == f"viscoelastic.0.{name}"


def _lowest_pair(strip: dict[str, float], load: float) -> tuple[float, float]:
    """Its frequency [Hz], and what it adds at that to the displacement, as a part of the static one.

    With one mode y = (s^2 + 2 z q s) k/(s^2 + 2 z q s + q^2) + 1 = N/D, and 1/(1 + 2 d s D/(w N) + s^2 D/(w^2 N)) is
    w^2 N over w^2 N + 2 d w s D + s^2 D. A load adds its stiffness over the strip's, of w^2 D, to the latter.
    """
    w, d = natural_frequency(strip), strip["beam.damping_ratio"]
    k, z, q = (strip[f"viscoelastic.0.{name}"] for name in ("amplitude", "damping_ratio", "frequency"))
    below = np.array([1.0, 2.0 * z * q, q * q])
    above = (1.0 + k) * below - [0.0, 0.0, k * q * q]
    under = np.polyadd(w * w * above, np.polymul([1.0, 2.0 * d * w, load * w * w], below))
    poles = np.roots(under)
    pole = min(poles[poles.imag > 0.0], key=abs)
    residue = np.polyval(w * w * above, pole) / np.polyval(np.polyder(under), pole)
    return abs(pole) / (2.0 * np.pi), (1.0 + load) * abs(residue) / abs(pole.real)


@pytest.mark.parametrize("load", [0.0, 1.0])  # in stiffnesses of the strip
@pytest.mark.parametrize(("least", "most", "is_it"), [(0.51, 0.59, True), (0.41, 0.49, False)])
def test_the_first_resonance_adds_half_of_the_static_displacement(
    least: float, most: float, is_it: bool, load: float
) -> None:
    beam = load_actuator("friend-2+viscoelastic+load" if load else "friend-2+viscoelastic")
    if load:
        beam = beam.replace(**{"load.stiffness": load * float(abs(tip_stiffness(beam.parameter_values)))})
    slow = {"viscoelastic.0.damping_ratio": 0.02, "viscoelastic.0.frequency": 120.0}
    found = 0
    for amplitude in np.geomspace(1e-3, 3.0, 400):
        strip = beam.replace(**slow, **{"viscoelastic.0.amplitude": amplitude}).parameter_values
        frequency, part = _lowest_pair(dict(strip), load)
        if least <= part <= most:
            found += 1
            assert bool(resonance(strip).frequency == pytest.approx(frequency)) is is_it
    assert found
