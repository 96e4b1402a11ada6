"""Complex pairs of poles beside real ones; couplings with such poles beside a slow mode, identified from no start."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from scipy.signal import TransferFunction, lsim

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.identification.search.pole_grid import grid_pairs, pole_grid
from ipmclab.identification.search.varpro import near_pairs, pair_minima
from ipmclab.model.numerics.drive import complex_responses, responses
from tests.identification.search.test_turning import series

TIME = np.linspace(0.0, 20.0, 401)
VOLTAGE = np.interp(TIME, [0.0, 2.0, 10.0, 11.0, 20.0], [0.0, 1.0, 0.7, -0.5, 0.2])


def test_the_best_set_is_the_one_that_an_independent_simulation_was_made_of() -> None:
    """Slow pole and pair lie on the grid; of a set that is not the true one the neighbours come no more."""
    grid = pole_grid([series(TIME, np.zeros(len(TIME)), VOLTAGE)], 8)
    slow, tau, zeta, constant, lead = float(grid[6]), float(-1.0 / grid[3]), 0.5, 3.0, 0.4
    pair = TransferFunction([lead, constant], [tau**2, 2.0 * zeta * tau, 1.0])
    readings = lsim(pair, VOLTAGE, TIME)[1] + 0.8 * lsim(TransferFunction([1.0], [1.0, -slow]), VOLTAGE, TIME)[1] + 5.0
    run, common = series(TIME, readings, VOLTAGE), np.ones((1, len(TIME)))
    sets = list(islice(grid_pairs([run], 1, common, np.inf), 4))
    np.testing.assert_allclose(sets[0], [np.log(-slow), -np.log(tau), np.arccos(-zeta)], rtol=1e-12)
    assert len({tuple(one) for one in sets}) == 4
    found = near_pairs([run], 1, common, np.inf)[0]
    assert found.pair is not None
    assert found.pair.pole == pytest.approx(complex(-zeta, np.sqrt(1.0 - zeta**2)) / tau, rel=1e-6)
    assert (*found.poles, *found.residues) == pytest.approx((slow, 0.8), rel=1e-4)
    assert not list(grid_pairs([run], 1, common, 0.0))


def test_rows_of_any_distance_give_what_they_give_among_regular_ones() -> None:
    """Rows left out of a straight line of voltage change no answer at the others."""
    kept = np.delete(np.arange(len(TIME)), [50, 51, 140, 300])  # in none of them the slope changes
    whole = series(TIME, VOLTAGE, VOLTAGE).drive
    fewer = series(TIME[kept], VOLTAGE[kept], VOLTAGE[kept]).drive
    poles = np.array([-3.0 + 0j, -0.2 + 0j, complex(-0.3, 0.95) / 0.6])
    answers = complex_responses(whole, poles)
    for all_rows, some in zip(answers, complex_responses(fewer, poles), strict=True):
        np.testing.assert_allclose(some, all_rows[:, kept], rtol=1e-9, atol=1e-12)
    # Of real poles it is what the real kernel says, and slopes are those of a difference.
    for turning, real in zip(answers, responses(whole, poles[:2].real), strict=True):
        np.testing.assert_allclose(turning[:2], real, rtol=1e-9, atol=1e-12)
    ahead, behind = (complex_responses(whole, poles + step)[0] for step in (1e-5j, -1e-5j))
    np.testing.assert_allclose((ahead - behind) / 2e-5j, answers[1], rtol=1e-6, atol=1e-9)


def test_a_start_in_motion_is_part_of_every_set() -> None:
    """The decay of a pair and of a slow pole that began before the record, beside what the voltage does."""
    pole, slow = complex(-0.6, 1.9), -0.15
    turned = complex_responses(series(TIME, VOLTAGE, VOLTAGE).drive, np.array([pole, complex(slow)]))[0]
    moving = np.real((0.7 - 0.4j) * np.exp(pole * TIME)) + 0.5 * np.exp(slow * TIME)
    readings = np.real((1.5 + 0.2j) * turned[0]) + 0.3 * turned[1].real + moving
    run = replace(series(TIME, readings, VOLTAGE), free_start=True)
    found = pair_minima([run], 1, np.ones((1, len(TIME))))[0]
    assert found.pair is not None
    assert found.pair.pole == pytest.approx(pole, rel=1e-5)
    assert found.pair.residue == pytest.approx(1.5 + 0.2j, rel=1e-4)
    assert float(found.poles[0]) == pytest.approx(slow, rel=1e-4)


def test_no_set_of_many_poles() -> None:
    assert not near_pairs([series(TIME, VOLTAGE, VOLTAGE)], 9, np.ones((1, len(TIME))), np.inf)


@pytest.mark.parametrize(
    ("corner", "damping", "time_constant", "ratio", "zero", "signal"),
    [
        (10.0, 0.2, 0.6, -0.1, 70.0, "square 1 V 0.2 Hz delay=1 s"),
        (10.0, 0.4, 2.0, -0.1, 70.0, "square 1 V 0.2 Hz delay=1 s"),
        (4.0, 0.2, 2.0, -0.1, 70.0, "square 1 V 0.2 Hz delay=1 s"),
        (4.0, 0.2, 0.6, -0.1, 20.0, "chirp 1 V 0.05 Hz 5 Hz for 16 s"),
        (4.0, 0.4, 0.6, 0.5, 20.0, "square 1 V 0.2 Hz delay=1 s"),
    ],
)
def test_complex_poles_beside_a_slow_mode_from_no_start(
    corner: float, damping: float, time_constant: float, ratio: float, zero: float, signal: str
) -> None:
    """What is left is the noise: in the first four a fit ended beside it when the slow mode was that of real poles."""
    usual = load_actuator("friend-2+relaxation.displacement")
    static = usual["coupling.gain"] * usual["coupling.zero"] / usual["coupling.p2"]
    strip = usual.replace(
        **{
            "coupling.gain": static * corner**2 / zero,
            "coupling.zero": zero,
            "coupling.p1": 2.0 * damping * corner,
            "coupling.p2": corner**2,
            "relaxation.displacement.0.ratio": ratio,
            "relaxation.displacement.0.time_constant": time_constant,
        }
    )
    run = simulate(strip, signal, duration=16.0, rate=50.0)
    assert run.displacement is not None
    noise = np.random.default_rng(1).normal(0.0, 2e-6, len(run))
    measured = Run.from_arrays(time=run.time, voltage=run.voltage, displacement=run.displacement + noise)
    fit = identify(usual, measured, free="coupling,relaxation")
    assert np.std(fit.residuals[0]["displacement"]) < 1.02 * np.std(noise)
