"""Ladder: pieces of membrane in a row, with the resistance of the electrodes between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ipmclab.model.blocks import Block, Matrix, solve
from ipmclab.model.stages.membrane import Membrane


@dataclass(frozen=True)
class Node:
    """A piece of membrane behind a resistance.

    Parameters
    ----------
    name : str
        Its states are called ``<name>.branches.<i>.voltage``.
    membrane : Membrane
    voltage, leak : str
        The port of its voltage [V], and the port [A] that takes what leaks there; empty where nothing leaks.
    resistance : number [ohm]
        Between it and the node before; for the first one between it and the source.
    """

    name: str
    membrane: Membrane
    voltage: str
    leak: str
    resistance: complex


def ladder(nodes: Sequence[Node], reads: Mapping[str, Matrix]) -> Block:
    """The block of some nodes in a row behind a voltage: ``voltage`` to ``current`` and to voltages of nodes.

    The first resistance may be 0, the others not: the node's equation is multiplied by it, so that the first
    node then has the voltage of the source itself.

    Parameters
    ----------
    nodes : sequence of Node
        From the source to the open end.
    reads : mapping of port to weights
        Output ports that are weighted sums of voltages: one weight for the source, then one for each node.
    """
    count, branches = len(nodes), len(nodes[0].membrane.rates)
    kind = np.result_type(
        float,
        *(
            np.asarray([node.resistance, node.membrane.dc, *node.membrane.branches, *node.membrane.rates])
            for node in nodes
        ),
    )
    resistances = np.array([node.resistance for node in nodes], kind)
    between = 1.0 / resistances[1:]
    pulls = np.array([node.membrane.branches for node in nodes], kind)
    rates = np.array([node.membrane.rates for node in nodes], kind)
    at_once = np.array([node.membrane.at_once for node in nodes], kind)
    # Kirchhoff's current law at each node; the first one times its resistance.
    onwards, back = np.append(between, 0.0), np.insert(between, 0, 0.0)
    law = np.diag(at_once + onwards + back) - np.diag(between, 1) - np.diag(between, -1)
    law[0] *= resistances[0]
    law[0, 0] += 1.0
    once = np.eye(count, dtype=kind)
    once[0, 0] = resistances[0]  # what a source of current does in that first equation
    from_current = solve(law, once)
    from_voltage = solve(law, np.eye(count, 1, dtype=kind))
    spread = np.zeros((count, count * branches), kind)
    for place in range(count):
        spread[place, place * branches : (place + 1) * branches] = pulls[place]
    from_state = from_current @ spread
    leaking = [place for place, node in enumerate(nodes) if node.leak]
    from_leak = -from_current[:, leaking]
    # What the source gives goes through the first node's membrane and leak, and on to the second node.
    taken = np.zeros((1, count), kind)
    taken[0, 0] = at_once[0] + onwards[0]
    taken[0, 1:2] = -onwards[0]
    current_state = taken @ from_state - spread[:1]
    current_leak = taken @ from_leak + np.array([[1.0 if place == 0 else 0.0 for place in leaking]])
    weights: Matrix = np.array(list(reads.values())).reshape(len(reads), 1 + count)
    shown = [place for place, node in enumerate(nodes) if node.voltage]
    to_states = np.repeat(np.eye(count), branches, axis=0) * rates.reshape(-1, 1)
    return Block(
        states=tuple(f"{node.name}.branches.{i}.voltage" for node in nodes for i in range(branches)),
        inputs=("voltage", *(nodes[place].leak for place in leaking)),
        outputs=("current", *reads, *(node.voltage for node in nodes if node.voltage)),
        a=to_states @ from_state - np.diag(rates.ravel()),
        b=np.hstack([to_states @ from_voltage, to_states @ from_leak]),
        c=np.vstack([current_state, weights[:, 1:] @ from_state, from_state[shown]]),
        d=np.vstack(
            [
                np.hstack([taken @ from_voltage, current_leak]),
                np.hstack([weights[:, 1:] @ from_voltage + weights[:, :1], weights[:, 1:] @ from_leak]),
                np.hstack([from_voltage[shown], from_leak[shown]]),
            ]
        ),
    )
