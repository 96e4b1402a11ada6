"""Any chamber that speaks text, by a table of its questions and commands (SCPI and the like)."""

from __future__ import annotations

import time
from collections.abc import Callable

from ipmclab.rig.chambers.chamber import ChamberError, Conditions, Mode, Ranges
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.dialogue import Dialogue
from ipmclab.rig.chambers.driver import Driver
from ipmclab.rig.chambers.line import Line
from ipmclab.rig.chambers.readings import SAME_HUMIDITY, SAME_TEMPERATURE, humidity, temperature
from ipmclab.rig.chambers.table_file import TextQuantity, TextTable


class ScpiTable(Driver):
    """A chamber that a table describes.

    Parameters
    ----------
    line : Line
    table : TextTable
    ranges : Ranges
    patience : float [s]
    """

    def __init__(self, line: Line, table: TextTable, ranges: Ranges, patience: float) -> None:
        super().__init__(line.where, ranges)
        self._table = table
        landmark = None if table.identify is None else (table.identify, _is_identity)
        self._dialogue = Dialogue(line, patience, landmark)

    def _identify(self, deadline: Deadline) -> None:
        if self._table.identify is not None:
            self._dialogue.ask(self._table.identify, _identity, deadline)

    def _state(self, deadline: Deadline) -> Conditions:
        self._check_unit(deadline)
        mode = self._does(deadline)
        alarms: tuple[str, ...] = ()
        alarm = self._table.alarm
        if alarm is not None:
            answer = self._dialogue.ask(alarm.ask, _words, deadline)
            alarms = () if answer in alarm.none else (answer,)
        warm, wanted_warm = self._pair(self._table.temperature, temperature, SAME_TEMPERATURE, mode, deadline)
        humid, wanted_humid = None, None
        if self._table.relative_humidity is not None and self._ranges.relative_humidity is not None:
            humid, wanted_humid = self._pair(self._table.relative_humidity, humidity, SAME_HUMIDITY, mode, deadline)
        return Conditions(time.monotonic(), warm, humid, mode, alarms, wanted_warm, wanted_humid)

    def _pair(
        self, quantity: TextQuantity, understand: Callable[[str], float], near: float, mode: Mode, deadline: Deadline
    ) -> tuple[float, float | None]:
        reading = self._dialogue.measure(quantity.ask, understand, near, deadline)
        if mode == "standby":
            return reading, None
        return reading, self._dialogue.ask(quantity.set_point, lambda answer: _or_off(answer, understand), deadline)

    def _does(self, deadline: Deadline) -> Mode:
        run = self._table.run

        def understand(answer: str) -> Mode:
            if answer in run.standby:
                return "standby"
            if answer in run.constant:
                return "constant"
            raise ValueError(answer)

        return self._dialogue.ask(run.ask, understand, deadline)

    def _check_unit(self, deadline: Deadline) -> None:
        unit = self._table.unit
        if unit is None:
            return
        answer = self._dialogue.ask(unit.ask, _words, deadline)
        if answer != unit.celsius:
            raise ChamberError(
                f"it answers {answer!r} to {unit.ask}, and {unit.celsius!r} where it uses degC",
                code="chamber-unit",
                where=self.where,
                repair="set it to degC",
            )

    def _send_temperature(self, temperature: float, deadline: Deadline) -> None:
        self._check_unit(deadline)
        self._command(self._table.temperature.tell.format(value=temperature), deadline)

    def _send_humidity(self, relative_humidity: float | None, deadline: Deadline) -> None:
        quantity = self._table.relative_humidity
        if quantity is None:
            return
        commands = quantity.off if relative_humidity is None else (quantity.tell.format(value=relative_humidity),)
        for command in commands:
            self._command(command, deadline)

    def _start(self, deadline: Deadline) -> None:
        for command in self._table.run.start:
            self._command(command, deadline)

    def _standby(self, deadline: Deadline) -> None:
        for command in self._table.run.stop:
            self._command(command, deadline)

    def _hang_up(self) -> None:
        self._dialogue.close()

    def _command(self, command: str, deadline: Deadline) -> None:
        if self._table.acknowledged is None:
            self._dialogue.say(command, deadline)
            return

        def is_done(answer: str) -> None:
            if answer != self._table.acknowledged:
                raise ValueError(answer)

        self._dialogue.ask(command, is_done, deadline)


def _words(answer: str) -> str:
    if not answer or not answer.isprintable():
        raise ValueError(answer)
    return answer


def _or_off(answer: str, understand: Callable[[str], float]) -> float | None:
    return None if answer.upper() == "OFF" else understand(answer)


def _is_identity(answer: str) -> bool:
    """Who an instrument is: at least maker and model, with a comma between (IEEE 488.2)."""
    return "," in answer and any(letter.isalpha() for letter in answer)


def _identity(answer: str) -> str:
    if not _is_identity(answer):
        raise ValueError(answer)
    return answer
