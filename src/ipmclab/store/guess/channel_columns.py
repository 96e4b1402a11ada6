"""Which column of a foreign record is which channel, in which unit, and what stands for a lost reading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.store.guess.headings import channels_of
from ipmclab.store.guess.inquiry import Column, Inquiry
from ipmclab.store.guess.question import Question
from ipmclab.store.guess.readings import Readings, find_sentinels
from ipmclab.store.import_map import MAPPED

_KELVIN: Final = (1.0, -273.15)
_FAHRENHEIT: Final = (5.0 / 9.0, -160.0 / 9.0)
_DEGREES: Final = {
    **dict.fromkeys(("k", "kelvin"), _KELVIN),
    **dict.fromkeys(("f", "fahrenheit"), _FAHRENHEIT),
}
"""Factor and offset to degC: no factor alone turns these units into it."""


def find_channel(inquiry: Inquiry, channel: str) -> None:
    """Find the column of a channel and put it into the map, or ask for it.

    Raises
    ------
    InputError
        No column can be the voltage, or an answer is none of those that can be given.
    """
    left = [column for column in inquiry.all if column.place not in inquiry.used and not column.is_blank]
    free = [column for column in left if column.readings is not None]
    # A column of readings that cannot be read as numbers is not left out: its import says which cell is wrong.
    spoilt = [column for column in left if column.readings is None and _has_digits(inquiry, column)]
    worded = [column for column in free if _means(column) == channel]
    worded = worded or [column for column in spoilt if _means(column) == channel]
    read = [column for column in worded if not column.heading.is_commanded]
    chosen = read or worded
    if not chosen:
        by_unit = [column for column in free if not column.heading.channels and _unit_says(column, channel)]
        chosen = by_unit
    if not chosen and channel == "voltage":
        unknown = [column for column in free if not column.heading.channels and not column.heading.foreign_unit]
        unknown = [column for column in unknown if not column.heading.unit]
        if not unknown:
            raise InputError(
                "no column that can be the voltage: every run has one",
                code="no-voltage",
                where=str(inquiry.path),
                repair="see what was saved, or write a map: docs/files.md, Import maps",
            )
        picked = inquiry.choose(channel, unknown, "which column is the voltage?", optional=False)
        chosen = [] if picked is None else [picked]
    elif not chosen and _unknown(free) and _is_nameless(inquiry):
        picked = inquiry.choose(channel, _unknown(free), f"which column is the {MAPPED[channel].name}?", optional=True)
        chosen = [] if picked is None else [picked]
    if len(chosen) > 1:
        text = f"several columns can be the {MAPPED[channel].name}: which one was read at the strip?"
        picked = inquiry.choose(channel, chosen, text, optional=channel != "voltage")
        chosen = [] if picked is None else [picked]
    if chosen:
        _place(inquiry, channel, chosen[0])


def _has_digits(inquiry: Inquiry, column: Column) -> bool:
    return any(letter.isdigit() for cell in inquiry.columns.cells[column.place] for letter in str(cell))


def _is_nameless(inquiry: Inquiry) -> bool:
    return not any(inquiry.columns.names)


def _unknown(free: Sequence[Column]) -> list[Column]:
    return [column for column in free if not column.heading.channels and not column.heading.unit]


def _means(column: Column) -> str:
    """The channel that the words of a heading mean, with its unit; an empty text where they mean none."""
    heading = column.heading
    said = tuple(name for name in heading.channels if name != "time")
    if heading.unit and (agreed := [name for name in said if name in heading.of_unit and name != "voltage"]):
        return agreed[0] if len(agreed) == 1 else ""
    if len(said) > 1:  # "laser voltage": what a sensor gives as a voltage
        said = tuple(name for name in said if name != "voltage")
    return said[0] if len(said) == 1 else ""


def _unit_says(column: Column, channel: str) -> bool:
    return channels_of(column.heading.unit) == (channel,) and not column.heading.is_commanded


def _place(inquiry: Inquiry, channel: str, column: Column) -> None:
    inquiry.used.add(column.place)
    quantity, heading = MAPPED[channel], column.heading
    readings = column.readings or Readings(np.zeros(1))
    keys: dict[str, Any] = {"column": column.name}
    unit = heading.unit if channel in heading.of_unit else ""
    foreign = heading.foreign_unit or (heading.unit if heading.unit and not unit else "")
    bare = foreign.lower().removeprefix("°").removeprefix("deg").strip(" _")
    line = _DEGREES.get(bare) if channel == "temperature" else None
    if line is not None:
        keys |= {"factor": line[0], "offset": line[1], "unit": "degC"}
    elif foreign:
        answer = inquiry.ask(
            Question(
                f"channels.{channel}.factor",
                f"the {quantity.name} {inquiry.label(column)} is in {foreign}: how many {quantity.display_unit} is 1 "
                f"{foreign}?",
                example="2.5",
            )
        )
        if answer:
            keys |= {"factor": _number(answer, f"channels.{channel}.factor"), "unit": quantity.display_unit}
    elif unit:
        keys["unit"] = unit
    else:
        span = f"from {np.min(readings.present):.6g} to {np.max(readings.present):.6g}"
        unit = inquiry.ask(
            Question(
                f"channels.{channel}.unit",
                f"in which unit is the {quantity.name} {inquiry.label(column)}? It goes {span}",
                tuple(quantity.units),
            )
        )
        keys |= {"unit": unit} if unit else {}
    lost = _sentinels(inquiry, channel, readings)
    if lost:
        keys["sentinels"] = lost
    inquiry.table["channels"][channel] = keys
    inquiry.take(
        f"{quantity.name}: column {inquiry.label(column)}, {foreign if line else keys.get('unit', 'unit not known')}"
        + (f"; {', '.join(f'{one:g}' for one in lost)} is no reading" if lost else "")
    )


def _sentinels(inquiry: Inquiry, channel: str, readings: Readings) -> list[float]:
    sure, perhaps = find_sentinels(readings.present)
    if channel == "voltage":
        perhaps = []  # the levels of a signal are far apart, too
    for value, count in perhaps:
        answer = inquiry.ask(
            Question(
                f"channels.{channel}.sentinels",
                f"{count} readings of the {MAPPED[channel].name} are exactly {value:g}, far from all others: "
                "does that mean that nothing was read?",
                ("yes", "no"),
            )
        )
        sure = [*sure, value] if answer == "yes" else sure
    return sure


def pair_indices(inquiry: Inquiry) -> None:
    """Where every channel has a column of its own that counts its rows, give each its own."""
    rows = {column.place: column for column in inquiry.all if column.heading.is_row and column.readings}
    if len(rows) < 2:
        return
    places = {column.name: column.place for column in inquiry.all}
    for channel in inquiry.table["channels"].values():
        partner = rows.get(places[channel["column"]] - 1)
        if partner is not None and partner.readings is not None and partner.readings.counts_rows:
            channel["index"] = partner.name


def _number(text: str, where: str) -> float:
    from ipmclab.units import NUMBER, parse_quantity

    return parse_quantity(text, NUMBER, where=where)
