"""Names of physical channels: lists and ranges as NI writes them."""

from __future__ import annotations

import re

_NUMBERED = re.compile(r"(?P<stem>.*?)(?P<number>\d*)")
_RANGE = re.compile(r"^(?P<stem>.*?)(?P<first>\d+):(?P<stem2>(?:[^:]*\D)?)(?P<last>\d+)$")


def expand(text: str) -> list[str]:
    """A list of names with ranges, one name each.

    Examples
    --------
    >>> expand("cDAQ1Mod1/ai0:2, cDAQ1Mod1/ai7")
    ['cDAQ1Mod1/ai0', 'cDAQ1Mod1/ai1', 'cDAQ1Mod1/ai2', 'cDAQ1Mod1/ai7']
    >>> expand("cDAQ1Mod1/ai3:2")
    ['cDAQ1Mod1/ai3', 'cDAQ1Mod1/ai2']
    """
    names = []
    for part in text.split(","):
        part = part.strip()
        if not part:
            continue
        match = _RANGE.match(part)
        if match is None or match["stem2"] not in ("", match["stem"], match["stem"].rpartition("/")[2]):
            names.append(part)
            continue
        first, last = int(match["first"]), int(match["last"])
        way = 1 if last >= first else -1
        names.extend(f"{match['stem']}{index}" for index in range(first, last + way, way))
    return names


def assigned(text: str, count: int) -> list[str]:
    """Names for `count` channels, as NI gives them: the last name of too short a list is counted on.

    Examples
    --------
    >>> assigned("volts", 1), assigned("volts", 2), assigned("foo31", 2)
    (['volts'], ['volts0', 'volts1'], ['foo31', 'foo32'])
    >>> assigned("a0:3, b", 8)
    ['a0', 'a1', 'a2', 'a3', 'b0', 'b1', 'b2', 'b3']
    """
    names = expand(text)
    left = count - len(names)
    if not names or left <= 0:
        return names[:count]
    last = _NUMBERED.fullmatch(names.pop())
    assert last is not None
    first = int(last["number"] or 0)
    return names + [f"{last['stem']}{first + k:0{len(last['number'])}d}" for k in range(left + 1)]
