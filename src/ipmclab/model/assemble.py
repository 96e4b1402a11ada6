"""Joins blocks by the names of their ports into one linear system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ipmclab.model.blocks import Block, Matrix


@dataclass(frozen=True, eq=False)
class System:
    """``x' = a x + b v``, ``y = c x + d v``: what every computation below the stages works on.

    Parameters
    ----------
    states, outputs : tuple of str
        Names of the states, and of the ports that are read.
    a, b, c, d : matrix
        Shapes (n_states, n_states), (n_states, 1), (n_outputs, n_states), (n_outputs, 1); SI units.
    """

    states: tuple[str, ...]
    outputs: tuple[str, ...]
    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix


def assemble(blocks: Sequence[Block], *, external: str, outputs: Sequence[str]) -> System:
    """Join blocks: an input port is driven by the output port of that name, or from outside.

    With the blocks stacked to ``y = C x + D u`` and their inputs ``u = E y + F v``, the joined
    system is ``u = (1 - E D)^-1 (E C x + F v)``; blocks may form a loop.

    Parameters
    ----------
    blocks : sequence of Block
    external : str
        The port that is driven from outside.
    outputs : sequence of str
        The ports that the system gives out.

    Raises
    ------
    ValueError
        A port with two drivers or with none, an unknown output, or a loop without a solution:
        a mistake in a stage, never in what a user gave.
    """
    output_ports = [port for block in blocks for port in block.outputs]
    input_ports = [port for block in blocks for port in block.inputs]
    drivers = {port: row for row, port in enumerate(output_ports)}
    if len(drivers) < len(output_ports) or external in drivers:
        raise ValueError(f"a port has two drivers: {sorted([external, *output_ports])}")
    missing = [port for port in (*input_ports, *outputs) if port not in drivers and port != external]
    if missing:
        raise ValueError(f"nothing drives the ports {missing}; there are {[external, *output_ports]}")

    n = sum(len(block.states) for block in blocks)
    kind = np.result_type(float, *(matrix for block in blocks for matrix in (block.a, block.b, block.c, block.d)))
    a, b = np.zeros((n, n), kind), np.zeros((n, len(input_ports)), kind)
    c, d = np.zeros((len(output_ports), n), kind), np.zeros((len(output_ports), len(input_ports)), kind)
    state = column = row = 0
    for block in blocks:
        states = slice(state, state := state + len(block.states))
        columns = slice(column, column := column + len(block.inputs))
        rows = slice(row, row := row + len(block.outputs))
        a[states, states], b[states, columns] = block.a, block.b
        c[rows, states], d[rows, columns] = block.c, block.d

    joined = np.zeros((len(input_ports), len(output_ports)))
    driven = np.zeros((len(input_ports), 1))
    for index, port in enumerate(input_ports):
        if port == external:
            driven[index] = 1.0
        else:
            joined[index, drivers[port]] = 1.0
    try:
        solved = np.linalg.solve(np.eye(len(input_ports)) - joined @ d, np.hstack([joined @ c, driven]))
    except np.linalg.LinAlgError as error:
        raise ValueError(f"the ports {input_ports} form a loop that has no solution") from error
    from_states, from_outside = solved[:, :n], solved[:, n:]
    chosen = [drivers[port] for port in outputs]
    return System(
        states=tuple(name for block in blocks for name in block.states),
        outputs=tuple(outputs),
        a=a + b @ from_states,
        b=b @ from_outside,
        c=c[chosen] + d[chosen] @ from_states,
        d=d[chosen] @ from_outside,
    )
