"""Whether a set point can be held, against the closed form of one fast and one slow mode, and against polynomials."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from ipmclab import load_actuator, simulate
from ipmclab.errors import InputError
from ipmclab.model.set_point import set_point
from tests.model.test_relaxation import FAST, single_fast


@pytest.mark.parametrize(
    ("ratio", "slow", "kind", "inverse", "unstable"),
    [
        (0.5, 14.0, "partial", False, False),
        (1.0, 14.0, "washout", False, False),
        (1.5, 14.0, "reversal", False, True),
        (1.5, 2.0, "reversal", True, False),
        (0.5, 0.5, "partial", True, True),
        (-0.5, 14.0, "partial", False, False),
    ],
)
def test_one_fast_and_one_slow_mode(ratio: float, slow: float, kind: str, inverse: bool, unstable: bool) -> None:
    actuator = single_fast("relaxation.displacement", ratio=ratio, time_constant=slow)
    point = set_point(actuator)
    # G [(1 - r) + (tau2 - r tau1) s]: its one zero, beside that of d(s) which stands on a pole.
    expected = (ratio - 1.0) / (slow - ratio * FAST)
    assert point.ratio == ratio
    assert (point.kind, point.inverse_start) == (kind, inverse)
    assert inverse == (ratio * FAST > slow)
    assert len(point.zeros) == 2
    assert point.zeros[0] == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert point.zeros[1] == pytest.approx(-50.0, rel=1e-9)
    assert bool(len(point.right_half_plane)) == unstable
    assert point.can_be_held == (ratio < 1.0)
    other = set_point(actuator, "force")
    assert (other.kind, other.ratio, other.can_be_held) == ("none", 0.0, True)


def test_zeros_of_many_modes_against_their_polynomial() -> None:
    actuator = load_actuator("friend-2+relaxation.force=2+relaxation.force_pair").replace(
        **{
            "relaxation.force.0.ratio": 0.9,
            "relaxation.force.0.time_constant": 3.0,
            "relaxation.force.1.ratio": 0.4,
            "relaxation.force.1.time_constant": 90.0,
            "relaxation.force_pair.0.ratio": -0.1,
            "relaxation.force_pair.0.lead": 2.0,
            "relaxation.force_pair.0.time_constant": 20.0,
            "relaxation.force_pair.0.damping_ratio": 0.4,
        }
    )
    polynomial = np.polynomial.Polynomial
    fractions = [
        (polynomial([210.5, 1.0]) * 41.097 / 210.5, polynomial([41.097, 15.897, 1.0])),
        (polynomial([-0.9]), polynomial([1.0, 3.0])),
        (polynomial([-0.4]), polynomial([1.0, 90.0])),
        (polynomial([0.1, -2.0]), polynomial([1.0, 16.0, 400.0])),
    ]
    numerator, denominator = polynomial([0.0]), polynomial([1.0])
    for top, bottom in fractions:
        numerator, denominator = numerator * bottom + top * denominator, denominator * bottom
    found = np.sort_complex(set_point(actuator, "force").zeros)
    np.testing.assert_allclose(found, np.sort_complex(numerator.roots()), rtol=1e-9)


def test_what_it_means_is_said() -> None:
    def told(ratio: float, slow: float = 14.0) -> str:
        return set_point(single_fast("relaxation.displacement", ratio=ratio, time_constant=slow)).sentence

    assert "can be held, with 2 times the voltage" in told(0.5)
    assert "a zero at the origin" in told(1.0)
    assert "integral action cannot" in told(1.0)
    assert "integral action in the original direction cannot" in told(1.5)
    assert "non-minimum phase" in told(1.5)
    # With r > 1 only a loop of the opposite sign could hold, of which the zero says how slow it is.
    assert "a loop of the opposite sign" in told(1.5)
    assert "a loop that holds" not in told(1.5)
    assert "rad/s" not in told(1.0)
    assert "inverse direction, for about" in told(0.5, 0.5)
    assert "inverse direction and stays there" in told(1.5, 2.0)
    assert "inverse direction" not in told(0.5, 14.0)
    assert "creeps on" in told(-0.5)


@pytest.mark.parametrize(
    ("ratio", "lead", "slow", "damping"),
    [
        (0.2, 60.0, 5.0, 0.3),  # complex zeros in the right half plane
        (0.2, 60.0, 5.0, 0.02),
        (-0.3, 50.0, 8.0, 2.0),
        (0.9, 3e6, 500.0, 1.0),
    ],
)
def test_how_long_an_inverse_start_lasts(ratio: float, lead: float, slow: float, damping: float) -> None:
    pair = {"ratio": ratio, "lead": lead, "time_constant": slow, "damping_ratio": damping}
    name = "relaxation.displacement_pair"
    actuator = single_fast(name).replace(**{f"{name}.0.{key}": value for key, value in pair.items()})
    point = set_point(actuator)
    assert point.inverse_start
    # 1/(1 + 1.7 s) less (r + lead s)/(1 + 2 zeta tau s + tau^2 s^2), by scipy's own step response.
    bottom = [slow**2, 2.0 * damping * slow, 1.0]
    top = np.polysub(bottom, np.polymul([lead, ratio], [FAST, 1.0]))
    times = np.linspace(0.0, 2.0 * point.inverse_for, 20_001)
    _, drive = scipy.signal.step((top, np.polymul(bottom, [FAST, 1.0])), T=times)
    expected = times[1:][drive[1:] > 0.0][0]
    assert point.inverse_for == pytest.approx(expected, rel=3e-4)
    assert f"for about {expected:.2g} s" in point.sentence


def test_an_inverse_start_is_as_long_in_a_simulated_step() -> None:
    name = "relaxation.displacement_pair"
    pair = {"ratio": 0.2, "lead": 60.0, "time_constant": 5.0, "damping_ratio": 0.3}
    strip = load_actuator(f"friend-2+{name}").replace(**{f"{name}.0.{key}": value for key, value in pair.items()})
    run = simulate(strip, "step 1 V", duration=40.0, rate=50.0)
    assert run.displacement is not None
    wrong = run.time[1:][run.displacement[1:] > 0.0]
    assert set_point(strip).inverse_for == pytest.approx(wrong[0], rel=0.1)  # the circuit lags a little as well
    assert "3 zeros lie in the right half plane, the nearest at" in set_point(strip).sentence


def test_another_drive_is_refused() -> None:
    with pytest.raises(InputError, match="current") as caught:
        set_point(load_actuator("friend-2"), "current")
    assert caught.value.code == "unknown-drive"
