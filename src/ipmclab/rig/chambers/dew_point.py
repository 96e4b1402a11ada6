"""A dew-point generator with the words of Thunder Scientific's 3900: ``DP=``, ``GEN``, ``STO``, ``?DP``, ``?TT``.

It regulates no temperature: that of the cell is somebody else's, and the humidity in the cell follows from both. The
words are those of its manual, as far as they could be read; nothing here was ever tried on a generator.
"""

from __future__ import annotations

import time
from typing import Final

from ipmclab.errors import InputError
from ipmclab.model.environment.sorption import dew_point, saturation_pressure
from ipmclab.rig.chambers.chamber import Conditions, Mode, Ranges
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.dialogue import Dialogue
from ipmclab.rig.chambers.driver import Driver
from ipmclab.rig.chambers.line import Line
from ipmclab.rig.chambers.readings import SAME_TEMPERATURE, number, temperature

_DOES: Final[dict[str, Mode]] = {"0": "standby", "1": "constant", "-1": "program"}  # idle, generating, purging
_DEW_POINT: Final = 1
"""Of what it can regulate, and where in its list of set points that is."""

_FAULTS: Final = {
    1: "expansion valve not closing",
    2: "flow valve not closing",
    4: "low supply pressure",
    8: "cabinet too warm",
}


class DewPointGenerator(Driver):
    """A generator of humid gas for a cell.

    Parameters
    ----------
    line : Line
    cell_temperature : float [degC]
        What the cell is kept at, by something else.
    humidities : (float, float) [percent]
        Least and greatest relative humidity in the cell.
    patience : float [s]

    Examples
    --------
    >>> from ipmclab.rig.chambers.line import TcpLine
    >>> generator = DewPointGenerator(TcpLine("192.168.0.11", 10001), 25.0, (5.0, 95.0), patience=3.0)
    >>> round(generator.dew_point(73.799), 3)
    20.0
    """

    def __init__(self, line: Line, cell_temperature: float, humidities: tuple[float, float], patience: float) -> None:
        super().__init__(line.where, Ranges((cell_temperature, cell_temperature), humidities))
        self._cell = cell_temperature
        # Nothing else that is asked is answered with a list.
        self._dialogue = Dialogue(line, patience, landmark=("?SP", lambda answer: answer.count(",") > 2))

    def dew_point(self, relative_humidity: float) -> float:
        """The dew point [degC] that gives a relative humidity [percent] in the cell."""
        return dew_point(self._cell, relative_humidity)

    def set(self, temperature: float, relative_humidity: float | None) -> None:
        """Generate from now on: see ``Chamber.set``."""
        if relative_humidity is None:
            raise InputError(
                "this generator regulates nothing but the humidity",
                code="out-of-range",
                where="relative_humidity",
                repair="give one",
            )
        super().set(temperature, relative_humidity)

    def _identify(self, deadline: Deadline) -> None:
        self._dialogue.ask("?SP", set_points, deadline)

    def _state(self, deadline: Deadline) -> Conditions:
        cell = self._dialogue.measure("?TT", temperature, SAME_TEMPERATURE, deadline)
        dew_point = self._dialogue.measure("?DP", temperature, SAME_TEMPERATURE, deadline)
        mode = self._does(deadline)
        faults = self._dialogue.ask("?ER", _whole, deadline)
        wanted: float | None = None
        if mode != "standby":
            wanted = relative_humidity_at(self._cell, self._dialogue.ask("?SP", set_points, deadline))
        return Conditions(
            time.monotonic(),
            cell,
            relative_humidity_at(cell, dew_point),
            mode,
            fault_words(faults),
            None if wanted is None else self._cell,
            wanted,
        )

    def _does(self, deadline: Deadline) -> Mode:
        def understand(answer: str) -> Mode:
            if answer not in _DOES:
                raise ValueError(answer)
            return _DOES[answer]

        return self._dialogue.ask("?RU", understand, deadline)

    def _send_temperature(self, temperature: float, deadline: Deadline) -> None:
        """Nothing: the cell has a loop of its own."""

    def _send_humidity(self, relative_humidity: float | None, deadline: Deadline) -> None:
        assert relative_humidity is not None
        self._command(f"DP={self.dew_point(relative_humidity):.2f}", deadline)

    def _start(self, deadline: Deadline) -> None:
        self._command("GEN", deadline)

    def _standby(self, deadline: Deadline) -> None:
        self._command("STO", deadline)

    def _hang_up(self) -> None:
        self._dialogue.close()

    def _command(self, words: str, deadline: Deadline) -> None:
        def is_done(answer: str) -> None:
            if answer:
                raise ValueError(answer)

        self._dialogue.ask(words, is_done, deadline)


def set_points(answer: str) -> float:
    """The dew point [degC] in the list that ``?SP`` gives; the last of it says what is regulated. Raises ValueError.

    Examples
    --------
    >>> set_points("19.8, 20.00, 23100, 14400, 73.8, 50.0, 25.0, 2.0, 1")
    20.0
    """
    values = [number(part) for part in answer.split(",")]
    if len(values) < 3 or not 0.0 <= values[-1] <= 5.0:
        raise ValueError(answer)
    return temperature(str(values[_DEW_POINT]))


def relative_humidity_at(cell_temperature: float, dew_point: float) -> float:
    """The relative humidity [percent] of air with some dew point.

    Parameters
    ----------
    cell_temperature, dew_point : float [degC]

    Examples
    --------
    >>> round(relative_humidity_at(25.0, 20.0), 3)
    73.799
    """
    return float(100.0 * saturation_pressure(dew_point) / saturation_pressure(cell_temperature))


def fault_words(number_of_faults: int) -> tuple[str, ...]:
    """What the number of ``?ER`` says, a sum of powers of 2.

    Examples
    --------
    >>> fault_words(0), fault_words(5), fault_words(64)
    ((), ('expansion valve not closing', 'low supply pressure'), ('fault 64',))
    """
    known = tuple(words for bit, words in _FAULTS.items() if number_of_faults & bit)
    rest = number_of_faults & ~sum(_FAULTS)
    return (*known, f"fault {rest}") if rest else known


def _whole(answer: str) -> int:
    if not answer.isdecimal() or len(answer) > 5:
        raise ValueError(answer)
    return int(answer)
