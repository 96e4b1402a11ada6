"""The folder of a sweep: Parquet files of consecutive sets, each there as a whole or not at all.

A part is written next to its place, forced onto the disk and renamed. After a kill every file that has its name is
complete; what was half written has another name and is removed. Which parts lack is shown by the names alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.destination import replacing
from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import lock_file
from ipmclab.sweep.packages import parquet

FloatArray = npt.NDArray[np.float64]

SET: Final = "set"
"""The column with the number of each set, from 0."""

_ABOUT: Final = "_sweep.json"  # readers of Parquet folders pass over names that begin so
_LOCK: Final = "_lock"


@dataclass(frozen=True)
class Parts:
    """The parts of one sweep in a folder.

    Parameters
    ----------
    folder : Path
    count : int
        Sets of the sweep.
    size : int
        Sets of one part; the last may have fewer.
    """

    folder: Path
    count: int
    size: int

    @property
    def files(self) -> int:
        """How many parts there are in the end."""
        return -(-self.count // self.size)

    def ends(self, part: int) -> tuple[int, int]:
        """The first set of a part, and the first of the next."""
        return part * self.size, min((part + 1) * self.size, self.count)

    def path(self, part: int) -> Path:
        """Where a part is."""
        return self.folder / f"part-{part:08d}.parquet"

    def done(self) -> int:
        """How many parts are there."""
        return sum(1 for _ in self.folder.glob("part-*.parquet"))

    def lacking(self) -> Iterator[int]:
        """The parts that are not there, in order."""
        there = {path.name for path in self.folder.glob("part-*.parquet")}
        return (part for part in range(self.files) if self.path(part).name not in there)

    def write(self, part: int, columns: Mapping[str, FloatArray]) -> None:
        """Write one part.

        Raises
        ------
        IpmclabError
            The disk is full, or may not be written to.
        """
        arrow, files = parquet()
        begin, end = self.ends(part)
        table = arrow.table({SET: np.arange(begin, end), **columns})
        with replacing(self.path(part), overwrite=False) as temporary:
            files.write_table(table, temporary, use_dictionary=False)  # no number comes twice

    def read(self, names: Sequence[str]) -> Iterator[dict[str, FloatArray]]:
        """Some columns, part by part in the order of the sets.

        Raises
        ------
        IpmclabError
            A file is not there, or was spoiled after it was written.
        """
        _, files = parquet()
        for part in range(self.files):
            path = self.path(part)
            try:
                table = files.read_table(path, columns=list(names))
            except (OSError, ValueError) as error:  # pyarrow's own errors are ValueErrors too
                raise IpmclabError(
                    f"this file of the sweep cannot be read: {error}",
                    code="bad-file",
                    where=str(path),
                    repair="remove it and run the sweep again, which makes what lacks",
                ) from error
            yield {name: np.asarray(table[name]) for name in names}

    @contextmanager
    def held(self, digest: str, about: Mapping[str, Any]) -> Iterator[None]:
        """The folder, made or found, locked against a second program; rests of a killed one are removed.

        Raises
        ------
        InputError
            Another program works on it; it holds another sweep; something else lies there.
        """
        self._make()
        with (self.folder / _LOCK).open("ab") as stream:
            if not lock_file(stream.fileno()):
                raise InputError(
                    "another program works on this sweep",
                    code="in-use",
                    where=str(self.folder),
                    repair="wait for it, or write into another folder",
                )
            self._claim(digest, about)
            for rest in self.folder.glob(".*.part"):
                rest.unlink(missing_ok=True)
            yield

    def _make(self) -> None:
        try:
            if not self.folder.parent.is_dir():
                raise InputError(
                    f"the folder {str(self.folder.parent)!r} does not exist",
                    code="no-such-folder",
                    where=str(self.folder),
                    repair="make the folder, or write elsewhere",
                )
            self.folder.mkdir(exist_ok=True)
        except (OSError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(
                f"this cannot be a folder here: {getattr(error, 'strerror', None) or error}",
                code="bad-path",
                where=str(self.folder),
                repair="give another name",
            ) from error

    def _claim(self, digest: str, about: Mapping[str, Any]) -> None:
        path = self.folder / _ABOUT
        if not path.exists():
            strange = [one.name for one in self.folder.iterdir() if one.name != _LOCK and not one.name.startswith(".")]
            if strange:
                raise InputError(
                    f"there is something else in this folder: {sorted(strange)[0]!r}",
                    code="not-a-sweep",
                    where=str(self.folder),
                    repair="give an empty or a new folder",
                )
            with replacing(path, overwrite=False) as temporary:
                temporary.write_text(json.dumps({"digest": digest, **about}, indent=1), encoding="utf-8")
        elif f'"digest": "{digest}"' not in path.read_text(encoding="utf-8", errors="replace"):
            raise InputError(
                "this folder holds another sweep: the strip, the signal, the design, the metrics, the size of its "
                "files or a version of the software differs",
                code="another-sweep",
                where=str(self.folder),
                repair="write into another folder, or remove this one",
            )
