"""The layer that hands voltages to a bench: none beyond the limit of the strip passes it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Literal

from ipmclab.errors import InputError
from ipmclab.rig.bench import Bench, Block
from ipmclab.rig.channels import Rig
from ipmclab.rig.request import check_signal
from ipmclab.rig.safety.clamped import Clamped
from ipmclab.rig.safety.limits import Limits
from ipmclab.signals import Signal

if TYPE_CHECKING:
    from ipmclab.sample import Sample


class GuardedBench:
    """A bench that refuses every voltage beyond the limit of the strip, and clamps what it hands on.

    Parameters
    ----------
    bench : Bench
    limits : Limits

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.rig import VirtualBench
    >>> bench = GuardedBench(VirtualBench(load_actuator("friend-2")), Limits())
    >>> bench.open(["voltage"], 50.0)
    >>> try:
    ...     bench.exchange(35.0)
    ... except InputError as error:
    ...     print(error)
    voltage: 35 V is asked for, the limit of the strip is 3.5 V; give a smaller voltage
    >>> bench.close()
    """

    def __init__(self, bench: Bench, limits: Limits) -> None:
        self._bench = bench
        self._limits = limits
        self._rate = 0.0
        self._checked: tuple[Signal, int, float] | None = None
        self.rig: Rig = bench.rig

    @property
    def origin(self) -> Literal["measured", "virtual bench"]:
        """That of the bench: a chassis tells what it is once it is open."""
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
        """Take hold of the bench: see ``Bench.open``."""
        self._bench.open(measured, rate)
        self._rate = rate

    def check(self, signal: Signal, rows: int, rate: float) -> None:
        """Refuse a signal before anything moves: looking at hours of it takes seconds, so ``apply`` does not again.

        Parameters
        ----------
        signal : Signal
        rows : int
        rate : float [Hz]

        Raises
        ------
        InputError
            A voltage beyond the limit, or beyond what the output can give.
        """
        check_signal(self.rig, signal, rows, rate)
        self._limits.refuse(signal, rows / rate, rate)
        self._checked = (signal, rows, rate)

    def apply(self, signal: Signal, rows: int, *, more: int = 0) -> Iterator[Block]:
        """Give a signal out, and read: see ``Bench.apply``.

        Parameters
        ----------
        signal : Signal
        rows : int
            After which the output is 0 V.
        more : int
            Rows at 0 V that may be read after them.

        Raises
        ------
        InputError
            A voltage beyond the limit: nothing is given out then.
        """
        checked = self._checked
        if checked is None or checked[0] is not signal or checked[1:] != (rows, self._rate):
            self._limits.refuse(signal, rows / self._rate, self._rate)
        clamped = Clamped(signal, self._limits.voltage.most, rows / self._rate)
        return self._bench.apply(clamped, rows + more)

    def exchange(self, voltage: float) -> dict[str, float]:
        """Read every channel once, then give a voltage out: see ``Bench.exchange``.

        Raises
        ------
        InputError
            A voltage beyond the limit: nothing is given out then.
        """
        most = self._limits.voltage.most
        if not abs(voltage) <= most:
            raise InputError(
                f"{voltage:g} V is asked for, the limit of the strip is {most:g} V",
                code="voltage-limit",
                where="voltage",
                repair="give a smaller voltage",
            )
        return self._bench.exchange(voltage)

    def zero(self) -> None:
        """Bring the output to 0 V now."""
        self._bench.zero()

    def close(self) -> None:
        """Bring the output to 0 V and let go of the bench."""
        self._bench.close()
