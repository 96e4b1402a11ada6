"""A cascade as one row of numbers, and what the modal loop needs of it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.blocks import Block
from ipmclab.model.numerics.cascade_loop import ZERO, ZERO_BEFORE, cascade
from ipmclab.model.numerics.modal import NEARLY_MEET, SECTIONS
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

_HOLDS: Final[dict[str, int]] = {"zero": ZERO, "zero-before": ZERO_BEFORE, "first": 2}
_LARGEST: Final = 2  # states of a block whose poles have a closed form

_MOST_SECTIONS: Final = 8
"""Of a cascade that goes by its modes."""

_OF_THREE: Final = np.array(
    [0, *range(2, 9), 9, 10, 33, 15, 16, 34, *range(21, 27), 35, *range(27, 31), 36, *range(37, 43)]
)
"""Where the numbers of ``modal_loop.modal`` stand among those of a cascade of three sections."""

_NOT_READ: Final = np.array([*range(11, 15), *range(17, 21), 31, 32])
"""The weights that it takes to be 0: current and node know the circuit alone, force does not know the beam."""


@dataclass(frozen=True, eq=False)
class Wiring:
    """Which block of a cascade drives which, as ``cascade_loop.cascade`` reads it.

    Parameters
    ----------
    numbers : int array
    sections : int
        How many blocks.
    ports : int
        How many ports.
    """

    numbers: npt.NDArray[np.int64]
    sections: int
    ports: int

    @classmethod
    def of(
        cls, blocks: Sequence[Block], *, external: str, outputs: Sequence[str], at_rest: Sequence[str] = ()
    ) -> Wiring | None:
        """The wiring of some blocks; None where they are no cascade that a modal loop carries.

        Parameters
        ----------
        blocks : sequence of Block
            In the order of the cascade.
        external : str
            The port that is driven from outside.
        outputs : sequence of str
            The ports that are read.
        at_rest : sequence of str
            Input ports that stay at 0.
        """
        ports = {external: 0}
        found: list[int] = []
        if not SECTIONS <= len(blocks) <= _MOST_SECTIONS:
            return None
        for block in blocks:
            if not 1 <= len(block.states) <= _LARGEST:
                return None
            if any(port not in ports and port not in at_rest for port in block.inputs):
                return None
            found += [len(block.states), len(block.inputs), len(block.outputs)]
            found += [-1 if port in at_rest else ports[port] for port in block.inputs]
            for port in block.outputs:
                ports[port] = len(ports)
            found += [ports[port] for port in block.outputs]
        return cls(np.array([*found, *(ports[port] for port in outputs)]), len(blocks), len(ports))

    def sections_over(self, entries: FloatArray, period: float, hold: Hold) -> FloatArray | None:
        """The numbers of ``kernels.modal_sections``; None where there are none, as where two poles nearly meet.

        Parameters
        ----------
        entries : float array
            Of the blocks, in the order of ``entries_of``.
        period : float [s]
        hold : "zero", "zero-before" or "first"
        """
        found = np.empty(13 * self.sections + 4)
        own = self.numbers, self.sections, self.ports
        return found if _loop()(entries, *own, NEARLY_MEET, period, _HOLDS[hold], found) else None

    def coefficients(self, entries: FloatArray, period: float, hold: Hold) -> FloatArray | None:
        """The numbers of ``kernels.modal``; None where these modes do not fit it. Parameters as ``sections_over``."""
        found = None if self.sections != SECTIONS else self.sections_over(entries, period, hold)
        return None if found is None or found[_NOT_READ].any() else found[_OF_THREE]

    def coefficients_of_many(
        self, entries: FloatArray, period: float, hold: Hold
    ) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """The same for many parameter sets, shape (n_sets, 32), and which of them there are."""
        from ipmclab.model.numerics import kernels

        sets = len(entries)
        if self.sections != SECTIONS:
            return np.zeros((sets, 0)), np.zeros(sets, dtype=bool)
        numbers, found = np.zeros((sets, 13 * self.sections + 4)), np.empty(sets, dtype=bool)
        own = self.numbers, self.sections, self.ports
        kernels.cascades(entries, *own, NEARLY_MEET, period, _HOLDS[hold], numbers, found)
        return numbers[:, _OF_THREE], found & ~numbers[:, _NOT_READ].any(axis=1)


def entries_of(blocks: Sequence[Block]) -> npt.NDArray[np.float64]:
    """a, b, c and d of each block, row by row, one after the other."""
    return np.concatenate([matrix.ravel() for block in blocks for matrix in (block.a, block.b, block.c, block.d)])


def _loop() -> Callable[..., bool]:
    """The compiled loop where a compiler is loaded, else the same as plain Python: the digits are the same."""
    if "ipmclab.model.numerics.kernels" not in sys.modules:
        return cascade
    from ipmclab.model.numerics import kernels

    return kernels.cascade
