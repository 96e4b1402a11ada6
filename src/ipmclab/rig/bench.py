"""What every bench can do: the few calls through which a strip is driven and read."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.channels import Rig
from ipmclab.rig.rows import RowSource
from ipmclab.sample import Sample
from ipmclab.signals import Signal

FloatArray = npt.NDArray[np.float64]

BLOCK_TIME: Final = 0.04
"""How long [s] a block lasts: a guard that looks at every block reacts within 100 ms."""


def block_rows(rate: float) -> int:
    """Rows of a block at a rate [Hz]: as many as fit into ``BLOCK_TIME``, at least one."""
    return max(1, int(BLOCK_TIME * rate))


class BenchError(IpmclabError):
    """The hardware failed, or cannot be reached (exit status 1).

    ``code`` is ``"bench-frozen"`` when no block came in time, ``"bench-lost"`` when the connection is gone,
    ``"bench-unreachable"`` when there was none, ``"bench-in-use"`` when somebody else holds the hardware,
    ``"output-stuck"`` when a voltage is read although 0 V was given out, ``"output-not-zero"`` when 0 V could not be
    given out, ``"daq<code>"`` (such as ``"daq-200279"``) for what else the driver reports.
    """


@dataclass(frozen=True)
class Block:
    """Some rows as a bench reads them.

    Parameters
    ----------
    first_row : int
        Row of its first reading; a jump past the end of the block before is a gap.
    readings : mapping of channel to float array, shape (n_block,) [V]
        As they come from the converters, unscaled.
    output : float array, shape (n_block,) [V]
        What the output was commanded to give since the row before each row.
    temperature : float array, shape (n_slow,) [degC]
        What the thermometer read since the block before; usually empty.
    """

    first_row: int
    readings: Mapping[str, FloatArray]
    output: FloatArray
    temperature: FloatArray = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.output)


class Bench(Protocol):
    """A strip behind the channels of a rig.

    ``open``, then any number of ``apply`` and ``exchange``, then ``close``. Whatever happens, ``zero`` brings
    the output to 0 V, and ``close`` calls it.
    """

    rig: Rig

    @property
    def origin(self) -> Literal["measured", "virtual bench"]:
        """What its runs are; a chassis states what it is once it is open."""

    @property
    def description(self) -> str:
        """The bench as a text for the record."""

    @property
    def sample(self) -> Sample | None:
        """The strip in the clamp, where the bench knows it (a virtual one does)."""

    def open(self, measured: Collection[str], rate: float) -> None:
        """Take hold of the bench, with its output reset to 0 V.

        Parameters
        ----------
        measured : collection of str
            Channels of the rig to read.
        rate : float [Hz]
            Of ``apply``.

        Raises
        ------
        InputError
            An unknown channel, displacement and force at once, a rate that the bench cannot do.
        BenchError
            The hardware is not there, or in use.
        """

    def apply(self, source: Signal | RowSource, rows: int | None = None) -> Iterator[Block]:
        """Give a signal, or what else has rows, out, and read: each row just before the output changes.

        The first block may be asked for any time after the call; the clock starts then. ``zero`` may be called between
        blocks: the output is at 0 V from then on, and the blocks continue coming. An iterator that is closed early
        stops the clock; the output keeps its last value until ``zero``.

        Parameters
        ----------
        source : Signal or RowSource
            The time of a signal starts at 0 with the first row.
        rows : int, optional
            Of a signal; any other source knows how many it has.

        Yields
        ------
        block : Block
            Blocks of ``block_rows(rate)`` rows (the last may be shorter), as many rows together as there are.

        Raises
        ------
        InputError
            A voltage beyond what the output can give, or a source whose voltages nothing holds within a limit: nothing
            is given out then.
        BenchError
            The hardware failed; frozen when no block came for max(1 s, 5 block periods), reported within 2 s more.
        """

    def exchange(self, voltage: float) -> dict[str, float]:
        """Read every channel once [V], then give ``voltage`` [V] out: a step of a control loop timed by its caller."""

    def zero(self) -> None:
        """Bring the output to 0 V now, whatever runs. May be called at any time, also twice, also after a failure."""

    def close(self) -> None:
        """Bring the output to 0 V and let go of the bench. May be called twice."""
