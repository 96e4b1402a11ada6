"""What the fit that an actuator carries left open, by the table of its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from ipmclab.model.actuator import Actuator

_LISTED: Final = 6  # names that a sentence lists (convention)


def entries_of(table: Mapping[str, Any] | None) -> list[Mapping[str, Any]]:
    """The parameters of a ``[fit]`` table, which may have been written by hand: what is no parameter says nothing."""
    found = (table or {}).get("parameters")
    each = found if isinstance(found, Sequence) else ()
    return [one for one in each if isinstance(one, Mapping) and isinstance(one.get("name"), str)]


def open_names(actuator: Actuator) -> tuple[str, ...]:
    """The parameters of an actuator that its fit did not determine."""
    entries = entries_of(actuator.fit_table)
    return tuple(
        one["name"] for one in entries if not one.get("determined", True) and one["name"] in actuator.parameter_values
    )


def open_sentence(actuator: Actuator) -> str:
    """What is to be said with every number that an actuator gives where its fit left something open, else nothing.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ipmclab import load_actuator
    >>> entry = {"name": "beam.modulus", "determined": False}
    >>> open_sentence(replace(load_actuator("friend-2"), fit_table={"parameters": [entry]}))
    'the fit does not determine beam.modulus: what depends on it is a guess'
    """
    names = open_names(actuator)
    if not names:
        return ""
    them = "it" if len(names) == 1 else "them"
    return f"the fit does not determine {first_of(names)}: what depends on {them} is a guess"


def first_of(names: Sequence[str]) -> str:
    """Names in a sentence, the first of many."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")
