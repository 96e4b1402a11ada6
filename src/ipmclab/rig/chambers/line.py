"""A line to an instrument that speaks text: one question, one answer, each until a deadline."""

from __future__ import annotations

import socket
import threading
import time
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Any, Final, Literal

from ipmclab.extras import how_to_install
from ipmclab.rig.chambers.chamber import ChamberError
from ipmclab.rig.chambers.deadline import Deadline

LONGEST_ANSWER: Final = 4096
"""No answer of a chamber is longer [byte]: what continues without an end is no answer."""

CONNECT_TIME: Final = 3.0
"""A chamber in the same building takes a connection sooner [s]."""

LONGEST_QUIET: Final = 3.0
"""A line that has lost its place is listened to at most so long [s]: half the time of a reading is left to ask."""

_GLANCE: Final = 0.1
"""So long [s] a connection is listened to before the deadline is looked at again."""

LOOK: Final = 0.005
"""How often [s] a line that should be quiet is looked at."""

_LONGEST_LOOK: Final = 4.0 * LOOK  # the sleep of a system may be as coarse

Parity = Literal["none", "even", "odd"]


class Quiet:
    """For how long nothing came on a line that was listened to.

    A program that was held up has not listened meanwhile: what came then waits to be read, and what an instrument was
    about to say comes afterwards. One look counts no more than it should take.

    Examples
    --------
    >>> quiet = Quiet(0.5)
    >>> quiet.looked(b"", 3.0)
    >>> quiet.lasted
    False
    """

    def __init__(self, seconds: float) -> None:
        self._left = self._seconds = seconds

    @property
    def lasted(self) -> bool:
        """Whether it was as long as it has to be."""
        return self._left <= 0.0

    def looked(self, came: bytes, took: float) -> None:
        """A look at the line, which took so long [s]."""
        self._left = self._seconds if came else self._left - min(took, _LONGEST_LOOK)


def silent(where: str, message: str) -> ChamberError:
    """The error of a chamber that does not answer."""
    return ChamberError(
        message, code="chamber-silent", where=where, repair="see that it is switched on, and look at its cable"
    )


def unreachable(where: str, why: object) -> ChamberError:
    """The error of a chamber to which there is no line."""
    return ChamberError(
        f"there is no line to it: {why}",
        code="chamber-unreachable",
        where=where,
        repair="see that it is switched on, look at its cable, and end other programs that use it",
    )


def garbled(where: str, answer: object) -> ChamberError:
    """The error of a chamber that is not understood."""
    return ChamberError(
        f"it answers {answer!r:.80}, which nobody understands",
        code="chamber-garbled",
        where=where,
        repair="look at the cable and its shield, the baud rate, the parity, and that the driver is the right one",
    )


def address_of(host: str, port: int, deadline: Deadline, where: str) -> list[tuple[Any, ...]]:
    """What ``socket`` needs to connect; the system's own search for a name knows no deadline.

    Raises
    ------
    ChamberError
    """
    found: list[tuple[Any, ...]] = []
    reasons: list[object] = []

    def search() -> None:
        try:
            found.extend(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))
        except (OSError, UnicodeError) as error:
            reasons.append(error)

    thread = threading.Thread(target=search, name="name of a chamber", daemon=True)
    thread.start()
    thread.join(deadline.left)
    if not found:
        raise unreachable(where, reasons[0] if reasons else f"nobody says where {host} is")
    return found


class Line(ABC):
    """One question, one answer.

    A line opens when it is first used, and again after ``drop``. Its answers end with a line feed.

    Parameters
    ----------
    where : str
        What the messages name: the chamber.
    end : bytes
        What ends a question.
    """

    def __init__(self, where: str, end: bytes = b"\r\n") -> None:
        self.where = where
        self._end = end
        self._left = b""

    def ask(self, question: str, deadline: Deadline) -> str:
        """Say something and wait for what comes back; what had come before is thrown away.

        Parameters
        ----------
        question : str
            ASCII.
        deadline : Deadline

        Returns
        -------
        answer : str
            Without its end.

        Raises
        ------
        ChamberError
        """
        self.tell(question, deadline)
        return self.hear(deadline)

    def tell(self, question: str, deadline: Deadline) -> None:
        """Say something. Raises ChamberError."""
        self._open(deadline)
        self._left = b""
        try:
            while not deadline.is_over and self._receive(Deadline(0.0)):
                pass
            self._send(question.encode("ascii") + self._end, deadline)
        except OSError as error:
            self.drop()
            raise unreachable(self.where, error) from error

    def hear(self, deadline: Deadline) -> str:
        """The next answer. Raises ChamberError."""
        while b"\n" not in self._left:
            if len(self._left) > LONGEST_ANSWER:
                raise garbled(self.where, self._left[:40])
            try:
                came = self._receive(deadline)
            except OSError as error:
                self.drop()
                raise unreachable(self.where, error) from error
            if deadline.is_over and b"\n" not in came:
                raise silent(self.where, f"it answers only {self._left!r:.40}" if self._left else "it does not answer")
            self._left += came
        answer, _, self._left = self._left.partition(b"\n")
        try:
            return answer.decode("ascii").strip()
        except UnicodeDecodeError as error:
            raise garbled(self.where, answer) from error

    def quieten(self, quiet: float, deadline: Deadline) -> bool:
        """Throw away what comes, until nothing has come for so long [s]; whether that was so. Raises ChamberError."""
        self._open(deadline)
        left = Quiet(quiet)
        try:
            while not left.lasted and not deadline.is_over:
                began = time.monotonic()
                left.looked(self._receive(deadline.within(LOOK)), time.monotonic() - began)
        except OSError as error:
            self.drop()
            raise unreachable(self.where, error) from error
        return left.lasted

    @abstractmethod
    def drop(self) -> None:
        """Let go of the line; never fails."""

    @abstractmethod
    def _open(self, deadline: Deadline) -> None:
        """Open the line where it is not. Raises ChamberError."""

    @abstractmethod
    def _send(self, what: bytes, deadline: Deadline) -> None:
        """Raises OSError."""

    @abstractmethod
    def _receive(self, deadline: Deadline) -> bytes:
        """What has come, as soon as something has; nothing where the deadline is over. Raises OSError."""


class TcpLine(Line):
    """A line by TCP.

    Parameters
    ----------
    host : str
    port : int
    end : bytes
    """

    def __init__(self, host: str, port: int, end: bytes = b"\r\n") -> None:
        super().__init__(f"chamber at {host}:{port}", end)
        self._host, self._port = host, port
        self._socket: socket.socket | None = None

    def drop(self) -> None:
        """Close the connection."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def _open(self, deadline: Deadline) -> None:
        if self._socket is not None:
            return
        deadline = deadline.within(CONNECT_TIME)
        self._left = b""
        reason: object = "no time was left"
        for family, kind, protocol, _, address in address_of(self._host, self._port, deadline, self.where):
            opened = socket.socket(family, kind, protocol)
            opened.settimeout(max(deadline.left, 1e-3))
            try:
                opened.connect(address)
            except OSError as error:
                opened.close()
                reason = error
            else:
                self._socket = opened
                return
        raise unreachable(self.where, reason)

    def _send(self, what: bytes, deadline: Deadline) -> None:
        assert self._socket is not None
        self._socket.settimeout(max(deadline.left, 1e-3))
        self._socket.sendall(what)

    def _receive(self, deadline: Deadline) -> bytes:
        assert self._socket is not None
        while True:
            # 0: what has come already, without waiting. In small steps, as another thread may cut the deadline.
            self._socket.settimeout(min(deadline.left, _GLANCE))
            try:
                came = self._socket.recv(LONGEST_ANSWER)
            except (TimeoutError, BlockingIOError):
                if deadline.is_over:
                    return b""
                continue
            if not came:
                raise ConnectionResetError("it closed the connection")
            return came


class SerialLine(Line):
    """A line by a serial port.

    Parameters
    ----------
    port : str
        As the system calls it: ``"COM3"``, ``"/dev/ttyUSB0"``.
    baud_rate : int
    parity : "none", "even" or "odd"
    end : bytes
    """

    def __init__(self, port: str, baud_rate: int, parity: Parity = "none", end: bytes = b"\r\n") -> None:
        super().__init__(f"chamber at {port}", end)
        self._port, self._baud_rate, self._parity = port, baud_rate, parity[0].upper()
        self._serial: Any = None

    def drop(self) -> None:
        """Close the port."""
        if self._serial is not None:
            with suppress(OSError):  # a converter that was unplugged
                self._serial.close()
        self._serial = None

    def _open(self, deadline: Deadline) -> None:
        if self._serial is not None:
            return
        serial = serial_client(self.where)
        self._left = b""
        try:
            self._serial = serial.Serial(
                self._port,
                self._baud_rate,
                parity=self._parity,
                timeout=0,
                write_timeout=max(deadline.within(CONNECT_TIME).left, 1e-3),
                exclusive=True,
            )
        except (OSError, ValueError) as error:  # an unknown port, one that is in use, a rate that it does not have
            raise unreachable(self.where, error) from error

    def _send(self, what: bytes, deadline: Deadline) -> None:
        self._serial.write_timeout = max(deadline.left, 1e-3)
        self._serial.write(what)

    def _receive(self, deadline: Deadline) -> bytes:
        # By looking again and again: a port that is read with a time of its own waits differently on each system.
        while True:
            came = self._serial.read(LONGEST_ANSWER)
            if came or deadline.is_over:
                return bytes(came)
            time.sleep(0.005)


def serial_client(where: str) -> Any:
    """pyserial.

    Raises
    ------
    ChamberError
        It is not installed.
    """
    try:
        import serial
    except ImportError as error:
        raise missing(error.name, where) from error
    return serial


def missing(name: str | None, where: str) -> ChamberError:
    """The error of a client that is not installed."""
    return ChamberError(
        f"{name} is not installed: this chamber is spoken to through it",
        code="no-chamber-client",
        where=where,
        repair=how_to_install("chamber"),
    )
