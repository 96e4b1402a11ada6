"""The blocks of a structure written out as one function of its parameters.

A stage is asked once for its block, with terms in place of numbers: what it does with them is written down, operation
by operation, and becomes a function that does the same with numbers, in the same order and with the same digits. It
takes a fraction of the time that the stages take, which look up names and fill matrices. A stage that takes no terms
(``terms``) is asked each time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.model.blocks import Block
from ipmclab.model.program import Program
from ipmclab.model.structure import Structure
from ipmclab.model.terms import REFUSED, Terms

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WrittenOut:
    """The blocks of a structure.

    Parameters
    ----------
    blocks : tuple of Block
        Their matrices hold no numbers.
    names : tuple of str
        The parameters on which they depend.
    function : callable
        From the values of these to the entries (``cascade.entries_of``).
    """

    blocks: tuple[Block, ...]
    names: tuple[str, ...]
    function: Callable[..., tuple[float, ...]]

    def entries(self, values: Mapping[str, float]) -> FloatArray:
        """The entries of the blocks for these parameters [SI]."""
        return np.array(self.function(*[values[name] for name in self.names]), dtype=np.float64)

    def entries_of_many(self, values: Mapping[str, Any], sets: int) -> FloatArray:
        """The same for many parameter sets, those of which there are many as arrays: shape (n_sets, n_entries)."""
        columns = self.function(*[values[name] for name in self.names])
        found = np.empty((sets, len(columns)))
        for place, column in enumerate(columns):
            found[:, place] = column
        return found


def written_out(structure: Structure) -> WrittenOut | None:
    """The blocks of a structure written out; None where its stages do more than arithmetic.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> strip = load_actuator("friend-2")
    >>> found = written_out(strip.structure)
    >>> first = strip.blocks()[0]
    >>> found.entries(strip.parameter_values)[:4].reshape(2, 2).tolist() == first.a.tolist()
    True
    """
    try:
        blocks = structure.blocks(Terms(structure.declarations))
        program = Program.of(entry for b in blocks for matrix in (b.a, b.b, b.c, b.d) for entry in matrix.flat)
    except REFUSED:
        return None
    return WrittenOut(blocks, program.names, program.written())
