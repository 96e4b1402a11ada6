"""The output of a rig goes to 0 V from anywhere, by a reset over a connection of its own."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import Rig
from ipmclab.rig.daqmx.client import client
from ipmclab.rig.daqmx.driver import Driver
from ipmclab.rig.daqmx.look_back import SETTLED, read_output
from ipmclab.rig.safety.readback import TOLERANCE, channels_at_output

if TYPE_CHECKING:
    pass


ANSWER: Final = 5.0
"""Time [s] for a server to answer when a bench is opened."""


_ANSWER_AFTER_FAILURE: Final = 1.5
"""The same after a failure: enough for a server that is being restarted, short for one that hangs."""


_RESET_TIME: Final = 5.0
"""Time [s] for the reset of a module."""


_OTHERS_READ: Final = 1.0
"""So long [s] an output that another program reads is waited for: the guardian of one that has just died does so."""


_LONGEST_RESET: Final = 1.2
"""What a guardian allows a reset at most [s]: it leaves behind what takes 1.5 s."""


def reset(rig: Rig) -> None:
    """Bring the output of a rig to 0 V from anywhere, through a connection of its own, and read it back.

    Resets every module of the rig: outputs go to 0 V, reservations are freed, and whatever another program
    was doing on them is aborted. This is what the guardian does when the recorder is silent, and what every
    bench does when it is opened.

    Parameters
    ----------
    rig : Rig

    Raises
    ------
    BenchError
        No driver, no server, no such module; ``"output-stuck"`` where a voltage is still read, ``"output-unread"``
        where nothing could be read.
    """
    driver = Driver(client(), rig, wait=_ANSWER_AFTER_FAILURE, patience=_ANSWER_AFTER_FAILURE)
    try:
        driver.be_patient(_RESET_TIME)
        driver.reset(driver.modules())
        see_zero(driver)
    finally:
        driver.close()


class Resetter:
    """A connection that is kept ready to bring the output of a rig to 0 V at once, for a guardian.

    Parameters
    ----------
    rig : Rig
        Of which only the output, the address and the channels that read what the output gives are looked at.
    within : float [s]
        How long a reset may take. The next one after a failure may take so much longer, up to 1.2 s: a server that
        is slow would else never be known to have brought its output to 0 V.

    Raises
    ------
    BenchError
        No driver, no server.
    """

    def __init__(self, rig: Rig, *, within: float = 0.4) -> None:
        self._rig = rig
        self._within = within
        self._allowed = within
        self._driver = Driver(client(), rig, wait=ANSWER)
        self._driver.be_patient(within)

    def reset(self) -> None:
        """Reset the module of the output. May be called again, also after it failed: it connects again then.

        Raises
        ------
        BenchError
        """
        self._connect()
        self._driver.reset(self._driver.modules()[:1])
        self._allowed = self._within
        self._driver.be_patient(self._within)

    def read(self) -> float:
        """What the output gives [V]. Inputs that a recorder holds which is gone, or silent, are reset for it.

        Raises
        ------
        BenchError
            It cannot be read.
        """
        self._connect()
        try:
            return read_output(self._driver)
        except BenchError as error:
            if error.code != "bench-in-use":
                raise
        self._driver.reset(self._driver.modules(channels_at_output(self._rig)))
        return read_output(self._driver)

    def _connect(self) -> None:
        """Again, where the connection was lost."""
        if self._driver.lost is not None:
            self._driver.close()
            self._allowed = min(self._allowed + self._within, max(_LONGEST_RESET, self._within))
            self._driver = Driver(client(), self._rig, wait=self._allowed, patience=self._allowed)

    def close(self) -> None:
        """Let go of the connection. May be called twice."""
        self._driver.close()


def see_zero(driver: Driver) -> None:
    """Read the output back; a rig whose channels cannot show it is known for that.

    Raises
    ------
    BenchError
        It is not at 0 V, or it could not be read.
    """
    if not channels_at_output(driver.rig):
        return
    try:
        volts = _read_back(driver)
    except IpmclabError as error:
        raise BenchError(
            f"the output was reset, but it could not be read back: {error.message}",
            code="output-unread",
            where=error.where,
            repair="see that it is at 0 V, or switch the amplifier off",
        ) from error
    if abs(volts) > TOLERANCE:
        raise stuck_error(volts)


def _read_back(driver: Driver) -> float:
    end = time.monotonic() + _OTHERS_READ
    while True:
        try:
            return read_output(driver)
        except IpmclabError as error:
            if error.code != "bench-in-use" or time.monotonic() >= end:
                raise
        time.sleep(SETTLED)


def stuck_error(volts: float) -> BenchError:
    return BenchError(
        f"the output was set to 0 V, but {volts:.3g} V are still read",
        code="output-stuck",
        where="voltage",
        repair="switch the amplifier off, then look at its wiring and at that of the output",
    )
