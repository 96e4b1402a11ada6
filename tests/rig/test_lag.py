"""A quantity that follows its setting."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.rig.lag import Lag


def test_a_lag_goes_on_from_where_it_is() -> None:
    lag = Lag(20.0, time_constant=100.0)
    assert lag.at(np.array([0.0, 50.0, 1e6])).tolist() == [20.0, 20.0, 20.0]
    lag.set(30.0, now=50.0)
    half = 50.0 + 100.0 * np.log(2.0)
    assert lag.at(np.array([50.0, half])) == pytest.approx([20.0, 25.0])
    # Down again before it was there.
    lag.set(5.0, now=half)
    assert lag.setting == 5.0
    later = half + 100.0 * np.log(4.0)
    assert lag.at(np.array([half, later, 1e6])) == pytest.approx([25.0, 10.0, 5.0])
    lag.set(float(lag.at(np.array([later]))[0]), now=later)
    assert lag.at(np.array([later, 1e6])) == pytest.approx([10.0, 10.0])
