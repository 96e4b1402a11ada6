"""Watlow F4T: Modbus by TCP (port 502) or a serial port.

The registers are those of its user's guide and of ESPEC North America's ChamberConnectLibrary (MIT); nothing here was
ever tried on a controller.
"""

from __future__ import annotations

import math
import time
from typing import Final

from ipmclab.errors import InputError
from ipmclab.rig.chambers.chamber import Conditions, Mode, Ranges
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.driver import Driver
from ipmclab.rig.chambers.line import garbled
from ipmclab.rig.chambers.readings import HUMIDITIES, TEMPERATURES
from ipmclab.rig.chambers.registers import Landmark, Registers

CELSIUS, FAHRENHEIT = 15, 30
OFF, AUTO, MANUAL = 62, 10, 54
ON: Final = 63
"""Words of a Watlow, which it writes as numbers."""

UNIT_BY_TCP, UNIT_BY_SERIAL_PORT = 6730, 14080
"""Where it says in which unit it gives temperatures; as it leaves the factory, in degrees Fahrenheit."""

NEXT_LOOP: Final = 160
READING, SET_POINT, MODE, ACTIVE_MODE = 2820, 2782, 2730, 2814
"""Of the first loop, the temperature; the humidity is the second."""

PROGRAM_STATE, PROGRAM_ACTION = 16568, 16566
_PROGRAM_RUNS: Final = (149, 146)  # running, paused
_TERMINATE: Final = 148

EVENTS: Final = (16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828)
ALARMS: Final = 4
ALARM, NEXT_ALARM = 1356, 100
_NO_ALARM: Final = (61, 88, 12)


def landmark(unit_register: int) -> Landmark:
    """The unit: 15 and 30 are the numbers of no mode and no alarm."""
    return Landmark(unit_register, (CELSIUS, FAHRENHEIT))


class WatlowF4T(Driver):
    """A chamber that a Watlow F4T regulates: loop 1 its temperature, loop 2 its humidity.

    Parameters
    ----------
    registers : Registers
    ranges : Ranges
    unit_register : int
        ``UNIT_BY_TCP`` or ``UNIT_BY_SERIAL_PORT``.
    run_event : int, optional
        The number of the event output (1 to 8) that lets the chamber run, where it has one.
    """

    def __init__(
        self, registers: Registers, ranges: Ranges, unit_register: int = UNIT_BY_TCP, run_event: int | None = None
    ) -> None:
        super().__init__(registers.where, ranges)
        self._registers = registers
        self._unit_register = unit_register
        if run_event is not None and not 1 <= run_event <= len(EVENTS):
            raise InputError(
                f"there is no event {run_event}, they go from 1 to {len(EVENTS)}",
                code="out-of-range",
                where="chamber.run_event",
                repair="look into the manual of the chamber which one starts it",
            )
        self._event = None if run_event is None else EVENTS[run_event - 1]
        self._is_humid = False
        self._loops = (0,) if ranges.relative_humidity is None else (0, NEXT_LOOP)

    def _identify(self, deadline: Deadline) -> None:
        self._is_fahrenheit(deadline)

    def _state(self, deadline: Deadline) -> Conditions:
        mode, regulated = self._modes(deadline)
        fahrenheit = self._is_fahrenheit(deadline)
        warm = _celsius(self._value(READING, deadline), fahrenheit)
        humid = self._value(READING + NEXT_LOOP, deadline) if len(self._loops) > 1 else None
        if not TEMPERATURES[0] <= warm <= TEMPERATURES[1] or not HUMIDITIES[0] <= (humid or 0.0) <= HUMIDITIES[1]:
            raise garbled(self.where, (warm, humid))
        set_points = [self._value(SET_POINT + loop, deadline) if loop in regulated else None for loop in (0, NEXT_LOOP)]
        wanted = set_points[0]
        return Conditions(
            time.monotonic(),
            warm,
            humid,
            mode,
            self._alarms(deadline),
            None if wanted is None else _celsius(wanted, fahrenheit),
            set_points[1],
        )

    def _does(self, deadline: Deadline) -> Mode:
        return self._modes(deadline)[0]

    def _modes(self, deadline: Deadline) -> tuple[Mode, tuple[int, ...]]:
        """What the chamber does, and the loops that are regulated."""
        if self._number(PROGRAM_STATE, deadline) in _PROGRAM_RUNS:
            return "program", self._loops
        modes = {loop: self._number(ACTIVE_MODE + loop, deadline) for loop in self._loops}
        for found in modes.values():
            if found not in (OFF, AUTO, MANUAL):
                raise garbled(self.where, found)
        if MANUAL in modes.values():
            return "program", self._loops  # somebody gives its heater a power by hand
        regulated = tuple(loop for loop, found in modes.items() if found == AUTO)
        return ("constant" if regulated else "standby"), regulated

    def _alarms(self, deadline: Deadline) -> tuple[str, ...]:
        states = [self._number(ALARM + place * NEXT_ALARM, deadline) for place in range(ALARMS)]
        return tuple(f"alarm {place}" for place, state in enumerate(states, 1) if state not in _NO_ALARM)

    def _send_temperature(self, temperature: float, deadline: Deadline) -> None:
        number = 1.8 * temperature + 32.0 if self._is_fahrenheit(deadline) else temperature
        self._registers.write(SET_POINT, number, "float32", deadline)

    def _send_humidity(self, relative_humidity: float | None, deadline: Deadline) -> None:
        if len(self._loops) == 1:
            return
        if relative_humidity is not None:
            self._registers.write(SET_POINT + NEXT_LOOP, relative_humidity, "float32", deadline)
        self._is_humid = relative_humidity is not None

    def _start(self, deadline: Deadline) -> None:
        # The humidity first: with the temperature the chamber runs.
        if len(self._loops) > 1:
            self._registers.write(MODE + NEXT_LOOP, AUTO if self._is_humid else OFF, "uint16", deadline)
        self._registers.write(MODE, AUTO, "uint16", deadline)
        if self._event is not None:
            self._registers.write(self._event, ON, "uint16", deadline)

    def _standby(self, deadline: Deadline) -> None:
        if self._number(PROGRAM_STATE, deadline) in _PROGRAM_RUNS:
            self._registers.write(PROGRAM_ACTION, _TERMINATE, "uint16", deadline)
        for loop in self._loops:
            self._registers.write(MODE + loop, OFF, "uint16", deadline)
        if self._event is not None:
            self._registers.write(self._event, OFF, "uint16", deadline)

    def _hang_up(self) -> None:
        self._registers.close()

    def _is_fahrenheit(self, deadline: Deadline) -> bool:
        """Asked each time: somebody may change it at the panel."""
        unit = self._number(self._unit_register, deadline)
        if unit not in (CELSIUS, FAHRENHEIT):
            raise garbled(self.where, unit)
        return unit == FAHRENHEIT

    def _number(self, address: int, deadline: Deadline) -> int:
        return round(self._registers.read(address, "uint16", deadline))

    def _value(self, address: int, deadline: Deadline) -> float:
        value = self._registers.read(address, "float32", deadline)
        if not math.isfinite(value):
            raise garbled(self.where, value)
        return value


def _celsius(value: float, is_fahrenheit: bool) -> float:
    return (value - 32.0) / 1.8 if is_fahrenheit else value
