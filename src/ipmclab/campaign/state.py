"""What a campaign has done, on the disk: a file that only grows, and that is right after any power cut.

Each event is one line: JSON, a space, and its CRC-32. A line that is cut off, or that does not check, never happened.
What it would have reported is found out again: a run that a sitting began is looked for by its uuid.
"""

from __future__ import annotations

import errno
import json
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Literal

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import lock_file, sync_file, sync_folder

FILE: Final = "campaign.log"

MODELS: Final = "models"
"""The folder of the fits, in that of the campaign."""

Verdict = Literal["kept", "flagged", "repeat", "interrupted"]
"""``kept``: good; ``flagged``: it fails its checks, and so did those before it; ``repeat``: it fails, and is recorded
again; ``interrupted``: it was ended before its end, and is recorded again."""


class State:
    """The events of a campaign in one folder.

    Parameters
    ----------
    folder : Path
        There already.

    Raises
    ------
    InputError
        Somebody else carries the campaign out in this folder now.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with State(Path(folder)) as state:
    ...         state.add("recorded", run="a", verdict="kept")
    ...     with State(Path(folder)) as state:
    ...         sorted(state.done)
    ['a']
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o644)
        if not lock_file(self._file):
            os.close(self._file)
            raise InputError(
                "this campaign is being carried out at the moment",
                code="in-use",
                where=str(folder),
                repair="wait for it, or name another folder",
            )
        sync_folder(folder)  # its name too: what a power cut leaves without a name never happened
        text = self.path.read_bytes()
        if text and not text.endswith(b"\n"):
            os.write(self._file, b"\n")  # what was cut off stays, as a line that does not check
        self.events: list[dict[str, Any]] = list(_events(text))

    def __enter__(self) -> State:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def add(self, event: str, **values: Any) -> None:
        """Record something that has happened, or is about to; it is on the disk when this returns."""
        record = {"event": event, "at": datetime.now().astimezone().isoformat(timespec="seconds"), **values}
        line = _line(record)
        try:
            if os.write(self._file, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            sync_file(self._file)
        except OSError as error:
            raise IpmclabError(
                f"the log of the campaign cannot be written: {error.strerror}",
                code="write-failed",
                where=str(self.path),
                repair="check that the disk has free space; the same command continues",
            ) from error
        self.events.append(record)

    @property
    def begun(self) -> Mapping[str, Any] | None:
        """How the campaign was begun."""
        return as_begun(self.events)

    def of(self, event: str) -> list[dict[str, Any]]:
        """The events of one kind, in their order."""
        return [one for one in self.events if one["event"] == event]

    @property
    def recorded(self) -> Mapping[str, dict[str, Any]]:
        """The last word on each run."""
        return {one["run"]: one for one in self.of("recorded")}

    @property
    def done(self) -> frozenset[str]:
        """The runs that need not be recorded any more."""
        return frozenset(name for name, one in self.recorded.items() if one["verdict"] in ("kept", "flagged"))

    @property
    def failures(self) -> dict[str, int]:
        """How often each run failed its checks; one that was interrupted did not."""
        found: dict[str, int] = {}
        for one in self.of("recorded"):
            if one["verdict"] in ("repeat", "flagged"):
                found[one["run"]] = found.get(one["run"], 0) + 1
        return found

    @property
    def open(self) -> dict[str, str]:
        """The runs of sittings that were begun, by uuid, of which nothing more is known."""
        known = {one["uuid"] for one in self.of("recorded")}
        begun = {uuid: run for one in self.of("sitting") for run, uuid in one["runs"].items()}
        over = {uuid for one in self.of("absent") for uuid in one["uuids"]}
        return {uuid: run for uuid, run in begun.items() if uuid not in known | over}


def _line(record: Mapping[str, Any]) -> bytes:
    text = json.dumps(record, ensure_ascii=True).encode()
    return text + f" {zlib.crc32(text):08x}\n".encode()


def _events(content: bytes) -> Iterator[dict[str, Any]]:
    for line in content.splitlines():
        text, _, checksum = line.rpartition(b" ")
        if checksum == f"{zlib.crc32(text):08x}".encode():
            yield json.loads(text)


def as_begun(events: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """How the campaign of these events was begun: its title, its checksum and its plan; None before it was.

    Examples
    --------
    >>> as_begun([{"event": "campaign", "title": "two strips"}, {"event": "recorded"}])["title"]
    'two strips'
    """
    return next((one for one in reversed(events) if one["event"] == "campaign"), None)


def read_events(folder: Path) -> list[dict[str, Any]]:
    """The events of a campaign, for whoever only looks.

    Raises
    ------
    InputError
        No campaign was carried out in this folder.
    """
    path = folder / FILE
    if not path.is_file():
        raise InputError(
            f"there is no {FILE} here: no campaign was carried out in this folder",
            code="no-campaign",
            where=str(folder),
            repair="name the folder that --out named",
        )
    return list(_events(path.read_bytes()))
