"""The NI bench: a strip on a CompactDAQ chassis, through NI's own client.

With ``rig.address`` the chassis is behind a gRPC server (NI's, or the stand-in of ``ipmclab rig serve``), without
it behind the driver of this computer; everything else is the same.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import BenchError, Block, block_rows
from ipmclab.rig.channels import Rig
from ipmclab.rig.daqmx.client import client
from ipmclab.rig.daqmx.driver import Driver
from ipmclab.rig.daqmx.in_use import Hold
from ipmclab.rig.daqmx.look_back import SETTLED, settled
from ipmclab.rig.daqmx.reset import ANSWER, reset, see_zero, stuck_error
from ipmclab.rig.daqmx.tasks import OnDemand, TimedTasks, rows_ahead
from ipmclab.rig.request import check_measured, check_rows, check_voltage
from ipmclab.rig.rows import ENDLESS, Feed, RowSource, as_rows
from ipmclab.rig.safety.readback import TOLERANCE, left_at_output
from ipmclab.signals import Signal

if TYPE_CHECKING:
    from ipmclab.sample import Sample

FloatArray = npt.NDArray[np.float64]

AHEAD: Final = 0.5
"""How far [s] the output is fed ahead: a program that hangs leaves no more than this of its signal."""


class NiBench:
    """A strip on a CompactDAQ chassis.

    Parameters
    ----------
    rig : Rig
        With the physical names of its channels; ``address`` names a gRPC server.
    ahead : float [s], optional
        How far the output is fed ahead of its clock; a simulated chassis is fed as one of metal is, so that what is
        proven there holds.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> NiBench(THESIS_RIG).description
    "NI-DAQmx, rig of Friend's thesis, chapter 3"
    """

    origin: Literal["measured", "virtual bench"] = "measured"

    def __init__(self, rig: Rig, *, ahead: float = AHEAD) -> None:
        self.rig = rig
        self._ahead = ahead
        self._about = "NI-DAQmx"
        self._driver: Driver | None = None
        self._hold: Hold | None = None
        self._measured: tuple[str, ...] = ()
        self._rate = 0.0
        self._lock = threading.RLock()  # zero may come from another thread, or from a signal handler of this one
        self._demand: OnDemand | None = None
        self._timed: TimedTasks | None = None
        self._output = 0.0
        self._zeros = 0  # how often the output was brought to 0 V; what was handed over before stays there
        self._zero_from: int | None = None
        self._failure: IpmclabError | None = None
        self._safe = True
        self._reported_danger = False

    @property
    def description(self) -> str:
        """The bench as a text for the record."""
        return f"{self._about}, {self.rig.name}"

    @property
    def sample(self) -> Sample | None:
        """The chassis does not know what is in the clamp."""
        return None

    def open(self, measured: Collection[str], rate: float) -> None:
        """Take hold of the chassis, with the output reset to 0 V: see ``Bench.open``."""
        from ipmclab.model.request import above_zero

        rate = above_zero("rate", rate, "Hz")
        check_measured(self.rig, measured)
        self.close()
        driver = Driver(client(), self.rig, wait=ANSWER)
        hold: Hold | None = None
        try:
            names = tuple(dict.fromkeys(measured))
            driver.check(names)
            modules = driver.modules(names)
            hold = Hold(self.rig.address, modules)
            driver.reset(modules)
            self._about, simulated = driver.describe(names)
            # Made once to see that the modules can do what will be asked of them, before anything is given out.
            TimedTasks(driver, names, rate, self._ahead).close()
            demand = OnDemand(driver, names)
            demand.prepare()
            driver.be_patient()
        except BaseException:
            driver.close()
            if hold is not None:
                hold.release()
            raise
        self._hold = hold
        self.origin = "virtual bench" if simulated else "measured"
        self._driver = driver
        self._demand = demand
        self._measured = names
        self._rate = rate
        self._output = 0.0
        self._failure = None
        self._safe = True
        self._reported_danger = False

    def apply(self, source: Signal | RowSource, rows: int | None = None) -> Iterator[Block]:
        """Give rows out, and read: see ``Bench.apply``. Blocks come as the chassis samples them."""
        self._opened()
        played = as_rows(source, rows)
        check_rows(self.rig, played, self._rate)
        feed = Feed(played, self._rate)
        feed.prepare(rows_ahead(self._rate, self._ahead))
        return self._blocks(feed, ENDLESS if played.length is None else played.length, self._zeros)

    def _blocks(self, feed: Feed, rows: int, zeros: int) -> Iterator[Block]:
        if rows < 1:
            return
        given, stuck = 0, 0
        timed: TimedTasks | None = None
        try:
            timed = self._start(feed, zeros)
            before = self._output
            while given < rows:
                count = min(block_rows(self._rate), rows - given)
                # A source may take its time: zero does not wait for it.
                feed.prepare(timed.wanted(given + count))
                with self._lock:
                    timed.feed(feed, given + count)
                # No block for this long means that the chassis does not move.
                readings = timed.read(count, max(1.0, 5.0 * block_rows(self._rate) / self._rate))
                output = np.concatenate([[before], feed.again(count)])
                before = float(output[-1])
                block = self._block(timed, given, readings, output)
                given += count
                if given == rows:
                    self._stop(timed)
                left = self._left(block)
                stuck = stuck + 1 if left is not None else 0
                if left is not None and stuck > 1:
                    raise stuck_error(left)
                yield block
        except IpmclabError as error:
            raise self._failed(error) from error.__cause__
        finally:
            if timed is not None and self._timed is timed:
                self._abandon(feed, given)

    def _start(self, feed: Feed, zeros: int) -> TimedTasks:
        driver = self._opened()
        with self._lock:
            if self._timed is not None:
                raise InputError(
                    "a signal is being given out", code="bench-busy", where="bench", repair="let it end first"
                )
            if self._demand is not None:
                self._demand.release()  # a module gives out on a clock or on demand, not both
            timed = TimedTasks(driver, self._measured, self._rate, self._ahead)
            self._timed, self._zero_from, self._safe = timed, None, False
            try:
                if self._zeros != zeros:  # the output was brought to 0 V since the rows were handed over
                    timed.stop_output()
                    self._zero_from = 0
                timed.start(feed)
            except BaseException:
                self._abandon()
                raise
        return timed

    def _block(self, timed: TimedTasks, first: int, readings: FloatArray, output: FloatArray) -> Block:
        """What was read as a block; ``output`` has one value more, that of the row after it."""
        with self._lock:
            if self._zero_from is None:
                self._output = float(output[-1])
            else:
                rows = np.arange(first, first + len(output))
                output = np.where(rows >= self._zero_from, 0.0, output)
        by_name = dict(zip(self._measured, readings, strict=True))
        return Block(first, by_name, output[:-1], timed.temperatures(first + len(output) - 1))

    def _left(self, block: Block) -> float | None:
        """What a block shows at the output [V] although it should long be gone; None where nothing is left."""
        if self._zero_from is None or block.first_row < self._zero_from + SETTLED * self._rate:
            return None
        return left_at_output(self.rig, {name: float(np.mean(values)) for name, values in block.readings.items()})

    def _stop(self, timed: TimedTasks) -> None:
        """Stop the clock, then the output, which keeps its last voltage."""
        with self._lock:
            timed.stop_clock()
            timed.close()
            self._timed = None

    def _abandon(self, feed: Feed | None = None, given: int = 0) -> None:
        """Leave a signal that did not end; the output keeps what it gives by now."""
        with self._lock:
            timed, self._timed = self._timed, None
            if timed is None:
                return
            with suppress(IpmclabError):
                unread = timed.sampled() - given
                timed.stop_clock()
                if feed is not None and self._zero_from is None and unread > 0:
                    self._output = float(feed.again(unread)[-1])
            timed.close()

    def exchange(self, voltage: float) -> dict[str, float]:
        """Read every channel once, then give a voltage out: see ``Bench.exchange``."""
        self._opened()
        check_voltage(self.rig, voltage)
        with self._lock:
            demand = self._demand
            if self._timed is not None or demand is None:
                raise InputError(
                    "a signal is being given out", code="bench-busy", where="bench", repair="let it end first"
                )
            try:
                readings = demand.read()
                self._safe = False
                demand.write(voltage)
            except IpmclabError as error:
                raise self._failed(error) from error.__cause__
            self._output = voltage
        return readings

    def zero(self) -> None:
        """Bring the output to 0 V now: see ``Bench.zero``. The inputs continue, so that the discharge is seen.

        Raises
        ------
        BenchError
            The output could not be brought to 0 V. After an earlier failure this is that failure, whose message now
            says so.
        """
        with self._lock:
            driver, demand = self._driver, self._demand
            if driver is None or demand is None:
                return
            if driver.lost is not None and self._safe:
                return
            self._zeros += 1
            try:
                self._zero_on_demand(demand)
            except IpmclabError as error:
                self._zero_by_reset(driver, demand, error)
            self._output = 0.0
            self._safe = True
            self._reported_danger = False

    def _zero_on_demand(self, demand: OnDemand) -> None:
        timed = self._timed
        if timed is not None:
            timed.stop_output()
            demand.write(0.0)
            self._zero_since(timed)
            return
        demand.write(0.0)
        if "voltage" in self._measured:
            left = settled(self.rig, demand)
            demand.release_inputs()
            if left is not None and abs(left) > TOLERANCE:
                raise stuck_error(left)

    def _zero_since(self, timed: TimedTasks) -> None:
        """The rows that are sampled from here on show 0 V; where some did before, it is from those on."""
        if self._zero_from is None:
            self._zero_from = timed.sampled()

    def _zero_by_reset(self, driver: Driver, demand: OnDemand, error: IpmclabError) -> None:
        """The last means: reset the output's module, through another connection where this one is lost."""
        try:
            if driver.lost is not None:
                reset(self.rig)
                return
            demand.close()  # the reset takes its reservation away
            driver.reset(driver.modules()[:1])
            if error.code == "output-stuck":
                raise error
            if self._timed is not None:
                self._zero_since(self._timed)
            else:
                see_zero(driver)
        except IpmclabError as also:
            self._reported_danger = True
            raise self._failed(_not_zeroed(self._failure, also)) from also

    def close(self) -> None:
        """Bring the output to 0 V and let go of the chassis. May be called twice.

        Raises
        ------
        BenchError
            The output could not be brought to 0 V, unless ``zero`` has reported that before.
        """
        with self._lock:
            driver, demand = self._driver, self._demand
            if driver is None or demand is None:
                return
            was_reported = self._reported_danger
            try:
                self.zero()
            except BenchError:
                if not was_reported:
                    raise
            finally:
                self._abandon()
                demand.close()
                driver.close()
                self._driver = self._demand = None
                if self._hold is not None:
                    self._hold.release()

    def _opened(self) -> Driver:
        if self._driver is None:
            raise InputError("the bench is not open", code="bench-closed", where="bench", repair="call open first")
        return self._driver

    def _failed(self, error: IpmclabError) -> IpmclabError:
        """Keep the first failure."""
        if self._failure is None and not isinstance(error, InputError):
            self._failure = error
        return error


def _not_zeroed(first: IpmclabError | None, also: IpmclabError) -> IpmclabError:
    """That the output may still drive the strip, reported with the first failure where there was one."""
    unread = also.code == "output-unread"
    danger = "it is not known that the output is at 0 V" if unread else "the output could not be brought to 0 V"
    if first is None:
        return BenchError(
            f"{danger}: {also.message}",
            code=also.code if unread else "output-not-zero",
            where=also.where,
            repair="switch the amplifier off",
        )
    if danger not in first.message and first is not also:
        first.message = f"{first.message}; {danger} ({also.message}): switch the amplifier off"
    return first
