"""The joined system written out as a list of operations, against complex steps through the stages themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import load_actuator
from ipmclab.model import Actuator
from ipmclab.model.blocks import solve
from ipmclab.model.joined import Joined, _by_steps
from ipmclab.model.program import Program
from ipmclab.model.terms import Term, Terms

EPSILON = np.finfo(float).eps

WRITTEN = (
    "friend-2",
    "friend-2+leak.cubic",
    "friend-2+branches=4+leak.exponential+leak.slow",
    "friend-2+leak.butler_volmer+viscoelastic+relaxation.displacement_pair+relaxation.force",
    "friend-2+leak.exponential+load+relaxation.displacement=2",
    "friend-2+leak.exponential+clamp",
    "friend-2+clamp+laser",
)


def drawn(text: str, seed: int) -> Actuator:
    """A strip whose parameters are all off those of its file."""
    strip, random = load_actuator(text), np.random.default_rng(seed)
    changes = {}
    for name, about in strip.parameters().items():
        value = about.value * random.uniform(0.6, 1.4) or random.uniform(0.1, 0.5)
        if about.transform != "count" and name not in ("geometry.free_length", "geometry.sensing_length"):
            changes[name] = min(max(value, about.lower), about.upper)
    return strip.replace(**changes)


@pytest.mark.parametrize("asked", [(), ("states", "delay")])
@pytest.mark.parametrize("chosen", [(0,), (3, 1), (0, 1, 2, 3)])
@pytest.mark.parametrize("text", WRITTEN)
def test_it_says_what_complex_steps_through_the_stages_say(
    text: str, chosen: tuple[int, ...], asked: tuple[str, ...]
) -> None:
    strip = drawn(text, seed=len(text))
    names = tuple(strip.parameter_values)
    ours, theirs = Joined.of(strip, names, chosen, asked), _by_steps(strip, names, chosen, asked)
    assert ours.seen.tolist() == theirs.seen.tolist()
    assert (ours.states, ours.count, ours.by_states, ours.by_delay) == (
        *(theirs.states, theirs.count, theirs.by_states),
        theirs.by_delay,
    )
    assert ours.forms.tolist() == theirs.forms.tolist()
    values = strip.values(names)
    for own, other, by_own, by_other in zip(ours.at, theirs.at, ours.by, theirs.by, strict=True):
        # The same sums and products; where stages solve two equations, in another order. From Python 3.12 on ``sum``
        # of real numbers, but not of complex ones, carries what it rounds: 11 roundings were seen between the two.
        np.testing.assert_allclose(own, other, rtol=40.0 * EPSILON, atol=0.0)
        assert by_own.shape == by_other.shape
        # A complex power goes by exp(n log z): of the cube of a thickness, log z = -9, some 30 roundings are lost.
        scaled = by_other[..., : len(names)] * values
        missed = np.abs(by_own[..., : len(names)] * values - scaled)
        assert np.all(missed <= 100.0 * EPSILON * np.maximum(np.abs(scaled), np.abs(other)[..., None]))
        assert not by_own[..., len(names) :].any()


@pytest.mark.parametrize("text", ["friend-2+line.modes", "friend-2+line.segments=3+leak.cubic"])
def test_stages_that_take_no_terms_go_by_complex_steps(text: str) -> None:
    strip = load_actuator(text)
    names = ("circuit.dc_resistivity", "circuit.branches.0.permittivity")
    found = Joined.of(strip, names, (0,), ())
    step = 1e-6
    for column, name in enumerate(names):
        pair = [
            Joined.of(strip.replace(**{name: strip[name] * (1.0 + sign * step)}), (), (0,), ()).at for sign in (1, -1)
        ]
        for by, ahead, behind in zip(found.by, *pair, strict=True):
            differences = (ahead - behind) / (2.0 * step * strip[name])
            rounding = 1e-9 * np.abs(ahead).max(initial=0.0) / strip[name]
            size = np.abs(differences).max(initial=0.0)
            np.testing.assert_allclose(by[..., column], differences, rtol=0.0, atol=1e-8 * size + rounding)


@given(st.lists(st.floats(0.2, 5.0), min_size=3, max_size=3), st.floats(-2.0, 2.0))
def test_every_operation_and_its_derivatives(given_values: list[float], number: float) -> None:
    def computed(a, b, c):  # every operation, numbers on either side, and a term that is used twice
        quotient = (number - a) / b + 2.0 / (c * c)
        return [quotient * quotient, (a + number) ** 2, -quotient - c**-1.5, 3.0, a]

    names = ("a", "b", "c")
    terms = Terms(names)
    program = Program.of(computed(*terms.values()))
    values = np.array([dict(zip(names, given_values, strict=True))[name] for name in program.names])
    entries, slopes = program.run(values, np.arange(3), 16)
    by_name = dict(zip(program.names, range(3), strict=True))
    np.testing.assert_allclose(entries, computed(*given_values), rtol=1e-14)
    assert np.allclose(program.written()(*values), entries, rtol=1e-14)
    for name in names:
        moved = [complex(value, 1e-100 * (own == name)) for own, value in zip(names, given_values, strict=True)]
        expected = [np.imag(entry) / 1e-100 for entry in computed(*moved)]
        np.testing.assert_allclose(slopes[:, by_name[name]], expected, rtol=1e-12, atol=1e-12)
    assert not slopes[:, 3:].any()


def test_the_same_operation_is_done_once_and_one_that_changes_nothing_is_none() -> None:
    terms = Terms(["a", "b"])
    a, b = terms["a"], terms["b"]
    assert a + b is a + b
    assert (a + 0.0 is a, a * 1.0 is a, 1.0 * a is a, a / 1.0 is a, a - 0 is a) == (True,) * 5
    assert (a * 0.0, 0.0 * a, 0.0 / a, a**0, a**1 is a) == (0.0, 0.0, 0.0, 1.0, True)
    assert len(Program.of([(a + b) * (a + b), a + b]).operations) == 2


@pytest.mark.parametrize("use", [bool, float, complex, abs, lambda a: a < 1.0, lambda a: a == 0.0, lambda a: 2.0**a])
def test_what_is_more_than_arithmetic_is_refused(use) -> None:
    with pytest.raises(TypeError):
        use(Terms(["a"])["a"])


def test_equations_are_solved_in_terms_as_in_numbers() -> None:
    random = np.random.default_rng(3)
    numbers = random.normal(size=(4, 4)) + 4.0 * np.eye(4)
    numbers[0, 2] = numbers[3, 1] = 0.0
    right = random.normal(size=(4, 2))
    names = [f"{row}{column}" for row in range(4) for column in range(4)]
    terms = Terms(names)
    matrix = np.array([terms[name] if number else 0.0 for name, number in zip(names, numbers.flat, strict=True)])
    program = Program.of(solve(matrix.reshape(4, 4), right).flat)
    values = dict(zip(names, numbers.flat, strict=True))
    entries = program.written()(*(values[name] for name in program.names))
    np.testing.assert_allclose(np.reshape(entries, (4, 2)), np.linalg.solve(numbers, right), rtol=1e-12)
    assert isinstance(matrix[0], Term)
