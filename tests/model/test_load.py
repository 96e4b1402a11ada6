"""A strip that is pushed, and one that presses on a spring: against hand-derived equations of the beam."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ipmclab import Actuator, InputError, load_actuator, simulate
from ipmclab.model.ports import left_at_rest

FREQUENCY = np.array([0.0, 0.05, 0.7, 5.0, 38.0, 120.0])
S = 2j * np.pi * FREQUENCY
STRIP = load_actuator("friend-2")


def on_spring(stiffness: float, variant: str = "") -> Actuator:
    return load_actuator(f"friend-2{variant}+load").replace(**{"load.stiffness": stiffness})


def beam() -> tuple[float, float, float]:
    """Stiffness of a cantilever at the sensing point, 3 Y I/L_s^3; natural frequency (Friend, eq. 4.7); damping."""
    h, w = STRIP["geometry.thickness"], STRIP["geometry.width"]
    modulus, density = STRIP["beam.modulus"], STRIP["beam.density"]
    own = 3.0 * modulus * (w * h**3 / 12.0) / STRIP["geometry.sensing_length"] ** 3
    natural = 1.875**2 * np.sqrt(modulus * h**2 / (12.0 * density)) / STRIP["geometry.free_length"] ** 2
    return own, natural, STRIP["beam.damping_ratio"]


def test_own_stiffness_is_blocked_force_over_free_displacement() -> None:
    free, blocked = STRIP.frequency_response([0.0], ["displacement", "force"])[:, 0].real
    np.testing.assert_allclose(blocked / free, beam()[0], rtol=1e-12)


def test_a_force_moves_a_free_strip_as_a_beam_and_adds_to_what_blocks_it() -> None:
    own, natural, damping = beam()
    moved, pressed, current = STRIP.frequency_response(
        FREQUENCY, ["displacement", "force", "current"], driven_by="external_force"
    )
    np.testing.assert_allclose(moved, natural**2 / own / (S**2 + 2 * damping * natural * S + natural**2), rtol=1e-10)
    np.testing.assert_allclose(pressed, 1.0)
    np.testing.assert_allclose(current, 0.0, atol=1e-12)  # [A/N]: the circuit does not feel it, but for rounding


@pytest.mark.parametrize("part", [1e-3, 0.5, 1.0, 30.0])
def test_a_spring_at_every_frequency(part: float) -> None:
    own, natural, damping = beam()
    free = STRIP.frequency_response(FREQUENCY, ["displacement"])[0]
    moved, pressed = on_spring(part * own).frequency_response(FREQUENCY, ["displacement", "force"])
    alone = S**2 + 2 * damping * natural * S + natural**2
    np.testing.assert_allclose(moved, free * alone / (alone + part * natural**2), rtol=1e-9)
    np.testing.assert_allclose(pressed, part * own * moved, rtol=1e-12)


SLOW = [
    "",
    "+viscoelastic",
    "+relaxation.displacement",
    "+relaxation.force",
    "+relaxation.displacement+relaxation.force",
]


@pytest.mark.parametrize("variant", SLOW)
def test_ends_of_the_load_line_are_the_outputs_of_today(variant: str) -> None:
    free, blocked = load_actuator(f"friend-2{variant}").frequency_response(FREQUENCY, ["displacement", "force"])
    soft = on_spring(1e-9, variant).frequency_response(FREQUENCY, ["displacement"])[0]
    hard = on_spring(1e9, variant).frequency_response(FREQUENCY, ["force"])[0]
    np.testing.assert_allclose(soft, free, rtol=1e-8)
    np.testing.assert_allclose(hard, blocked, rtol=1e-6)


@pytest.mark.parametrize("stiffness", [0.2, 3.0, 40.0])
def test_a_constant_voltage_ends_on_the_load_line(stiffness: float) -> None:
    free = simulate(STRIP, "step 1 V", duration=200, rate=10).displacement[-1]
    run = simulate(on_spring(stiffness), "step 1 V", duration=200, rate=10)
    own = beam()[0]
    np.testing.assert_allclose(run.displacement[-1], free * own / (own + stiffness), rtol=1e-6)
    np.testing.assert_allclose(run.force, stiffness * run.displacement, rtol=1e-9, atol=1e-15)
    assert not np.any(run.force > simulate(STRIP, "step 1 V", duration=200, rate=10).force[-1] * 1.5)


def test_force_record_against_another_integration() -> None:
    own, natural, damping = beam()
    rows, rate, stiffness = 150, 100.0, 2.0
    time = np.arange(rows) / rate
    force = 1e-3 * np.sin(40.0 * time) * (time > 0.2)
    run = simulate(
        on_spring(stiffness), np.zeros(rows), duration=rows / rate, rate=rate, hold="first", external_force=force
    )

    def rates(t: float, state: np.ndarray) -> list[float]:
        push = np.interp(t, time, force) / own
        pull = natural**2 * (push - (1.0 + stiffness / own) * state[0])
        return [state[1], pull - 2.0 * damping * natural * state[1]]

    solved = solve_ivp(rates, (0.0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-10, atol=1e-14, max_step=0.5 / rate)
    np.testing.assert_allclose(run.displacement, solved.y[0], atol=1e-6 * np.max(np.abs(solved.y[0])))
    assert np.max(np.abs(run.displacement)) > 1e-5
    np.testing.assert_array_equal(run.current, 0.0)
    assert run.metadata.findings[-1].code == "external-force"


@pytest.mark.parametrize("name", ["friend-2", "friend-2+leak.exponential+viscoelastic+load"])
@pytest.mark.parametrize("rate", [50.0, 20.0])
def test_voltage_and_force_add_and_blocks_joined_equal_one_call(name: str, rate: float) -> None:
    strip = load_actuator(name)
    rows = np.arange(80)
    voltage, force = 2.5 * np.sin(0.2 * rows), 1e-3 * np.cos(0.5 * rows)
    for hold in ("zero", "zero-before", "first"):
        run = simulate(strip, voltage, duration=80 / rate, rate=rate, hold=hold, external_force=force)
        whole = np.stack([run.current, run.applied_voltage, run.displacement, run.force])
        stepped = strip.simulator(rate, hold, inputs=("voltage", "external_force"))
        blocks = [stepped.block(voltage[:31], force[:31]), stepped.step(voltage[31], force[31])[:, None]]
        blocks.append(stepped.block(voltage[32:], force[32:]))
        np.testing.assert_allclose(np.hstack(blocks), whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max(axis=1).min())
        # The beam is linear and does not act back on the circuit, so that what the force does is added.
        alone = simulate(strip, voltage, duration=80 / rate, rate=rate, hold=hold)
        pushed = simulate(strip, 0.0 * voltage, duration=80 / rate, rate=rate, hold=hold, external_force=force)
        np.testing.assert_allclose(run.current, alone.current, rtol=1e-9, atol=1e-15)
        together = alone.displacement + pushed.displacement
        np.testing.assert_allclose(run.displacement, together, atol=1e-9 * np.max(np.abs(together)))


def test_what_cannot_be_used_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"external_force: the array has shape \(3,\), there are 100 rows"):
        simulate(STRIP, "step 1 V", duration=2, rate=50, external_force=[0.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"external_force: row 1 is nan"):
        simulate(STRIP, [1.0, 1.0], duration=0.04, rate=50, external_force=[0.0, float("nan")])
    with pytest.raises(InputError, match="this simulator is driven by the voltage alone"):
        STRIP.simulator(50).step(1.0, 0.001)
    with pytest.raises(InputError, match="unknown input 'force'"):
        STRIP.simulator(50, inputs=("voltage", "force"))
    with pytest.raises(InputError, match="keep one of load and laser"):
        load_actuator("friend-2+load+laser")


def test_a_force_is_refused_where_a_laser_reads_an_arc() -> None:
    strip = load_actuator("friend-2+laser")
    with pytest.raises(InputError, match="a force at one point bends it otherwise"):
        simulate(strip, "step 1 V", duration=1.0, rate=50.0, external_force=np.full(50, 1e-3))


def test_inputs_are_named_once_each() -> None:
    for inputs in ((), ("voltage", "voltage")):
        with pytest.raises(InputError, match="name each once"):
            left_at_rest(inputs)
