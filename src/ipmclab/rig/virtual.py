"""The virtual bench: a strip that exists only as a model, behind the sensors of a rig."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.rig.channels import THESIS_RIG, Rig
from ipmclab.rig.plant import Plant
from ipmclab.signals import Signal

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.sample import Sample

FloatArray = npt.NDArray[np.float64]


class VirtualBench:
    """An actuator on a simulated rig, with the noise, the limits and the timing of the real one.

    Parameters
    ----------
    actuator : Actuator
        The strip in the clamp.
    rig : Rig, optional
        ``THESIS_RIG``, that of Friend's thesis, chapter 3, where it is left out.
    seed : int
        Of the noise: the same seed gives the same readings.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.signals import Step
    >>> bench = VirtualBench(load_actuator("friend-2"))
    >>> bench.open(["voltage", "current"], rate=50.0)
    >>> blocks = list(bench.apply(Step(1.0), rows=100))
    >>> sorted(blocks[0])
    ['current', 'voltage']
    >>> bench.close()
    """

    origin: Final[Literal["virtual bench"]] = "virtual bench"
    block_rows: int = 1000
    """Rows that come at once."""

    def __init__(self, actuator: Actuator, *, rig: Rig | None = None, seed: int = 20261121) -> None:
        self._actuator = actuator
        self._seed = seed
        self._times_opened = 0
        self._plant: Plant | None = None
        self._measured: tuple[str, ...] = ()
        self._rate = 0.0
        self._output = 0.0
        self.rig = rig or THESIS_RIG

    @property
    def description(self) -> str:
        """The bench as a text for the record."""
        return f"virtual bench, actuator {self._actuator.name}, {self.rig.name}, seed {self._seed}"

    @property
    def sample(self) -> Sample | None:
        """The strip in the clamp."""
        return self._actuator.sample

    def open(self, measured: Collection[str], rate: float) -> None:
        """Take a strip that is discharged and at rest, with the output at 0 V.

        Parameters
        ----------
        measured : collection of str
            Channels to read.
        rate : float [Hz]

        Raises
        ------
        InputError
            An unknown channel, or displacement and force at once.
        """
        known = [channel.name for channel in self.rig.channels]
        for name in measured:
            if name not in known:
                raise InputError(
                    f"the bench has no channel {name!r}",
                    code="unknown-channel",
                    where="measured",
                    repair=suggest(name, known),
                )
        if "displacement" in measured and "force" in measured:
            raise InputError(
                "displacement and force cannot be measured in one run: the load cell holds the tip",
                code="blocked-tip",
                where="measured",
                repair="record two runs, one with each",
            )
        self._plant = Plant(self._actuator, self.rig, rate, (self._seed, self._times_opened))
        self._times_opened += 1
        self._measured = tuple(measured)
        self._rate = rate
        self._output = 0.0

    def apply(self, signal: Signal, rows: int) -> Iterator[dict[str, FloatArray]]:
        """Give a signal out, and read: each row just before the output changes.

        Parameters
        ----------
        signal : Signal
            Its time starts at 0 with the first row.
        rows : int

        Yields
        ------
        readings : mapping of channel to float array, shape (n_block,) [V]
            As they come from the converters; the blocks have ``rows`` rows together.

        Raises
        ------
        InputError
            A voltage beyond what the output can give: nothing is given out then.
        """
        if self._plant is None:
            raise InputError("the bench is not open", code="bench-closed", where="bench", repair="call open first")
        voltage = signal.voltage(np.arange(rows) / self._rate)
        low, high = self.rig.output.low, self.rig.output.high
        beyond = np.flatnonzero((voltage < low) | (voltage > high))
        if len(beyond):
            row = int(beyond[0])
            raise InputError(
                f"the signal asks for {voltage[row]:g} V at {row / self._rate:g} s, "
                f"the output gives {low:g} V to {high:g} V",
                code="out-of-range",
                where="signal",
                repair="give a smaller amplitude or offset",
            )
        return self._blocks(self._plant, voltage)

    def _blocks(self, plant: Plant, voltage: FloatArray) -> Iterator[dict[str, FloatArray]]:
        for start in range(0, len(voltage), self.block_rows):
            block = voltage[start : start + self.block_rows]
            readings = plant.read(np.concatenate([[self._output], block[:-1]]))
            self._output = float(block[-1])
            yield {name: readings[name] for name in self._measured}

    def close(self) -> None:
        """Bring the output to 0 V and let go of the strip."""
        self._output = 0.0
        self._plant = None
