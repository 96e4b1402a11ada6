"""The mixed model against the analysis of variance, against its own likelihood written out, and against chance."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import f as fisher
from scipy.stats import t as student

from ipmclab.comparison.mixed import RESIDUAL, MixedFit, fit_mixed

Array = npt.NDArray[np.float64]


def campaign(seed: int, *, strips: int = 6, mountings: int = 2, repeats: int = 3) -> tuple[Array, list[int], list[int]]:
    """Readings of strips, their strips and their mountings."""
    draw = np.random.default_rng(seed)
    strip = np.repeat(np.arange(strips), mountings * repeats)
    mounting = np.repeat(np.arange(strips * mountings), repeats)
    y = draw.normal(size=strips)[strip] + 0.5 * draw.normal(size=strips * mountings)[mounting]
    return y + 0.3 * draw.normal(size=len(strip)), strip.tolist(), mounting.tolist()


def test_a_balanced_campaign_is_the_nested_analysis_of_variance() -> None:
    """Components, standard errors and degrees of freedom are those of the table of mean squares."""
    y, strip, mounting = campaign(1)
    thick = np.asarray(strip) % 2.0
    fit = fit_mixed(y, np.column_stack([np.ones_like(y), thick]), {"strip": strip, "mounting": mounting})
    by = y.reshape(6, 2, 3)
    means, of_strip = by.mean(axis=2), by.mean(axis=(1, 2))
    within = float(np.sum((by - means[:, :, None]) ** 2)) / 24
    between_mountings = 3 * float(np.sum((means - of_strip[:, None]) ** 2)) / 6
    halves = of_strip[0::2], of_strip[1::2]
    between_strips = 6 * sum(float(np.sum((half - half.mean()) ** 2)) for half in halves) / 4
    assert fit.variances == pytest.approx(
        {
            RESIDUAL: within,
            "strip": (between_strips - between_mountings) / 6,
            "mounting": (between_mountings - within) / 3,
        }
    )
    effect = fit.contrast([0.0, 1.0])
    assert effect.value == pytest.approx(halves[1].mean() - halves[0].mean())
    assert effect.standard_error == pytest.approx(math.sqrt(between_strips / 6 * (1 / 3 + 1 / 3)))
    assert effect.freedom == pytest.approx(4.0)
    squares = effect.value**2 / effect.standard_error**2
    assert effect.p_value == pytest.approx(float(fisher.sf(squares, 1, 4)))


def test_groups_more_alike_than_repeats_keep_the_table_of_mean_squares() -> None:
    """A component is negative then, and the mean of the groups keeps its one exact test."""
    y = np.array([0.0, 1.0, 0.2, 0.9, -0.1, 1.2])
    fit = fit_mixed(y, np.ones((6, 1)), {"strip": [0, 0, 1, 1, 2, 2]})
    assert fit.variances["strip"] < 0.0
    means = y.reshape(3, 2).mean(axis=1)
    mean = fit.contrast([1.0])
    assert mean.standard_error == pytest.approx(float(np.std(means, ddof=1)) / math.sqrt(3.0))


def test_readings_that_do_not_scatter_end_well() -> None:
    """Simulated repeats are equal to the last digit; so may be the means of all strips."""
    for y in ([1.0, 1.0, 2.0, 2.0, 4.0, 4.0], [0.0, 1.0, 0.0, 1.0, 0.0, 1.0], [1.0] * 6):
        mean = fit_mixed(y, np.ones((6, 1)), {"strip": [0, 0, 1, 1, 2, 2]}).contrast([1.0])
        assert mean.value == pytest.approx(np.mean(y))
        assert math.isfinite(mean.standard_error)


def test_without_groups_it_is_ordinary_least_squares() -> None:
    draw = np.random.default_rng(2)
    x = np.column_stack([np.ones(12), draw.normal(size=12)])
    y = x @ [1.0, 2.0] + draw.normal(size=12)
    fit = fit_mixed(y, x, {})
    beta, (left,), *_ = np.linalg.lstsq(x, y, rcond=None)
    slope = fit.contrast([0.0, 1.0])
    error = math.sqrt(left / 10 * np.linalg.inv(x.T @ x)[1, 1])
    assert (slope.value, slope.standard_error, slope.freedom) == pytest.approx((beta[1], error, 10.0))
    row = np.array([1.0, 0.5])
    low, high = fit.new_reading(row).interval
    reach = float(student.ppf(0.975, 10)) * math.sqrt(left / 10 * (1.0 + row @ np.linalg.inv(x.T @ x) @ row))
    assert (low, high) == pytest.approx((row @ beta - reach, row @ beta + reach))


def written_out(y: Array, x: Array, groups: dict[str, list[int]], components: dict[str, float]) -> float:
    """Minus twice the restricted log likelihood, with V in full."""
    v = components[RESIDUAL] * np.eye(len(y))
    for name, members in groups.items():
        v += components[name] * np.equal.outer(np.asarray(members), np.asarray(members))
    w = np.linalg.inv(v)
    a = x.T @ w @ x
    left = y - x @ np.linalg.solve(a, x.T @ w @ y)
    return float(np.linalg.slogdet(v)[1] + np.linalg.slogdet(a)[1] + left @ w @ left)


def test_an_unbalanced_campaign_is_at_the_top_of_its_likelihood() -> None:
    """With the covariance of all readings written out, no component nearby is more likely."""
    y, strip, mounting = campaign(3)
    kept = np.random.default_rng(4).permutation(len(y))[:25]
    y, groups = y[kept], {"strip": [strip[k] for k in kept], "mounting": [mounting[k] for k in kept]}
    x = np.column_stack([np.ones(25), np.arange(25.0) % 3])
    fit = fit_mixed(y, x, groups)
    best = written_out(y, x, groups, dict(fit.variances))
    for name, size in fit.variances.items():
        for factor in (0.97, 1.03):
            assert written_out(y, x, groups, {**fit.variances, name: size * factor}) > best
    v_inverse = np.linalg.inv(
        fit.variances[RESIDUAL] * np.eye(25)
        + sum(fit.variances[n] * np.equal.outer(np.asarray(m), np.asarray(m)) for n, m in groups.items())
    )
    plain = np.linalg.inv(x.T @ v_inverse @ x)
    assert np.all(np.diag(fit.covariance) >= np.diag(plain) * (1.0 - 1e-9))


@pytest.mark.parametrize(
    ("groups", "unseen"),
    [
        ({"strip": [0, 0, 0, 0]}, ("strip",)),
        ({"strip": [0, 0, 1, 1], "mounting": [0, 0, 1, 1]}, ("mounting",)),
        ({"strip": [0, 0, 1, 1], "mounting": [0, 1, 2, 3]}, ("mounting",)),
    ],
)
def test_scatter_that_nothing_tells_from_another_is_named(groups: dict[str, list[int]], unseen: tuple[str]) -> None:
    """One strip only; one mounting a strip; one reading a mounting."""
    fit = fit_mixed([1.0, 1.3, 2.0, 2.1], np.ones((4, 1)), groups)
    assert fit.unseen == unseen
    assert set(fit.variances) == {RESIDUAL, *groups} - set(unseen)


def test_chance_is_covered() -> None:
    """A small twin of ``benchmarks/comparison.py``: 200 campaigns, an effect between and one within strips."""
    draw = np.random.default_rng(20261121)
    hits = np.zeros(3)
    strip, mounting = np.repeat(np.arange(6), 6), np.repeat(np.arange(12), 3)
    thick, humid = strip % 2.0, np.tile([0.0, 0.5, 1.0], 12)
    x = np.column_stack([np.ones(36), thick, humid])
    for _ in range(200):
        own, clamped = 0.4 * draw.normal(size=7), 0.2 * draw.normal(size=13)
        y = 0.3 * thick + 0.2 * humid + own[strip] + clamped[mounting] + 0.2 * draw.normal(size=36)
        fit: MixedFit = fit_mixed(y, x, {"strip": strip.tolist(), "mounting": mounting.tolist()})
        new = own[6] + clamped[12] + 0.2 * draw.normal()
        for place, (estimate, truth) in enumerate(
            [
                (fit.contrast([0.0, 1.0, 0.0]), 0.3),
                (fit.contrast([0.0, 0.0, 1.0]), 0.2),
                (fit.new_reading([1.0, 0.0, 0.0]), new),
            ]
        ):
            low, high = estimate.interval
            hits[place] += low <= truth <= high
    assert np.all(hits >= 178), hits  # 95 % of 200, less four standard deviations
