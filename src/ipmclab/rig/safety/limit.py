"""One limit: its quantity, the readings that it needs, how far it may go and what happens then."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, get_args

from ipmclab.errors import InputError, suggest, unknown_name
from ipmclab.units import (
    CHARGE,
    CURRENT,
    DISPLACEMENT,
    ENERGY,
    FORCE,
    POWER,
    RELATIVE_HUMIDITY,
    TEMPERATURE,
    TIME,
    VOLTAGE,
    Quantity,
    format_quantity,
    parse_quantity,
)

if TYPE_CHECKING:
    from ipmclab.rig.channels import Channel


Action = Literal["zero", "warn"]
"""``zero``: the output goes to 0 V and the run ends, aborted. ``warn``: the run continues, with a mark."""


ELECTROLYSIS: Final = 1.23
"""Above this voltage [V] water is split."""


MEAN_TIME: Final = 1.0
"""Over so long [s] the mean current and the power are averaged."""


QUANTITIES: Final[Mapping[str, Quantity]] = {
    "voltage": VOLTAGE,
    "current": CURRENT,
    "mean_current": CURRENT,
    "charge": CHARGE,
    "power": POWER,
    "energy": ENERGY,
    "displacement": DISPLACEMENT,
    "force": FORCE,
    "temperature": TEMPERATURE,
    "relative_humidity": RELATIVE_HUMIDITY,
}
"""The quantity of each limit."""


NEEDS: Final[Mapping[str, tuple[str, ...]]] = {
    "voltage": ("voltage",),
    "current": ("current",),
    "mean_current": ("current",),
    "charge": ("voltage", "current"),
    "power": ("voltage", "current"),
    "energy": ("voltage", "current"),
    "displacement": ("displacement",),
    "force": ("force",),
    "temperature": ("temperature",),
    "relative_humidity": ("relative_humidity",),
}
"""The readings that each limit is watched with."""


AIR: Final = ("temperature", "relative_humidity")
"""The limits of the air around the strip, which may have a lower end too."""


_WORDS: Final = ("most", "duration", "action")


@dataclass(frozen=True)
class Limit:
    """How far a quantity may go, how long it may be beyond, and what happens then.

    Parameters
    ----------
    most : float [SI unit of the quantity]
        Largest magnitude; of the air the highest value.
    duration : float [s]
        The limit acts once the quantity has been beyond it for so long without a break; with 0, at the first reading.
    action : "zero" or "warn"
    least : float, optional
        Of the air the lowest value.

    Raises
    ------
    InputError
        A ``most`` that is not above 0, a ``least`` that is not below it, a negative duration, an unknown action.
    """

    most: float
    duration: float = 0.0
    action: Action = "zero"
    least: float | None = None

    def __post_init__(self) -> None:
        if self.least is not None and not -math.inf < self.least < self.most:
            raise InputError(
                f"the lower limit is {self.least:g}, the upper one is {self.most:g}",
                code="bad-limit",
                where="least",
                repair="give a lower limit below the upper one",
            )
        if not 0.0 < self.most < math.inf:
            raise InputError(
                f"the limit is {self.most:g}, it must be above 0",
                code="bad-limit",
                where="most",
                repair="give the largest magnitude that is allowed",
            )
        if not 0.0 <= self.duration < math.inf:
            raise InputError(
                f"the duration is {self.duration:g} s", code="bad-limit", where="duration", repair="give 0 s or more"
            )
        if self.action not in get_args(Action):
            raise InputError(
                f"unknown action {self.action!r}",
                code="bad-limit",
                where="action",
                repair=suggest(str(self.action), get_args(Action)),
            )


_HUMIDITY: Final = Limit(100.0, 10.0)
"""What a limit of the humidity starts from, where one is stated."""


def words(name: str) -> str:
    """A limit in words.

    Examples
    --------
    >>> words("mean_current")
    'mean current over 1 s'
    """
    special = {
        "mean_current": f"mean current over {MEAN_TIME:g} s",
        "charge": f"charge above {ELECTROLYSIS} V",
        "power": f"mean power over {MEAN_TIME:g} s",
    }
    return special.get(name, name.replace("_", " "))


def shown(name: str, value: float) -> str:
    """A value of a limited quantity with its unit, as people read it.

    Examples
    --------
    >>> shown("force", 0.08)
    '80 mN'
    """
    quantity = QUANTITIES[name]
    return f"{quantity.to_display(value):.4g} {quantity.display_unit}"


def _unseen(name: str, limit: Limit, channel: Channel) -> str | None:
    """Why a channel does not show that a limit is passed: it reads no further."""
    low, high = channel.range
    if channel.zeroed:
        low, high = low - channel.rest, high - channel.rest
    largest = high if name in AIR else max(-low, high)
    if limit.most >= largest and (name, limit.most) != ("relative_humidity", _HUMIDITY.most):
        end, most, reads = "limit", limit.most, f"up to {shown(name, largest)}"
    elif limit.least is not None and limit.least <= low:
        end, most, reads = "lower limit", limit.least, f"down to {shown(name, low)}"
    else:
        return None
    return (
        f"the {end} of the {words(name)} is {shown(name, most)}, its channel reads {reads}: "
        "nothing shows when it is exceeded"
    )


def _text(value: Any, place: str) -> str:
    if not isinstance(value, str):
        raise InputError(
            f"{value!r} is not a text",
            code="bad-value",
            where=place,
            repair='write a number with its unit in quotes, such as "150 mA", or "off"',
        )
    return value


def _read(given: Any, default: Limit, name: str, place: str) -> Limit:
    quantity = QUANTITIES[name]
    known = (*_WORDS, "least") if name in AIR else _WORDS
    if not isinstance(given, Mapping):
        most = parse_quantity(_text(given, place), quantity, where=place)
        values: dict[str, Any] = {"most": most}
    else:
        values = {}
        for key, value in given.items():
            at = f"{place}.{key}"
            if key not in known:
                raise unknown_name("key", key, known, where=at)
            text = _text(value, at)
            if key == "action":
                values[key] = text
            else:
                values[key] = parse_quantity(text, TIME if key == "duration" else quantity, where=at)
    if "most" in values and values["most"] <= 0.0:  # here its unit is known
        raise InputError(
            f"the limit is {values['most']:g} {quantity.unit}, it must be above 0",
            code="bad-limit",
            where=f"{place}.most",
            repair="give the largest magnitude that is allowed",
        )
    try:
        return replace(default, **values)
    except InputError as error:
        error.where = f"{place}.{error.where}"
        raise


def _write(limit: Limit, quantity: Quantity) -> dict[str, str]:
    least = {} if limit.least is None else {"least": format_quantity(limit.least, quantity)}
    return {
        "most": format_quantity(limit.most, quantity),
        **least,
        "duration": format_quantity(limit.duration, TIME),
        "action": limit.action,
    }
