"""From the settings of a chamber to the driver that speaks with it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ipmclab.errors import InputError
from ipmclab.rig.chambers.chamber import Chamber, Ranges
from ipmclab.rig.chambers.settings import BAUD_RATES, ChamberSettings

if TYPE_CHECKING:
    from ipmclab.rig.chambers.line import Line

_USUAL_BAUD_RATE = 19200


def open_chamber(settings: ChamberSettings) -> Chamber:
    """A chamber, to which no line is opened before it is first spoken to.

    Parameters
    ----------
    settings : ChamberSettings

    Raises
    ------
    InputError
        A table that cannot be read.

    Examples
    --------
    >>> open_chamber(ChamberSettings("virtual")).read().mode
    'off'
    """
    if settings.is_virtual:
        from ipmclab.rig.chambers.virtual import RANGES, VirtualChamber, VirtualClimate

        if settings.temperature is None:
            return VirtualChamber()
        ranges = Ranges(settings.temperature, settings.relative_humidity or RANGES.relative_humidity)
        return VirtualChamber(climate=VirtualClimate(ranges=ranges))
    if settings.driver == "dew-point":
        return _dew_point(settings)
    if settings.temperature is None:
        raise InputError(
            "its range is missing",
            code="missing-key",
            where="chamber.temperature",
            repair='write temperature = ["10 degC", "60 degC"]: it is never set beyond',
        )
    ranges = Ranges(settings.temperature, settings.relative_humidity)
    return (_by_modbus if settings.driver in ("watlow-f4t", "modbus") else _by_text)(settings, ranges)


def _by_text(settings: ChamberSettings, ranges: Ranges) -> Chamber:
    line = _line(settings, b"\n" if settings.driver == "scpi" else b"\r\n")
    match settings.driver:
        case "espec-p300":
            from ipmclab.rig.chambers.espec_p300 import EspecP300

            return EspecP300(line, ranges, settings.waits)
        case "espec-sh":
            from ipmclab.rig.chambers.espec_sh import EspecSh

            return EspecSh(line, ranges, settings.waits)
    from ipmclab.rig.chambers.scpi_table import ScpiTable
    from ipmclab.rig.chambers.table_file import TextTable, read_table

    return ScpiTable(line, read_table(_table(settings), TextTable), ranges, settings.waits)


def _dew_point(settings: ChamberSettings) -> Chamber:
    from ipmclab.rig.chambers.dew_point import DewPointGenerator

    if settings.cell_temperature is None or settings.relative_humidity is None:
        raise InputError(
            "a dew-point generator needs the temperature of its cell and the range of its humidity",
            code="missing-key",
            where="chamber.cell_temperature",
            repair='write cell_temperature = "25 degC" and relative_humidity = ["5 percent", "95 percent"]',
        )
    line = _line(settings, b"\r")
    return DewPointGenerator(line, settings.cell_temperature, settings.relative_humidity, settings.waits)


def _line(settings: ChamberSettings, end: bytes) -> Line:
    from ipmclab.rig.chambers.line import SerialLine, TcpLine

    if settings.port is not None:
        return SerialLine(settings.port, _baud_rate(settings), settings.parity, end)
    return TcpLine(*settings.host_and_port, end)


def _by_modbus(settings: ChamberSettings, ranges: Ranges) -> Chamber:
    from ipmclab.rig.chambers import watlow_f4t
    from ipmclab.rig.chambers.modbus_table import ModbusTable
    from ipmclab.rig.chambers.registers import Registers, by_serial_port, by_tcp
    from ipmclab.rig.chambers.table_file import RegisterTable, read_table

    where = f"chamber at {settings.where}"
    if settings.port is not None:
        client = by_serial_port(settings.port, _baud_rate(settings), settings.parity, where)
    else:
        client = by_tcp(*settings.host_and_port, where)
    if settings.driver == "modbus":
        table = read_table(_table(settings), RegisterTable)
        registers = Registers(where, client, unit=table.unit_id, patience=settings.waits, word_order=table.word_order)
        return ModbusTable(registers, table, ranges)
    unit_register = watlow_f4t.UNIT_BY_TCP if settings.port is None else watlow_f4t.UNIT_BY_SERIAL_PORT
    registers = Registers(
        where, client, unit=settings.unit, patience=settings.waits, landmark=watlow_f4t.landmark(unit_register)
    )
    return watlow_f4t.WatlowF4T(registers, ranges, unit_register, settings.run_event)


def _baud_rate(settings: ChamberSettings) -> int:
    return settings.baud_rate or BAUD_RATES.get(settings.driver, _USUAL_BAUD_RATE)


def _table(settings: ChamberSettings) -> Path:
    if settings.table is None:
        raise InputError(
            f"the driver {settings.driver} needs a table",
            code="missing-key",
            where="chamber.table",
            repair='write table = "chamber.toml", a file in the folder of the rig file',
        )
    return Path(settings.table)
