"""What the guardians of a laboratory folder have come to, also those whose recorders are gone."""

from __future__ import annotations

import os
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Final

from ipmclab.rig.process import aftermath
from ipmclab.rig.process.hub import SUFFIX

_TAIL: Final = 65536  # bytes of the log that are looked at: some hundred runs


def left_by_others(folder: Path, own: str) -> dict[str, tuple[str, str]]:
    """State and text of each guardian that matters when its recorder is not followed, by the name of that one's file.

    A guardian that is armed for another recorder which is there is none of them: that is a run that continues.

    Parameters
    ----------
    folder : Path
        The laboratory folder.
    own : str
        The name of the file of the recorder that is followed, or was last.
    """
    found = {}
    for file in sorted((folder / "recording").glob(f"*{aftermath.SUFFIX}")):
        recorder = file.with_suffix(SUFFIX)
        state, text = aftermath.read(file)
        if recorder.name == own or not state:
            continue
        if state in ("zero", "disarmed", "failed", "unread") or not (recorder.exists() or _is_settled(folder, file)):
            found[recorder.name] = (state, text)
    return found


def _is_settled(folder: Path, file: Path) -> bool:
    """Whether a guardian had an output at 0 V after another one wrote its last word, by their common log."""
    with suppress(OSError, ValueError):
        when = file.stat().st_mtime
        with (folder / "guardian.log").open("rb") as stream:
            stream.seek(0, os.SEEK_END)
            stream.seek(max(0, stream.tell() - _TAIL))
            lines = stream.read().decode(errors="replace").splitlines()
        for line in reversed(lines):
            moment, _, text = line.partition(" ")
            if text == "disarmed" or " is at 0 V," in text:
                return datetime.fromisoformat(moment).timestamp() > when
    return False
