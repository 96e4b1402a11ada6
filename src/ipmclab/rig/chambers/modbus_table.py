"""Any chamber that speaks Modbus, by a table of its registers."""

from __future__ import annotations

import math
import time

from ipmclab.errors import InputError
from ipmclab.rig.chambers.chamber import Conditions, Mode, Ranges
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.driver import Driver
from ipmclab.rig.chambers.line import garbled
from ipmclab.rig.chambers.readings import HUMIDITIES, TEMPERATURES
from ipmclab.rig.chambers.registers import Registers
from ipmclab.rig.chambers.table_file import RegisterQuantity, RegisterTable, RegisterValue


class ModbusTable(Driver):
    """A chamber that a table describes.

    Parameters
    ----------
    registers : Registers
    table : RegisterTable
    ranges : Ranges
    """

    def __init__(self, registers: Registers, table: RegisterTable, ranges: Ranges) -> None:
        super().__init__(registers.where, ranges)
        self._registers = registers
        self._table = table
        self._is_humid = table.relative_humidity is not None and ranges.relative_humidity is not None

    def set(self, temperature: float, relative_humidity: float | None) -> None:
        """Regulate towards these from now on: see ``Chamber.set``."""
        if relative_humidity is None and self._is_humid:
            raise InputError(
                "a table of registers cannot switch the humidity off: the chamber would keep its last set point",
                code="out-of-range",
                where="relative_humidity",
                repair="give one, or take relative_humidity out of [chamber]",
            )
        super().set(temperature, relative_humidity)

    def _identify(self, deadline: Deadline) -> None:
        self._does(deadline)

    def _state(self, deadline: Deadline) -> Conditions:
        mode = self._does(deadline)
        warm, wanted_warm = self._pair(self._table.temperature, TEMPERATURES, mode, deadline)
        humid, wanted_humid = None, None
        if self._is_humid and self._table.relative_humidity is not None:
            humid, wanted_humid = self._pair(self._table.relative_humidity, HUMIDITIES, mode, deadline)
        alarms: tuple[str, ...] = ()
        if self._table.alarm is not None:
            code = round(self._registers.read(self._table.alarm.number, "uint16", deadline))
            alarms = () if code in self._table.alarm.none else (f"alarm {code}",)
        return Conditions(time.monotonic(), warm, humid, mode, alarms, wanted_warm, wanted_humid)

    def _pair(
        self, quantity: RegisterQuantity, ends: tuple[float, float], mode: Mode, deadline: Deadline
    ) -> tuple[float, float | None]:
        reading = self._value(quantity.reading, ends, deadline)
        return reading, None if mode == "standby" else self._value(quantity.set_point, ends, deadline)

    def _does(self, deadline: Deadline) -> Mode:
        state = round(self._registers.read(self._table.run.state, "uint16", deadline))
        if state in self._table.run.standby:
            return "standby"
        if state in self._table.run.constant:
            return "constant"
        raise garbled(self.where, f"{state} as what it does")

    def _send_temperature(self, temperature: float, deadline: Deadline) -> None:
        self._put(self._table.temperature.set_point, temperature, deadline)

    def _send_humidity(self, relative_humidity: float | None, deadline: Deadline) -> None:
        if self._table.relative_humidity is not None and relative_humidity is not None:
            self._put(self._table.relative_humidity.set_point, relative_humidity, deadline)

    def _start(self, deadline: Deadline) -> None:
        self._registers.write(self._table.run.command, self._table.run.start, "uint16", deadline)

    def _standby(self, deadline: Deadline) -> None:
        self._registers.write(self._table.run.command, self._table.run.stop, "uint16", deadline)

    def _hang_up(self) -> None:
        self._registers.close()

    def _value(self, at: RegisterValue, ends: tuple[float, float], deadline: Deadline) -> float:
        value = at.scale * self._registers.read(at.number, at.type, deadline, at.kind)
        value = (value - 32.0) / 1.8 if at.unit == "degF" else value
        if not math.isfinite(value) or not ends[0] <= value <= ends[1]:
            raise garbled(self.where, value)
        return value

    def _put(self, at: RegisterValue, value: float, deadline: Deadline) -> None:
        number = 1.8 * value + 32.0 if at.unit == "degF" else value
        self._registers.write(at.number, number / at.scale, at.type, deadline)
