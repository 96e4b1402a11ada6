"""What follows from parameters of any size: known, or not given."""

from __future__ import annotations

import math

import pytest

from ipmclab import load_actuator
from ipmclab.model.quantities import quantities_of


@pytest.mark.parametrize(("permittivity", "charges"), [(1.0, True), (1e6, False)])
def test_what_comes_after_1e15_seconds_is_not_given(permittivity: float, charges: bool) -> None:
    """Beside a fast pole of 1 1/s a slow one of 1e-15 1/s is rounding."""
    slow = {"circuit.branches.1.resistivity": 1e9, "circuit.branches.1.permittivity": permittivity}
    found = quantities_of(load_actuator("friend-2").replace(**slow), ["current", "force"], highest=100.0)
    assert all(math.isfinite(value) for value in found.values())
    assert "circuit.high_frequency_resistance" in found
    assert ("circuit.capacitance" in found) == charges
    assert ("circuit.time_constants.1" in found) == charges
    assert "force.static_gain" not in found or charges
