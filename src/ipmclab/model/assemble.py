"""Joins blocks by the names of their ports into one linear system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ipmclab.model.blocks import Block, Law, Matrix, solve


@dataclass(frozen=True, eq=False)
class LawPorts:
    """The static laws of a system, and how it is joined to them.

    With w the vector of what the laws give and p of what they read, w = law(p), the system is
    ``x' = a x + b u + drive w``, ``y = c x + d u + reach w`` and ``p = c_law x + d_law u + loop w``.

    Parameters
    ----------
    laws : tuple of Law
        One for each entry of w and p.
    drive, reach, c, d, loop : matrix
        Shapes (n_states, n_laws), (n_outputs, n_laws), (n_laws, n_states), (n_laws, n_inputs), (n_laws, n_laws); SI
        units.
    """

    laws: tuple[Law, ...]
    drive: Matrix
    reach: Matrix
    c: Matrix
    d: Matrix
    loop: Matrix


@dataclass(frozen=True, eq=False)
class System:
    """``x' = a x + b u``, ``y = c x + d u``: what every computation below the stages works on.

    Parameters
    ----------
    states, inputs, outputs : tuple of str
        Names of the states, of the ports that are driven from outside, and of those that are read.
    a, b, c, d : matrix
        Shapes (n_states, n_states), (n_states, n_inputs), (n_outputs, n_states), (n_outputs, n_inputs); SI units.
        With the blocks of many parameter sets they have that axis first.
    law_ports : LawPorts, optional
        Static laws at ports; None in a linear system.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    law_ports: LawPorts | None = None


def assemble(
    blocks: Sequence[Block],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    laws: Sequence[Law] = (),
    at_rest: Sequence[str] = (),
) -> System:
    """Join blocks: an input port is driven by the output port of that name, or from outside.

    With the blocks stacked to ``y = C x + D u`` and their inputs ``u = E y + F v``, the joined
    system is ``u = (1 - E D)^-1 (E C x + F v)``; blocks may form a loop.

    Parameters
    ----------
    blocks : sequence of Block
    inputs : sequence of str
        The ports that are driven from outside.
    outputs : sequence of str
        The ports that the system gives out.
    laws : sequence of Law
        Each reads an output port and drives an input port; it stays outside the linear system.
    at_rest : sequence of str
        Input ports at which nothing happens: they stay at 0, and the joined system does not have them.

    Raises
    ------
    ValueError
        A port with two drivers or with none, an unknown output, or a loop without a solution:
        a mistake in a stage, never in what a user gave.
    """
    output_ports = [port for block in blocks for port in block.outputs]
    moving = [[column for column, port in enumerate(block.inputs) if port not in at_rest] for block in blocks]
    input_ports = [block.inputs[column] for block, columns in zip(blocks, moving, strict=True) for column in columns]
    drivers = {port: row for row, port in enumerate(output_ports)}
    outside = [*inputs, *(law.current for law in laws)]
    if len(drivers) < len(output_ports) or set(outside) & set(drivers) or len(set(outside)) < len(outside):
        raise ValueError(f"a port has two drivers: {sorted([*outside, *output_ports])}")
    read = [*outputs, *(law.voltage for law in laws)]
    missing = [port for port in (*input_ports, *read) if port not in drivers and port not in outside]
    if missing:
        raise ValueError(f"nothing drives the ports {missing}; there are {[*outside, *output_ports]}")

    n = sum(len(block.states) for block in blocks)
    kind = np.result_type(float, *(matrix for block in blocks for matrix in (block.a, block.b, block.c, block.d)))
    sets = np.broadcast_shapes(
        *(matrix.shape[:-2] for block in blocks for matrix in (block.a, block.b, block.c, block.d))
    )
    a, b = np.zeros((*sets, n, n), kind), np.zeros((*sets, n, len(input_ports)), kind)
    c = np.zeros((*sets, len(output_ports), n), kind)
    d = np.zeros((*sets, len(output_ports), len(input_ports)), kind)
    state = column = row = 0
    for block, driven_columns in zip(blocks, moving, strict=True):
        states = slice(state, state := state + len(block.states))
        columns = slice(column, column := column + len(driven_columns))
        rows = slice(row, row := row + len(block.outputs))
        a[..., states, states], b[..., states, columns] = block.a, block.b[..., driven_columns]
        c[..., rows, states], d[..., rows, columns] = block.c, block.d[..., driven_columns]

    # E and F hold one 1 in each row: what they pick out is picked, not multiplied.
    inside = [index for index, port in enumerate(input_ports) if port not in outside]
    driving = [drivers[input_ports[index]] for index in inside]
    picked_d = np.zeros((*sets, len(input_ports), len(input_ports)), kind)
    here = np.zeros((*sets, len(input_ports), n + len(outside)), kind)
    picked_d[..., inside, :], here[..., inside, :n] = d[..., driving, :], c[..., driving, :]
    for index, port in enumerate(input_ports):
        if port in outside:
            here[..., index, n + outside.index(port)] = 1.0
    try:
        solved = solve(np.eye(len(input_ports)) - picked_d, here)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"the ports {input_ports} form a loop that has no solution") from error
    from_states, from_outside = solved[..., :n], solved[..., n:]
    a, b, c, d = a + b @ from_states, b @ from_outside, c + d @ from_states, d @ from_outside
    chosen = [drivers[port] for port in outputs]
    at_laws = [drivers[law.voltage] for law in laws]
    first_law = len(inputs)
    return System(
        states=tuple(name for block in blocks for name in block.states),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        a=a,
        b=b[..., :first_law],
        c=c[..., chosen, :],
        d=d[..., chosen, :first_law],
        law_ports=LawPorts(
            laws=tuple(laws),
            drive=b[..., first_law:],
            reach=d[..., chosen, first_law:],
            c=c[..., at_laws, :],
            d=d[..., at_laws, :first_law],
            loop=d[..., at_laws, first_law:],
        )
        if laws
        else None,
    )
