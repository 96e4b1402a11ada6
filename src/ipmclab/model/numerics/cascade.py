"""A cascade as one row of numbers, and what the modal loop needs of it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.blocks import Block
from ipmclab.model.numerics.cascade_loop import ZERO, ZERO_BEFORE, cascade, room_for
from ipmclab.model.numerics.modal import NEARLY_MEET, SECTIONS
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

HOLDS: Final[dict[str, int]] = {"zero": ZERO, "zero-before": ZERO_BEFORE, "first": 2}
"""As ``cascade_loop.cascade`` knows them."""

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
    ports : int
        How many ports.
    states : tuple of int
        Of each section.
    reads : tuple of tuple of int
        The sections that each output reads.
    """

    numbers: npt.NDArray[np.int64]
    ports: int
    states: tuple[int, ...]
    reads: tuple[tuple[int, ...], ...]

    @property
    def sections(self) -> int:
        """How many blocks there are."""
        return len(self.states)

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
        sees: dict[str, set[int]] = {external: set()}
        found: list[int] = []
        if not SECTIONS <= len(blocks) <= _MOST_SECTIONS:
            return None
        for section, block in enumerate(blocks):
            if not 1 <= len(block.states) <= _LARGEST:
                return None
            if any(port not in ports and port not in at_rest for port in block.inputs):
                return None
            found += [len(block.states), len(block.inputs), len(block.outputs)]
            found += [-1 if port in at_rest else ports[port] for port in block.inputs]
            for row, port in enumerate(block.outputs):
                ports[port] = len(ports)
                sees[port] = _seen(block, section, row, sees)
            found += [ports[port] for port in block.outputs]
        found += [ports[port] for port in outputs]
        reads = tuple(tuple(sorted(sees[port])) for port in outputs)
        return cls(np.array(found), len(ports), tuple(len(block.states) for block in blocks), reads)

    def sections_over(self, entries: FloatArray, period: float, hold: Hold) -> FloatArray | None:
        """The numbers of ``kernels.modal_sections``; None where there are none, as where two poles nearly meet.

        Parameters
        ----------
        entries : float array
            Of the blocks, in the order of ``entries_of``.
        period : float [s]
        hold : "zero", "zero-before" or "first"
        """
        found = np.empty(self._count())
        own = self.numbers, self.sections, self.ports
        return found if _loop()(entries, *own, NEARLY_MEET, period, HOLDS[hold], self._room(), found) else None

    def coefficients(self, entries: FloatArray, period: float, hold: Hold) -> FloatArray | None:
        """The numbers of ``kernels.modal``; None where these modes do not fit it. Parameters as ``sections_over``."""
        found = None if self.sections != SECTIONS else self.sections_over(entries, period, hold)
        return None if found is None else of_three(found)

    def sections_of_many(
        self, entries: FloatArray, period: float, hold: Hold
    ) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """``sections_over`` of many parameter sets, that axis first, and which of them have these numbers."""
        from ipmclab.model.numerics import kernels

        numbers, found = np.zeros((len(entries), self._count())), np.empty(len(entries), dtype=bool)
        own = self.numbers, self.sections, self.ports
        kernels.cascades(entries, *own, NEARLY_MEET, period, HOLDS[hold], self._room(), numbers, found)
        return numbers, found

    def _room(self) -> FloatArray:
        return np.zeros(room_for(self.sections, self.ports, len(self.reads)))

    def _count(self) -> int:
        """How many numbers ``cascade_loop.cascade`` writes."""
        return 3 * self.sections + 2 * self.sections * (len(self.reads) + 1) + len(self.reads)


def of_three(found: FloatArray) -> FloatArray | None:
    """The numbers of ``kernels.modal`` among those of three sections and four outputs, shape (..., 43).

    None where it needs others.
    """
    numbers = found.T  # first the axis that is chosen from: of one system that takes a tenth of the time
    return None if any(numbers[_NOT_READ].ravel().tolist()) else numbers[_OF_THREE].T


def _seen(block: Block, section: int, row: int, sees: Mapping[str, set[int]]) -> set[int]:
    """The sections whose modes an output of a block reads."""
    found: set[int] = set()
    for column, port in enumerate(block.inputs):
        if port not in sees:
            continue
        by_states = _any(block.c[row]) and _any(block.b[:, column])
        if by_states or _any(block.d[row, column : column + 1]):
            found |= sees[port] | ({section} if by_states else set())
    return found


def _any(entries: npt.NDArray[Any]) -> bool:
    """Whether an entry is not a plain zero."""
    return any(not isinstance(entry, float) or entry != 0.0 for entry in entries.tolist())


def entries_of(blocks: Sequence[Block]) -> npt.NDArray[np.float64]:
    """a, b, c and d of each block, row by row, one after the other."""
    return np.concatenate([matrix.ravel() for block in blocks for matrix in (block.a, block.b, block.c, block.d)])


def _loop() -> Callable[..., bool]:
    """The compiled loop where a compiler is loaded, else the same as plain Python: the digits are the same."""
    if "ipmclab.model.numerics.kernels" not in sys.modules:
        return cascade
    from ipmclab.model.numerics.kernels import cascade as compiled  # waits where another thread is loading it

    return compiled
