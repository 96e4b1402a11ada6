"""How far a strip scatters by itself, against draws and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.comparison.own_scatter import own_scatter


def test_the_variance_of_the_mean_is_that_of_drawn_means() -> None:
    draw = np.random.default_rng(20261121)
    mountings = ["1", "1", "2", "2", "2", "3"]
    number = np.array([0, 0, 1, 1, 1, 2])
    values = 0.3 * draw.standard_normal((4000, 3))[:, number] + 0.05 * draw.standard_normal((4000, 6))
    found = np.array([own_scatter(one, mountings).variance for one in values])
    assert found.mean() == pytest.approx(np.var(values.mean(axis=1)), rel=0.1)


def test_of_one_mounting_the_repeats_have_it_and_of_one_reading_nothing() -> None:
    one = own_scatter(np.array([1.0, 2.0, 3.0]), ["1", "1", "1"])
    assert (one.variance, one.freedom) == (pytest.approx(1.0 / 3.0), 2.0)
    assert own_scatter(np.array([1.0]), ["1"]).beyond(0.0) == 0.0
    assert own_scatter(np.array([1.0, 3.0]), ["1", "1"]).beyond([0.25, 4.0]).tolist() == [0.75, 0.0]
