"""Joining blocks by port names, loops included, against python-control's own interconnection."""

from __future__ import annotations

import control
import numpy as np
import pytest

from ipmclab.model.assemble import assemble
from ipmclab.model.blocks import Block, block
from ipmclab.model.numerics.modal import modes


def lag(source: str, target: str, rate: float, gain: float, direct: float = 0.0) -> Block:
    """``gain rate/(s + rate) + direct`` from one port to another."""
    return block(
        states=[f"{target}.lag"],
        inputs=[source],
        outputs=[target],
        a=[[-rate]],
        b=[[rate]],
        c=[[gain]],
        d=[[direct]],
    )


def adder(first: str, second: str, target: str) -> Block:
    return block(states=[], inputs=[first, second], outputs=[target], a=[], b=[], c=[[]], d=[[1.0, 1.0]])


def test_a_loop_that_acts_back() -> None:
    # What the beam gives back is added to what drives the circuit: as sensing will be joined.
    forward, back = lag("sum", "out", 3.0, 2.0, direct=0.5), lag("out", "back", 7.0, -0.4, direct=0.1)
    stages = (adder("voltage", "back", "sum"), forward, back)
    system = assemble(stages, inputs=["voltage"], outputs=["out", "back"])
    forward_control = control.ss(forward.a, forward.b, forward.c, forward.d)
    back_control = control.ss(back.a, back.b, back.c, back.d)
    expected = control.feedback(forward_control, back_control, sign=1)
    for frequency in (0.0, 0.3, 5.0, 200.0):
        own = system.c @ np.linalg.solve(1j * frequency * np.eye(2) - system.a, system.b) + system.d
        assert own[0, 0] == pytest.approx(complex(expected(1j * frequency)), rel=1e-12)
    # A loop has no closed form here: the dense path must answer.
    assert modes(stages, external="voltage", outputs=["out"]) is None


def test_blocks_may_come_in_any_order_and_names_stay() -> None:
    stages = [lag("voltage", "middle", 2.0, 1.0), lag("middle", "out", 5.0, 3.0)]
    one = assemble(stages, inputs=["voltage"], outputs=["out", "middle"])
    other = assemble(stages[::-1], inputs=["voltage"], outputs=["out", "middle"])
    assert one.states == ("middle.lag", "out.lag")
    assert other.states == ("out.lag", "middle.lag")
    for system in (one, other):
        dc = system.d - system.c @ np.linalg.solve(system.a, system.b)
        np.testing.assert_allclose(dc[:, 0], [3.0, 1.0], rtol=1e-14)


def test_mistakes_in_a_stage_are_named() -> None:
    first = lag("voltage", "out", 1.0, 1.0)
    with pytest.raises(ValueError, match="two drivers"):
        assemble([first, lag("voltage", "out", 2.0, 1.0)], inputs=["voltage"], outputs=["out"])
    with pytest.raises(ValueError, match=r"nothing drives the ports \['node'\]"):
        assemble([lag("node", "out", 1.0, 1.0)], inputs=["voltage"], outputs=["out"])
    straight = [adder("voltage", "back", "sum"), lag("sum", "back", 1.0, 0.0, direct=1.0)]
    with pytest.raises(ValueError, match="a loop that has no solution"):
        assemble(straight, inputs=["voltage"], outputs=["back"])
