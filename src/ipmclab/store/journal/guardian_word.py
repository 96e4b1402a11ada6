"""What a guardian wrote of the output, next to the journal of the recorder that it watched over."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

SUFFIX: Final = ".guardian"
"""Of the file in which a guardian says what it has come to."""

EVENT: Final = "guardian"
"""The kind of event by which a journal names that file."""

_ACTS_WITHIN: Final = 6.0
"""How long [s] after the last row a guardian may take: it acts within 1 s, or says after 3 s that it could not."""


@dataclass(frozen=True)
class Word:
    """What a guardian has come to.

    Parameters
    ----------
    state : str
        ``armed``, ``disarmed``, ``zero``, ``unread`` or ``failed``; empty where there is no file, ``unknown`` where it
        cannot be read.
    text : str
    time : float [s since 1970]
        When it said so.
    """

    state: str = ""
    text: str = ""
    time: float = 0.0

    def __str__(self) -> str:
        when = datetime.fromtimestamp(self.time, UTC).astimezone().isoformat(" ", "milliseconds")
        match self.state:
            case "zero":
                return f"its guardian read the output back at 0 V at {when} ({self.text})"
            case "disarmed":
                return f"its recorder had the output at 0 V at {when}"
            case "unread":
                return f"its guardian reset the output at {when}, but could not read it back ({self.text})"
            case "failed":
                return f"its guardian could NOT bring the output to 0 V by {when} ({self.text})"
            case "":
                return "its guardian left no word of the output"
        return "its guardian never said that the output is at 0 V"


def read_word(file: Path, *, since: float | None = None) -> Word:
    """What is in the file of a guardian; where its recorder may just have died, its word is waited for.

    Parameters
    ----------
    file : Path
    since : float [s since 1970], optional
        When its recorder wrote last. Without it nothing is waited for.
    """
    while True:
        word = _read(file)
        if since is None or word.state not in ("armed", "unknown") or time.time() > since + _ACTS_WITHIN:
            return word
        time.sleep(0.1)


def _read(file: Path) -> Word:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        return Word(str(document["state"]), str(document["text"]), float(document.get("time", 0.0)))
    except FileNotFoundError:
        return Word()
    except (OSError, ValueError, KeyError, TypeError) as error:
        return Word("unknown", str(error))
