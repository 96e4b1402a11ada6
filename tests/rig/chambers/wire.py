"""Emulated instruments at the end of a real line: a TCP socket, or a pseudo-terminal where there are such things.

Whatever a real line does to answers is done here: late, in halves, cut, garbled, after noise, not at all, or the
connection is closed. What the instrument itself does is in ``devices.py``.
"""

from __future__ import annotations

import os
import random
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Literal, Protocol

Kind = Literal["late", "halves", "cut", "garbage", "noise", "silence", "close", "gone", "bit", "flood"]
"""``noise``: before the answer; ``gone``: the connection is closed and none is taken; ``bit``: one bit is turned;
``flood``: lines that nobody asked for, without an end where the fault lasts."""

LINE_FAULTS: tuple[Kind, ...] = (
    "late",
    "halves",
    "cut",
    "garbage",
    "noise",
    "silence",
    "close",
    "gone",
    "bit",
    "flood",
)


@dataclass(frozen=True)
class Fault:
    """What becomes of answers.

    Parameters
    ----------
    kind : Kind
    after : int
        So many answers are well before.
    lasts : int
        So many are not.
    seconds : float
        How late, between the halves, or how long a flood that does not last.
    """

    kind: Kind
    after: int = 0
    lasts: int = 10**9
    seconds: float = 0.5


class Device(Protocol):
    """An instrument: cuts what comes into questions, and answers each."""

    def questions(self, came: bytes) -> tuple[list[bytes], bytes]:
        """The whole questions in what has come, and the rest."""

    def answer(self, question: bytes) -> bytes:
        """What it answers; nothing where it does not."""


class Emulator:
    """An instrument on a line; ``fault`` may be set at any moment."""

    def __init__(self, device: Device, seed: int = 0) -> None:
        self.device = device
        self.asked = 0
        self._fault: Fault | None = None
        self._since = 0
        self._drawn = random.Random(seed)
        self._stop = threading.Event()
        self._closers: list[Callable[[], None]] = []
        self._threads: list[threading.Thread] = []

    @property
    def fault(self) -> Fault | None:
        return self._fault

    @fault.setter
    def fault(self, fault: Fault | None) -> None:
        self._fault, self._since = fault, self.asked

    @property
    def is_bad(self) -> Kind | None:
        """What becomes of the answer to the present question."""
        fault = self._fault
        if fault is None:
            return None
        place = self.asked - self._since - fault.after
        return fault.kind if 0 < place <= fault.lasts else None

    def stop(self) -> None:
        self._stop.set()
        for close in self._closers:
            with suppress(OSError):
                close()
        for thread in self._threads:
            thread.join(5.0)

    def _serve(self, receive: Callable[[], bytes | None], write: Callable[[bytes], None]) -> None:
        """Answer on one connection until it is closed."""
        left = b""
        while not self._stop.is_set():
            came = receive()
            if came is None:
                return
            questions, left = self.device.questions(left + came)
            for question in questions:
                self.asked += 1
                kind = self.is_bad
                answer = self.device.answer(question)
                if kind in ("close", "gone"):
                    return
                if answer:
                    self._send(answer, kind, write)

    def _send(self, answer: bytes, kind: Kind | None, write: Callable[[bytes], None]) -> None:
        seconds = 0.0 if self._fault is None else self._fault.seconds
        middle = max(1, len(answer) // 2)
        match kind:
            case None:
                write(answer)
            case "late":
                fault, until = self._fault, time.monotonic() + seconds
                while time.monotonic() < until and self._fault is fault and not self._stop.is_set():
                    time.sleep(0.02)
                write(answer)
            case "flood":
                fault, until = (
                    self._fault,
                    time.monotonic() + (seconds if self._fault and self._fault.lasts < 100 else 1e9),
                )
                while time.monotonic() < until and self._fault is fault and not self._stop.is_set():
                    write(b"0.0\r\n" * 100)
                    time.sleep(0.01 * seconds)  # 0: they come sooner than anybody understands them
                write(answer)
            case "halves":
                write(answer[:middle])
                self._stop.wait(min(seconds, 0.1))
                write(answer[middle:])
            case "cut":
                write(answer[:middle])
            case "garbage":
                write(self._drawn.randbytes(len(answer)) + b"\r\n")
            case "noise":
                write(self._drawn.randbytes(3) + answer)
            case "bit":
                place = self._drawn.randrange(len(answer))
                write(answer[:place] + bytes([answer[place] ^ (1 << self._drawn.randrange(7))]) + answer[place + 1 :])
            case _:
                pass


class TcpEmulator(Emulator):
    """An instrument at a socket of this computer; ``port`` is known at once."""

    def __init__(self, device: Device, seed: int = 0) -> None:
        super().__init__(device, seed)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.05)
        self.port = self._listener.getsockname()[1]
        self._closers.append(self._listener.close)
        self._start(self._accept)

    def _start(self, run: Callable[[], None]) -> None:
        thread = threading.Thread(target=run, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while not self._stop.is_set():
            if self._fault is not None and self._fault.kind == "gone" and self.asked > self._since + self._fault.after:
                time.sleep(0.05)  # it listens, and nobody takes the connection
                continue
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            connection.settimeout(0.05)
            self._start(lambda connection=connection: self._talk(connection))

    def _talk(self, connection: socket.socket) -> None:
        def receive() -> bytes | None:
            try:
                return connection.recv(4096) or None
            except TimeoutError:
                return b""

        with connection, suppress(OSError):
            self._serve(receive, connection.sendall)


class PtyEmulator(Emulator):
    """An instrument at a pseudo-terminal; ``port`` is its name."""

    def __init__(self, device: Device, seed: int = 0) -> None:
        import tty

        super().__init__(device, seed)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        thread = threading.Thread(target=self._run, daemon=True)
        self._threads.append(thread)
        thread.start()

    def stop(self) -> None:
        super().stop()
        os.close(self._master)
        os.close(self._slave)

    def _run(self) -> None:
        def receive() -> bytes | None:
            ready, _, _ = select.select([self._master], [], [], 0.05)
            return os.read(self._master, 4096) if ready else b""

        def write(answer: bytes) -> None:
            if select.select([], [self._master], [], 0.05)[1]:  # nobody reads: what does not fit is lost, as on a wire
                os.write(self._master, answer)

        while not self._stop.is_set():  # a serial line has no connection that could be closed
            with suppress(OSError):
                self._serve(receive, write)


@contextmanager
def at_socket(device: Device, seed: int = 0) -> Iterator[TcpEmulator]:
    emulator = TcpEmulator(device, seed)
    try:
        yield emulator
    finally:
        emulator.stop()


@contextmanager
def at_terminal(device: Device, seed: int = 0) -> Iterator[PtyEmulator]:
    emulator = PtyEmulator(device, seed)
    try:
        yield emulator
    finally:
        emulator.stop()
