"""Whether the output really is at 0 V, from what the channels read.

A word about the output is said only after it was read back: a reset, or a 0 V written, that met no error is neither.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ipmclab.rig.channels import Rig

TOLERANCE: Final = 0.1
"""What may be left [V]: offsets of amplifier and converter are millivolts, a step that drives a strip is more."""


def channels_at_output(rig: Rig) -> tuple[str, ...]:
    """The channels that together read what the output gives; none where those of the rig cannot.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> channels_at_output(THESIS_RIG)
    ('voltage',)
    """
    needed = _needed(rig)
    return needed if {channel.name for channel in rig.channels if channel.physical}.issuperset(needed) else ()


def resistance_between(rig: Rig) -> float:
    """The resistance [ohm] between the output and the place where the voltage is read."""
    return rig.source_resistance + (rig.shunt_resistance if rig.voltage_sensed == "electrodes" else 0.0)


def at_output(rig: Rig, readings: Mapping[str, float]) -> float | None:
    """What the output gives [V], from readings [V] as they come from the converters; None when they cannot
    show it."""
    needed = _needed(rig)
    if not readings.keys() >= set(needed):
        return None
    voltage, *current = (rig[name].to_quantity(readings[name]) for name in needed)
    return voltage + resistance_between(rig) * sum(current)


def left_at_output(rig: Rig, readings: Mapping[str, float]) -> float | None:
    """What the output still gives although it should give 0 V.

    The current of a strip that discharges drops over the resistances between the output and the place
    where the voltage is read, so 0 V at the output need not read as 0 V.

    Parameters
    ----------
    rig : Rig
    readings : mapping of channel to float [V]
        As they come from the converters.

    Returns
    -------
    voltage : float or None [V]
        None when it is within ``TOLERANCE`` of 0 V, or when the channels cannot show it.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> left_at_output(THESIS_RIG, {"voltage": 2.9, "current": 0.02})
    2.9
    >>> left_at_output(THESIS_RIG, {"voltage": 0.01, "current": -0.1}) is None
    True
    """
    left = at_output(rig, readings)
    return left if left is not None and abs(left) > TOLERANCE else None


def _needed(rig: Rig) -> tuple[str, ...]:
    return ("voltage", "current") if resistance_between(rig) else ("voltage",)
