"""A thickness that no strip has is told with its value, what strips have, and the unit."""

from __future__ import annotations

import pytest

from ipmclab import identify, load_actuator, simulate
from ipmclab.consistency import cross_check
from ipmclab.consistency.of_fit import with_cross_checks
from ipmclab.fit.answer import answer_of

FRIEND = load_actuator("friend-2")


@pytest.mark.parametrize(("thickness", "is_usual"), [(5e-3, False), (0.5e-3, True), (0.025e-3, True), (0.01e-3, False)])
def test_a_thickness_in_another_unit_is_warned_of(thickness: float, is_usual: bool) -> None:
    """A data sheet's 0.5 mm as 0.5 cm; 25 um is the thinnest membrane that is sold."""
    found = cross_check(FRIEND.replace(**{"geometry.thickness": thickness}))
    told = [one for one in found if one.code == "thickness-unusual"]
    assert (told == []) is is_usual
    for one in told:
        assert one.severity == "warning"
        assert f"{1e3 * thickness:g} mm" in one.message
        assert "0.02 mm to 1 mm" in one.message


def test_a_fit_says_it_first_even_where_it_makes_a_reading_seem_off() -> None:
    """The force of a strip twenty times as thick is far larger: what was read seems to be in another unit."""
    run = simulate(FRIEND, "step 1 V delay=2 s", duration=20.0, rate=50.0)
    thick = FRIEND.replace(**{"geometry.thickness": 5e-3})
    current = with_cross_checks(identify(thick, run, free="electrical"), [run])
    assert answer_of(current).findings[0].code == "thickness-unusual"
    force = with_cross_checks(identify(thick, run, free="coupling.gain"), [run])
    errors = [one.code for one in force.findings if one.severity == "error"]
    assert errors[0] == "unit-off"
    assert "thickness-unusual" in {one.code for one in force.findings}
