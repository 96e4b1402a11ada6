"""A search for variance components in which nothing tells two of them apart: what a campaign once met."""

import numpy as np

from ipmclab.comparison.mixed import fit_mixed

READINGS = [
    -8.117994410189707,
    -8.11768430440545,
    -7.145301776261317,
    -7.145389011608116,
    -7.9992580970996245,
    -7.999375282099855,
    -6.820138118723093,
    -6.819778311872407,
    -8.178279075676995,
    -8.17790779807212,
    -9.056438072017048,
    -9.056691348940674,
]
"""Logarithms of a metric of six strips, two repeats each."""

DESIGN = [
    [1.0, 0.0, 0.0, 1.0000002438176316],
    [1.0, 0.0, 0.0, 1.000001367639297],
    [1.0, 0.0, 0.625, 0.9999999337978618],
    [1.0, 0.0, 0.625, 0.9999992362533802],
    [1.0, 0.0, 0.375, 1.000000166312689],
    [1.0, 0.0, 0.375, 1.0000010285551737],
    [1.0, 1.0, 1.0, 0.9999984999564272],
    [1.0, 1.0, 1.0, 0.9999996625305633],
    [1.0, 1.0, 0.625, 1.000000166312689],
    [1.0, 1.0, 0.625, 1.0000004375799876],
    [1.0, 1.0, 0.375, 1.0000000888077467],
    [1.0, 1.0, 0.375, 0.9999991684365556],
]
"""Thickness and loading of the strips, and a humidity that hardly moves."""

GROUPS = {"strip": [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5], "mounting": [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]}


def test_components_that_nothing_tells_apart_do_not_stop_it() -> None:
    fit = fit_mixed(READINGS, DESIGN, GROUPS)
    for weights in np.eye(len(DESIGN[0])):
        low, high = fit.contrast(weights).interval
        assert low <= high


def test_rounding_decides_no_interval() -> None:
    """Small campaigns whose strips and mountings do not differ at all, with rows in another order."""
    draw = np.random.default_rng(3)
    for _ in range(12):
        strips = np.repeat(np.arange(5), 6)[draw.random(30) > 0.2]
        mountings = 10 * strips + draw.integers(0, 2, len(strips))
        design = np.column_stack([np.ones(len(strips)), strips % 2])
        readings = draw.normal(size=len(strips))
        turned = draw.permutation(len(strips))
        both = [
            fit_mixed(readings[order], design[order], {"strip": strips[order], "mounting": mountings[order]})
            for order in (np.arange(len(strips)), turned)
        ]
        (low, high), (again, _) = (fit.contrast([0.0, 1.0]).interval for fit in both)
        assert abs(low - again) < 1e-5 * (high - low)
