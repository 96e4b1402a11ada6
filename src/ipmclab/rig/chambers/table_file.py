"""Tables of chambers that have no driver of their own: their queries and commands, as a TOML file says it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field

from ipmclab.errors import InputError
from ipmclab.store.strict import Strict, validated
from ipmclab.toml_file import parse_table, read_text

Words = Annotated[tuple[str, ...], Field(strict=False)]
Numbers = Annotated[tuple[int, ...], Field(strict=False)]
Register = Annotated[int, Field(ge=0, le=65535)]


class TextQuantity(Strict):
    """``[temperature]`` or ``[relative_humidity]`` of an instrument that speaks text.

    ``ask`` and ``set_point`` are questions, answered with a number. ``tell`` is a command with ``{value}`` in it, as
    ``"TEMP {value:.1f}"``. ``off`` are the commands that regulate none.
    """

    ask: str
    set_point: str
    tell: str
    off: Words = ()


class TextUnit(Strict):
    """``[unit]``: a question, and its answer where temperatures are in degC."""

    ask: str
    celsius: str


class TextRun(Strict):
    """``[run]``: a question, its answers while the instrument regulates and while it does not, and the commands."""

    ask: str
    constant: Words
    standby: Words
    start: Words
    stop: Words


class TextAlarm(Strict):
    """``[alarm]``: a question, and its answers where all is well."""

    ask: str
    none: Words


class TextTable(Strict):
    """An instrument that speaks text, as SCPI does."""

    identify: str | None = "*IDN?"
    acknowledged: str | None = None
    temperature: TextQuantity
    relative_humidity: TextQuantity | None = None
    unit: TextUnit | None = None
    run: TextRun
    alarm: TextAlarm | None = None


class RegisterValue(Strict):
    """A register: its number, counted from 0, its type, and what its value is multiplied by to give degC or percent."""

    number: Register
    type: Literal["int16", "uint16", "int32", "uint32", "float32"] = "int16"
    kind: Literal["holding", "input"] = "holding"
    scale: Annotated[float, Field(gt=0.0, strict=False)] = 1.0
    unit: Literal["degC", "degF", "percent"] | None = None


class RegisterQuantity(Strict):
    """``[temperature]`` or ``[relative_humidity]``: two registers."""

    reading: RegisterValue
    set_point: RegisterValue


class RegisterRun(Strict):
    """``[run]``: where it states what it does, its numbers for that, where it is commanded, and the numbers for
    that."""

    state: Register
    command: Register
    constant: Numbers
    standby: Numbers
    start: int
    stop: int


class RegisterAlarm(Strict):
    """``[alarm]``: a register, and its values where all is well."""

    number: Register
    none: Numbers = (0,)


class RegisterTable(Strict):
    """An instrument that speaks Modbus."""

    unit_id: Annotated[int, Field(ge=0, le=247)] = 1
    word_order: Literal["low-first", "high-first"] = "low-first"
    temperature: RegisterQuantity
    relative_humidity: RegisterQuantity | None = None
    run: RegisterRun
    alarm: RegisterAlarm | None = None


Table = TypeVar("Table", TextTable, RegisterTable)


def read_table(path: Path, model: type[Table]) -> Table:
    """Read the table of an instrument.

    Parameters
    ----------
    path : Path
    model : TextTable or RegisterTable

    Raises
    ------
    InputError
        No such file, no TOML, an unknown or missing key, a command without its ``{value}``.
    """
    where = str(path)
    missing = InputError(
        "there is no such file", code="no-chamber-table", where=where, repair="give the path of the chamber's table"
    )
    document = parse_table(read_text(path, kind="the table of a chamber", missing=missing), where=where)
    table = validated(model, document, where=where)
    if isinstance(table, TextTable):
        for name, quantity in (("temperature", table.temperature), ("relative_humidity", table.relative_humidity)):
            if quantity is not None:
                _check_command(quantity.tell, f"{where}: {name}.tell")
    return table


def _check_command(command: str, where: str) -> None:
    """A command must hold its value, and as a number that the instrument reads. Raises InputError."""
    try:
        text = command.format(value=23.25)
        holds = text != command.format(value=-8.5) and text.isascii() and "\n" not in text
    except (ValueError, KeyError, IndexError, AttributeError):
        holds = False
    if not holds:
        raise InputError(
            f"{command!r} does not give the value",
            code="bad-value",
            where=where,
            repair='write it with {value} in it, such as ":SOURCE:CLOOP1:SPOINT {value:.1f}"',
        )
