"""Complex pairs of poles on a grid, and couplings with complex poles beside a slow mode, identified from no start."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy.signal import TransferFunction, lsim

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.identification.search.starts.complex_pairs import best_pairs, pair_columns, real_column
from ipmclab.identification.search.varpro import pole_grid
from tests.identification.search.test_start_turning import series

TIME = np.linspace(0.0, 20.0, 401)
VOLTAGE = np.interp(TIME, [0.0, 2.0, 10.0, 11.0, 20.0], [0.0, 1.0, 0.7, -0.5, 0.2])


def test_the_best_set_is_the_one_that_an_independent_simulation_was_made_of() -> None:
    """Slow pole and pair lie on the grid; of a set that is not the true one the neighbours come no more."""
    grid = pole_grid([series(TIME, np.zeros(len(TIME)), VOLTAGE)], 8)
    slow, tau, zeta, constant, lead = float(grid[6]), float(-1.0 / grid[3]), 0.5, 3.0, 0.4
    pair = TransferFunction([lead, constant], [tau**2, 2.0 * zeta * tau, 1.0])
    readings = lsim(pair, VOLTAGE, TIME)[1] + 0.8 * lsim(TransferFunction([1.0], [1.0, -slow]), VOLTAGE, TIME)[1] + 5.0
    sets = list(islice(best_pairs([series(TIME, readings, VOLTAGE)], np.ones((1, len(TIME))), 1), 4))
    first = sets[0]
    assert (first.time_constant, first.damping_ratio) == (tau, zeta)
    assert (first.constant, first.lead) == pytest.approx((constant, lead), rel=1e-3)
    assert (*first.poles, *first.residues) == pytest.approx((slow, 0.8), rel=1e-3)
    assert len({(*one.poles, one.time_constant, one.damping_ratio) for one in sets}) == 4


def test_rows_of_any_distance_give_what_they_give_among_regular_ones() -> None:
    """Rows left out of a straight line of voltage change no answer at the others."""
    kept = np.delete(np.arange(len(TIME)), [50, 51, 140, 300])  # in none of them the slope changes
    whole = series(TIME, VOLTAGE, VOLTAGE)
    fewer = series(TIME[kept], VOLTAGE[kept], VOLTAGE[kept])
    for pole in (-3.0, -0.2):
        np.testing.assert_allclose(real_column([fewer], pole), real_column([whole], pole)[kept], rtol=1e-9, atol=1e-12)
    pairs = [pair_columns([one], 0.6, 0.3) for one in (whole, fewer)]
    np.testing.assert_allclose(pairs[1], pairs[0][:, kept], rtol=1e-9, atol=1e-12)


def test_no_set_of_many_poles() -> None:
    assert not list(best_pairs([series(TIME, VOLTAGE, VOLTAGE)], np.ones((1, len(TIME))), 4))


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
