"""The numbers of the modal loop, made in one pass, against the stages' own blocks and their fractions."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Actuator, load_actuator
from ipmclab.model import with_stages
from ipmclab.model.numerics import kernels
from ipmclab.model.numerics.cascade import Wiring, entries_of
from ipmclab.model.numerics.cascade_loop import cascade, room_for
from ipmclab.model.numerics.modal import NEARLY_MEET, Modes, modes
from ipmclab.model.numerics.modal_loop import modal_sections as plain_sections
from ipmclab.model.outputs import modal_coefficients, modal_sections, set_up, simulate_outputs
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest
from ipmclab.model.written_out import written_out
from ipmclab.run import Hold
from tests.model.by_fractions import recursion

HOLDS: tuple[Hold, ...] = ("zero", "zero-before", "first")
FRIEND = load_actuator("friend-2")
AT_REST = left_at_rest(["voltage"])
SWINGING = "coupling.p1"  # small: the poles of the coupling are a pair


def strips(count: int, seed: int) -> list[Actuator]:
    """Strips around friend-2, a third of them with a pair of poles in the coupling."""
    generator = np.random.default_rng(seed)
    names = [n for n in FRIEND.parameter_values if n.startswith(("circuit.", "coupling.", "beam.")) and FRIEND[n] > 0.0]
    found = []
    for k in range(count):
        values = {name: FRIEND[name] * float(np.exp(generator.uniform(-1.0, 1.0))) for name in names}
        values["beam.damping_ratio"] = float(generator.choice([0.05, 0.4, 1.7]))
        if k % 3 == 0:
            values[SWINGING] *= 0.05
        found.append(FRIEND.replace(**values))
    return found


def by_fractions(strip: Actuator, period: float, hold: Hold) -> np.ndarray | None:
    """The same numbers by way of partial fractions, mode by mode."""
    found = modes(strip.blocks(), external="voltage", outputs=OUTPUT_PORTS, at_rest=AT_REST)
    if found is None or (made := recursion(found, period, hold)) is None:
        return None
    current, applied, displacement, force = made.weights
    direct = made.direct
    read = [*current[:2], direct[0], *applied[:2], direct[1], *displacement, direct[2], *force[:4], direct[3]]
    return np.array([*made.numbers, *read, *made.starts])


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("period", [1e-3, 0.02, 0.3])
def test_it_gives_the_numbers_of_the_fractions(hold: Hold, period: float) -> None:
    fitting = 0
    for strip in strips(40, 7):
        found, expected = modal_coefficients(strip, period, hold), by_fractions(strip, period, hold)
        assert (found is None) == (expected is None)
        if found is not None and expected is not None:
            fitting += 1
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-13 * np.abs(expected).max())
    assert fitting > 20  # heavily damped beams are gone within 0.3 s


def test_compiled_or_not_the_digits_are_the_same() -> None:
    for strip in strips(20, 8):
        wiring = Wiring.of(strip.blocks(), external="voltage", outputs=OUTPUT_PORTS, at_rest=AT_REST)
        assert wiring is not None
        for number in range(len(HOLDS)):
            both = np.zeros((2, 43))
            asked = entries_of(strip.blocks()), wiring.numbers, 3, wiring.ports, NEARLY_MEET, 0.02, number
            rooms = np.zeros((2, *room_for(3, wiring.ports, 4)))
            assert kernels.cascade(*asked, rooms[0], both[0]) == cascade(*asked, rooms[1], both[1])
            np.testing.assert_array_equal(both[0], both[1])


def test_many_at_once_are_each_alone() -> None:
    written, wiring = set_up(FRIEND.structure)
    assert written is not None
    assert wiring is not None
    several = strips(9, 9)
    values = {name: np.array([strip[name] for strip in several]) for name in FRIEND.parameter_values}
    numbers, found = wiring.sections_of_many(written.entries_of_many(values, 9), 0.02, "first")
    for k, strip in enumerate(several):
        alone = modal_sections(strip, 0.02, "first")
        assert found[k] == (alone is not None)
        if alone is not None:
            np.testing.assert_allclose(numbers[k], alone[0], rtol=1e-12)


def test_poles_that_nearly_meet_have_no_such_numbers() -> None:
    one, other = sorted(-pole.real for pole in _modes(FRIEND).poles[1])
    circuit = -min(pole.real for pole in _modes(FRIEND).poles[0])
    p1, p2 = circuit + other, circuit * other  # one pole of the coupling where the circuit has its fast one
    met = FRIEND.replace(**{SWINGING: p1, "coupling.p2": p2})
    assert one < other
    assert modal_coefficients(met, 0.02, "zero") is None
    assert modal_coefficients(met.replace(**{SWINGING: p1 * 1.01}), 0.02, "zero") is not None


def _modes(strip: Actuator) -> Modes:
    found = modes(strip.blocks(), external="voltage", outputs=OUTPUT_PORTS, at_rest=AT_REST)
    assert found is not None
    return found


@pytest.mark.parametrize("stages", ["", "leak.exponential", "relaxation.displacement", "viscoelastic", "load", "laser"])
def test_written_out_the_blocks_have_the_same_digits(stages: str) -> None:
    strip = with_stages(FRIEND, stages) if stages else FRIEND
    found = written_out(strip.structure)
    assert found is not None
    np.testing.assert_array_equal(found.entries(strip.parameter_values), entries_of(strip.blocks()))
    assert [b.inputs for b in found.blocks] == [b.inputs for b in strip.blocks()]


def test_written_out_equations_are_solved_to_rounding() -> None:
    """LAPACK takes them in another order."""
    clamped = with_stages(FRIEND, "clamp")
    found = written_out(clamped.structure)
    assert found is not None
    expected = entries_of(clamped.blocks())
    np.testing.assert_allclose(found.entries(clamped.parameter_values), expected, rtol=10.0 * np.finfo(float).eps)


@pytest.mark.parametrize("stages", ["line.modes", "line.segments=3"])
def test_a_stage_that_does_more_than_arithmetic_is_asked_each_time(stages: str) -> None:
    assert written_out(with_stages(FRIEND, stages).structure) is None


SLOW = ("relaxation.displacement", "relaxation.displacement_pair", "relaxation.displacement+relaxation.force")
"""The last has two slow modes with one time constant: poles that stand side by side may meet."""


@pytest.mark.parametrize("stages", SLOW)
@pytest.mark.parametrize("hold", HOLDS)
def test_more_sections_give_what_matrices_give(stages: str, hold: Hold) -> None:
    strip = load_actuator(f"friend-2+{stages}")
    assert modal_sections(strip, 0.02, hold) is not None
    time = np.arange(700) * 0.02
    voltage = np.sin(time) + np.where(time > 5.0, 1.0, 0.0)
    rest = np.zeros(len(strip.state_names))
    found = simulate_outputs(strip, time, voltage, hold)
    expected = simulate_outputs(strip, time, voltage, hold, initial_state=rest)
    for own, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=0.0, atol=1e-12 * np.abs(other).max())


def test_one_behind_the_other_they_may_not_meet() -> None:
    slow = load_actuator("friend-2+relaxation.displacement")
    lag = -1.0 / max(pole.real for pole in _modes(FRIEND).poles[0])
    met = slow.replace(**{f"{SLOW[0]}.0.time_constant": lag})
    assert modal_sections(met, 0.02, "zero") is None
    assert len(simulate_outputs(met, [0.0, 0.02], [1.0, 1.0], "zero")) == 4


def test_of_three_sections_both_loops_say_the_same() -> None:
    voltage = np.sin(np.arange(600) * 0.02)
    for hold in HOLDS:
        numbers, found = modal_coefficients(FRIEND, 0.02, hold), modal_sections(FRIEND, 0.02, hold)
        assert numbers is not None
        assert found is not None
        both = np.empty((3, 4, 600))
        kernels.modal(voltage, numbers, both[0])
        kernels.modal_sections(voltage, *found, both[1])
        plain_sections(voltage, *found, both[2])
        np.testing.assert_allclose(both[1], both[0], rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(both[2], both[1])
