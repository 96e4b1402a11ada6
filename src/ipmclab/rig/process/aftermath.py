"""What became of the output when a recorder's process is gone: its guardian writes it down, its clients read it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

from ipmclab.store.journal.guardian_word import SUFFIX as SUFFIX
from ipmclab.store.journal.guardian_word import read_word

PATIENCE: Final = 6.0
"""How long [s] a client waits for the guardian's word: it acts within 1 s, or says after 3 s that it could not."""

_LOOK: Final = 0.1
_UNREAD: Final = "a guardian reset the output, but could not read back that it is at 0 V ({})"


def fate(recorder: Path, within: float = PATIENCE) -> str:
    """What is known of the output, in words, once the recorder of a file is gone.

    Parameters
    ----------
    recorder : Path
        The file that the recorder was found by.
    within : float [s]
        How long to wait for a guardian that still acts.
    """
    file = recorder.with_suffix(SUFFIX)
    until = time.monotonic() + within
    while True:
        state, text = read(file)
        if state == "zero":
            return "its guardian brought the output to 0 V"
        if state == "unread":
            return f"SWITCH THE AMPLIFIER OFF: {_UNREAD.format(text)}"
        if state == "failed":
            return f"SWITCH THE AMPLIFIER OFF: its guardian could NOT bring the output to 0 V ({text})"
        if state in ("", "disarmed"):
            return "the output was at 0 V" if state else "no guardian was watching an output"
        if time.monotonic() >= until:
            return "SWITCH THE AMPLIFIER OFF: its guardian has not said that the output is at 0 V"
        time.sleep(_LOOK)


def read(file: Path) -> tuple[str, str]:
    """State and text that a guardian wrote; both empty where there is none."""
    word = read_word(file)
    return word.state, word.text


def failures(folder: Path) -> list[tuple[Path, str]]:
    """The guardians of a laboratory folder that have not read their output at 0 V, with what they said."""
    found = []
    for file in sorted((folder / "recording").glob(f"*{SUFFIX}")):
        state, text = read(file)
        if state == "failed":
            found.append((file, f"SWITCH THE AMPLIFIER OFF: a guardian could NOT bring the output to 0 V ({text})"))
        elif state == "unread":
            found.append((file, f"SWITCH THE AMPLIFIER OFF, or see that it is at 0 V: {_UNREAD.format(text)}"))
    return found
