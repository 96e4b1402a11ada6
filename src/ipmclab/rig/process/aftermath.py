"""What became of the output when a recorder's process is gone: its guardian writes it down, its clients read it."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Final

SUFFIX: Final = ".guardian"
"""Of the file beside the recorder's own in which its guardian says what it has come to."""

PATIENCE: Final = 6.0
"""How long [s] a client waits for the guardian's word: it acts within 1 s, or says after 3 s that it could not."""

_LOOK: Final = 0.1


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
        if state == "failed":
            return f"SWITCH THE AMPLIFIER OFF: its guardian could NOT bring the output to 0 V ({text})"
        if state in ("", "disarmed"):
            return "the output was at 0 V" if state else "no guardian was watching an output"
        if time.monotonic() >= until:
            return "SWITCH THE AMPLIFIER OFF: its guardian has not said that the output is at 0 V"
        time.sleep(_LOOK)


def read(file: Path) -> tuple[str, str]:
    """State and text that a guardian wrote; both empty where there is none."""
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        return str(told["state"]), str(told["text"])
    except FileNotFoundError:
        return "", ""
    except (OSError, ValueError, KeyError, TypeError) as error:
        return "unknown", str(error)


def failures(folder: Path) -> list[tuple[Path, str]]:
    """The guardians of a laboratory folder that could not bring their output to 0 V, with what they said."""
    found = []
    for file in sorted((folder / "recording").glob(f"*{SUFFIX}")):
        state, text = read(file)
        if state == "failed":
            found.append((file, f"SWITCH THE AMPLIFIER OFF: a guardian could NOT bring the output to 0 V ({text})"))
    return found
