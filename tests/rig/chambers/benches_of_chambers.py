"""Every driver beside an emulated instrument for it, by TCP and on a serial line."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ipmclab.rig.chambers.chamber import Chamber
from ipmclab.rig.chambers.drivers import open_chamber
from ipmclab.rig.chambers.settings import MOST_PATIENCE, ChamberSettings
from tests.rig.chambers.devices import (
    MODBUS_TABLE,
    SCPI_TABLE,
    DewPointDevice,
    EspecDevice,
    F4TDevice,
    PlainModbusDevice,
    Room,
    ScpiDevice,
)
from tests.rig.chambers.wire import Emulator, at_socket, at_terminal

Case = TypeVar("Case")

Quick = Callable[[], AbstractContextManager[None]]
"""Of the fixture ``quick``."""

HAS_TERMINALS = hasattr(os, "openpty")


@dataclass(frozen=True)
class Kind:
    """A driver, its instrument, and the line between."""

    driver: str
    serial: bool
    device: Callable[[], Any]
    table: str = ""

    def __str__(self) -> str:
        return f"{self.driver}-{'serial' if self.serial else 'tcp'}"


KINDS = [
    Kind("espec-p300", False, EspecDevice),
    Kind("espec-p300", True, EspecDevice),
    Kind("espec-sh", True, lambda: EspecDevice(sh=True)),
    Kind("watlow-f4t", False, F4TDevice),
    Kind("watlow-f4t", True, lambda: F4TDevice(rtu=True)),
    Kind("dew-point", True, DewPointDevice),
    Kind("scpi", False, ScpiDevice, SCPI_TABLE),
    Kind("scpi", True, ScpiDevice, SCPI_TABLE),
    Kind("modbus", False, PlainModbusDevice, MODBUS_TABLE),
    Kind("modbus", True, lambda: PlainModbusDevice(rtu=True), MODBUS_TABLE),
]
"""Without the serial ones where there are no pseudo-terminals (Windows)."""
KINDS = [kind for kind in KINDS if HAS_TERMINALS or not kind.serial]

BY_CONVERTER = [Kind("espec-sh", False, lambda: EspecDevice(sh=True)), Kind("dew-point", False, DewPointDevice)]
"""Serial instruments behind a converter to Ethernet."""

WANTED = (25.0, 60.0)
"""What every one of them can be set to."""


@dataclass
class Pair:
    """A driver and its emulated instrument."""

    chamber: Chamber
    emulator: Emulator
    device: Any

    @property
    def room(self) -> Room:
        return self.device.room


@contextmanager
def paired(kind: Kind, folder: Path, *, patience: float = MOST_PATIENCE, seed: int = 0) -> Iterator[Pair]:
    """A driver that speaks with an emulated instrument, and waits for its answers however busy the machine is.

    Where answers fail to come, ``patience`` [s] says how long it waits for each.
    """
    device = kind.device()
    with (at_terminal if kind.serial else at_socket)(device, seed) as emulator:
        table = None
        if kind.table:
            path = folder / f"{kind}-{Path(str(emulator.port)).name}.toml"
            path.write_text(kind.table, encoding="utf-8")
            table = str(path)
        settings = ChamberSettings(
            kind.driver,  # type: ignore[arg-type]
            None if kind.driver == "dew-point" else (0.0, 60.0),
            (5.0, 95.0),
            port=str(emulator.port) if kind.serial else None,
            address=None if kind.serial else f"127.0.0.1:{emulator.port}",
            baud_rate=38400 if kind.serial else None,
            patience=patience,
            table=table,
            cell_temperature=25.0 if kind.driver == "dew-point" else None,
        )
        chamber = open_chamber(settings)
        try:
            yield Pair(chamber, emulator, device)
        finally:
            chamber.close()


def at_once(hold: Callable[[Case], None], cases: Iterable[Case]) -> None:
    """Hold some cases beside each other, for each of them mostly waits; an error names its case."""

    def one(case: Case) -> None:
        try:
            hold(case)
        except BaseException as error:
            error.add_note(f"case: {case}")
            raise

    with ThreadPoolExecutor(10) as pool:
        for held in [pool.submit(one, case) for case in cases]:
            held.result()


def set_by_another(pair: Pair, kind: Kind) -> None:
    """Another client sets 42 %RH; by TCP it is one, on a serial line somebody at the panel."""
    if kind.serial or kind.driver not in ("espec-p300", "scpi"):
        if kind.driver == "dew-point":
            pair.device.reply("DP=11.00")
        else:
            pair.room.humidity_set_point = 42.0
        return
    words = {"espec-p300": b"HUMI,S42.0\r\n", "scpi": b":SOURCE:CLOOP2:SPOINT 42\n"}[kind.driver]
    with socket.create_connection(("127.0.0.1", pair.emulator.port), timeout=5.0) as other:  # type: ignore[attr-defined]
        other.sendall(words + b"TYPE?\r\n*IDN?\n")
        other.recv(64)
