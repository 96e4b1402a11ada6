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
_NUMBERS: Final = 32
_LARGEST: Final = 2  # states of a block whose poles have a closed form


@dataclass(frozen=True, eq=False)
class Wiring:
    """Which block of a cascade drives which, as ``cascade_loop.cascade`` reads it.

    Parameters
    ----------
    numbers : int array
    ports : int
    """

    numbers: npt.NDArray[np.int64]
    ports: int

    @classmethod
    def of(
        cls, blocks: Sequence[Block], *, external: str, outputs: Sequence[str], at_rest: Sequence[str] = ()
    ) -> Wiring | None:
        """The wiring of some blocks; None where they are no cascade that the modal loop carries.

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
        if len(blocks) != SECTIONS:
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
        return cls(np.array([*found, *(ports[port] for port in outputs)]), len(ports))

    def coefficients(self, entries: FloatArray, period: float, hold: Hold) -> FloatArray | None:
        """The numbers of ``kernels.modal``; None where these modes do not fit it, or two poles nearly meet.

        Parameters
        ----------
        entries : float array
            Of the blocks, in the order of ``entries_of``.
        period : float [s]
        hold : "zero", "zero-before" or "first"
        """
        found = np.empty(_NUMBERS)
        fits = _loop()(entries, self.numbers, self.ports, NEARLY_MEET, period, _HOLDS[hold], found)
        return found if fits else None

    def coefficients_of_many(
        self, entries: FloatArray, period: float, hold: Hold
    ) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """The same for many parameter sets, shape (n_sets, 32), and which of them there are."""
        from ipmclab.model.numerics import kernels

        numbers, found = np.zeros((len(entries), _NUMBERS)), np.empty(len(entries), dtype=bool)
        kernels.cascades(entries, self.numbers, self.ports, NEARLY_MEET, period, _HOLDS[hold], numbers, found)
        return numbers, found


def entries_of(blocks: Sequence[Block]) -> npt.NDArray[np.float64]:
    """a, b, c and d of each block, row by row, one after the other."""
    return np.concatenate([matrix.ravel() for block in blocks for matrix in (block.a, block.b, block.c, block.d)])


def _loop() -> Callable[..., bool]:
    """The compiled loop where a compiler is loaded, else the same as plain Python: the digits are the same."""
    if "ipmclab.model.numerics.kernels" not in sys.modules:
        return cascade
    from ipmclab.model.numerics import kernels

    return kernels.cascade
