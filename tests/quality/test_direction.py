"""In which direction a channel answers: judged at the first edge, as far as the readings show it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from ipmclab.quality import check
from ipmclab.run import Run

EDGE = 200


@pytest.mark.parametrize(("rows", "opposite"), [(40, False), (120, True)])
def test_only_what_is_read_before_the_voltage_turns_says_which_way_a_strip_goes(rows: int, opposite: bool) -> None:
    """It follows within 5 s, its noise hides what it does in the first 40 rows, and then the voltage turns."""
    voltage = np.where(np.arange(2000) < EDGE + rows, 1.0, -1.0)
    voltage[:EDGE] = 0.0
    follows = lfilter([1.0 / 250.0], [1.0, 1.0 / 250.0 - 1.0], voltage)
    noise = np.random.default_rng(20261123).normal(0.0, 2e-6, 2000)
    for sign in (1.0, -1.0):
        run = Run.from_arrays(time=np.arange(2000) / 50.0, voltage=voltage, displacement=sign * 1e-4 * follows + noise)
        codes = {finding.code for finding in check(run)}
        assert ("response-opposite" in codes) is (opposite and sign < 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_noise_does_in_the_first_rows_is_no_answer(sign: float) -> None:
    """An AR(1) noise of 0.9, 4 % of the answer: of 400 such records 30 were said to go the wrong way."""
    draws = np.random.default_rng(20261128).standard_normal((200, 1200))
    noise = lfilter([np.sqrt(1.0 - 0.81)], [1.0, -0.9], draws)[:, 200:]
    time = np.arange(1000) / 100.0
    voltage = np.where(time < 1.995, 0.0, 1.0)
    follows = 5e-4 * sign * lfilter([0.05], [1.0, -0.95], voltage)
    runs = [Run.from_arrays(time=time, voltage=voltage, displacement=follows + 2e-5 * one) for one in noise]
    said = sum("response-opposite" in {finding.code for finding in check(run)} for run in runs)
    assert said == (0 if sign > 0.0 else len(runs))


def goes_the_wrong_way(**answers: np.ndarray) -> bool:
    """Of readings at 50 Hz with the voltage under its own name."""
    run = Run.from_arrays(time=np.arange(2000) / 50.0, **answers)
    return "response-opposite" in {finding.code for finding in check(run)}


ONE_VOLT = np.where(np.arange(2000) >= EDGE, 1.0, 0.0)


@pytest.mark.parametrize(
    ("late", "noises", "pulse", "missing", "is_told"),
    [
        (0, -100.0, 1800, None, True),
        (-3, -100.0, 1800, None, True),  # rows are read up to three too early or too late
        (3, -100.0, 1800, None, True),
        (-4, -100.0, 1800, None, False),
        (4, -100.0, 1800, None, False),
        (0, 100.0, 1800, None, False),
        (0, -7.0, 1800, None, False),  # it must stand ten standard deviations clear
        (0, -15.0, 1800, None, True),
        (2, -100.0, 2, None, False),  # the voltage has gone down again: that is its inrush
        (1, -100.0, 2, None, True),
        (0, -100.0, 1800, 2, False),  # what a missing reading was like, nobody knows
        (0, -100.0, 1800, -7, False),
    ],
)
def test_a_current_is_judged_by_its_inrush(
    late: int, noises: float, pulse: int, missing: int | None, is_told: bool
) -> None:
    voltage = np.where(np.arange(2000) < EDGE + pulse, ONE_VOLT, 0.0)
    current = 2e-3 + np.random.default_rng(20261123).normal(0.0, 1e-5, 2000)  # its zero is off by 2 mA
    current[EDGE + late] += noises * 1e-5
    if missing is not None:
        current[EDGE + missing] = np.nan
    assert goes_the_wrong_way(voltage=voltage, current=current) is is_told


@pytest.mark.parametrize(("row", "is_told"), [(0, True), (3, True), (4, False)])
def test_a_record_that_begins_with_the_voltage_is_judged_from_its_first_row(row: int, is_told: bool) -> None:
    current = np.random.default_rng(20261123).normal(0.0, 1e-5, 2000)
    current[row] = -1e-3
    assert goes_the_wrong_way(voltage=np.ones(2000), current=current) is is_told


@pytest.mark.parametrize(
    ("noises", "pulse", "missing", "is_told"),
    [
        (-100.0, 1800, None, True),
        (100.0, 1800, None, False),
        (-100.0, 5, None, True),  # five rows are enough
        (-100.0, 4, None, False),
        (-5.5, 1800, None, True),  # of a mean of many rows and of the five at rest
        (-3.5, 1800, None, False),
        (-100.0, 1800, -9, True),
        (-100.0, 1800, -8, False),  # five rows, of which the last is four before the edge
        (-100.0, 1800, -4, False),
        (-100.0, 1800, -3, True),
        (-100.0, 1800, 0, True),
        (-100.0, 1800, 1, False),
        (-100.0, 1800, 5, False),
        (-100.0, 1800, 6, True),
    ],
)
def test_a_displacement_is_judged_by_its_mean_after_the_edge(
    noises: float, pulse: int, missing: int | None, is_told: bool
) -> None:
    voltage = np.where(np.arange(2000) < EDGE + pulse, ONE_VOLT, 0.0)
    displacement = 3e-4 + np.random.default_rng(20261123).normal(0.0, 1e-6, 2000) + noises * 1e-6 * voltage
    if missing is not None:
        displacement[EDGE + missing] = np.nan
    assert goes_the_wrong_way(voltage=voltage, displacement=displacement) is is_told
