"""How people read metrics: their names and units."""

from __future__ import annotations

from typing import Final

from ipmclab.units import (
    ANGLE,
    CHANNELS,
    CHARGE,
    CURRENT,
    DISPLACEMENT,
    DISPLACEMENT_PER_VOLT,
    ENERGY,
    FORCE,
    FORCE_PER_VOLT,
    NUMBER,
    POWER,
    TIME,
    Quantity,
)

_QUANTITIES: Final = {
    one.unit: one
    for one in (
        NUMBER,
        CURRENT,
        DISPLACEMENT,
        FORCE,
        TIME,
        ANGLE,
        CHARGE,
        ENERGY,
        POWER,
        DISPLACEMENT_PER_VOLT,
        FORCE_PER_VOLT,
    )
}


def quantity_of(unit: str) -> Quantity:
    """The quantity of a metric in this SI unit.

    Examples
    --------
    >>> quantity_of("m").display_unit
    'mm'
    """
    return _QUANTITIES.get(unit, NUMBER)


def metric_label(key: str) -> str:
    """What people call a metric.

    Examples
    --------
    >>> metric_label("displacement.back_relaxation")
    'displacement, back relaxation'
    """
    channel, _, name = key.partition(".")
    return f"{CHANNELS[channel].name}, {name.replace('_', ' ')}" if channel in CHANNELS else key
