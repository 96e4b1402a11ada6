"""ESPEC P300 and SCP-220: by serial port (19200 baud) or TCP."""

from __future__ import annotations

from typing import Final

from ipmclab.rig.chambers.chamber import Conditions, Mode
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.espec import Espec, alarm_answer, mode_answer
from ipmclab.rig.chambers.line import garbled
from ipmclab.rig.chambers.readings import humidity, temperature

_SAME_TEMPERATURE: Final = 2.0  # K
_SAME_HUMIDITY: Final = 8.0  # percent
_LOOKS: Final = 3


class EspecP300(Espec):
    """Its ``MON?`` states the air in one line, and ``TEMP?`` and ``HUMI?`` state it again.

    Nothing on these lines has a checksum: a reading of 3.0 may be what is left of 23.0. Each reading is therefore taken
    twice, by two questions, and believed where both agree.

    Examples
    --------
    >>> from ipmclab.rig.chambers.chamber import Ranges
    >>> from ipmclab.rig.chambers.line import TcpLine
    >>> chamber = EspecP300(TcpLine("192.168.0.10", 10001), Ranges((-20.0, 100.0), (20.0, 98.0)), patience=3.0)
    >>> chamber.ranges.temperature, chamber.where
    ((-20.0, 100.0), 'chamber at 192.168.0.10:10001')
    """

    def _state(self, deadline: Deadline) -> Conditions:
        for _ in range(_LOOKS):
            warm, humid, mode, count = self._ask("MON?", monitor_answer, deadline)
            air = self._air(deadline)
            same = abs(air[0][0] - warm) <= _SAME_TEMPERATURE
            if humid is not None and air[1] is not None:
                same = same and abs(air[1][0] - humid) <= _SAME_HUMIDITY
            if same:
                alarms = self._ask("ALARM?", alarm_answer, deadline) if count else ()
                return self._conditions(mode, alarms, air)
        raise garbled(self.where, f"{warm:g} degC to MON? and {air[0][0]:g} degC to TEMP?")

    def _start(self, deadline: Deadline) -> None:
        self._command("MODE,CONSTANT", deadline)


def monitor_answer(answer: str) -> tuple[float, float | None, Mode, int]:
    """What ``MON?`` says: temperature [degC], humidity [percent], mode, how many alarms. Raises ValueError.

    Examples
    --------
    >>> monitor_answer("23.0,60,CONSTANT,0"), monitor_answer("23.0,,OFF,1")
    ((23.0, 60.0, 'constant', 0), (23.0, None, 'off', 1))
    """
    warm, humid, mode, count = (part.strip() for part in answer.split(","))
    if not count.isdecimal():
        raise ValueError(answer)
    return temperature(warm), humidity(humid) if humid else None, mode_answer(mode), int(count)
