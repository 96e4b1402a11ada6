"""The numbers of ``drifting_law_loop`` in one state of the water."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ipmclab.model.blocks import Block
from ipmclab.model.numerics.drifting_modal import with_states
from ipmclab.model.numerics.law_modal import modal_numbers
from ipmclab.model.numerics.modal import modes
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest

FloatArray = npt.NDArray[np.float64]


def law_numbers_at(blocks: Sequence[Block], scale: FloatArray, series: float, period: float) -> FloatArray | None:
    """What ``drifting_law_loop`` has to know of a strip without its leak.

    Parameters
    ----------
    blocks : sequence of Block
        Circuit, coupling and beam.
    scale : float array, shape (n_states,)
        How many times each state is what goes on between pieces.
    series : float [ohm]
    period : float [s]

    Returns
    -------
    numbers : float array, shape (NUMBERS,), or None
        None where another way must answer.
    """
    names = [name for block in blocks for name in block.states]
    found = modes(
        [with_states(block) for block in blocks],
        external="voltage",
        outputs=(*OUTPUT_PORTS, *names),
        at_rest=left_at_rest(["voltage"]),
    )
    numbers = None if found is None else modal_numbers(found, period)
    if numbers is None:
        return None
    weights, read = numbers.weights[: len(OUTPUT_PORTS)], numbers.weights[len(OUTPUT_PORTS) :, :6]
    # A section of one state has a second mode that stays 0.
    of_modes = np.eye(6)
    places = [2 * section + k for section, block in enumerate(blocks) for k in range(len(block.states))]
    of_modes[places] = read * scale[:, None]
    circuit = np.array([*numbers.circuit, series, weights[1, 6]])
    return np.concatenate([circuit, *(one.ravel() for one in (numbers.mechanical, weights, of_modes))])
