"""How fast a parameter ages: a free parameter of a fit, by its name."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from ipmclab.errors import InputError, suggest

AGE: Final = "age."

SCALES: Final = {"runs": "1/run", "hours": "1/h", "charge": "1/C"}
"""The scales on which a strip ages, each with the unit of a rate on it."""

_NAME: Final = re.compile(r"age\.(\w+)\.(.+)")


class Age(NamedTuple):
    """How fast one parameter ages: the change of its logarithm for each unit of a dose."""

    scale: str
    parameter: str

    @property
    def unit(self) -> str:
        """Of the rate."""
        return SCALES[self.scale]

    @classmethod
    def of(cls, name: str) -> Age:
        """What a name says.

        Examples
        --------
        >>> Age.of("age.runs.coupling.gain")
        Age(scale='runs', parameter='coupling.gain')
        """
        found = _NAME.fullmatch(name)
        assert found is not None
        return cls(found[1], found[2])


def grown(rates: Mapping[str, float], doses: Mapping[str, float]) -> dict[str, float]:
    """How many times as large each parameter is that ages.

    Parameters
    ----------
    rates : mapping of name to float
        Such as ``age.runs.coupling.gain``: the change of the logarithm for each unit of dose.
    doses : mapping of scale to float

    Examples
    --------
    >>> round(grown({"age.runs.coupling.gain": -0.1}, {"runs": 2.0})["coupling.gain"], 4)
    0.8187
    """
    found: dict[str, float] = {}
    for name, rate in rates.items():
        age = Age.of(name)
        found[age.parameter] = found.get(age.parameter, 1.0) * math.exp(min(rate * doses[age.scale], 700.0))
    return found


def check_age(name: str, known: Sequence[str], *, where: str) -> None:
    """Refuse a name that begins as that of a rate does and is none.

    Raises
    ------
    InputError
        No such scale, or no such parameter of the actuator.
    """
    found = _NAME.fullmatch(name)
    scale, parameter = ("", "") if found is None else (found[1], found[2])
    if scale not in SCALES:
        raise InputError(
            f"{name!r} does not say with what a parameter ages",
            code="unknown-parameter",
            where=where,
            repair=f"give age, {', '.join(SCALES)} and a parameter, such as 'age.runs.coupling.gain'",
        )
    if parameter not in known:
        raise InputError(
            f"{name!r} is to be how fast {parameter!r} ages, and there is no such parameter",
            code="unknown-parameter",
            where=where,
            repair=suggest(parameter, known),
        )
