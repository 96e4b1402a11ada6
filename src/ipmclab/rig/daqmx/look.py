"""Looks at a chassis from outside, without touching its output: for ``rig prove``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ipmclab.errors import InputError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import Rig
from ipmclab.rig.daqmx.client import client
from ipmclab.rig.daqmx.driver import Driver, module_of
from ipmclab.rig.daqmx.tasks import OnDemand
from ipmclab.rig.safety.readback import left_at_output

_ANSWER = 5.0  # s


class Watcher:
    """Reads what the output of a rig gives, also while or after another program drives it.

    The modules of the inputs are reset, which takes them away from that program; the output is left as it is.

    Parameters
    ----------
    rig : Rig

    Raises
    ------
    InputError
        Inputs and output are on one module, so that the one cannot be reset without the other.
    BenchError
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._names = ("voltage", "current")
        output = module_of(rig.output.physical)
        self._inputs = tuple(dict.fromkeys(module_of(rig[name].physical) for name in self._names))
        if output in self._inputs:
            raise InputError(
                f"the output and the inputs of voltage and current are both on {output}",
                code="shared-module",
                where="output.physical",
                repair="this check needs them on modules of their own",
            )
        self._driver = Driver(client(), rig, wait=_ANSWER)
        self._demand: OnDemand | None = None

    def take(self) -> None:
        """Take the inputs away from whoever holds them."""
        self.release()
        self._driver.reset(self._inputs)
        self._demand = OnDemand(self._driver, self._names)

    def output(self) -> float:
        """What the output gives [V], 0 where it is within the tolerance of the reading.

        A guardian reads the output back again and again until it is at 0 V, and takes the inputs for each reading: they
        are taken back as often.
        """
        end = time.monotonic() + _ANSWER
        while True:
            if self._demand is None:
                self.take()
            assert self._demand is not None
            try:
                return left_at_output(self._rig, self._demand.read()) or 0.0
            except BenchError as error:
                if error.code not in ("bench-lost", "bench-in-use") or time.monotonic() >= end:
                    raise
            self.take()

    def time_to_zero(self, within: float) -> tuple[float, float | None]:
        """What the output gives when it is first looked at [V], and after how long [s] it gives 0 V."""
        began = time.monotonic()
        self.take()
        first = self.output()
        volts = first
        while True:
            elapsed = time.monotonic() - began
            if volts == 0.0:
                return first, elapsed
            if elapsed > within:
                return first, None
            time.sleep(0.01)
            volts = self.output()

    def clock_terminal(self, rate: float) -> str:
        """The terminal of the sample clock that the inputs get."""
        constants = self._driver.client.constants
        with self._clocked(rate, constants.AcquisitionType.CONTINUOUS, 1000) as task:
            task.control(constants.TaskMode.TASK_RESERVE)
            return str(task.timing.samp_clk_term)

    def waited(self, rate: float, rows: int) -> float:
        """How long [s] this computer waits for so many rows from their start: on a real clock never less than they are.

        A busy computer only adds to it, so that the shortest of a few shows a clock that runs ahead.
        """
        with self._clocked(rate, self._driver.client.constants.AcquisitionType.FINITE, rows) as task:
            began = time.monotonic()
            task.start()
            task.wait_until_done(timeout=_ANSWER + rows / rate)
            return time.monotonic() - began

    @contextmanager
    def _clocked(self, rate: float, mode: object, rows: int) -> Iterator[Any]:
        """A task that reads the inputs by a sample clock."""
        self.release()
        self._driver.reset(self._inputs)
        task = self._driver.task("clock")
        try:
            with self._driver.translated():
                for name in self._names:
                    self._driver.add_input(task, self._rig[name])
                task.timing.cfg_samp_clk_timing(rate, sample_mode=mode, samps_per_chan=rows)
                yield task
        finally:
            self._driver.clear(task)

    def release(self) -> None:
        """Let go of the inputs."""
        if self._demand is not None:
            self._demand.close()
            self._demand = None

    def close(self) -> None:
        """Let go of the chassis. May be called twice."""
        self.release()
        self._driver.close()


def describe(rig: Rig) -> tuple[str, bool]:
    """The chassis as text, and whether it is a simulated one.

    Raises
    ------
    IpmclabError
        It is not there.
    """
    driver = Driver(client(), rig, wait=_ANSWER)
    try:
        driver.check([channel.name for channel in rig.channels])
        return driver.describe()
    finally:
        driver.close()
