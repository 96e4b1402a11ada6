"""Registers of an instrument that speaks Modbus, by TCP or a serial port, read and written until a deadline.

The frames are pymodbus's. What it lacks is here: a deadline for the whole, one kind of error, and a way back to the
right place once an answer was missed.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

from ipmclab.rig.chambers.chamber import ChamberError
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.dialogue import ATTEMPTS
from ipmclab.rig.chambers.line import (
    CONNECT_TIME,
    LONGEST_QUIET,
    LOOK,
    Parity,
    Quiet,
    address_of,
    garbled,
    missing,
    serial_client,
    silent,
    unreachable,
)

Kind = Literal["holding", "input"]
Type = Literal["int16", "uint16", "int32", "uint32", "float32"]
WordOrder = Literal["low-first", "high-first"]

_REASONS: Final = {
    1: "it has no such function",
    2: "it has no such register",
    3: "it does not take this value",
    4: "it failed",
    6: "it is busy",
    10: "the gateway has no way to it",
    11: "it does not answer the gateway",
}

MOST_BYTES: Final = 520
"""Two of the longest frames of Modbus: what comes beyond is no answer to one question."""

_WORDS: Final = {"int16": 1, "uint16": 1, "int32": 2, "uint32": 2, "float32": 2}


@dataclass(frozen=True)
class Landmark:
    """A register whose values no other register that is read has, so that an answer to it is known as such."""

    address: int
    values: tuple[int, ...]


Client = Callable[[Deadline], Any]
"""Opens pymodbus's client: ``by_tcp``, ``by_serial_port``. Raises ChamberError."""


class Registers:
    """The registers of one instrument.

    By TCP every answer carries the number of its question. On a serial line it does not: once an answer was missed, the
    landmark is read until it comes, and without a landmark the line has to be quiet for as long as an answer may take.

    Parameters
    ----------
    where : str
        The chamber, for messages.
    client : Client
        See ``by_tcp`` and ``by_serial_port``.
    unit : int
        Number of the instrument on its line.
    patience : float [s]
        How long one answer may take.
    word_order : "low-first" or "high-first"
        Of values of 32 bits.
    landmark : Landmark, optional
    """

    def __init__(
        self,
        where: str,
        client: Client,
        *,
        unit: int = 1,
        patience: float = 3.0,
        word_order: WordOrder = "low-first",
        landmark: Landmark | None = None,
    ) -> None:
        self.where = where
        self._open = client
        self._unit = unit
        self._patience = patience
        self._word_order = "little" if word_order == "low-first" else "big"
        self._landmark = landmark
        self._client: Any = None
        self._lost = False
        self._until = Deadline(0.0)  # of the present question
        self._came = 0  # bytes since that

    def read(self, address: int, type_: Type, deadline: Deadline, kind: Kind = "holding") -> float:
        """The value of a register, or of two. Raises ChamberError."""
        words = self._ask(lambda client: self._read(client, address, _WORDS[type_], kind), deadline)
        assert words is not None
        value = self._client.convert_from_registers(words, self._data_type(type_), word_order=self._word_order)
        return float(value)

    def write(self, address: int, value: float, type_: Type, deadline: Deadline) -> None:
        """Give a register a value. Raises ChamberError."""

        def put(client: Any) -> None:
            whole = value if type_ == "float32" else round(value)
            words = client.convert_to_registers(whole, self._data_type(type_), word_order=self._word_order)
            if len(words) == 1:
                _understood(client.write_register(address, words[0], device_id=self._unit), self.where)
            else:
                _understood(client.write_registers(address, words, device_id=self._unit), self.where)

        self._ask(put, deadline)

    def close(self) -> None:
        """Let go of the line."""
        if self._client is not None:
            self._client.close()
        self._client = None

    def _limit(self, client: Any) -> None:
        """On a line that never falls quiet pymodbus searches all that has come for a frame, again with each byte."""
        receive = client.recv

        def receive_some(size: int | None) -> bytes:
            if self._came >= MOST_BYTES or self._until.is_over:
                return b""
            came = bytes(receive(size)[:MOST_BYTES])
            self._came += len(came)
            return came

        client.recv = receive_some

    def _data_type(self, type_: Type) -> Any:
        return getattr(self._client.DATATYPE, type_.upper())

    def _ask(self, what: Callable[[Any], Any], deadline: Deadline) -> Any:
        """Do something with the client, again where it failed, until the deadline."""
        for attempt in range(ATTEMPTS):
            try:
                if self._lost:
                    self.close()
                if self._client is None:
                    self._client = self._open(deadline)
                    self._limit(self._client)
                if self._lost:
                    self._find_place(deadline)
                return self._once(what, deadline)
            except ChamberError as error:
                self._lost = self._lost or error.code != "chamber-refused"
                if attempt == ATTEMPTS - 1 or deadline.is_over or error.code == "no-chamber-client":
                    raise
        raise AssertionError("unreachable")

    def _once(self, what: Callable[[Any], Any], deadline: Deadline) -> Any:
        self._until, self._came = deadline.within(self._patience), 0
        # pymodbus waits at most twice this time: for an answer, and for the rest of it.
        self._client.comm_params.timeout_connect = max(0.5 * self._until.left, 1e-2)
        try:
            return what(self._client)
        except ChamberError:
            raise
        except OSError as error:
            raise unreachable(self.where, error) from error
        except Exception as error:  # pymodbus raises whatever happens to it over bytes that are no frame
            from pymodbus.exceptions import ConnectionException, ModbusIOException

            if isinstance(error, ConnectionException):
                raise unreachable(self.where, "it closed the connection") from error
            if isinstance(error, ModbusIOException) and "No response" in str(error):
                raise silent(self.where, "it does not answer, or not in frames of Modbus") from error
            raise garbled(self.where, str(error)) from error

    def _read(self, client: Any, address: int, count: int, kind: Kind) -> list[int]:
        ask = client.read_holding_registers if kind == "holding" else client.read_input_registers
        answer = _understood(ask(address, count=count, device_id=self._unit), self.where)
        words = list(answer.registers)
        if len(words) != count:
            raise garbled(self.where, words)
        return words

    def _find_place(self, deadline: Deadline) -> None:
        port = self._client.socket
        if hasattr(port, "reset_input_buffer"):  # a serial port
            quiet = min(LONGEST_QUIET if self._landmark is None else 0.1, self._patience)
            self._quieten(port, quiet, deadline)
            landmark = self._landmark
            while landmark is not None:
                found = self._once(lambda client: self._read(client, landmark.address, 1, "holding"), deadline)
                if found[0] in landmark.values:
                    break
                if deadline.is_over:
                    raise garbled(self.where, found)
                self._quieten(port, quiet, deadline)
        self._lost = False

    def _quieten(self, port: Any, quiet: float, deadline: Deadline) -> None:
        """Throw away what comes, until nothing has come for a while. Raises ChamberError."""
        left = Quiet(quiet)
        try:
            while not left.lasted and not deadline.is_over:
                began = time.monotonic()
                time.sleep(LOOK)
                left.looked(port.read(port.in_waiting) if port.in_waiting else b"", time.monotonic() - began)
        except OSError as error:
            raise unreachable(self.where, error) from error


def _pymodbus(where: str) -> Any:
    """pymodbus's clients, which write to nobody's terminal. Raises ChamberError."""
    try:
        from pymodbus import client
    except ImportError as error:
        raise missing(error.name, where) from error
    logging.getLogger("pymodbus").addHandler(logging.NullHandler())
    return client


def by_tcp(host: str, port: int, where: str) -> Client:
    """A client by TCP."""

    def open_(deadline: Deadline) -> Any:
        clients = _pymodbus(where)
        deadline = deadline.within(CONNECT_TIME)
        for *_, address in address_of(host, port, deadline, where):
            client = clients.ModbusTcpClient(str(address[0]), port=port, timeout=max(deadline.left, 1e-2), retries=0)
            if client.connect():
                return client
        raise unreachable(where, "it takes no connection")

    return open_


def by_serial_port(port: str, baud_rate: int, parity: Parity, where: str) -> Client:
    """A client by a serial port (RTU)."""

    def open_(deadline: Deadline) -> Any:
        serial_client(where)
        client = _pymodbus(where).ModbusSerialClient(
            port,
            baudrate=baud_rate,
            parity=parity[0].upper(),
            timeout=max(deadline.within(CONNECT_TIME).left, 1e-2),
            retries=0,
        )
        if not client.connect():
            raise unreachable(where, f"the port {port} is not there, or another program has it")
        return client

    return open_


def _understood(answer: Any, where: str) -> Any:
    """An answer that is no refusal. Raises ChamberError."""
    if answer.isError():
        code = getattr(answer, "exception_code", 0)
        raise ChamberError(
            f"it refuses: {_REASONS.get(code, 'see its manual')} (Modbus exception {code})",
            code="chamber-refused",
            where=where,
            repair="look at its panel, and at the registers of its manual",
        )
    return answer
