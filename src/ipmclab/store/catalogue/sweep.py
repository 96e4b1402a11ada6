"""Keeping the catalogue true to the files: what is new, what changed, what is gone."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.store.catalogue.database import REFUSED_VALUE
from ipmclab.store.catalogue.facts import FileFacts, problem_text, read_facts
from ipmclab.store.catalogue.write import choose_shown, clear_file, put_run_file

if TYPE_CHECKING:
    from ipmclab.store.catalogue.database import Database

Progress = Callable[[int, int], None]
"""Called with how many are done, and of how many."""

_BATCH: Final = 200
"""Files read between two transactions: what was read is kept when the sweep is stopped."""

_ASIDE: Final = ("recording", "journal-archive", "lost+found")
"""Folders of a laboratory that hold no run files."""


@dataclass(frozen=True)
class Problem:
    """A file that could not be taken into the catalogue, or not as it should be."""

    path: str
    code: str
    message: str


@dataclass(frozen=True)
class Sweep:
    """What a look at the files found.

    Parameters
    ----------
    files : int
        netCDF files in the folder.
    added, changed : int
        Files that were read because they are new or have another size or time.
    gone : int
        Files that were there at the last look.
    problems : tuple of Problem
        Every file that is damaged, also from earlier looks, and folders that cannot be read.
    foreign : int
        netCDF files that are no runs.
    """

    files: int
    added: int
    changed: int
    gone: int
    problems: tuple[Problem, ...]
    foreign: int


def sweep_files(database: Database, root: Path, laboratory: str, on_progress: Progress | None = None) -> Sweep:
    """Read the run files whose size or time differ from the catalogue, and note those that are gone.

    Raises
    ------
    IpmclabError
        The catalogue cannot be read or written. What is wrong with a file is reported in the result.
    """
    from sqlalchemy import select

    from ipmclab.store.catalogue.tables import file

    problems: list[Problem] = []
    there = dict(run_files(root, problems))
    with database.read() as connection:
        columns = (file.c.path, file.c.size, file.c.mtime_ns, file.c.problem_code)
        rows = connection.execute(select(*columns).where(file.c.laboratory == laboratory)).all()
    known = {path: (size, mtime) for path, size, mtime, _ in rows}
    # First what is gone: a file that now has its uuid for itself may take its place.
    gone = sorted(path for path in known if path not in there and _is_gone(root / path))
    if gone:
        with database.write() as connection:
            choose_shown(connection, *[clear_file(connection, laboratory, path) for path in gone])
    # A right that was given or an update of ipmclab mends a file without a trace in its size and time.
    doubtful = {path for path, _, _, code in rows if code not in (None, "not-a-run")}
    fresh = {path for path, stamp in there.items() if known.get(path) != stamp}
    todo = iter(sorted(fresh | (doubtful & there.keys())))
    total = len(fresh | (doubtful & there.keys()))
    done = 0
    while batch := list(islice(todo, _BATCH)):
        read: list[tuple[str, FileFacts | InputError]] = []
        for path in batch:
            read.append((path, _read(root / path)))
            done += 1
            if on_progress is not None:
                on_progress(done, total)
        _put(database, laboratory, read, there, problems)
    with database.read() as connection:
        bad = select(file.c.path, file.c.problem_code, file.c.problem)
        bad = bad.where(file.c.laboratory == laboratory, file.c.problem_code.is_not(None))
        found = connection.execute(bad.order_by(file.c.path)).all()
    problems += [Problem(path, code, text) for path, code, text in found if code != "not-a-run"]
    return Sweep(
        files=len(there),
        added=sum(path not in known for path in there),
        changed=sum(path in known for path in fresh),
        gone=len(gone),
        problems=tuple(problems),
        foreign=sum(code == "not-a-run" for _, code, _ in found),
    )


def _is_gone(path: Path) -> bool:
    """Whether there is surely no such file: one in a folder that cannot be read now may be there."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:
        return False
    return False


def run_files(root: Path, problems: list[Problem]) -> Iterator[tuple[str, tuple[int, int]]]:
    """The netCDF files below a folder, each with its size [bytes] and time [ns].

    Links to folders are not followed, so that a loop has an end.
    """
    folders = [root]
    while folders:
        folder = folders.pop()
        try:
            with os.scandir(folder) as entries:
                listed = list(entries)
        except OSError as error:
            where = folder.relative_to(root).as_posix()
            problems.append(
                Problem(where, "unreadable-folder", f"the folder cannot be read: {error.strerror or error}")
            )
            continue
        for entry in listed:
            if entry.name.startswith(".") or (folder == root and entry.name in _ASIDE):
                continue
            try:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(Path(entry.path))
                elif entry.name.lower().endswith(".nc") and entry.is_file():
                    stamp = entry.stat()
                    path = Path(entry.path).relative_to(root).as_posix()
                    path.encode()
                    yield path, (stamp.st_size, stamp.st_mtime_ns)
            except UnicodeEncodeError:
                shown = entry.name.encode("utf-8", "replace").decode()
                problems.append(
                    Problem(shown, "bad-name", "its name is no text that a catalogue could keep; rename the file")
                )
            except OSError:  # it went away, or it is a link to nothing
                continue


def _read(path: Path) -> FileFacts | InputError:
    try:
        return read_facts(path)
    except InputError as error:
        return error


def _put(
    database: Database,
    laboratory: str,
    read: Sequence[tuple[str, FileFacts | InputError]],
    stamps: dict[str, tuple[int, int]],
    problems: list[Problem],
) -> None:
    """Write what was read of some files; one that the database refuses does not stop the others."""
    try:
        with database.write() as connection:
            ids = [put_run_file(connection, laboratory, path, facts, stamps[path]) for path, facts in read]
            choose_shown(connection, *(run_id for pair in ids for run_id in pair))
    except IpmclabError as error:
        if error.code != REFUSED_VALUE:
            raise
        if len(read) == 1:
            problems.append(Problem(read[0][0], *problem_text(error)))
            return
        for one in read:
            _put(database, laboratory, [one], stamps, problems)
