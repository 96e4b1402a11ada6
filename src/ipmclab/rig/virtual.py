"""The virtual bench: a strip that exists only as a model, behind the sensors of a rig."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.model.simulate import above_zero
from ipmclab.rig.bench import Block, block_rows
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
    >>> blocks[1].first_row, len(blocks[1]), sorted(blocks[1].readings)
    (2, 2, ['current', 'voltage'])
    >>> bench.close()
    """

    origin: Literal["measured", "virtual bench"] = "virtual bench"

    def __init__(self, actuator: Actuator, *, rig: Rig | None = None, seed: int = 20261121) -> None:
        self._actuator = actuator
        self._seed = seed
        self._times_opened = 0
        self._plant: Plant | None = None
        self._measured: tuple[str, ...] = ()
        self._rate = 0.0
        self._output = 0.0
        self._given_out: FloatArray = np.empty(0)
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
        """Take a strip that is discharged and at rest, with the output at 0 V: see ``Bench.open``."""
        rate = above_zero("rate", rate, "Hz")
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

    def apply(self, signal: Signal, rows: int) -> Iterator[Block]:
        """Give a signal out, and read: see ``Bench.apply``. Blocks come as fast as they are asked for."""
        plant = self._opened()
        voltage = np.array(signal.voltage(np.arange(rows) / self._rate))  # a copy, which zero may write to
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
        self._given_out = voltage
        return self._blocks(plant, voltage)

    def _blocks(self, plant: Plant, voltage: FloatArray) -> Iterator[Block]:
        length = block_rows(self._rate)
        for start in range(0, len(voltage), length):
            given = voltage[start : start + length]
            output = np.concatenate([[self._output], given[:-1]])
            readings = plant.read(output)
            self._output = float(given[-1])
            yield Block(start, {name: readings[name] for name in self._measured}, output)

    def exchange(self, voltage: float) -> dict[str, float]:
        """Read every channel once, then give a voltage out: see ``Bench.exchange``. One period of the rate passes."""
        plant = self._opened()
        low, high = self.rig.output.low, self.rig.output.high
        if not low <= voltage <= high:
            raise InputError(
                f"{voltage:g} V is asked for, the output gives {low:g} V to {high:g} V",
                code="out-of-range",
                where="voltage",
                repair="give a smaller voltage",
            )
        readings = plant.read(np.array([self._output]))
        self._output = voltage
        return {name: float(readings[name][0]) for name in self._measured}

    def zero(self) -> None:
        """Bring the output to 0 V: also what is left of a signal that is being given out."""
        self._given_out[:] = 0.0
        self._output = 0.0

    def close(self) -> None:
        """Bring the output to 0 V and let go of the strip."""
        self.zero()
        self._plant = None

    def _opened(self) -> Plant:
        if self._plant is None:
            raise InputError("the bench is not open", code="bench-closed", where="bench", repair="call open first")
        return self._plant
