"""What intervals do to a system and the derivatives of that, against exponentials of forty digits."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import load_actuator
from ipmclab.model.numerics.discretise import step_and_slopes, transitions
from ipmclab.model.numerics.vectors_loop import filled

Array = np.ndarray

EPSILON = np.finfo(float).eps

digits = np.vectorize(Decimal, otypes=[object])


def generator(a: Array, drive: Array, unit: float) -> Array:
    """Its exponential holds the state's, the answers to constants, and those to what rises to 1 over the duration."""
    n, m = drive.shape
    whole = digits(np.zeros((n + 2 * m, n + 2 * m)))
    whole[:n, :n], whole[:n, n : n + m] = a, drive
    whole[n : n + m, n + m :] = digits(unit * np.eye(m))
    return whole


def exponential(whole: Array, direction: Array) -> tuple[Array, Array]:
    """The exponential and its derivative: the series of a small part of it, then squares."""
    halved = 6 + max(0, int(np.log2(float(np.abs(whole).sum(axis=0).max()))))
    one, other = whole / 2**halved, direction / 2**halved
    total, by_total = digits(np.eye(len(whole))), digits(np.zeros(whole.shape))
    term, by_term = total, by_total
    for k in range(1, 20):
        term, by_term = one @ term / k, (other @ term + one @ by_term) / k
        total, by_total = total + term, by_total + by_term
    for _ in range(halved):
        total, by_total = total @ total, by_total @ total + total @ by_total
    return total, by_total


def side_by_side(whole: Array, n: int, m: int, inputs: int) -> Array:
    """The rows of a state of such an exponential in the order of ``step_and_slopes``."""
    held, ramped = whole[:n, n : n + m], whole[:n, n + m :]
    laws = slice(inputs, None)
    made = np.hstack([held[:, :inputs], ramped[:, :inputs], whole[:n, :n], (held - ramped)[:, laws], ramped[:, laws]])
    return made.astype(float)


@given(
    n=st.integers(1, 5),
    inputs=st.integers(1, 2),
    laws=st.integers(0, 2),
    columns=st.integers(1, 20),
    duration=st.sampled_from([1e-6, 0.3, 4.0]),
    seed=st.integers(0, 2**32),
)
def test_against_forty_digits(n: int, inputs: int, laws: int, columns: int, duration: float, seed: int) -> None:
    """Of systems that lose energy, whose exponential never exceeds 1.

    A product adds as many roundings as it has terms, a derivative of one twice as many, and what is missing doubles
    with the interval: ``2 (n + 1) (1 + |a| t)`` roundings of what is carried, the exponential less 1, or of its
    derivative. The sizes that states are counted in, powers of 2, change no digit.
    """
    random = np.random.default_rng(seed)
    m, width = inputs + laws, filled(columns)
    around, lost = random.normal(size=(2, n, n))
    a, drive = 3.0 * (around - around.T) - lost @ lost.T, random.normal(size=(n, m))
    by_a, by_drive = np.zeros((n, n, width)), np.zeros((n, m, width))
    by_a[..., :columns], by_drive[..., :columns] = (random.normal(size=(n, k, columns)) for k in (n, m))
    sizes = 2.0 ** random.integers(-20, 20, n)
    ratios = sizes / sizes[:, None]
    moved = by_a * ratios[..., None], by_drive / sizes[:, None, None]
    found = step_and_slopes(a * ratios, drive / sizes[:, None], inputs, np.array([1.0, duration]), moved)
    step, slopes = (one[1] * sizes.reshape(-1, *[1] * (one.ndim - 2)) for one in found)
    first, last = 2 * inputs, 2 * inputs + n
    step[:, first:last] /= sizes
    slopes[:, first:last] /= sizes[:, None]
    assert step.shape == (n, 2 * inputs + n + 2 * laws)
    assert not slopes[..., columns:].any()

    column = random.integers(columns)
    with localcontext(prec=40):
        time = Decimal(duration)
        whole = generator(digits(a) * time, digits(drive) * time, 1.0)
        direction = generator(digits(by_a[..., column]) * time, digits(by_drive[..., column]) * time, 0.0)
        expected, by_expected = (side_by_side(one, n, m, inputs) for one in exponential(whole, direction))
    roundings = 2.0 * EPSILON * (n + 1.0) * (1.0 + np.linalg.norm(a, 2) * duration)
    assert np.max(np.abs(step - expected)) < roundings * np.max(np.abs(expected), initial=1.0)
    assert np.max(np.abs(slopes[..., column] - by_expected)) < roundings * np.max(np.abs(by_expected))


@pytest.mark.parametrize("duration", [1e-9, 1e-3, 0.02, 7.0])
def test_poles_that_meet_and_poles_far_apart(duration: float) -> None:
    """Two equal poles, by hand: exp(p t), t exp(p t); beside one that is gone at once and one that hardly moves.

    Each double of an interval adds two roundings, and there are at most 22 of the fastest.
    """
    p, fast, slow = -1.5, -3e5, -1e-7
    a = np.zeros((4, 4))
    a[0, 0] = a[1, 1] = p
    a[1, 0], a[2, 2], a[3, 3] = 1.0, fast, slow
    step, _ = step_and_slopes(a, np.ones((4, 1)), 1, np.array([duration]))
    state, close = step[0, :, 2:], {"rtol": 44.0 * EPSILON, "atol": EPSILON}
    np.testing.assert_allclose(state[:2, :2], np.exp(p * duration) * np.array([[1.0, 0.0], [duration, 1.0]]), **close)
    np.testing.assert_allclose(np.diag(state)[2:], np.exp([fast * duration, slow * duration]), **close)
    held = np.expm1([p * duration, fast * duration, slow * duration]) / [p, fast, slow]
    np.testing.assert_allclose(step[0, [0, 2, 3], 0], held, rtol=44.0 * EPSILON)


def test_what_is_beyond_floating_point_is_no_number() -> None:
    system = load_actuator("friend-2").system
    assert np.isnan(transitions([system], [np.inf]).state).any()
    assert np.isfinite(transitions([system], [1e12, 1e-300]).state).all()
