"""The words that the controllers of ESPEC's chambers have in common: ``TEMP?``, ``HUMI?``, ``MODE,STANDBY``.

A question ends with a question mark. A command is answered with ``OK``, most controllers repeat it behind a colon, or
with ``NA:`` and the reason. The words were read in ESPEC North America's ChamberConnectLibrary (MIT) and in ATWG's
driver of an SH-641; nothing here was ever tried on a chamber.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, TypeVar

from ipmclab.rig.chambers.chamber import ChamberError, Conditions, Mode, Ranges
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.dialogue import Dialogue
from ipmclab.rig.chambers.driver import Driver
from ipmclab.rig.chambers.line import Line
from ipmclab.rig.chambers.readings import humidity, number, temperature

Meaning = TypeVar("Meaning")

_MOST: Final = 200.0
"""No chamber of these series goes higher [degC]: what states more is in degrees Fahrenheit."""

_MODES: Final[dict[str, Mode]] = {"CONSTANT": "constant", "STANDBY": "standby", "OFF": "off"}

_REASONS: Final = {
    "CMD ERR": "it does not know this command",
    "PARA ERR": "it does not understand the value",
    "DATA OUT OF RANGE": "the value is outside the limits that are set at its panel",
    "PROTECT ON": "its panel is locked against changes",
    "CHB NOT READY": "it is not ready",
    "CONT NOT READY-1": "it regulates no humidity",
    "INVALID REQ": "it has no such function",
}


class Espec(Driver):
    """A chamber of ESPEC.

    Parameters
    ----------
    line : Line
    ranges : Ranges
    patience : float [s]
        How long one answer may take.
    """

    humidity_digits = 1
    """Behind the point, in a set point of the humidity."""

    def __init__(self, line: Line, ranges: Ranges, patience: float) -> None:
        super().__init__(line.where, ranges)
        self._dialogue = Dialogue(line, patience, landmark=("TYPE?", _is_type))

    def _identify(self, deadline: Deadline) -> None:
        most = self._ask("TYPE?", _type, deadline)
        if most > _MOST:
            raise ChamberError(
                f"its upper limit is {most:g} degrees: it uses degrees Fahrenheit",
                code="chamber-unit",
                where=self.where,
                repair="set it to degC at its panel",
            )

    def _send_temperature(self, temperature: float, deadline: Deadline) -> None:
        self._command(f"TEMP,S{temperature:.1f}", deadline)

    def _send_humidity(self, relative_humidity: float | None, deadline: Deadline) -> None:
        if relative_humidity is not None:
            self._command(f"HUMI,S{relative_humidity:.{self.humidity_digits}f}", deadline)
        elif self._ranges.relative_humidity is not None:
            self._command("HUMI,SOFF", deadline)

    def _does(self, deadline: Deadline) -> Mode:
        return self._ask("MODE?", mode_answer, deadline)

    def _standby(self, deadline: Deadline) -> None:
        self._command("MODE,STANDBY", deadline)

    def _hang_up(self) -> None:
        self._dialogue.close()

    def _command(self, words: str, deadline: Deadline) -> None:
        """Send it something, and see that it understood just that. Raises ChamberError."""
        bare = words.replace(" ", "")

        def is_done(answer: str) -> None:
            verdict, _, repeated = answer.replace(" ", "").partition(":")
            if verdict != "OK" or repeated not in ("", bare):
                raise ValueError(answer)

        self._ask(words, is_done, deadline)

    def _ask(self, question: str, understand: Callable[[str], Meaning], deadline: Deadline) -> Meaning:
        def refusal_or(answer: str) -> Meaning:
            if answer.startswith("NA:"):
                reason = answer.removeprefix("NA:").strip()
                raise ChamberError(
                    f"it refuses {question}: {_REASONS.get(reason, 'see its manual')} ({reason})",
                    code="chamber-refused",
                    where=self.where,
                    repair="look at its panel",
                )
            return understand(answer)

        return self._dialogue.ask(question, refusal_or, deadline)

    def _air(self, deadline: Deadline) -> tuple[tuple[float, float], tuple[float, float | None] | None]:
        """Reading and set point, of the temperature and of the humidity."""
        of_temperature = self._ask("TEMP?", temperature_answer, deadline)
        if self._ranges.relative_humidity is None:
            return of_temperature, None
        return of_temperature, self._ask("HUMI?", humidity_answer, deadline)

    def _conditions(
        self,
        mode: Mode,
        alarms: tuple[str, ...],
        air: tuple[tuple[float, float], tuple[float, float | None] | None],
    ) -> Conditions:
        (warm, wanted), humid = air
        regulates = mode not in ("standby", "off")
        return Conditions(
            time.monotonic(),
            warm,
            None if humid is None else humid[0],
            mode,
            alarms,
            wanted if regulates else None,
            humid[1] if regulates and humid is not None else None,
        )


def temperature_answer(answer: str) -> tuple[float, float]:
    """Reading and set point [degC] of ``TEMP?``; the limits of its alarm follow. Raises ValueError.

    Examples
    --------
    >>> temperature_answer("26.4,0.0,140.0,-50.0")
    (26.4, 0.0)
    """
    reading, set_point, high, low = answer.split(",")
    number(high), number(low)
    return temperature(reading), temperature(set_point)


def humidity_answer(answer: str) -> tuple[float, float | None]:
    """Reading and set point [percent] of ``HUMI?``; None for OFF. Raises ValueError.

    Examples
    --------
    >>> humidity_answer("25,85,100,0"), humidity_answer("25,OFF,100,0")
    ((25.0, 85.0), (25.0, None))
    """
    reading, set_point, high, low = answer.split(",")
    number(high), number(low)
    return humidity(reading), None if set_point.strip() == "OFF" else humidity(set_point)


def mode_answer(answer: str) -> Mode:
    """What ``MODE?`` says. Raises ValueError.

    Examples
    --------
    >>> mode_answer("RUN PAUSE"), mode_answer("STANDBY")
    ('program', 'standby')
    """
    word = answer.strip().partition(",")[0]
    if word.startswith(("RUN", "RMT RUN")):
        return "program"
    try:
        return _MODES[word]
    except KeyError:
        raise ValueError(f"{word!r} is no mode") from None


def alarm_answer(answer: str) -> tuple[str, ...]:
    """What ``ALARM?`` says: how many, and their numbers. Raises ValueError.

    Examples
    --------
    >>> alarm_answer("0"), alarm_answer("2,1,26")
    ((), ('alarm 1', 'alarm 26'))
    """
    count, *codes = (part.strip() for part in answer.split(","))
    if not all(part.isdecimal() for part in (count, *codes)) or int(count) != len(codes):
        raise ValueError(answer)
    return tuple(f"alarm {code}" for code in codes)


def _type(answer: str) -> float:
    """The largest temperature in the answer to ``TYPE?``. Raises ValueError."""
    *kinds, most = answer.split(",")
    if len(kinds) < 2 or not kinds[0].strip().isalpha():
        raise ValueError(answer)
    return number(most)


def _is_type(answer: str) -> bool:
    try:
        _type(answer)
    except ValueError:
        return False
    return True
