"""Records that browsers have sent, each until its import is done or given up, and never more than a few."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ipmclab.errors import InputError

MOST_UPLOADS: Final = 4
"""Records that are kept at once, those on their way included: half a GiB where all are as large as they may be."""


class Uploads:
    """The records that were sent. It is used by the server's own thread alone.

    Parameters
    ----------
    folder : Path
        Where they are until then.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kept: list[Path] = []
        self._coming = 0

    @contextlib.contextmanager
    def receive(self, name: str) -> Iterator[Path]:
        """A file for a record that comes; it is kept if the block ends well, and the oldest makes room for it.

        Raises
        ------
        InputError
            Too many are on their way.
        """
        if self._coming == MOST_UPLOADS:
            raise InputError(
                f"{MOST_UPLOADS} records are being sent already",
                code="busy",
                where="upload",
                repair="wait until they are here, then send it again",
            )
        path = self._folder / f"{secrets.token_hex(8)}-{name}"
        self._coming += 1
        while self._kept and len(self._kept) + self._coming > MOST_UPLOADS:
            self.forget(self._kept[0])
        try:
            yield path
        except BaseException:  # the browser left, it is too large, or the disk is full: half a record is of no use
            path.unlink(missing_ok=True)
            raise
        finally:
            self._coming -= 1
        self._kept.append(path)

    def forget(self, path: Path | None) -> None:
        """Delete a record whose import is done or given up; a file that was not sent stays."""
        if path in self._kept:
            self._kept.remove(path)
            with contextlib.suppress(OSError):  # a worker has it open, where that matters; it goes with the server
                path.unlink()
