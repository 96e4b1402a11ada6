"""The columns of a foreign record with their first rows: what each is, is said above it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from nicegui.element import Element

from ipmclab.errors import InputError
from ipmclab.store.import_map import MAPPED

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments


class ColumnMap(Element, component="column_map.js"):
    """The columns of a foreign record.

    Parameters
    ----------
    names : sequence of str
    rows : sequence of sequence of str
        The first rows.
    begin : sequence of mapping
        What each column is said to be at first, as ``channel_tables`` takes it.
    on_mapped : callable
        Called with what each column is said to be.
    """

    def __init__(
        self,
        names: Sequence[str],
        rows: Sequence[Sequence[str]],
        begin: Sequence[Mapping[str, str]],
        on_mapped: Callable[[list[dict[str, str]]], None],
    ) -> None:
        super().__init__()
        channels = {name: quantity for name, quantity in MAPPED.items() if name != "applied_voltage"}
        self._props["options"] = {
            "columns": [{"name": name, "begin": dict(one)} for name, one in zip(names, begin, strict=True)],
            "rows": [list(row) for row in rows],
            "channels": {name: list(quantity.units) for name, quantity in channels.items()},
            "usual": {name: quantity.display_unit for name, quantity in channels.items()},
        }
        self._props["errors"] = {}

        def mapped(event: GenericEventArguments) -> None:
            on_mapped(event.args)

        self.on("mapped", mapped)

    def complain(self, errors: Mapping[int, str]) -> None:
        """Say what is wrong with columns, by their places; nothing of the others."""
        self._props["errors"] = {str(place): text for place, text in errors.items()}
        self.update()


class Said:
    """What somebody said of the columns of a record, while the record is read in other ways.

    A column is known by its name; one without, or with another, by its place among as many.

    Examples
    --------
    >>> said = Said()
    >>> first = said.begin(("t", "I"), ("time", "current"))
    >>> said.keep([first[0], {**first[1], "unit": "mA"}])
    >>> [one["unit"] for one in said.begin(("volt", "I", "t"), ("voltage", "current", "time"))]
    ['', 'mA', '']
    """

    def __init__(self) -> None:
        self._names: tuple[str, ...] = ()
        self._guesses: list[dict[str, str]] = []
        self._known: dict[object, dict[str, str]] = {}

    def keep(self, columns: Sequence[Mapping[str, str]]) -> None:
        """Remember what is said of the columns now; what is as it was guessed nobody said."""
        for place, (column, guess) in enumerate(zip(columns, self._guesses, strict=True)):
            for key in self._keys(place):
                if dict(column) != guess:
                    self._known[key] = dict(column)
                elif self._known.get(key) != guess:
                    self._known.pop(key, None)

    def begin(self, names: Sequence[str], guesses: Sequence[str | None]) -> list[dict[str, str]]:
        """What is said of columns at first: what was said of them before, and of the others what they seem to be."""
        self._names = tuple(names)
        self._guesses = [_guessed(guess) for guess in guesses]
        found: dict[int, dict[str, str]] = {}
        for of_name in (True, False):
            for place in range(len(names)):
                keys = [key for key in self._keys(place) if isinstance(key, str) is of_name]
                known = next((self._known[key] for key in keys if key in self._known), None)
                if place not in found and known is not None and not _is_among(known, found.values()):
                    found[place] = dict(known)
        # A channel that somebody said is one column is not guessed of another.
        self._guesses = [
            guess if place in found or not _is_among(guess, found.values()) else _guessed(None)
            for place, guess in enumerate(self._guesses)
        ]
        return [found.get(place, dict(guess)) for place, guess in enumerate(self._guesses)]

    def _keys(self, place: int) -> list[object]:
        name = self._names[place]
        alone = [name] if name and self._names.count(name) == 1 else []
        return [*alone, (len(self._names), place)]


def _guessed(channel: str | None) -> dict[str, str]:
    return {"channel": channel or "", "unit": "", "factor": "", "sign": "1", "zero_at": "", "sentinels": ""}


def _is_among(column: Mapping[str, str], others: Iterable[Mapping[str, str]]) -> bool:
    """Whether another column is said to be the same channel."""
    return bool(column["channel"]) and any(one["channel"] == column["channel"] for one in others)


def channel_tables(names: Sequence[str], columns: Sequence[Mapping[str, str]]) -> dict[str, dict[str, Any]]:
    """The ``channels`` of an import map.

    Parameters
    ----------
    names : sequence of str
        Of the columns.
    columns : sequence of mapping
        What each is said to be: ``channel``, ``unit``, ``factor``, ``sign``, ``zero_at``, ``sentinels``, as texts.

    Raises
    ------
    InputError
        A channel that two columns are said to be; a factor or sentinel that is no number. Its ``where`` is the channel.

    Examples
    --------
    >>> blank = {"unit": "", "factor": "", "sign": "1", "zero_at": "", "sentinels": ""}
    >>> channel_tables(["t", "U"], [{**blank, "channel": ""}, {**blank, "channel": "voltage", "unit": "V"}])
    {'voltage': {'column': 'U', 'unit': 'V'}}
    """
    tables: dict[str, dict[str, Any]] = {}
    for place, column in enumerate(columns):
        channel = column["channel"]
        if not channel:
            continue
        if channel in tables:
            raise InputError(
                f"two columns are said to be the {channel.replace('_', ' ')}",
                code="ambiguous-column",
                where=f"channels.{channel}",
                repair="choose – for one of them",
            )
        name = names[place]
        table: dict[str, Any] = {"column": name if name and names.count(name) == 1 else place}
        if column["unit"]:
            table["unit"] = column["unit"]
        if channel != "time":
            if column["factor"].strip():
                table["factor"] = _number(column["factor"], channel, "the factor")
            if column["sign"] == "-1":
                table["sign"] = -1
            if column["zero_at"].strip():
                table["zero_at"] = column["zero_at"].strip()
            lost = [part for part in column["sentinels"].replace(";", ",").split(",") if part.strip()]
            if lost:
                table["sentinels"] = [_number(part, channel, "a lost reading") for part in lost]
        tables[channel] = table
    return tables


def _number(text: str, channel: str, what: str) -> float:
    from ipmclab.units import NUMBER, parse_quantity

    try:
        return parse_quantity(text.strip(), NUMBER, where=f"channels.{channel}")
    except InputError as error:
        raise InputError(
            f"{what}, {text.strip()!r}, is no plain number",
            code=error.code,
            where=f"channels.{channel}",
            repair=f"write a point for the comma: {text.strip().replace(',', '.')}"
            if "," in text
            else "write for example -1.5",
        ) from error
