"""Strips whose poles are real, equal, complex, or nearly meet."""

from __future__ import annotations

import pytest

from ipmclab import load_actuator
from ipmclab.model import Actuator
from tests.independent.thesis import FRIEND_2, Strip

STRIPS = {
    "friend-2": FRIEND_2,
    "one branch": FRIEND_2.changed(resistivities=(0.35734,), permittivities=(0.11998,)),
    "three branches": FRIEND_2.changed(resistivities=(0.35734, 24.2415, 2.0), permittivities=(0.11998, 0.48106, 0.02)),
    "equal branches": FRIEND_2.changed(resistivities=(1.0, 1.0), permittivities=(0.2, 0.2)),
    "equal poles of d(s)": FRIEND_2.changed(p1=16.0, p2=64.0),
    "complex poles of d(s)": FRIEND_2.changed(p1=3.0, p2=64.0),
    "overdamped beam": FRIEND_2.changed(damping_ratio=1.7),
    "critically damped beam": FRIEND_2.changed(damping_ratio=1.0),
    "contact resistance": FRIEND_2.changed(contact_resistance=3.0),
    "soft and slow": FRIEND_2.changed(modulus=2e5, density=5000.0),
}


def actuator_of(strip: Strip) -> Actuator:
    """The actuator with a strip's parameters."""
    return Actuator(name="strip", parameter_values=strip.dotted())


@pytest.fixture(params=sorted(STRIPS))
def strip(request: pytest.FixtureRequest) -> Strip:
    return STRIPS[request.param]


@pytest.fixture
def friend_2() -> Actuator:
    return load_actuator("friend-2")
