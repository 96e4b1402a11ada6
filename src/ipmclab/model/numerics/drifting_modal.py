"""The fast path of a linear strip whose parameters drift: modes in pieces, with numbers from a few states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.blocks import Block
from ipmclab.model.numerics.cascade import Wiring, entries_of, of_three
from ipmclab.model.numerics.modal import SECTIONS
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest
from ipmclab.run import Hold

if TYPE_CHECKING:
    from ipmclab.model.numerics.drifting_modal_loop import Pieces

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_OUTPUTS: Final = len(OUTPUT_PORTS)
_MODES: Final = 2 * SECTIONS


def with_states(block: Block) -> Block:
    """The block with its states among its outputs."""
    size = len(block.states)
    return Block(
        block.states,
        block.inputs,
        (*block.outputs, *block.states),
        block.a,
        block.b,
        np.vstack([block.c, np.eye(size)]),
        np.vstack([block.d, np.zeros((size, len(block.inputs)))]),
    )


def numbers_at(systems: Sequence[Sequence[Block]], scales: FloatArray, period: float, hold: Hold) -> FloatArray | None:
    """Everything that a piece needs of each system: numbers (26), starts (6), and its states of modes and voltage (42).

    Parameters
    ----------
    systems : sequence of sequence of Block
        Each the same blocks with other numbers.
    scales : float array, shape (n_systems, n_states)
        How many times each state is what goes on between pieces.
    period : float [s]
    hold : "zero", "zero-before" or "first"

    Returns
    -------
    numbers : float array, shape (n_systems, 74), or None
        None where another way must answer.
    """
    shown = [[with_states(block) for block in blocks] for blocks in systems]
    outputs = (*OUTPUT_PORTS, *(name for block in systems[0] for name in block.states))
    if len(outputs) != _OUTPUTS + _MODES:
        return None
    wiring = Wiring.of(shown[0], external="voltage", outputs=outputs, at_rest=left_at_rest(["voltage"]))
    if wiring is None:
        return None
    numbers, found = wiring.sections_of_many(np.array([entries_of(blocks) for blocks in shown]), period, hold)
    if not np.all(found):
        return None
    ends = np.cumsum([3 * SECTIONS, len(outputs) * _MODES, len(outputs)])
    moves, weights, direct, starts = np.split(numbers, ends, axis=1)
    own = of_three(np.hstack([moves, weights[:, : _OUTPUTS * _MODES], direct[:, :_OUTPUTS], starts]))
    if own is None:
        return None
    weights = weights.reshape(len(numbers), -1, _MODES)
    of_modes = np.concatenate([weights[:, _OUTPUTS:], direct[:, _OUTPUTS:, None]], axis=2) * scales[:, :, None]
    return np.hstack([own, of_modes.reshape(len(numbers), -1)])


def pieces_between(knots: FloatArray, weights: FloatArray, first: IndexArray) -> Pieces | None:
    """The pieces of a record from the numbers at some states.

    Parameters
    ----------
    knots : float array, shape (n_knots, 74)
    weights : float array, shape (n_pieces, n_knots)
    first : int array, shape (n_pieces + 1,)

    Returns
    -------
    pieces : Pieces or None
        None where modes change their kind on the way, from two real ones to a pair.
    """
    from ipmclab.model.numerics.drifting_modal_loop import Pieces

    kinds = knots[:, [3, 6]] != 0.0
    if np.any(kinds != kinds[0]):
        return None
    numbers = weights @ knots
    of_modes = numbers[:, 32:].reshape(-1, _MODES, _MODES + 1)
    across = np.zeros_like(of_modes)
    # The states go on: what they are of the modes before, less what the voltage gives to them now.
    going = of_modes[:-1].copy()
    going[:, :, -1] -= of_modes[1:, :, -1]
    across[1:] = np.linalg.solve(of_modes[1:, :, :-1], going)
    return Pieces(first, np.ascontiguousarray(numbers[:, :26]), numbers[0, 26:32].copy(), across)
