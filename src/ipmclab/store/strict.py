"""Tables that a user writes, checked strictly: an unknown key or a value of another kind is an error."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any, Final, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ipmclab.errors import InputError, missing_key, suggest, unknown_name

Pair = Annotated[tuple[float, float], Field(strict=False)]
"""Two numbers, written ``[low, high]``."""

Rows = Annotated[tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]], Field(strict=False)]
"""A half-open range of rows, written ``[start, stop]``, counted from 0."""


class Strict(BaseModel):
    """A table whose keys are all known and whose values are never converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, table: Any) -> Any:
        for key in table if isinstance(table, dict) else ():
            if key not in cls.model_fields:
                raise unknown_name("key", key, cls.model_fields, where=str(key))
        return table


_EXPECTED: Final = {
    "string_type": ("is not a text", 'write it in quotes; a quantity is a number with its unit, such as "12.3 mm"'),
    "int_type": ("is not a whole number", "write a whole number without quotes"),
    "int_from_float": ("is not a whole number", "write a whole number without quotes"),
    "float_type": ("is not a number", "write a number without quotes"),
    "finite_number": ("is not a finite number", "write the number itself"),
    "bool_type": ("is neither true nor false", "write true or false without quotes"),
    "tuple_type": ("is not a list", "write it in square brackets"),
    "dict_type": ("is not a table", "write it as a table of keys"),
    "model_type": ("is not a table", "write it as a table of keys"),
    "model_attributes_type": ("is not a table", "write it as a table of keys"),
    "dataclass_type": ("is not a table", "write it as a table of keys"),
}
"""What is wrong and what to do, for each kind of complaint about a value of another kind."""


Table = TypeVar("Table", bound=Strict)


def validated(model: type[Table], document: Any, *, where: str) -> Table:
    """A table of a file, checked.

    Parameters
    ----------
    model : class of Strict
    document : object
        What is in the file.
    where : str
        The file.

    Raises
    ------
    InputError
        The first complaint, with the file and the key that it concerns.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise as_input_error(error, document, where=f"{where}: ") from error
    except InputError as error:
        raise error.at(f"{where}: {error.where}") from error


def as_input_error(error: ValidationError, table: Any, *, where: str) -> InputError:
    """The first complaint about a table in plain words, with the key that it concerns.

    Parameters
    ----------
    error : ValidationError
    table : object
        What was checked.
    where : str
        The file, with ``: `` or ``.`` behind it where a key follows.
    """
    first = error.errors(include_url=False)[0]
    kind, given, context = first["type"], first["input"], first.get("ctx", {})
    path = _path(first["loc"], table, key_is_missing=kind == "missing")
    cause = context.get("error")
    if isinstance(cause, InputError):
        inside = f"{path}.{cause.where}".strip(".")
        return cause.at(where + inside)
    if kind == "union_tag_not_found":
        return _no_format(given, where + path)
    place = (where + path).rstrip(": .")
    if kind == "missing":
        return missing_key(place, "add it")
    shown = repr(given) if len(repr(given)) <= 60 else repr(given)[:57] + "..."
    if kind == "union_tag_invalid":
        names = re.findall("'([^']*)'", context["expected_tags"])
        place, message, repair = f"{place}.format", f"unknown format {context['tag']!r}", suggest(context["tag"], names)
    elif kind == "literal_error":
        near = suggest(str(given), re.findall("'([^']*)'", context["expected"]))
        repair = near if near.startswith("did") else "write one of these"
        message = f"{shown} is not {context['expected']}"
    elif kind == "greater_than_equal":
        message, repair = f"{shown} is below {context['ge']}", f"give {context['ge']} or more"
    elif kind == "less_than_equal":
        message, repair = f"{shown} is above {context['le']}", f"give {context['le']} or less"
    else:
        message, repair = _EXPECTED.get(kind, (first["msg"][:1].lower() + first["msg"][1:], "correct this value"))
        message = f"{shown} {message}" if kind in _EXPECTED else f"{shown}: {message}"
    return InputError(message, code="bad-value", where=place, repair=repair)


def _path(location: Sequence[int | str], table: Any, *, key_is_missing: bool) -> str:
    """The keys that lead to a place in the table, without the names that pydantic gives to alternatives."""
    parts = []
    for part in location:
        keys = table if isinstance(table, dict) else range(len(table)) if isinstance(table, list | tuple) else ()
        if part in keys:
            parts.append(str(part))
            table = table[part]
    if key_is_missing:
        parts.append(str(location[-1]))
    return ".".join(parts)


def _no_format(table: Any, place: str) -> InputError:
    for key in table if isinstance(table, dict) else ():
        near = suggest(str(key), ["format"])
        if near.startswith("did"):
            return InputError(f"unknown key {key!r}", code="unknown-key", where=f"{place}.{key}", repair=near)
    return InputError(
        "it does not say what kind of file this is",
        code="missing-key",
        where=place,
        repair='add format = "csv", or the format that it has',
    )
