"""Which values of a factor are one level, and how they are written."""

from __future__ import annotations

import pytest

from ipmclab import InputError
from ipmclab.comparison.factors import FACTORS, chosen_factors, levels_of


@pytest.mark.parametrize(
    ("name", "value", "alike", "apart", "shown"),
    [
        ("thickness", 183e-6, 183.9e-6, 184.1e-6, "0.183 mm"),
        ("loading", 30e-3, 30.9e-3, 31.1e-3, "3 mg/cm^2"),
        ("voltage", 1.0, 1.019, 1.021, "1 V"),
        ("frequency", 0.1, 0.1009, 0.1012, "0.1 Hz"),
        ("frequency", 10.0, 10.09, 10.12, "10 Hz"),
        ("humidity", 80.0, 82.9, 83.1, "80 percent"),
        ("temperature", 20.0, 21.9, 22.1, "20 degC"),
        ("clamp_pressure", 1e4, 10_099.0, 10_101.0, "10 kPa"),
    ],
)
def test_a_level_is_what_a_factor_wanders_by(name: str, value: float, alike: float, apart: float, shown: str) -> None:
    factor = FACTORS[name]
    assert len(set(levels_of(factor, [alike, value]))) == 1
    assert levels_of(factor, [apart, value]) == [apart, value]
    assert factor.show(value) == shown


def test_a_chain_of_neighbours_is_one_level_and_the_order_is_kept() -> None:
    humidity = FACTORS["humidity"]
    assert levels_of(humidity, [66.0, 60.0, 63.0, 80.0]) == [63.0, 63.0, 63.0, 80.0]
    assert levels_of(humidity, [70.0]) == [70.0]
    assert levels_of(humidity, []) == []
    assert levels_of(FACTORS["voltage"], [0.1, 0.1, 0.1]) == [0.1, 0.1, 0.1]  # and no mean, which rounds


def test_factors_are_named_once_in_the_order_asked_for() -> None:
    assert [one.name for one in chosen_factors(["voltage, thickness", "voltage", ""])] == ["voltage", "thickness"]
    assert chosen_factors([]) == tuple(FACTORS.values())
    with pytest.raises(InputError, match="unknown factor 'volts'; did you mean 'voltage'"):
        chosen_factors(["thickness,volts"])
