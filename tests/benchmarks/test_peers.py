"""What other tools are given to solve is the strip that is simulated."""

import numpy as np
import pytest

from benchmarks.peers import LEAK, Strip, by_control, by_scipy, held_to, simulated
from ipmclab import load_actuator


@pytest.mark.parametrize(("stages", "leak", "volts"), [("", 0.0, 1.0), ("+leak.cubic", LEAK, 2.0)])
def test_its_equations_are_those_that_are_simulated(stages: str, leak: float, volts: float) -> None:
    actuator = load_actuator(f"friend-2{stages}")
    if leak:
        actuator = actuator.replace(**{"leak.cubic.cubic": leak})
    strip = Strip(leak)
    candidates = {"ours": lambda: simulated(actuator, volts), "control": None if leak else by_control(strip)}
    assert list(held_to(by_scipy(strip, volts), candidates)) == ["ours", *([] if leak else ["control"])]


def test_what_is_wrong_is_not_timed() -> None:
    right = by_scipy(Strip(0.0), 1.0)
    with pytest.raises(SystemExit, match="off by"):
        held_to(right, {"wrong": lambda: right * np.array([[1.0], [1.0], [1.001], [1.0]])})
