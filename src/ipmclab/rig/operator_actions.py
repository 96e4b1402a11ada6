"""What an operator does at a real rig, as words that do it at a virtual one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from ipmclab.errors import unknown_name
from ipmclab.rig.plant import StripPlant
from ipmclab.units import RELATIVE_HUMIDITY, TEMPERATURE, parse_quantity

_SWITCHES: Final[Mapping[str, tuple[str, str, Any]]] = {
    "tip clear": ("the load cell moves away from the tip", "tip", "free"),
    "tip on cell": ("the load cell moves against the tip", "tip", "on cell"),
    "tip either": (
        "each mechanical sensor reads as if the strip were mounted for it, as at the start",
        "tip",
        "either",
    ),
    "contact good": ("the strip is clamped well", "contact", "good"),
    "contact bad": ("the strip is clamped badly: 50 ohm more", "contact", "bad"),
    "contact open": ("the clamp does not touch the strip", "contact", "open"),
    "laser blocked": ("something is between laser and strip", "laser_blocked", True),
    "laser clear": ("nothing is between laser and strip", "laser_blocked", False),
    "probes shorted": (
        "a piece of metal joins the four contacts of the sheet-resistance probe",
        "probes_shorted",
        True,
    ),
    "probes on strip": ("the four contacts lie on the strip", "probes_shorted", False),
}

WORDS: Final[Mapping[str, str]] = {
    **{words: meaning for words, (meaning, _, _) in _SWITCHES.items()},
    "rest": "the strip is left alone until it is discharged",
    "temperature 30 degC": "the chamber is set, and the air follows",
    "humidity 60 percent": "the chamber is set, and the air follows",
}
"""What can be done, and what it means."""


def carry_out(plant: StripPlant, words: str) -> None:
    """Do one of ``WORDS`` to a plant.

    Raises
    ------
    InputError
        No such thing to do, or a setting that no chamber has.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> plant = StripPlant(THESIS_RIG)
    >>> carry_out(plant, "tip clear")
    >>> plant.tip
    'free'
    """
    known = " ".join(words.split())
    what, _, setting = known.partition(" ")
    if known in _SWITCHES:
        _, attribute, value = _SWITCHES[known]
        setattr(plant, attribute, value)
    elif known == "rest":
        plant.rest()
    elif what == "temperature":
        plant.set_chamber(temperature=parse_quantity(setting, TEMPERATURE, where=what))
    elif what == "humidity":
        plant.set_chamber(relative_humidity=parse_quantity(setting, RELATIVE_HUMIDITY, where=what))
    else:
        raise unknown_name("words", known, WORDS, where="hands")
