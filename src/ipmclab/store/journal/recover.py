"""What a crash left in a laboratory folder becomes runs again; what was finished is not touched."""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from uuid import UUID

from ipmclab.errors import IpmclabError
from ipmclab.store.journal.finalise import Finished, finish
from ipmclab.store.journal.guardian_word import SUFFIX, read_word
from ipmclab.store.journal.laboratory import Laboratory

ARCHIVE_TIME: Final = 30 * 86400.0
"""How long [s] the journal of a finished run is kept."""


WORD_TIME: Final = 60.0
"""How long [s] the word of a guardian is kept that brought its output to 0 V: clients look several times a second."""


@dataclass(frozen=True)
class Recovery:
    """What ``recover`` has done.

    Parameters
    ----------
    finished : tuple of Finished
        One for each journal that was there and could be dealt with.
    failed : tuple of (path, IpmclabError)
        Journals that could not: they are kept.
    removed : tuple of path
        Half-written files that nobody needs any more, and journals whose run has been finished for 30 days.
    """

    finished: tuple[Finished, ...]
    failed: tuple[tuple[Path, IpmclabError], ...]
    removed: tuple[Path, ...]


def recover(
    laboratory: Laboratory | str | os.PathLike[str],
    *,
    on_progress: Callable[[int, int, Path], None] | None = None,
) -> Recovery:
    """Make a run of every journal that nobody is writing: complete or aborted as it says, else recovered.

    Safe at any time, also while others record or recover: a journal that is in use is left alone. Doing it twice
    gives the same. One journal that cannot be dealt with does not stop the others.

    Parameters
    ----------
    laboratory : Laboratory or path
    on_progress : callable of (done, total, path), optional
        Called before each journal.

    Raises
    ------
    InputError
        No such folder.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     recover(folder)
    Recovery(finished=(), failed=(), removed=())
    """
    laboratory = Laboratory.open(laboratory)
    # Half files first, then the journals: a half file whose journal is there belongs to whoever finishes it now.
    halves = [*laboratory.runs.glob("*/*/*.part"), *laboratory.recording.glob("*.ballast")]
    journals = laboratory.journals()
    removed = [half for half in halves if not _belongs(half, journals) and _remove(half)]
    finished: list[Finished] = []
    failed: list[tuple[Path, IpmclabError]] = []
    for number, journal in enumerate(journals):
        if on_progress is not None:
            on_progress(number, len(journals), journal)
        try:
            finished.append(finish(journal, laboratory))
        except IpmclabError as error:
            failed.append((journal, error))
    removed += _old_journals(laboratory)
    removed += _settled_words(laboratory)
    return Recovery(tuple(finished), tuple(failed), tuple(removed))


def _belongs(half: Path, journals: tuple[Path, ...]) -> bool:
    return any(journal.stem == half.stem or f"_{journal.stem[:8]}." in half.name for journal in journals)


def _old_journals(laboratory: Laboratory) -> list[Path]:
    """Remove archived journals whose time is over and whose run file is there."""
    old = laboratory.archived(time.time() - ARCHIVE_TIME)
    if not old:
        return []
    there = {path.stem.rpartition("_")[2] for path in laboratory.runs.glob("*/*/*.nc")}
    return [path for path in old if _first_digits(path) in there and _remove(path)]


def _settled_words(laboratory: Laboratory) -> list[Path]:
    """Remove what guardians left that had their output at 0 V, once no journal waits for it and others have read it."""
    if laboratory.journals():
        return []
    return [
        file
        for file in laboratory.recording.glob(f"*{SUFFIX}")
        if (word := read_word(file)).state in ("zero", "disarmed")
        and word.time < time.time() - WORD_TIME
        and not file.with_suffix(".recorder").exists()
        and _remove(file)
    ]


def _first_digits(journal: Path) -> str:
    with suppress(ValueError):
        return UUID(journal.stem).hex[:8]
    return ""


def _remove(path: Path) -> bool:
    """Remove a file if the system lets us; another time will do."""
    try:
        path.chmod(path.stat().st_mode | stat.S_IWRITE)  # Windows removes no file that may only be read
        path.unlink()
    except OSError:
        return False
    return True
