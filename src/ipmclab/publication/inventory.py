"""What a folder holds that is worth publishing: runs, fits, and other files, each with its checksum."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ipmclab.checksum import file_checksum
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_file import read_fit
from ipmclab.quality import measure
from ipmclab.quality.metrics import Metric
from ipmclab.run import Run, RunMetadata
from ipmclab.store.run_file import read_run

FORMATS: Final = {
    ".nc": "application/x-netcdf",
    ".toml": "application/toml",
    ".csv": "text/csv",
    ".json": "application/json",
    ".md": "text/markdown",
    ".txt": "text/plain",
    ".html": "text/html",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".svg": "image/svg+xml",
    ".pdf": "application/pdf",
    ".m": "text/x-matlab",
    ".mat": "application/x-matlab-data",
    ".xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    ".gz": "application/gzip",
}
"""Kinds of files that are taken along, by their ending; state, locks and journals of this program are not."""

CHECKSUMS: Final = "manifest-sha256.txt"
"""Checksums of every file of a crate as ``sha256sum -c`` reads them."""

_OF_A_CRATE: Final = ("ro-crate-metadata.json", "ro-crate-preview.html", CHECKSUMS)
_ODD: Final = re.compile(r"[\x00-\x1f\x7f\\\ud800-\udfff]")
"""What no name has everywhere: control characters, a backslash, bytes that are no text."""


@dataclass(frozen=True, eq=False)
class RunFacts:
    """What is published of a run in addition to its file: its arrays are let go, so that a folder may hold thousands.

    Parameters
    ----------
    metadata : RunMetadata
    rows : int
    rate : float [Hz]
    duration : float [s]
    channels : tuple of str
    content_sha256 : str
    metrics : tuple of Metric
    """

    metadata: RunMetadata
    rows: int
    rate: float
    duration: float
    channels: tuple[str, ...]
    content_sha256: str
    metrics: tuple[Metric, ...]

    @classmethod
    def of(cls, run: Run) -> RunFacts:
        """From a run."""
        duration = float(run.time[-1] - run.time[0])
        return cls(run.metadata, len(run), run.rate, duration, tuple(run.channels), run.content_sha256, measure(run))


@dataclass(frozen=True, eq=False)
class Item:
    """One file.

    Parameters
    ----------
    path : Path
    name : str
        Its path in the folder, with slashes.
    size : int [byte]
    sha256 : str
    run : RunFacts, optional
        Where it is one.
    fit : Fit, optional
        Where it is one.
    """

    path: Path
    name: str
    size: int
    sha256: str
    run: RunFacts | None = None
    fit: Fit | None = None

    @property
    def format(self) -> str:
        """Its media type."""
        return FORMATS[self.path.suffix.lower()]


def inventory(folder: Path) -> tuple[Item, ...]:
    """Every file of a folder and its folders that is worth publishing, by name; links and hidden files are not.

    Raises
    ------
    InputError
        No such folder, nothing in it, or a file whose name other systems cannot hold.
    """
    if not folder.is_dir():
        raise InputError(
            "there is no such folder", code="no-such-folder", where=str(folder), repair="name a folder of runs"
        )
    names = {path: path.relative_to(folder).as_posix() for path in _files(folder)}
    for name in names.values():
        if _ODD.search(name):
            raise InputError(
                f"other computers cannot hold a file with the name {name!a}",
                code="bad-name",
                where=str(folder),
                repair="rename it: letters, digits, spaces and hyphens are read everywhere",
            )
    found = tuple(_item(path, name) for path, name in names.items())
    if not found:
        raise InputError(
            "there is no run, fit, table or report in this folder",
            code="nothing-to-export",
            where=str(folder),
            repair="name a folder of runs",
        )
    return found


def _files(folder: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            path = Path(place) / name
            known = path.suffix.lower() in FORMATS and name not in _OF_A_CRATE
            if known and not name.startswith(".") and path.is_file() and not path.is_symlink():
                yield path


def _item(path: Path, name: str) -> Item:
    run, fit = None, None
    try:
        if path.suffix.lower() == ".nc":
            run = RunFacts.of(read_run(path))
        elif path.suffix.lower() == ".toml":
            fit = read_fit(path)
    except IpmclabError:  # no fit, a file of another program, or of an earlier version: it is taken along as it is
        pass
    return Item(path, name, path.stat().st_size, file_checksum(path), run, fit)
