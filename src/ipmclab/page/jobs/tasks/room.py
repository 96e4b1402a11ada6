"""How large a record a worker of the page takes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ipmclab.store.importers.unpacked import refuse_large

MOST_UNPACKED: Final = 128 * 1024 * 1024
"""Bytes of a record: read as text it takes a worker up to 25 times as much."""


def refuse_large_here(path: Path) -> None:
    """Refuse a record that would unpack to more than a worker should hold.

    Raises
    ------
    InputError
        It holds more than ``MOST_UNPACKED`` bytes, or is not there any more.
    """
    refuse_large(path, MOST_UNPACKED)
