"""The layer that passes voltages to a bench: none beyond the limit of the strip passes it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Literal

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import Bench, BenchError, Block
from ipmclab.rig.channels import Rig
from ipmclab.rig.request import check_rows
from ipmclab.rig.rows import ClampedRows, RowSource, SignalRows, as_rows
from ipmclab.rig.safety.guard import Alarm
from ipmclab.rig.safety.limits import Limits
from ipmclab.rig.safety.row_watch import RowWatch
from ipmclab.signals import Signal

if TYPE_CHECKING:
    from ipmclab.sample import Sample


class LimitPassed(IpmclabError):
    """A reading is beyond a limit of the strip; the output was brought to 0 V (exit status 1).

    Parameters
    ----------
    alarm : Alarm
    """

    def __init__(self, alarm: Alarm) -> None:
        super().__init__(
            str(alarm),
            code="limit-passed",
            where=alarm.limit,
            repair="let the strip rest, then open the bench again and ask for less",
        )
        self.alarm = alarm


class GuardedBench:
    """A bench that refuses every voltage beyond the limit of the strip, and clamps what it passes on.

    Rows that are played block after block are clamped here, and their readings are guarded by who records them. Single
    rows, read and given out on demand, are guarded here with the same limits: each reading is looked at before the next
    voltage is given out.

    Parameters
    ----------
    bench : Bench
    limits : Limits
    on_warning : callable of Alarm, optional
        Called with a limit of ``exchange`` that does not end it.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.rig.virtual import VirtualBench
    >>> bench = GuardedBench(VirtualBench(load_actuator("friend-2")), Limits())
    >>> bench.open(["voltage"], 50.0)
    >>> try:
    ...     bench.exchange(35.0)
    ... except InputError as error:
    ...     print(error)
    voltage: 35 V is asked for, the limit of the strip is 3.5 V; give a smaller voltage
    >>> bench.close()
    """

    def __init__(self, bench: Bench, limits: Limits, on_warning: Callable[[Alarm], None] | None = None) -> None:
        self._bench = bench
        self._limits = limits
        self._on_warning = on_warning
        self._checked: tuple[RowSource, float] | None = None
        self._lock = threading.RLock()  # zero may come from another thread, or from a signal handler of this one
        self._opened: tuple[float, RowWatch] | None = None  # with its rate
        self._ended: IpmclabError | None = None
        self._zeroed = threading.Event()  # since the bench was last asked to open
        self.rig: Rig = bench.rig

    @property
    def origin(self) -> Literal["measured", "virtual bench"]:
        """That of the bench: a chassis states what it is once it is open."""
        return self._bench.origin

    @property
    def description(self) -> str:
        """The bench as a text for the record."""
        return self._bench.description

    @property
    def sample(self) -> Sample | None:
        """The strip in the clamp."""
        return self._bench.sample

    def open(self, measured: Collection[str], rate: float) -> None:
        """Take hold of the bench: see ``Bench.open``. Voltage and current are always read: most limits need them."""
        known = [channel.name for channel in self.rig.channels]
        names = tuple(dict.fromkeys([*measured, *(name for name in ("voltage", "current") if name in known)]))
        self._zeroed.clear()
        self._bench.open(names, rate)
        with self._lock:
            self._opened = rate, RowWatch(self._limits, rate, self.rig, names)
            self._ended = None
            if self._zeroed.is_set():  # what comes while the bench is being opened holds for what is opened
                self.zero()

    def subtract(self, zeros: Mapping[str, float]) -> None:
        """Subtract from the readings of ``exchange`` what the channels read at rest.

        Parameters
        ----------
        zeros : mapping of channel to float [SI unit of the channel]
        """
        _, watch = self._check_open()
        watch.subtract(zeros)

    def check(self, source: RowSource, rate: float) -> None:
        """Refuse a signal before anything moves: looking at hours of it takes seconds, so ``apply`` does not again.

        The voltages of other sources are not known beforehand; they are clamped as they come.

        Parameters
        ----------
        source : RowSource
        rate : float [Hz]

        Raises
        ------
        InputError
            A voltage beyond the limit, or beyond what the output can give.
        """
        self._refuse(source, rate)
        self._checked = (source, rate)

    def _refuse(self, source: RowSource, rate: float) -> None:
        if isinstance(source, SignalRows):
            self._limits.refuse(source.signal, source.length / rate, rate)
            most, output = self._limits.voltage.most, self.rig.output
            if output.low > -most or output.high < most:  # otherwise it gives all that the strip withstands
                check_rows(self.rig, source, rate)

    def apply(self, source: Signal | RowSource, rows: int | None = None, *, more: int = 0) -> Iterator[Block]:
        """Give rows out, and read: see ``Bench.apply``.

        Parameters
        ----------
        source : Signal or RowSource
        rows : int, optional
            Of a signal. After the last row the output is 0 V.
        more : int
            Rows at 0 V that may be read after them.

        Raises
        ------
        InputError
            A signal with a voltage beyond the limit: nothing is given out then.
        """
        rate, _ = self._check_open()
        played = as_rows(source, rows)
        checked, at_rate = self._checked or (None, None)
        if played is not checked or rate != at_rate:
            self._refuse(played, rate)
        most, output = self._limits.voltage.most, self.rig.output
        return self._bench.apply(ClampedRows(played, max(-most, output.low), min(most, output.high), more))

    def exchange(self, voltage: float, row: int | None = None) -> dict[str, float]:
        """Read every channel once, then give a voltage out: see ``Bench.exchange``.

        The limits are watched with what was read; the temperature, which a thermometer reads in addition to the
        channels, is not. Where one is passed, the output is brought to 0 V, as it is after any other failure. Once it
        was, also by ``zero`` from elsewhere, only 0 V is given out until the bench is opened again.

        Parameters
        ----------
        voltage : float [V]
        row : int, optional
            Of this reading by the clock of the caller; the one after the last where it is left out. Rows between them
            were missed, and count as the larger of their neighbours.

        Raises
        ------
        InputError
            A voltage beyond the limit: nothing is given out then.
        LimitPassed
            A limit that ends the run was passed, now or before.
        IpmclabError
            The output was brought to 0 V before.
        BenchError
            The hardware failed, or the output does not go to 0 V.
        """
        most = self._limits.voltage.most
        if not abs(voltage) <= most:
            raise InputError(
                f"{voltage:g} V is asked for, the limit of the strip is {most:g} V",
                code="voltage-limit",
                where="voltage",
                repair="give a smaller voltage",
            )
        with self._lock:
            _, watch = self._check_open()
            if self._ended is not None and voltage != 0.0:
                raise self._ended
            with self._zero_on_failure():
                readings = self._bench.exchange(voltage)
                if self._ended is not None:  # a signal handler of this thread brought the output to 0 V meanwhile
                    self._bench.zero()
                alarms = watch.look(readings, row)
            self._act(alarms)
        return readings

    def _act(self, alarms: Sequence[Alarm]) -> None:
        """Do what limits that were passed ask for: the output goes to 0 V before anyone is informed."""
        for one in alarms:
            if one.kind == "stuck":
                raise output_stuck(one)
        ending = next((one for one in alarms if one.action != "warn"), None)
        passed = None if ending is None else LimitPassed(ending)
        if passed is not None:
            self._ended = passed
            self.zero()
        if self._on_warning is not None:
            with self._zero_on_failure():
                for one in alarms:
                    if one.action == "warn":
                        self._on_warning(one)
        if passed is not None:
            raise passed

    def _check_open(self) -> tuple[float, RowWatch]:
        if self._opened is None:
            raise InputError("the bench is not open", code="bench-closed", where="bench", repair="call open first")
        return self._opened

    @contextmanager
    def _zero_on_failure(self) -> Iterator[None]:
        """Whatever fails, the strip is not left at the last voltage."""
        try:
            yield
        except BaseException:
            with suppress(IpmclabError):  # what failed first is what is reported
                self.zero()
            raise

    def zero(self) -> None:
        """Bring the output to 0 V now."""
        self._zeroed.set()
        if self._ended is None:
            self._ended = IpmclabError(
                "the output was brought to 0 V",
                code="zeroed",
                where="voltage",
                repair="open the bench again before another voltage is given out",
            )
        with self._lock:
            if self._opened is not None:  # first, so that an output not at 0 V is reported later too
                self._opened[1].zeroed()
            self._bench.zero()

    def close(self) -> None:
        """Bring the output to 0 V and let go of the bench."""
        self._bench.close()


def output_stuck(alarm: Alarm) -> BenchError:
    """The error of an output that does not go to 0 V."""
    return BenchError(str(alarm), code="output-stuck", where="voltage", repair="switch the output amplifier off")
