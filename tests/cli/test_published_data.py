"""The published facts: readable, complete, and as the thesis states them."""

from __future__ import annotations

import pytest

from ipmclab.data import SOURCE, published_measurements, published_sample
from ipmclab.units import CURRENT, DISPLACEMENT, FORCE


def test_the_source_is_named() -> None:
    assert "Friend" in SOURCE
    assert "chapter 5" in SOURCE


@pytest.mark.parametrize(
    ("sample", "figure", "metric", "quantity", "value"),
    [
        (2, "5.15", "max_displacement", DISPLACEMENT, 3.7e-3),
        (2, "5.20", "half_period_end_current", CURRENT, 15e-3),
        (5, "5.47", "max_force", FORCE, 3.7e-3),
        (7, "5.60", "peak_current", CURRENT, 57.96e-3),
    ],
)
def test_a_number_is_as_the_thesis_states_it(sample, figure, metric, quantity, value) -> None:
    conditions = "room" if sample == 2 else "20 degC, 80 %RH"
    rows = published_measurements(sample, conditions=conditions)
    (row,) = (row for row in rows if (row.figure, row.metric) == (figure, metric))
    assert row.value(quantity) == pytest.approx(value, rel=1e-12)


def test_a_run_has_its_voltage() -> None:
    of_figure = {
        row.figure: (row.amplitude, row.frequency) for row in published_measurements(1, conditions="20 degC, 80 %RH")
    }
    assert of_figure == {"5.6": (1.0, None), "5.7": (1.0, 0.1), "5.8": (1.0, 0.1), "5.9": (3.0, None)}


def test_the_clipped_current_is_a_lower_bound() -> None:
    bounds = [row for row in published_measurements(2) if row.qualifier == "lower_bound"]
    assert [(row.figure, row.number) for row in bounds] == [("5.15", "204.8 mA")]


def test_every_sample_gained_water() -> None:
    for number in range(1, 8):
        sample = published_sample(number)
        assert sample.dry_mass is not None
        assert sample.hydrated_mass is not None
        assert sample.dry_mass < sample.hydrated_mass
