"""The folder that the page shows: experiments, actuators, rigs, the laboratory with its runs; no path outside it."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ipmclab.errors import InputError
from ipmclab.platform import is_device

RUNS: Final = "runs"
"""The laboratory folder in a folder that is none itself, as experiment files name it unless they say otherwise."""

_FIRST_PORT: Final = 20_000
_PORTS: Final = 10_000
"""Of these ports each folder has one: above those of known services, below those that systems give away."""

_FILE: Final = re.compile(r"\bfile\s+(\"[^\"]*\"|'[^']*'|\S+)", re.IGNORECASE)
_HALF: Final = re.compile(r"\..+\.[0-9a-f]{8}\.part")  # as ``destination`` names a file until it is whole
_LEFT: Final = 600.0
"""How long [s] nobody writes on with a file that nobody writes any more."""

_MOST_BYTES: Final = 200
"""Of a name that somebody gives: a file system has room for 255, and until a file is whole its name is longer."""

_MOST_TOLD: Final = 80
"""Letters of a name that an error repeats."""

_MOST_LETTERS: Final = 80
_NAME = re.compile(rf"[\w][\w .+-]{{0,{_MOST_LETTERS - 1}}}")


@dataclass(frozen=True)
class Lab:
    """A folder to work in.

    Parameters
    ----------
    root : Path
        Everything that the page reads or writes is in it.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     Lab.open(folder).path("step.toml").name
    'step.toml'
    """

    root: Path

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> Lab:
        """The lab of a folder.

        Raises
        ------
        InputError
            There is no such folder.
        """
        root = Path(os.path.realpath(folder))
        if not root.is_dir():
            raise InputError(
                "there is no such folder",
                code="no-such-folder",
                where=str(folder),
                repair="name the folder with your experiment files, or a laboratory folder",
            )
        return cls(root)

    @property
    def laboratory_folder(self) -> Path:
        """Where the runs are: the folder itself where it is a laboratory, else ``runs`` in it."""
        return self.root if (self.root / "recording").is_dir() else self.root / RUNS

    @property
    def mark(self) -> str:
        """A short name of the folder that distinguishes it from others."""
        return hashlib.sha256(os.fsencode(self.root)).hexdigest()[:12]

    @property
    def port(self) -> int:
        """The port that the page of this folder has where nobody says otherwise and nobody has taken it.

        Begun again it is where it was: a page that is open finds it again, with what its browser has kept.
        """
        return _FIRST_PORT + int(self.mark, 16) % _PORTS

    def path(self, name: str | os.PathLike[str]) -> Path:
        """A file or folder in the lab, by its path below the root.

        Raises
        ------
        InputError
            It is outside, by whatever way: absolute, through .., through a link; or no file can be called so.
        """
        try:
            whole = Path(os.path.realpath(self.root / name))
            is_inside = whole.is_relative_to(self.root) and _can_be(whole)
        except ValueError:  # a null byte
            is_inside = False
        if not is_inside:
            raise InputError(
                f"{_shortened(str(name))!r} is not in the folder of this page",
                code="outside-folder",
                where="path",
                repair="copy the file into the folder, or start ipmclab page in the folder that has it",
            )
        return whole

    def below(self, path: str | os.PathLike[str]) -> str:
        """A path in the lab as it is shown: from the root, with forward slashes."""
        return self.path(path).relative_to(self.root).as_posix()

    def new_file(self, name: str, suffix: str) -> Path:
        """The path of a file that a user named, in the root.

        Parameters
        ----------
        name : str
            With or without the suffix.
        suffix : str
            Such as ``".toml"``.

        Raises
        ------
        InputError
            A name that is no plain file name.
        """
        stem = name.strip().removesuffix(suffix)
        is_named = _NAME.fullmatch(stem) is not None and len(stem.encode()) <= _MOST_BYTES
        if not is_named or is_device(stem) or stem.endswith((".", " ")):
            raise InputError(
                f"{_shortened(name)!r} is no plain file name",
                code="bad-name",
                where="name",
                repair="use letters, digits, spaces, and . + - _; at most 80 (of a script that is not Latin fewer), "
                "beginning with a letter or digit",
            )
        return self.path(stem + suffix)

    def forget_halves(self) -> None:
        """Delete what a process that was killed had written half; what somebody may be writing now stays."""
        for folder in {self.root, self.laboratory_folder}:
            for path in folder.glob(".*.part"):
                with contextlib.suppress(OSError):
                    if _HALF.fullmatch(path.name) and time.time() - path.lstat().st_mtime > _LEFT:
                        path.unlink()

    def tables(self) -> list[Path]:
        """The TOML files of the root, which may be experiments, actuators, rigs..."""
        return self.files("*.toml")

    def files(self, pattern: str) -> list[Path]:
        """The files of the root that a pattern names, without links that lead outside or nowhere."""
        return sorted(path for path in self.root.glob(pattern) if path.is_file() and self.is_inside(path))

    def is_inside(self, path: Path) -> bool:
        """Whether a path is in the lab wherever its links lead."""
        return Path(os.path.realpath(path)).is_relative_to(self.root)


def _can_be(path: Path) -> bool:
    """Whether a file system can have a file of this name: whoever asks for a longer one gets its error, not no."""
    try:
        path.lstat()
    except OSError as error:
        return error.errno != errno.ENAMETOOLONG
    return True


def _shortened(name: str) -> str:
    """A name as an error says it: of a long one its beginning is enough."""
    return name if len(name) <= _MOST_TOLD else f"{name[:_MOST_TOLD]}…"


def plain_name(text: str, where: str) -> str:
    """What a sample or a mounting is called, as it is written.

    Raises
    ------
    InputError
        Longer than a file may be called, beside whose name it is in lists.

    Examples
    --------
    >>> plain_name(" strip-1 ", "sample")
    'strip-1'
    """
    name = text.strip()
    if len(name) > _MOST_LETTERS:
        raise InputError(
            f"it has {len(name)} letters, at most {_MOST_LETTERS} can be read in a list",
            code="bad-name",
            where=where,
            repair="write a shorter one",
        )
    return name


def files_of(signal: str) -> list[str]:
    """The files that the text of a signal takes samples from.

    Examples
    --------
    >>> files_of("file 'my sweep.csv' for 3 s then file other.nc gain=-1")
    ['my sweep.csv', 'other.nc']
    """
    return [
        found[1:-1] if found[0] == found[-1] in "\"'" and len(found) > 1 else found for found in _FILE.findall(signal)
    ]
