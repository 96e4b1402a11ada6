"""Parameters of several strips: what their fits say together, and of which strips."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from ipmclab import InputError, Sample, identify, load_actuator, simulate
from ipmclab.comparison.fits import compare_fits, mixture_quantiles
from ipmclab.fit.fit import Fit

LEAK, RATIO = "circuit.dc_resistivity", "relaxation.displacement.0.ratio"


@pytest.fixture(scope="module")
def fit() -> Fit:
    strip = load_actuator("friend-2")
    return identify(strip, simulate(strip, "step 1 V", duration=10, rate=10), free=LEAK)


def of_strip(fit: Fit, name: str, *, error: float = 0.1, **values: float) -> Fit:
    """As if another strip had been fitted: each value [SI] known to a tenth of itself."""
    first = next(iter(fit.parameters.values()))
    found = {
        key: replace(first, name=key, value=value, standard_error=error * abs(value), determined=True)
        for key, value in values.items()
    }
    return replace(fit, actuator=replace(fit.actuator, sample=Sample(id=name)), parameters=found)


def test_strips_of_other_structures_are_compared_by_what_they_share(fit: Fit) -> None:
    """The first strip has no slow mode: that the others have one was a KeyError."""
    slow = replace(fit, actuator=load_actuator("friend-2+relaxation.displacement"))
    fits = [
        of_strip(fit, "a", **{LEAK: 30.0}),
        of_strip(slow, "b", **{LEAK: 40.0, RATIO: 0.2}),
        of_strip(slow, "c", **{LEAK: 36.0, RATIO: 0.3}),
    ]
    assert not any(one.sampled for one in compare_fits(fits))  # chains are walked when asked for
    assert {one.name: one.strips for one in compare_fits(fits)} == {LEAK: ("a", "b", "c"), RATIO: ("b", "c")}


def test_a_parameter_counts_where_its_fit_determines_it(fit: Fit) -> None:
    fits = [of_strip(fit, name, **{LEAK: 30.0 + place}) for place, name in enumerate("abc")]
    vague = fits[1].parameters[LEAK]
    for worse in (replace(vague, determined=False), replace(vague, standard_error=math.inf)):
        (found,) = compare_fits([fits[0], replace(fits[1], parameters={LEAK: worse}), fits[2]])
        assert (found.strips, found.values, found.next_strip) == (("a", "c"), (30.0, 32.0), None)
        with pytest.raises(InputError, match="no two of the fits determine the same parameter"):
            compare_fits([fits[0], replace(fits[1], parameters={LEAK: worse})])


def test_what_strips_differ_by_is_less_the_errors_of_their_fits(fit: Fit) -> None:
    """Of e^-0.3, 1 and e^0.3 the logarithm scatters by 0.3: known exactly, that is what strips differ by."""
    sizes = [10.0 * math.exp(0.3 * way) for way in (-1, 0, 1)]

    def found(error: float) -> tuple[float, float, tuple[float, float]]:
        each = [of_strip(fit, name, error=error, **{LEAK: size}) for name, size in zip("abc", sizes, strict=True)]
        (one,) = compare_fits(each)
        assert one.is_log
        assert one.next_strip is not None
        return one.typical, one.between, one.next_strip

    typical, between, (low, high) = found(1e-6)
    assert (typical, between) == (pytest.approx(10.0), pytest.approx(0.3, rel=1e-3))
    reach = 4.302653 * 0.3 * math.sqrt(1.0 + 1.0 / 3.0)  # Student's t of two degrees of freedom
    assert [low, high] == pytest.approx([10.0 * math.exp(-reach), 10.0 * math.exp(reach)], rel=1e-3)
    typical, between, _ = found(0.5)
    assert (typical, between) == (pytest.approx(10.0), 0.0)


def test_samples_of_the_scatter_are_those_of_quadrature(fit: Fit) -> None:
    """One number, the logarithm of the standard deviation: its density is summed on a grid, beside the chains."""
    errors, sizes = np.array([0.05, 0.1, 0.02, 0.08]), np.array([30.0, 40.0, 36.0, 33.0])
    each = zip("abcd", errors, sizes, strict=True)
    (found,) = compare_fits(
        [of_strip(fit, name, error=error, **{LEAK: size}) for name, error, size in each], posterior=True
    )
    values = np.log(sizes)
    wide = 3.0 * float(np.std(values, ddof=1))
    grid = np.linspace(math.log(1e-4 * wide), math.log(1e4 * wide), 4001)
    squares = np.exp(2.0 * grid)
    weights = 1.0 / (errors**2 + squares[:, None])
    total = weights.sum(axis=1)
    mean = weights @ values / total
    density = 0.5 * (
        np.log(weights).sum(axis=1) - np.log(total) - (weights * (values - mean[:, None]) ** 2).sum(axis=1)
    )
    density += grid - np.log1p(squares / wide**2)  # half Cauchy beforehand
    chance = np.exp(density - density.max())
    chance /= chance.sum()
    low, middle, high = np.exp(np.interp([0.025, 0.5, 0.975], np.cumsum(chance), grid))
    assert found.sampled is not None
    assert found.sampled.between[0] == pytest.approx(middle, rel=0.05)
    assert found.sampled.between[1] == pytest.approx((low, high), rel=0.1)
    spread = np.sqrt(1.0 / total + squares)
    for end, share in zip(found.sampled.next_strip, (0.025, 0.975), strict=True):
        assert float(chance @ ndtr((math.log(end) - mean) / spread)) == pytest.approx(share, abs=0.005)
    assert found.sampled.convergence.r_hat < 1.01


def test_one_strip_or_the_same_strip_twice_is_refused(fit: Fit) -> None:
    one = of_strip(fit, "a", **{LEAK: 30.0})
    for fits, message in (([one], "one fit says nothing"), ([one, one], "two fits are of the strip 'a'")):
        with pytest.raises(InputError, match=message):
            compare_fits(fits)
    unnamed = [replace(one, actuator=replace(one.actuator, sample=None, name=name)) for name in ("x", "y")]
    assert compare_fits(unnamed)[0].strips == ("x", "y")


def test_quantiles_of_a_mixture_are_those_of_its_parts_together() -> None:
    """Half at 0 and half at 10, each of width 1: the middle is between, the ends are those of one part at 5 %."""
    low, middle, high = mixture_quantiles(np.array([0.0, 10.0]), np.ones(2), (0.025, 0.5, 0.975))
    assert (low, middle, high) == (pytest.approx(-1.6449, abs=1e-3), pytest.approx(5.0), pytest.approx(11.6449, 1e-4))
