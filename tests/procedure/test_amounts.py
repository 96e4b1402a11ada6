"""Numbers with contributions, against what the same errors do when they are drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.measurement.uncertain import Uncertain, derived, exact, mean_of, weighted_mean
from ipmclab.procedure.hand import read_hand
from ipmclab.procedure.joint import _prior
from ipmclab.units import LENGTH

SEED = 20261121


def test_what_two_numbers_share_moves_them_together() -> None:
    width = Uncertain(5e-3, {"width": 0.1e-3})
    read, spacing = Uncertain(2.667, {"meter": 0.029}), Uncertain(10e-3, {"spacing": 0.05e-3})
    square = derived(lambda r, w, d: r * w / d, read, width, spacing)
    electrode = derived(lambda s, w: s * 30e-3 / w, square, width)
    assert math.hypot(0.029 / 2.667, 0.02, 0.005) == pytest.approx(square.uncertainty / square.value, rel=1e-6)
    # The width is in both, and goes out of the resistance of the whole electrode.
    assert math.hypot(0.029 / 2.667, 0.005) == pytest.approx(electrode.uncertainty / electrode.value, rel=1e-6)
    assert set(electrode.shares) == {"meter", "spacing"}


@given(st.lists(st.floats(0.1, 10.0), min_size=3, max_size=3), st.lists(st.floats(1e-4, 1e-2), min_size=3, max_size=3))
def test_first_order_as_by_hand(values: list[float], errors: list[float]) -> None:
    a, b, c = (Uncertain(v, {n: v * e}) for n, v, e in zip("abc", values, errors, strict=True))
    found = derived(lambda x, y, z: x**3 * y / z, a, b, c)
    assert found.uncertainty / found.value == pytest.approx(math.hypot(3.0 * errors[0], errors[1], errors[2]), rel=1e-5)
    assert sum(found.shares.values()) == pytest.approx(1.0)


def test_the_interval_of_few_readings_holds_the_truth() -> None:
    rng = np.random.default_rng(SEED)
    for count in (3, 5, 20):
        inside = [
            low <= 1.0 <= high
            for low, high in (mean_of(list(rng.normal(1.0, 0.1, count)), "readings").interval for _ in range(4000))
        ]
        assert np.mean(inside) == pytest.approx(0.95, abs=0.012)


def test_one_reading_has_no_scatter() -> None:
    assert mean_of([2.0], "readings") == Uncertain(2.0)
    assert exact(2.0).uncertainty == 0.0


def test_the_better_known_counts_more_and_the_common_part_stays() -> None:
    one = Uncertain(1.0, {"own 1": 0.1, "common": 0.2})
    other = Uncertain(2.0, {"own 2": 0.2, "common": 0.2})
    found = weighted_mean([one, other])
    assert found.value == pytest.approx(1.2)
    assert found.parts["common"] == pytest.approx(0.2)
    assert found.without(["common"]).uncertainty == pytest.approx(math.sqrt(1.0 / (100.0 + 25.0)))


def test_as_people_read_it() -> None:
    assert Uncertain(1.3333, {"a": 0.0208}).said("ohm/sq") == "1.333 ± 0.021 ohm/sq"
    assert Uncertain(1.3333, {"a": 0.0196}).said("ohm/sq") == "1.333 ± 0.020 ohm/sq"
    assert Uncertain(6.79e-9, {"a": 1.2e-10}).said("m/V/s") == "6.79e-09 ± 1.2e-10 m/V/s"
    assert Uncertain(1.45e9, {"a": 0.11e9}).said("MPa", 1e6) == "1450 ± 110 MPa"
    assert Uncertain(1.0, {"a": math.inf}).said("V") == "not determined"
    assert Uncertain(1.0, {"a": 3.0}).interval[0] == 0.0
    assert Uncertain(1.0, {"a#0": 3.0, "a#1": 4.0, "b": 5.0}).shares == {
        "a": pytest.approx(0.5),
        "b": pytest.approx(0.5),
    }


def test_as_many_digits_as_its_uncertainty_has() -> None:
    """Two of the uncertainty, of a number too that is smaller than it; a power of ten from the seventh place on."""
    assert Uncertain(1e-4, {"a": 1.2e-5}).said("m") == "0.000100 ± 0.000012 m"
    assert Uncertain(1e-4, {"a": 1.2e-6}).said("m") == "0.0001 ± 1.2e-06 m"
    assert Uncertain(6.7912e-9, {"a": 1.2e-10}).said("m") == "6.79e-09 ± 1.2e-10 m"
    assert Uncertain(1.2345e8, {"a": 3.4e9}).said("Pa") == "1.2e+08 ± 3.4e+09 Pa"
    assert Uncertain(1.25, {"a": 0.0}).said("m") == exact(1.25).said("m") == "1.25 m"


def test_shares_of_nothing_and_of_what_nobody_knows() -> None:
    assert Uncertain(1.0, {"a": 0.0}).shares == {}
    assert Uncertain(1.0, {"a": math.inf, "b": 1.0}).shares == {}


def test_what_follows_from_a_number_that_is_zero() -> None:
    found = derived(lambda x: 2.0 * x + 1.0, Uncertain(0.0, {"zero": 0.5}))
    assert (found.value, found.uncertainty) == pytest.approx((1.0, 1.0))


def test_readings_that_are_all_alike_have_no_scatter() -> None:
    assert mean_of([5e-3] * 3, "readings") == exact(5e-3)
    width = read_hand(
        {"readings": ["5 mm", "5 mm", "5 mm"], "standard_uncertainty": "0.05 mm"},
        LENGTH,
        name="geometry.width",
        source="width",
        where="geometry.width",
    )
    assert width.parts == {"width": 0.05e-3}
    sheet = derived(lambda w: w / 3e-3, width)
    prior = _prior(sheet, {"geometry.width": width})
    assert (prior.value, prior.uncertainty) == pytest.approx((5 / 3, 1e-4 * 5 / 3))
    assert prior.follows == {"geometry.width": pytest.approx(1 / 3e-3)}
