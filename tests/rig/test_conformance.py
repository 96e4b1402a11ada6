"""The benches pass the one suite that says what a bench does."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from ipmclab import load_actuator
from ipmclab.rig.bench import Bench
from ipmclab.rig.ni import NiBench
from ipmclab.rig.virtual import VirtualBench
from tests.rig.conformance import Conformance
from tests.rig.stand_in import StandIn, serve


class TestVirtualBench(Conformance):
    """The in-process bench."""

    @pytest.fixture
    def make(self) -> Callable[[], Bench]:
        strip = load_actuator("friend-2")
        return lambda: VirtualBench(strip)


@pytest.fixture(scope="module")
def chassis() -> Iterator[StandIn]:
    """One stand-in for the whole suite, whose time passes only when it is read."""
    with serve("lock-step") as stand_in:
        yield stand_in


class TestNiBenchOnTheStandIn(Conformance):
    """The NI bench, through NI's client."""

    @pytest.fixture
    def make(self, chassis: StandIn) -> Callable[[], Bench]:
        chassis.rest()
        return lambda: NiBench(chassis.rig)
