"""The tasks of an NI bench: hardware-timed for a signal, on demand for a control loop and for 0 V."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import block_rows
from ipmclab.rig.daqmx.driver import COLDEST, HOTTEST, Driver
from ipmclab.rig.rows import Feed

FloatArray = npt.NDArray[np.float64]

READ_AHEAD: Final = 10.0
"""Time [s] for which the chassis keeps readings that were not fetched."""

THERMOMETER_RATE: Final = 1.0
"""Readings [1/s] of the thermometer: an NI 9217 that resolves well takes 0.2 s for each."""

RATE_TOLERANCE: Final = 50e-6
"""The clock of a cDAQ chassis is no better than 50 ppm; a rate within that is the rate."""

_SLOW: Final = 100.0
"""A rate [Hz] that every module can do."""

_AT_ONCE: Final = 1024
"""Rows that the output is fed at once where a block is shorter: a signal may take long to compute."""

_MOST_AHEAD: Final = 2**18
"""Rows that the output is given before its clock starts, at most: 2 MiB, half of the longest message of gRPC."""

_QUICK: Final = 1.0
"""Timeout [s] of calls that wait for nothing."""


def rows_ahead(rate: float, ahead: float) -> int:
    """How many rows the output is given before its clock starts, at a rate [Hz] and for a time [s]."""
    return min(math.ceil(ahead * rate), _MOST_AHEAD) + block_rows(rate)


class TimedTasks:
    """Inputs and output on one sample clock, and the thermometer on a slow one of its own.

    The input task is the master: it is reserved first, so that the terminal of its clock is known, and the output
    task takes that clock. The output is armed before the inputs start: on each edge the inputs are read, then
    the output changes. Both continue until they are stopped.

    Parameters
    ----------
    driver : Driver
    names : sequence of str
        Channels to read.
    rate : float [Hz]
    ahead : float [s]
        How far the output is fed ahead of its clock.

    Raises
    ------
    InputError
        A rate that the modules cannot do.
    BenchError
    """

    def __init__(self, driver: Driver, names: Sequence[str], rate: float, ahead: float) -> None:
        self._driver = driver
        self._rate = rate
        self._ahead = rows_ahead(rate, ahead)
        self._fed = 0
        self._polled = 0
        self._output: Any = None
        self._thermometer: Any = None
        self._inputs: Any = None
        self.n_channels = len(names)
        try:
            with driver.translated():
                self._inputs = driver.task("ai")
                self._make_inputs(names)
                self._output = driver.task("ao")
                self._make_output()
                if driver.rig.thermometer is not None:
                    self._thermometer = driver.task("rtd")
                    self._make_thermometer()
        except BaseException:
            self.close()
            raise

    def _make_inputs(self, names: Sequence[str]) -> None:
        constants, task = self._driver.client.constants, self._inputs
        for name in names:
            self._driver.add_input(task, self._driver.rig[name])
        buffered = max(1000, math.ceil(READ_AHEAD * self._rate), 4 * block_rows(self._rate))
        _set_clock(self._driver, task, self._rate, "", buffered, f"{len(names)} channels are read")
        task.control(constants.TaskMode.TASK_RESERVE)
        actual = task.timing.samp_clk_rate
        if abs(actual / self._rate - 1.0) > RATE_TOLERANCE:
            raise InputError(
                f"{self._rate:.12g} Hz is asked for, the chassis can clock {actual:.9g} Hz",
                code="bad-rate",
                where="rate",
                repair=f"give {actual:.12g} Hz, or a rate that divides 80 MHz",
            )
        self._reader = self._driver.client.stream_readers.AnalogMultiChannelReader(task.in_stream)
        self._reader.verify_array_shape = False

    def _make_output(self) -> None:
        client, task = self._driver.client, self._output
        self._driver.add_output(task)
        clock = self._inputs.timing.samp_clk_term
        room = 2 * self._ahead + 2 * block_rows(self._rate) + 2
        _set_clock(self._driver, task, self._rate, clock, room, "the output is given out")
        task.out_stream.regen_mode = client.constants.RegenerationMode.DONT_ALLOW_REGENERATION
        task.out_stream.output_buf_size = room
        task.control(client.constants.TaskMode.TASK_RESERVE)
        self._writer = client.stream_writers.AnalogSingleChannelWriter(task.out_stream, auto_start=False)
        self._writer.verify_array_shape = False

    def _make_thermometer(self) -> None:
        client, task = self._driver.client, self._thermometer
        self._driver.add_thermometer(task)
        continuous = client.constants.AcquisitionType.CONTINUOUS
        task.timing.cfg_samp_clk_timing(THERMOMETER_RATE, sample_mode=continuous, samps_per_chan=1000)
        self._slow_reader = client.stream_readers.AnalogMultiChannelReader(task.in_stream)
        self._slow_reader.verify_array_shape = False

    def start(self, feed: Feed) -> None:
        """Arm the output, unless it was stopped, then start the clock."""
        self.feed(feed, 0)
        with self._driver.translated():
            if self._thermometer is not None:
                self._thermometer.start()
            if self._output is not None:
                self._output.start()
            self._inputs.start()

    def wanted(self, row: int) -> int:
        """How many voltages the output takes at a row, to last until ``ahead`` after it; none once it was stopped."""
        missing = row + self._ahead - self._fed
        # Not at every block: a quarter of what it holds may be used up first.
        if self._output is None or missing < max(1, min(self._ahead // 4, _AT_ONCE)):
            return 0
        if row > 0:  # before the clock starts there is time
            return min(missing, max(_AT_ONCE, 2 * block_rows(self._rate)))
        return missing

    def feed(self, feed: Feed, row: int) -> None:
        """Give the output what it wants at a row."""
        missing, task = self.wanted(row), self._output
        if not missing:
            return
        try:
            with self._driver.translated():
                self._writer.write_many_sample(feed.take(missing), timeout=_QUICK)
        except IpmclabError:
            if self._output is task:
                raise
            return  # a signal handler of this thread brought the output to 0 V meanwhile
        self._fed += missing

    def read(self, rows: int, timeout: float) -> FloatArray:
        """The next rows of every channel [V], shape (n_channel, rows), after they were sampled."""
        readings = np.empty((self.n_channels, rows))
        with self._driver.translated():
            self._reader.read_many_sample(readings, rows, timeout=timeout)
        return readings

    def temperatures(self, row: int) -> FloatArray:
        """What the thermometer read [degC] since it was last asked: without waiting, and not at every block."""
        if self._thermometer is None or row - self._polled < self._rate / THERMOMETER_RATE:
            return np.empty(0)
        self._polled = row
        with self._driver.translated():
            count = self._thermometer.in_stream.avail_samp_per_chan
            values = np.empty((1, count))
            if count:
                self._slow_reader.read_many_sample(values, count, timeout=_QUICK)
        # A broken wire reads as the end of the scale.
        return np.where((values[0] > COLDEST) & (values[0] < HOTTEST), values[0], np.nan)

    def sampled(self) -> int:
        """How many rows the chassis has sampled by now."""
        with self._driver.translated():
            return int(self._inputs.in_stream.total_samp_per_chan_acquired)

    def stop_output(self) -> None:
        """Stop feeding and clear the output, which keeps its last voltage; the inputs continue."""
        task, self._output = self._output, None
        if task is not None:
            with self._driver.translated():
                task.close()

    def stop_clock(self) -> None:
        """Stop the inputs, and with them the clock."""
        with self._driver.translated():
            self._inputs.stop()

    def close(self) -> None:
        """Clear every task; may be called twice, and after any failure."""
        tasks = (self._inputs, self._output, self._thermometer)
        self._inputs = self._output = self._thermometer = None
        for task in tasks:
            self._driver.clear(task)


class OnDemand:
    """Single readings and single voltages, timed by whoever asks.

    Parameters
    ----------
    driver : Driver
    names : sequence of str
        Channels to read.
    """

    def __init__(self, driver: Driver, names: Sequence[str]) -> None:
        self._driver = driver
        self._names = tuple(names)
        self._inputs: Any = None
        self._output: Any = None

    def read(self) -> dict[str, float]:
        """Every channel once [V]."""
        readings = np.empty(len(self._names))
        if self._inputs is None:
            self._start_inputs()
        with self._driver.translated():
            self._reader.read_one_sample(readings, timeout=_QUICK)
        return dict(zip(self._names, readings.tolist(), strict=True))

    def _start_inputs(self) -> None:
        """Make the task of the inputs, whole or not at all; one that runs is read at once."""
        try:
            with self._driver.translated():
                self._inputs = self._driver.task("ai")
                for name in self._names:
                    self._driver.add_input(self._inputs, self._driver.rig[name])
                self._reader = self._driver.client.stream_readers.AnalogMultiChannelReader(self._inputs.in_stream)
                self._reader.verify_array_shape = False
                self._inputs.start()
        except BaseException:
            self.release_inputs()
            raise

    def prepare(self) -> None:
        """Make what is needed to give a voltage out, so that 0 V comes at once when it is called for."""
        if self._output is not None:
            return
        try:
            with self._driver.translated():
                self._output = self._driver.task("now")
                self._driver.add_output(self._output)
                self._writer = self._driver.client.stream_writers.AnalogSingleChannelWriter(self._output.out_stream)
                self._writer.verify_array_shape = False
        except BaseException:
            self._release_output()
            raise

    def write(self, voltage: float) -> None:
        """Give a voltage [V] out."""
        self.prepare()
        with self._driver.translated():
            self._writer.write_one_sample(voltage, timeout=_QUICK)

    def release_inputs(self) -> None:
        """Let the inputs go."""
        task, self._inputs = self._inputs, None
        self._driver.clear(task)

    def release(self) -> None:
        """Let the modules go for a sample clock: the output keeps its voltage, and its task stays prepared."""
        self.release_inputs()
        if self._output is not None:
            with self._driver.translated():
                self._output.stop()
                self._output.control(self._driver.client.constants.TaskMode.TASK_UNRESERVE)

    def close(self) -> None:
        """Clear the tasks; the output keeps its voltage. May be called twice, and after any failure."""
        self.release_inputs()
        self._release_output()

    def _release_output(self) -> None:
        task, self._output = self._output, None
        self._driver.clear(task)


def _set_clock(driver: Driver, task: Any, rate: float, source: str, buffered: int, what: str) -> None:
    """Continuous sampling on a clock, unless the modules are too slow for it."""
    continuous = driver.client.constants.AcquisitionType.CONTINUOUS
    # The modules report their highest rate only once there is a rate, and refuse one that is too high.
    for wanted in dict.fromkeys((min(rate, _SLOW), rate)):
        task.timing.cfg_samp_clk_timing(wanted, source=source, sample_mode=continuous, samps_per_chan=buffered)
        most = task.timing.samp_clk_max_rate
        if rate > most:
            raise InputError(
                f"{rate:.12g} Hz is asked for, {what} at {most:.12g} Hz at most",
                code="bad-rate",
                where="rate",
                repair="give a lower rate, or record fewer channels",
            )
