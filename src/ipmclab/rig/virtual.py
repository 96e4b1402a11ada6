"""The virtual bench: a strip that exists only as a model, behind the sensors of a rig."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.request import above_zero
from ipmclab.rig.bench import Block, block_rows
from ipmclab.rig.channels import THESIS_RIG, Rig
from ipmclab.rig.plant import StripPlant
from ipmclab.rig.request import check_measured, check_rows, check_voltage
from ipmclab.rig.rows import ENDLESS, RowSource, as_rows
from ipmclab.rig.thermometer import platinum_temperature
from ipmclab.signals import Signal

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.sample import Sample

FloatArray = npt.NDArray[np.float64]

THERMOMETER_PERIOD: Final = 1.0
"""How often [s] the thermometer is read."""


class VirtualBench:
    """An actuator on a simulated rig, with the noise, the limits and the timing of the real one.

    Parameters
    ----------
    actuator : Actuator, optional
        The strip in the clamp; that of ``rig.virtual`` where it is left out.
    rig : Rig, optional
        ``THESIS_RIG``, that of Friend's thesis, chapter 3, where it is left out.
    seed : int, optional
        Of the noise: the same seed gives the same readings. That of ``rig.virtual`` where it is left out.

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

    def __init__(self, actuator: Actuator | None = None, *, rig: Rig | None = None, seed: int | None = None) -> None:
        self.rig = rig or THESIS_RIG
        self._actuator = actuator
        self._seed = self.rig.virtual.seed if seed is None else seed
        self._plant: StripPlant | None = None
        self._noise = {
            channel.name: np.random.default_rng([self._seed, place]) for place, channel in enumerate(self.rig.channels)
        }
        self._measured: tuple[str, ...] = ()
        self._opened = False
        self._rate = 0.0
        self._start = 0.0
        self._rows = 0
        self._output = 0.0
        self._playing: RowSource | None = None
        self._given_out: FloatArray = np.empty(0)

    @property
    def plant(self) -> StripPlant:
        """What is behind the channels."""
        if self._plant is None:
            self._plant = StripPlant(self.rig, self._actuator)
        return self._plant

    def elapsed(self) -> float:
        """How far its clock has come [s]: it runs as fast as its blocks are asked for."""
        return self.plant.time

    @property
    def description(self) -> str:
        """The bench as a text for the record."""
        what = "dummy load" if self.plant.actuator is None else f"actuator {self.plant.actuator.name}"
        return f"virtual bench, {what}, {self.rig.name}, seed {self._seed}"

    @property
    def sample(self) -> Sample | None:
        """The strip in the clamp."""
        return None if self.plant.actuator is None else self.plant.actuator.sample

    def operate(self, words: str) -> None:
        """Do what an operator does: see ``ipmclab.rig.operator_actions``."""
        from ipmclab.rig.operator_actions import carry_out

        carry_out(self.plant, words)

    def open(self, measured: Collection[str], rate: float) -> None:
        """Take the strip as it was left, with the output at 0 V: see ``Bench.open``.

        No time passes between two openings: ``operate("rest")`` lets the strip discharge.
        """
        rate = above_zero("rate", rate, "Hz")
        check_measured(self.rig, measured)
        self._opened = True
        self._measured = tuple(measured)
        self._rate = rate
        self._start, self._rows = self.plant.time, 0
        self._output = 0.0

    def apply(self, source: Signal | RowSource, rows: int | None = None) -> Iterator[Block]:
        """Give rows out, and read: see ``Bench.apply``. Blocks come as fast as they are asked for."""
        self._check_open()
        played = as_rows(source, rows)
        check_rows(self.rig, played, self._rate)
        self._playing = played
        return self._blocks(played)

    def _blocks(self, played: RowSource) -> Iterator[Block]:
        length, rows = block_rows(self._rate), ENDLESS if played.length is None else played.length
        for start in range(0, rows, length):
            # A copy, which zero may write to at any moment, also from another thread.
            given = np.array(played.voltages(start, min(length, rows - start), self._rate))
            self._given_out = given
            if self._playing is not played:
                given[:] = 0.0
            output = np.concatenate([[self._output], given[:-1]])
            readings, temperature = self._read(output)
            self._output = float(given[-1])
            yield Block(start, readings, output, temperature)

    def exchange(self, voltage: float) -> dict[str, float]:
        """Read every channel once, then give a voltage out: see ``Bench.exchange``. One period of the rate passes."""
        self._check_open()
        check_voltage(self.rig, voltage)
        readings, _ = self._read(np.array([self._output]))
        self._output = voltage
        return {name: float(readings[name][0]) for name in self._measured}

    def zero(self) -> None:
        """Bring the output to 0 V: also what is left of the rows that are being given out."""
        self._playing = None
        self._given_out[:] = 0.0
        self._output = 0.0

    def close(self) -> None:
        """Bring the output to 0 V and let go of the strip."""
        self.zero()
        self._opened = False

    def _read(self, output: FloatArray) -> tuple[dict[str, FloatArray], FloatArray]:
        """Let the clock run for some rows: what the converters read [V], and the thermometer [degC]."""
        rows = self._rows + np.arange(1, len(output) + 1)
        self._rows += len(output)
        volts = self.plant.advance(self._start + rows / self._rate, {self.rig.output.physical: output})
        readings = {}
        for name in self._measured:
            channel = self.rig[name]
            # Drawn row by row, so that the noise does not depend on how the rows are cut into blocks.
            deviation = math.hypot(channel.converter.noise, channel.sensor_noise / channel.gain)
            noise = deviation * self._noise[name].standard_normal(len(rows))
            readings[name] = channel.converter.convert(volts[channel.physical or name] + noise)
        meter = self.rig.thermometer
        if meter is None:
            return readings, np.empty(0)
        due = (rows - 1) % max(1, round(self._rate * THERMOMETER_PERIOD)) == 0
        if not due.any():  # most blocks: a resistance of no row would be computed, and solved for all the same
            return readings, np.empty(0)
        return readings, platinum_temperature(volts[meter.physical or "thermometer"][due], meter.resistance)

    def _check_open(self) -> None:
        if not self._opened:
            raise InputError("the bench is not open", code="bench-closed", where="bench", repair="call open first")
