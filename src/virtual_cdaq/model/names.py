"""Names of physical channels: lists and ranges as NI writes them."""

from __future__ import annotations

import re

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
