"""The conditions of an experiment: what the chamber is set to, and when a strip is in equilibrium with it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from ipmclab.errors import InputError
from ipmclab.signals import Signal
from ipmclab.store.strict import Strict
from ipmclab.units import RELATIVE_HUMIDITY, TEMPERATURE, TIME, Quantity, parse_quantity

Order = Literal["palindromic", "listed"]

MOST_CONDITIONS: Final = 200
"""A plan of more takes longer than any strip lives."""

EXAMPLES: Final = {
    "temperature": "25 degC",
    "temperature_tolerance": "1 degC",
    "relative_humidity": "80 percent",
    "humidity_tolerance": "3 percent",
    "settle": "30 min",
    "longest_wait": "3 h",
    "longest_still": "10 min",
    "temperature_drift": "1 degC",
    "humidity_drift": "5 percent",
}
"""What is where a quantity of an environment belongs, for messages."""


class ConditionTable(Strict):
    """One of ``[[environments]]``."""

    temperature: str | None = None
    relative_humidity: str | None = None


class EnvironmentTable(ConditionTable):
    """``[environment]``."""

    temperature_tolerance: str = "1 degC"
    humidity_tolerance: str = "3 percent"
    settle: str = "30 min"
    longest_wait: str = "3 h"
    longest_still: str = "10 min"
    temperature_drift: str = "1 degC"
    humidity_drift: str = "5 percent"
    order: Order = "palindromic"


class ReferenceTable(ConditionTable):
    """``[reference]``."""

    every: Annotated[int, Field(ge=1)] = 4
    signal: str | None = None


@dataclass(frozen=True)
class TargetEnvironment:
    """What the chamber is set to, and when the strip counts as being in equilibrium with it.

    Parameters
    ----------
    temperature : float [degC], optional
    relative_humidity : float [percent], optional
    temperature_tolerance : float [K], humidity_tolerance : float [percent]
        How far from the target a reading may be.
    settle : float [s]
        How long every reading must stay within the tolerance.
    longest_wait : float [s]
        When to give up.
    longest_still : float [s]
        A run that takes longer is recorded with the chamber at work.
    temperature_drift : float [K], humidity_drift : float [percent]
        How far the air may go while the chamber is still, before it is resumed.
    """

    temperature: float | None
    relative_humidity: float | None
    temperature_tolerance: float
    humidity_tolerance: float
    settle: float
    longest_wait: float
    longest_still: float = 600.0
    temperature_drift: float = 1.0
    humidity_drift: float = 5.0

    def __str__(self) -> str:
        """The target as people say it."""
        parts = []
        if self.temperature is not None:
            parts.append(f"{self.temperature:g} +- {self.temperature_tolerance:g} degC")
        if self.relative_humidity is not None:
            parts.append(f"{self.relative_humidity:g} +- {self.humidity_tolerance:g} %RH")
        return ", ".join(parts)

    @property
    def name(self) -> str:
        """The condition alone.

        Examples
        --------
        >>> TargetEnvironment(25.0, 60.0, 1.0, 3.0, 1800.0, 10800.0).name
        '25 degC, 60 %RH'
        """
        parts = [] if self.temperature is None else [f"{self.temperature:g} degC"]
        return ", ".join([*parts, *([] if self.relative_humidity is None else [f"{self.relative_humidity:g} %RH"])])

    @property
    def allowed(self) -> dict[str, float]:
        """How far each reading may be from its target."""
        return {"temperature": self.temperature_tolerance, "relative_humidity": self.humidity_tolerance}

    @property
    def most_drift(self) -> dict[str, float]:
        """How far each reading may go while the chamber is still."""
        return {"temperature": self.temperature_drift, "relative_humidity": self.humidity_drift}


@dataclass(frozen=True)
class Reference:
    """The condition to which an experiment comes back again and again: what changed there is the strip's age.

    Parameters
    ----------
    environment : TargetEnvironment
    every : int
        After so many other conditions, and at the start and the end.
    signal : Signal, optional
        What is applied there; the first of the experiment's where it is left out.
    """

    environment: TargetEnvironment
    every: int
    signal: Signal | None = None


def conditions_from_texts(given: Any, where: str) -> Any:
    """What is under ``environments``, with tables in the place of texts; what is no list is left as it is.

    Raises
    ------
    InputError
        A text that is no condition.

    Examples
    --------
    >>> conditions_from_texts(["25 degC, 60 percent", {"relative_humidity": "80 percent"}], "environments")
    [{'temperature': '25 degC', 'relative_humidity': '60 percent'}, {'relative_humidity': '80 percent'}]
    """
    if not isinstance(given, list):
        return given
    return [_table(one, f"{where}.{place}") if isinstance(one, str) else one for place, one in enumerate(given)]


def _table(text: str, where: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in text.split(","):
        for name, (quantity, _, _) in _CONDITION.items():
            try:
                parse_quantity(part, quantity, where=where)
            except InputError:
                continue
            if name not in found:
                found[name] = part.strip()
                break
        else:
            raise InputError(
                f"{text!r} is no condition",
                code="bad-value",
                where=where,
                repair='write for example "25 degC, 60 percent", or one of the two',
            )
    return found


def read_environments(
    environment: EnvironmentTable | None,
    conditions: Sequence[ConditionTable] | None,
    reference: ReferenceTable | None,
    signal: Signal | None,
    place: Callable[[str], str],
) -> tuple[tuple[TargetEnvironment, ...], Reference | None]:
    """The conditions of an experiment file.

    Parameters
    ----------
    environment : EnvironmentTable, optional
        What all conditions share, or the only one.
    conditions : sequence of ConditionTable, optional
    reference : ReferenceTable, optional
    signal : Signal, optional
        That of the reference.
    place : callable
        Where a key is, for messages.

    Raises
    ------
    InputError
        A condition without temperature and humidity, a quantity out of range, a reference without conditions.
    """
    shared = _target(environment or EnvironmentTable(), place)
    if conditions is None:
        if reference is not None:
            raise InputError(
                "a reference is visited between conditions, and none are listed",
                code="missing-key",
                where=place("reference"),
                repair='add environments = [{ relative_humidity = "30 percent" }, ...], or take [reference] out',
            )
        if environment is None:
            return (), None
        _refuse_nothing(shared, place("environment"))
        return (shared,), None
    if not 1 <= len(conditions) <= MOST_CONDITIONS:
        raise InputError(
            f"{len(conditions)} conditions are listed",
            code="bad-value",
            where=place("environments"),
            repair=f"list 1 to {MOST_CONDITIONS}",
        )
    targets = [_condition(one, shared, place, f"environments.{at}") for at, one in enumerate(conditions)]
    _refuse_mixed(targets, place("environments"))
    if reference is None:
        return tuple(targets), None
    home = _condition(reference, shared, place, "reference")
    _refuse_mixed([*targets, home], place("reference"))
    return tuple(targets), Reference(home, reference.every, signal)


def _condition(
    table: ConditionTable, shared: TargetEnvironment, place: Callable[[str], str], key: str
) -> TargetEnvironment:
    values = {
        name: _number(getattr(table, name), quantity, low, high, place(f"{key}.{name}"))
        for name, (quantity, low, high) in _CONDITION.items()
        if getattr(table, name) is not None
    }
    target = replace(shared, **values)
    _refuse_nothing(target, place(key))
    return target


def _target(table: EnvironmentTable, place: Callable[[str], str]) -> TargetEnvironment:
    def value(key: str, quantity: Quantity, low: float, high: float) -> float:
        return _number(getattr(table, key), quantity, low, high, place(f"environment.{key}"))

    stated = {
        key: None if getattr(table, key) is None else value(key, quantity, low, high)
        for key, (quantity, low, high) in _CONDITION.items()
    }
    target = TargetEnvironment(
        **stated,
        temperature_tolerance=value("temperature_tolerance", TEMPERATURE, 0.01, 50.0),
        humidity_tolerance=value("humidity_tolerance", RELATIVE_HUMIDITY, 0.1, 50.0),
        settle=value("settle", TIME, 0.0, math.inf),
        longest_wait=value("longest_wait", TIME, 0.0, math.inf),
        longest_still=value("longest_still", TIME, 0.0, math.inf),
        temperature_drift=value("temperature_drift", TEMPERATURE, 0.01, 50.0),
        humidity_drift=value("humidity_drift", RELATIVE_HUMIDITY, 0.1, 50.0),
    )
    if target.settle and target.longest_wait <= target.settle:
        raise InputError(
            f"longest_wait is {target.longest_wait:g} s, not longer than settle, {target.settle:g} s",
            code="out-of-range",
            where=place("environment.longest_wait"),
            repair="wait longer than the environment has to be settled",
        )
    return target


def _number(text: str, quantity: Quantity, low: float, high: float, where: str) -> float:
    number = parse_quantity(text, quantity, where=where)
    if not low <= number <= high:
        raise InputError(
            f"{text!r} is outside {low:g} to {high:g} {quantity.unit}" if high < math.inf else f"{text!r} is negative",
            code="out-of-range",
            where=where,
            repair="give what the chamber can reach" if high < math.inf else "give 0 s or more",
        )
    return number


def _refuse_nothing(target: TargetEnvironment, where: str) -> None:
    if target.temperature is None and target.relative_humidity is None:
        raise InputError(
            "neither temperature nor relative_humidity is stated",
            code="missing-key",
            where=where,
            repair='add temperature = "25 degC" or relative_humidity = "80 percent"',
        )


def _refuse_mixed(targets: Sequence[TargetEnvironment], where: str) -> None:
    """A quantity that one condition sets and another leaves as it happens to be."""
    for name in _CONDITION:
        stated = [getattr(target, name) is not None for target in targets]
        if any(stated) and not all(stated):
            raise InputError(
                f"some conditions state their {name.replace('_', ' ')}, others do not: theirs would be left over",
                code="missing-key",
                where=where,
                repair=f'state it in each, or once for all: [environment] {name} = "{EXAMPLES[name]}"',
            )


_CONDITION: Final[Mapping[str, tuple[Quantity, float, float]]] = {
    "temperature": (TEMPERATURE, -100.0, 300.0),
    "relative_humidity": (RELATIVE_HUMIDITY, 0.0, 100.0),
}
"""What a condition states, and what no chamber exceeds."""
