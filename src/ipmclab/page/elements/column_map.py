"""The columns of a foreign record with their first rows: what each is, is said above it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
    guesses : sequence of str or None
        What each column seems to be.
    on_mapped : callable
        Called with what each column is said to be.
    """

    def __init__(
        self,
        names: Sequence[str],
        rows: Sequence[Sequence[str]],
        guesses: Sequence[str | None],
        on_mapped: Callable[[list[dict[str, str]]], None],
    ) -> None:
        super().__init__()
        self._props["options"] = {
            "columns": [{"name": name, "guess": guess} for name, guess in zip(names, guesses, strict=True)],
            "rows": [list(row) for row in rows],
            "channels": {name: list(quantity.units) for name, quantity in MAPPED.items() if name != "applied_voltage"},
        }
        self._props["errors"] = {}

        def mapped(event: GenericEventArguments) -> None:
            on_mapped(event.args)

        self.on("mapped", mapped)

    def complain(self, errors: Mapping[int, str]) -> None:
        """Say what is wrong with columns, by their places; nothing of the others."""
        self._props["errors"] = {str(place): text for place, text in errors.items()}
        self.update()


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
