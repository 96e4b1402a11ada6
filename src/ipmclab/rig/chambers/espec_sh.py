"""ESPEC SH and SU series (the SH-262 of the thesis): by serial port, 9600 baud."""

from __future__ import annotations

from typing import Final

from ipmclab.rig.chambers.chamber import ChamberError, Conditions, Mode
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.espec import Espec, alarm_answer
from ipmclab.rig.chambers.line import garbled
from ipmclab.rig.chambers.readings import SAME_HUMIDITY, SAME_TEMPERATURE

_LOOKS: Final = 3


class EspecSh(Espec):
    """Fewer words than a P300: where it refuses ``MODE?`` its mode is unknown, and alarms where it refuses ``ALARM?``.

    Each reading is taken twice and believed where both agree, for nothing on the line has a checksum.

    Examples
    --------
    >>> from ipmclab.rig.chambers.chamber import Ranges
    >>> from ipmclab.rig.chambers.line import SerialLine
    >>> chamber = EspecSh(SerialLine("COM3", 9600), Ranges((-40.0, 150.0), (30.0, 95.0)), patience=5.0)
    >>> chamber.where
    'chamber at COM3'
    """

    humidity_digits = 0

    def _state(self, deadline: Deadline) -> Conditions:
        before = self._air(deadline)
        for _ in range(_LOOKS):
            air = self._air(deadline)
            same = abs(air[0][0] - before[0][0]) <= SAME_TEMPERATURE and air[0][1] == before[0][1]
            if air[1] is not None and before[1] is not None:
                same = same and abs(air[1][0] - before[1][0]) <= SAME_HUMIDITY and air[1][1] == before[1][1]
            if same:
                return self._conditions(self._does(deadline), self._alarms(deadline), air)
            before = air
        raise garbled(self.where, f"{before[0][0]:g} degC to one TEMP? and {air[0][0]:g} degC to the next")

    def _start(self, deadline: Deadline) -> None:
        self._command("POWER,ON", deadline)
        self._command("MODE,CONSTANT", deadline)

    def _does(self, deadline: Deadline) -> Mode:
        try:
            return super()._does(deadline)
        except ChamberError as error:
            if error.code != "chamber-refused":
                raise
            return "unknown"

    def _alarms(self, deadline: Deadline) -> tuple[str, ...]:
        try:
            return self._ask("ALARM?", alarm_answer, deadline)
        except ChamberError as error:
            if error.code != "chamber-refused":
                raise
            return ()
