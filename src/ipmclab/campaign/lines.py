"""Where in a campaign file a mistake is: its key and its line, which a message is to name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from ipmclab.errors import InputError
from ipmclab.store.strict import validated

_TABLE: Final = re.compile(r"^\s*(\[\[?)\s*([^\]\s]+)\s*\]")
_KEY: Final = re.compile(r"^\s*([A-Za-z0-9_\"'.-]+)\s*=")


def keyed(model: type[Any], table: Mapping[str, Any], place: str = "") -> Any:
    """A table, checked, with the keys alone as the place of what is wrong."""
    try:
        return validated(model, table, where="")
    except InputError as error:
        inside = error.where.removeprefix(":").strip()
        raise error.at(f"{place}.{inside}".strip(".")) from error


def line_of(text: str, place: str) -> int | None:
    """The line, counted from 1, on which a key is, or else the table that would hold it.

    Parameters
    ----------
    text : str
        TOML.
    place : str
        Such as ``"experiments.1.signals.0"``; places in lists are counted from 0.

    Examples
    --------
    >>> text = 'title = "a"\\n[[samples]]\\nid = "s1"\\n[[samples]]\\nid = 2'
    >>> line_of(text, "samples.1.id"), line_of(text, "samples.0.colour"), line_of(text, "order")
    (5, 2, None)
    """
    found: int | None = None
    longest = 0
    counts: dict[str, int] = {}
    at = ""
    for number, line in enumerate(text.splitlines(), start=1):
        table, key = _TABLE.match(line), _KEY.match(line)
        if table is not None:
            at = _opened(table[2], counts, is_list=table[1] == "[[")
            path = at
        elif key is not None:
            name = key[1].strip("\"'")
            path = f"{at}.{name}" if at else name
        else:
            continue
        if (place == path or place.startswith(f"{path}.")) and len(path) > longest:
            found, longest = number, len(path)
    return found


def _opened(name: str, counts: dict[str, int], *, is_list: bool) -> str:
    """The place of a table that begins: within a list it is in the last one that was opened."""
    if is_list:
        counts[name] = counts.get(name, -1) + 1
    parts: list[str] = []
    whole = ""
    for part in name.split("."):
        whole = f"{whole}.{part}" if whole else part
        parts.append(part)
        if whole in counts:
            parts.append(str(counts[whole]))
    return ".".join(parts)
