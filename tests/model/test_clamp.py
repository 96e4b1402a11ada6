"""The clamped section: what the contacts feed at once, against strips that have no such section."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import InputError, load_actuator, simulate
from ipmclab.model import Actuator, sensitivities, simulate_outputs
from tests.independent.thesis import FRIEND_2, OUTPUTS, Strip
from tests.model.conftest import actuator_of

RATE = 50.0
ROWS = 400


def rough(rows: int = ROWS) -> np.ndarray:
    """Steps, slopes and noise at once."""
    time = np.arange(rows) / RATE
    noise = np.random.default_rng(20261121).normal(size=rows)
    return np.sin(2.0 * np.pi * 0.13 * time) + np.sign(np.sin(1.1 * time)) + 0.1 * noise + 1.0


def clamped(strip: Strip, share: float, **further: float) -> Actuator:
    values = {**strip.dotted(), "clamp.direct_share": share, **further}
    return Actuator(name="clamped", parameter_values=values)


def responses(actuator: Actuator, hold: str = "zero") -> np.ndarray:
    run = simulate(actuator, rough(), duration=ROWS / RATE, rate=RATE, hold=hold)
    return np.array([run.channels[output] for output in OUTPUTS])


def assert_same(ours: np.ndarray, expected: np.ndarray, of_peak: float = 1e-12) -> None:
    worst = np.max(np.abs(ours - expected), axis=1) / np.max(np.abs(expected), axis=1)
    assert np.all(worst < of_peak), dict(zip(OUTPUTS, worst, strict=True))


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("contact", [0.0, 3.0])
def test_share_0_is_the_strip_of_the_thesis(contact: float, hold: str) -> None:
    strip = FRIEND_2.changed(contact_resistance=contact)
    assert_same(responses(clamped(strip, 0.0), hold), responses(actuator_of(strip), hold))


def test_without_contact_resistance_the_free_part_knows_nothing_of_the_clamped_one() -> None:
    free_only = {**FRIEND_2.dotted(), "geometry.clamped_length": 0.0}
    clamped_only = {**free_only, "circuit.sheet_resistance": 1e-6}  # of which only the current is taken
    clamped_only["geometry.free_length"] = clamped_only["geometry.sensing_length"] = FRIEND_2.clamped_length
    ours = responses(clamped(FRIEND_2, 1.0))
    expected = responses(Actuator(name="free", parameter_values=free_only))
    assert_same(ours[1:], expected[1:])
    # The currents add: of the clamped part the one behind (nearly) nothing.
    extra = responses(Actuator(name="section", parameter_values=clamped_only))[:1]
    assert_same(ours[:1], expected[:1] + extra, of_peak=2e-6)


def test_what_leaks_at_contacts_of_no_resistance_is_the_law_of_the_voltage_itself() -> None:
    law = {"leak.cubic.linear": 5.0, "leak.cubic.quadratic": 2.0, "leak.cubic.cubic": 30.0}
    free_only = {**FRIEND_2.dotted(), "geometry.clamped_length": 0.0}
    leaking = responses(clamped(FRIEND_2, 1.0, **law))
    free = responses(Actuator(name="free", parameter_values={**free_only, **law}))
    assert_same(leaking[1:], free[1:], of_peak=1e-6)
    charging = responses(clamped(FRIEND_2, 1.0))[:1] - responses(Actuator(name="free", parameter_values=free_only))[:1]
    volts, area = rough(), FRIEND_2.clamped_length * FRIEND_2.width
    leak = area * (5.0 * volts + 2.0 * volts * np.abs(volts) + 30.0 * volts**3)
    assert_same(leaking[:1], free[:1] + charging + leak, of_peak=1e-6)


@pytest.mark.parametrize(("share", "contact"), [(0.3, 0.0), (1.0, 2.0), (0.7, 0.5)])
def test_current_and_node_voltage_over_frequency(share: float, contact: float) -> None:
    """Kirchhoff's laws written out by impedances."""
    frequency = np.array([0.0, 1e-3, 0.1, 1.0, 20.0, 1e4])
    s = 2j * np.pi * frequency
    direct = share * FRIEND_2.clamped_length
    rest = FRIEND_2.total_length - direct
    of_whole = 1.0 / FRIEND_2.dc_resistance + sum(
        s * c / (1.0 + s * r * c)
        for r, c in zip(FRIEND_2.branch_resistances, FRIEND_2.branch_capacitances, strict=True)
    )
    at_contact, behind = of_whole * direct / FRIEND_2.total_length, of_whole * rest / FRIEND_2.total_length
    electrodes = 2.0 * FRIEND_2.sheet_resistance * rest / FRIEND_2.width
    load = at_contact + 1.0 / (electrodes + 1.0 / behind)
    current = load / (1.0 + contact * load)
    node = (1.0 - contact * current) / (1.0 + electrodes * behind)
    actuator = clamped(FRIEND_2.changed(contact_resistance=contact), share)
    ours = actuator.frequency_response(frequency, ["current", "applied_voltage"])
    assert np.allclose(ours, [current, node], rtol=1e-11, atol=0.0)


def test_a_clamped_length_of_nothing_changes_nothing() -> None:
    without = {**FRIEND_2.dotted(), "geometry.clamped_length": 0.0}
    stage = Actuator(name="stage", parameter_values={**without, "clamp.direct_share": 1.0})
    assert_same(responses(stage), responses(Actuator(name="none", parameter_values=without)))


def test_the_peak_may_exceed_what_the_electrodes_let_through() -> None:
    """The thesis measured 204.8 mA at 1 V where V/2R_e is 62.5 mA (Friend, section 5.1.2)."""
    at_most = 1.0 / (2.0 * FRIEND_2.electrode_resistance)
    lumped, direct = (
        simulate(load_actuator(name), "step 1 V", duration=1.0, rate=RATE).current
        for name in ("friend-2", "friend-2+clamp")
    )
    assert lumped is not None
    assert direct is not None
    section = FRIEND_2.clamped_length / FRIEND_2.total_length
    membrane = 1.0 / FRIEND_2.dc_resistance + np.sum(1.0 / FRIEND_2.branch_resistances)
    free = 1.0 / ((1.0 - section) * 2.0 * FRIEND_2.electrode_resistance + 1.0 / ((1.0 - section) * membrane))
    assert np.max(lumped) < at_most
    assert direct[0] == pytest.approx(section * membrane + free, rel=1e-12)
    assert direct[0] > 5.0 * at_most


@pytest.mark.parametrize("contact", [0.0, 1.5])
@pytest.mark.parametrize("stage", ["lumped", "segments"])
def test_a_leak_by_ohms_law_is_a_lower_dc_resistivity(stage: str, contact: float) -> None:
    """The leak's ports, at the contacts and at each node, against the same conductance inside the membrane."""
    strip, leak = FRIEND_2.changed(contact_resistance=contact), 40.0
    segments = {"line.segments": 4.0} if stage == "segments" else {}
    law = {"leak.cubic.linear": leak, "leak.cubic.quadratic": 0.0, "leak.cubic.cubic": 0.0}
    system = clamped(strip, 0.6, **segments, **law).system
    ports = system.law_ports
    assert ports is not None
    conductances = np.diag([float(one.coefficients[0]) for one in ports.laws])
    assert np.trace(conductances) == pytest.approx(leak * strip.total_length * strip.width, rel=1e-12)
    # What the laws read once their own currents flow, p = c x + d v + loop K p, and with it the system without laws.
    read = conductances @ np.linalg.inv(np.eye(len(ports.laws)) - ports.loop @ conductances)
    a, b = system.a + ports.drive @ read @ ports.c, system.b + ports.drive @ read @ ports.d
    c, d = system.c + ports.reach @ read @ ports.c, system.d + ports.reach @ read @ ports.d
    frequency = np.array([0.0, 0.01, 1.0, 30.0, 1e4])
    s = 2j * np.pi * frequency
    ours = np.array([(c @ np.linalg.solve(one * np.eye(len(a)) - a, b) + d)[:, 0] for one in s]).T
    conductivity = 1.0 / strip.dc_resistivity + leak * strip.thickness
    plain = clamped(strip, 0.6, **segments).replace(**{"circuit.dc_resistivity": 1.0 / conductivity})
    assert np.allclose(ours, plain.frequency_response(frequency), rtol=1e-10, atol=0.0)


def test_derivatives_by_share_and_contact_resistance() -> None:
    actuator = clamped(FRIEND_2.changed(contact_resistance=0.5), 0.6)
    names = ["clamp.direct_share", "circuit.contact_resistance", "geometry.clamped_length", "circuit.sheet_resistance"]
    time = np.arange(60) / RATE
    exact = sensitivities(actuator, names, time, rough(60), "zero").parameters
    for index, name in enumerate(names):
        step = 1e-5 * actuator[name]
        ahead, behind = (
            simulate_outputs(actuator.replace(**{name: actuator[name] + sign * step}), time, rough(60), "zero")
            for sign in (1.0, -1.0)
        )
        difference = (ahead - behind) / (2.0 * step)
        peak = np.max(np.abs(difference), axis=1, keepdims=True)
        assert np.max(np.abs(exact[:, :, index] - difference) / peak) < 1e-7, name


def test_derivative_by_the_share_where_it_is_0() -> None:
    actuator = clamped(FRIEND_2, 0.0)
    time = np.arange(60) / RATE
    exact = sensitivities(actuator, ["clamp.direct_share"], time, rough(60), "zero", outputs=["current"])
    step = 1e-6
    ahead = simulate_outputs(clamped(FRIEND_2, step), time, rough(60), "zero", outputs=["current"])
    slope = (ahead - exact.values) / step
    assert np.max(np.abs(exact.parameters[:, :, 0] - slope)) < 1e-4 * np.max(np.abs(slope))


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan])
def test_a_share_outside_0_to_1_is_refused(share: float) -> None:
    with pytest.raises(InputError, match=r"outside the allowed 0 to 1") as raised:
        clamped(FRIEND_2, share)
    assert raised.value.where == "clamp.direct_share"
