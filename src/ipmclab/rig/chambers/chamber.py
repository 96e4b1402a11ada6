"""What every environmental chamber can do, whatever language it speaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, Protocol

from ipmclab.errors import InputError, IpmclabError

DEADLINE: Final = 30.0
"""No call of a chamber takes longer [s]: what was not answered until then is a ``ChamberError``."""

Mode = Literal["constant", "program", "standby", "off", "unknown"]
"""What a chamber does: it holds set points, follows a program of its own, waits, or is off."""


class ChamberError(IpmclabError):
    """A chamber that does not answer, answers what nobody understands, refuses, or raises an alarm.

    Its ``code`` is ``"chamber-silent"``, ``"chamber-garbled"``, ``"chamber-refused"``, ``"chamber-alarm"`` or
    ``"chamber-in-use"``; ``where`` names the chamber, and ``repair`` says what to do.
    """


@dataclass(frozen=True)
class Ranges:
    """What a chamber can be set to.

    Parameters
    ----------
    temperature : (float, float) [degC]
        Least and greatest.
    relative_humidity : (float, float) [percent], optional
        Least and greatest; None where it regulates no humidity.

    Examples
    --------
    >>> Ranges((-10.0, 100.0), (10.0, 98.0)).check(120.0, None)
    Traceback (most recent call last):
    ...
    ipmclab.errors.InputError: temperature: 120 degC is outside -10 to 100 degC; give what the chamber can reach
    """

    temperature: tuple[float, float]
    relative_humidity: tuple[float, float] | None = None

    def check(self, temperature: float | None, relative_humidity: float | None) -> None:
        """Refuse set points that the chamber does not have.

        Parameters
        ----------
        temperature : float [degC], optional
        relative_humidity : float [percent], optional

        Raises
        ------
        InputError
        """
        asked = (
            ("temperature", temperature, self.temperature, "degC"),
            ("relative_humidity", relative_humidity, self.relative_humidity, "percent"),
        )
        for name, value, ends, unit in asked:
            if value is None:
                continue
            if ends is None:
                raise InputError(
                    "this chamber regulates no humidity",
                    code="out-of-range",
                    where=name,
                    repair="leave it out, or use another chamber",
                )
            low, high = ends
            if not low <= value <= high:
                raise InputError(
                    f"{value:g} {unit} is outside {low:g} to {high:g} {unit}",
                    code="out-of-range",
                    where=name,
                    repair="give what the chamber can reach",
                )


@dataclass(frozen=True)
class Conditions:
    """What a chamber reports of itself.

    Parameters
    ----------
    time : float [s]
        When it was read, on the clock of the chamber's driver: that of the computer (``time.monotonic``), or that of a
        simulated bench.
    temperature : float [degC]
        By its own sensor.
    relative_humidity : float [percent], optional
        By its own sensor; None where it has none.
    mode : "constant", "program", "standby", "off" or "unknown"
    alarms : tuple of str
        In its own words; empty where all is well.
    temperature_set_point : float [degC], humidity_set_point : float [percent], optional
        As the chamber states them: None where it regulates none.

    Examples
    --------
    >>> str(Conditions(0.0, 24.9, 59.2, "constant", ("water tank empty",), 25.0, 60.0))
    '24.9 degC (set to 25), 59.2 %RH (set to 60), constant, alarm: water tank empty'
    """

    time: float
    temperature: float
    relative_humidity: float | None
    mode: Mode
    alarms: tuple[str, ...] = ()
    temperature_set_point: float | None = None
    humidity_set_point: float | None = None

    def __str__(self) -> str:
        """As people say it."""
        parts = [f"{self.temperature:.1f} degC{_set_to(self.temperature_set_point)}"]
        if self.relative_humidity is not None:
            parts.append(f"{self.relative_humidity:.1f} %RH{_set_to(self.humidity_set_point)}")
        parts.append(self.mode)
        return ", ".join([*parts, *(f"alarm: {alarm}" for alarm in self.alarms)])


@dataclass(frozen=True)
class Stillness:
    """What to expect of a chamber whose fan and compressor are off.

    Parameters
    ----------
    longest : float [s]
        After so long it must be resumed.
    temperature_drift : float [K], humidity_drift : float [percent], optional
        How far the air may go from where it was until then; None where the driver cannot know.
    """

    longest: float
    temperature_drift: float | None = None
    humidity_drift: float | None = None


class Chamber(Protocol):
    """An environmental chamber.

    Every call returns within ``DEADLINE`` or raises ChamberError, and may be made from any thread.
    """

    @property
    def ranges(self) -> Ranges:
        """What it can be set to."""

    def set(self, temperature: float, relative_humidity: float | None) -> None:
        """Regulate towards these from now on.

        Parameters
        ----------
        temperature : float [degC]
        relative_humidity : float [percent], optional
            None regulates no humidity.

        Raises
        ------
        InputError
            Outside ``ranges``.
        ChamberError
        """

    def read(self) -> Conditions:
        """What it is like now. Raises ChamberError."""

    def still(self, longest: float) -> Stillness:
        """Fan and compressor off, so that nothing shakes the strip, for at most so long [s]. Raises ChamberError."""

    def resume(self) -> None:
        """Regulate again as before ``still``; nothing where it is not still. Raises ChamberError."""

    def safe(self) -> None:
        """Regulate nothing (standby). Works at any time, also after errors and more than once. Raises ChamberError
        only where the chamber could not be reached."""

    def close(self) -> None:
        """Let go of the line to it, and leave it as it is. May be called twice."""


def _set_to(value: float | None) -> str:
    return "" if value is None else f" (set to {value:g})"
