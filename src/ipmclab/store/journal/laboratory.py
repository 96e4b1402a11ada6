"""The laboratory folder: where runs are recorded, kept and found again."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from uuid import UUID

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import LONGEST_PATH
from ipmclab.run import RunMetadata

BALLAST: Final = 64 << 20
"""Bytes that are held back while a run is recorded, so that on a full disk it can still be ended and finished."""

_ROOM_FACTOR: Final = 1.3  # the journal, and the run file with it: at most 0.3 of it with the 16 bits of a converter
_LONGEST_WORD: Final = 40


@dataclass(frozen=True)
class Laboratory:
    """A folder with all the runs of a laboratory.

    ``recording/`` has a journal for each run that is being recorded, or that a crash left; ``runs/YYYY/MM/`` the
    finished runs, read-only; ``journal-archive/`` the journals of finished runs, for 30 days; ``lost+found/`` journals
    that do not say what they are.

    Parameters
    ----------
    root : path

    Use ``Laboratory.open``, which makes the folders.
    """

    root: Path

    @classmethod
    def open(cls, root: str | os.PathLike[str] | Laboratory, *, create: bool = True) -> Laboratory:
        """Open the laboratory of a folder.

        Parameters
        ----------
        root : str or path
        create : bool
            Whether to make it where there is none; the folder that it is in must be there.

        Raises
        ------
        InputError
            No such folder, or one that is no laboratory where none may be made.
        IpmclabError
            The folders cannot be made.
        """
        if isinstance(root, Laboratory):
            return root
        laboratory = cls(Path(os.path.realpath(root)))
        where = str(root)
        if not laboratory.recording.is_dir() and not create:
            raise InputError(
                "this is no laboratory folder: it has no folder 'recording'",
                code="no-laboratory",
                where=where,
                repair="name the folder that the experiment files name",
            )
        if not laboratory.root.parent.is_dir():
            raise InputError(
                f"the folder {str(laboratory.root.parent)!r} does not exist",
                code="no-such-folder",
                where=where,
                repair="make the folder, or record elsewhere",
            )
        if laboratory.root.exists() and not laboratory.root.is_dir():
            raise InputError(
                "this is a file, and runs are recorded into a folder",
                code="no-such-folder",
                where=where,
                repair="name a folder, which is made where it does not exist",
            )
        try:
            laboratory.root.mkdir(exist_ok=True)
            for folder in (laboratory.recording, laboratory.runs, laboratory.archive, laboratory.lost):
                folder.mkdir(exist_ok=True)
        except OSError as error:
            raise IpmclabError(
                f"the laboratory folder cannot be made: {error.strerror or error}",
                code="write-failed",
                where=where,
                repair="see that the disk has room and that you may write there",
            ) from error
        return laboratory

    @property
    def recording(self) -> Path:
        """Where runs are recorded."""
        return self.root / "recording"

    @property
    def runs(self) -> Path:
        """Where finished runs are."""
        return self.root / "runs"

    @property
    def archive(self) -> Path:
        """Where the journals of finished runs stay for a while."""
        return self.root / "journal-archive"

    @property
    def lost(self) -> Path:
        """Where journals are that cannot be made into a run."""
        return self.root / "lost+found"

    def journal(self, uuid: str) -> Path:
        """Where the journal of a run is while it is recorded."""
        return self.recording / f"{uuid}.runj"

    def ballast(self, uuid: str) -> Path:
        """The file that holds room back for a run while it is recorded."""
        return self.recording / f"{uuid}.ballast"

    def journals(self) -> tuple[Path, ...]:
        """The journals that are being written or wait to be finished, the oldest first."""
        return tuple(path for _, path in sorted(_with_age(self.recording)))

    def salvaged(self) -> tuple[Path, ...]:
        """The tables of journals that lost their header."""
        return tuple(sorted(self.lost.glob("*.csv")))

    def archived(self, before: float) -> tuple[Path, ...]:
        """The archived journals that were last written before a time [s since 1970]."""
        return tuple(path for age, path in _with_age(self.archive) if age < before)

    def run_file(self, uuid: str, metadata: RunMetadata, created_at: str) -> Path:
        """Where a finished run is: ``runs/2026/11/20261121_143205_rig1_S2_step_3f2a77c1.nc``.

        Parameters
        ----------
        uuid : str
        metadata : RunMetadata
        created_at : str
            ISO 8601; used where the metadata do not say when the run was recorded.
        """
        from ipmclab.store.catalogue.facts import signal_facts  # which would bring the signals along

        moment = metadata.recorded_at or ""
        moment = moment if _DATE.match(moment) else created_at
        digits = re.sub(r"\D", "", moment)
        purpose = metadata.purpose if metadata.purpose != "signal" else None
        signal = purpose or "-".join(signal_facts(metadata.signal).words)
        sample = metadata.sample.id if metadata.sample else None
        words = (_word(metadata.rig, "rig"), _word(sample, "sample"), _word(signal, "signal"))
        name = "_".join((digits[:8], digits[8:14], *words, UUID(uuid).hex[:8]))
        return self.runs / digits[:4] / digits[4:6] / f"{name}.nc"

    def check_name(self, metadata: RunMetadata) -> None:
        """Refuse a run whose file would have a name that cannot be opened: better before it is recorded than after.

        Parameters
        ----------
        metadata : RunMetadata
            Rig, sample and signal: they stand in the name.

        Raises
        ------
        InputError
        """
        file = self.run_file(_SOME_UUID, metadata, "2026-11-21T14:32:05")
        length = len(str(file)) + len(".part")
        if length > LONGEST_PATH:
            raise InputError(
                f"the run would be at a path of {length} letters, this system opens {LONGEST_PATH} at most: {file}",
                code="path-too-long",
                where="folder",
                repair=f"record into a folder whose path is {length - LONGEST_PATH} letters shorter, or give rig, "
                "sample or signal a shorter name",
            )

    def free_space(self) -> int:
        """Bytes that are free on its disk."""
        return shutil.disk_usage(self.root).free


_SOME_UUID: Final = "00000000-0000-4000-8000-000000000000"
_DATE: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d")


def free_space_needed(*, rate: float, duration: float, columns: Sequence[str], ballast: int = BALLAST) -> int:
    """Bytes that must be free for a run: its journal, its file, and what is held back.

    Examples
    --------
    >>> free_space_needed(rate=10e3, duration=3600.0, columns=["voltage", "current"], ballast=0)
    748800000
    """
    return ballast + int(_ROOM_FACTOR * rate * duration * 8 * len(columns))


def _with_age(folder: Path) -> list[tuple[float, Path]]:
    found = []
    for path in folder.glob("*.runj"):
        with suppress(FileNotFoundError):  # somebody has finished it meanwhile
            found.append((path.stat().st_mtime, path))
    return found


def _word(text: str | None, otherwise: str) -> str:
    """A text as part of a file name that every system takes."""
    return re.sub(r"[^A-Za-z0-9.-]+", "-", text or "").strip("-.")[:_LONGEST_WORD] or otherwise
