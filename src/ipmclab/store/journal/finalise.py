"""A journal becomes a run file: written to another name, read back, renamed, and only then is the journal put away.

It is done in a process of its own: the library below netCDF can crash on a full disk, and must not take the recorder
with it. Doing it again, also after it was killed at any moment, gives the same file.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.checksum import ArrayChecksum, content_checksum, file_checksum
from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import (
    detached,
    is_still_at,
    keeps_what_is_open,
    lock_file,
    move_file,
    python_child,
    sync_file,
    sync_folder,
)
from ipmclab.store.document import attributes_of, document_of
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.record import JournalRecord, read_journal
from ipmclab.store.journal.run import Layout, layout_of
from ipmclab.store.journal.salvage import salvage
from ipmclab.store.run_file import CHUNK_ROWS, add_variables, attributes_in_file

Outcome = Literal["run", "empty", "lost", "in-use", "gone"]


@dataclass(frozen=True)
class Finished:
    """What became of a journal.

    Parameters
    ----------
    journal : str
        Where it was.
    outcome : "run", "empty", "lost", "in-use" or "gone"
        A run file was made of it; it had no rows and was put away; it could not be made into a run and is in
        ``lost+found``, its rows beside it where it has whole ones; it is being written at this moment; somebody else
        has dealt with it.
    path : str
        Of the run file, or where the journal is now.
    uuid, state, note : str
        Of the run, and why it has that state.
    rows : int
    sha256 : str
        Of the run file.
    salvaged : str
        A table of the rows of a journal that is lost.
    """

    journal: str
    outcome: Outcome
    path: str = ""
    uuid: str = ""
    state: str = ""
    note: str = ""
    rows: int = 0
    sha256: str = ""
    salvaged: str = ""

    @property
    def is_loss(self) -> bool:
        """Whether it has rows that no run has."""
        return self.outcome == "lost" and bool(self.rows or self.salvaged)


def finalise(journal: str | os.PathLike[str], laboratory: Laboratory | str | os.PathLike[str]) -> Path:
    """Make the run file of a journal that has ended.

    Parameters
    ----------
    journal : str or path
        What ``Journal.end`` gave.
    laboratory : Laboratory or path

    Returns
    -------
    path : path
        Of the run file.

    Raises
    ------
    IpmclabError
        It could not be written, or has nothing to write; the journal is kept, and ``ipmclab recover`` tries again.
    """
    finished = finish(journal, laboratory)
    if finished.outcome == "run":
        return Path(finished.path)
    why, repair = {
        "empty": ("nothing was recorded", "record again"),
        "lost": (f"it cannot be made into a run: {finished.note}", "record again"),
        "in-use": ("it is still being written", "see ipmclab recover"),
        "gone": ("it is not there any more", "see ipmclab runs: another program has finished it"),
    }[finished.outcome]
    raise IpmclabError(why, code=f"journal-{finished.outcome}", where=str(journal), repair=repair)


def finish(journal: str | os.PathLike[str], laboratory: Laboratory | str | os.PathLike[str]) -> Finished:
    """Deal with a journal in a process of its own, and report what became of it.

    Raises
    ------
    IpmclabError
        It could not be done; the journal is kept.
    """
    root = Laboratory.open(laboratory).root
    command = python_child("ipmclab.store.journal.finalise", os.fspath(journal), str(root))
    done = subprocess.run(command, capture_output=True, check=False, **detached())
    lines = done.stdout.decode(errors="replace").strip().splitlines()
    try:
        answer = json.loads(lines[-1])
    except (IndexError, ValueError):
        answer = {}
    if "outcome" in answer:  # all is on the disk by then, also where the library crashes as the process ends
        return Finished(**answer)
    if "error" in answer:
        raise IpmclabError(**answer["error"])
    raise IpmclabError(
        f"the program that writes the run file ended with status {done.returncode}",
        code="finalise-failed",
        where=str(journal),
        repair="the journal is kept: see that the disk has room, then: ipmclab recover",
    )


def finish_here(journal: Path, laboratory: Laboratory) -> Finished:
    """Deal with a journal in this process.

    Raises
    ------
    IpmclabError, OSError, RuntimeError
        It could not be done; the journal is kept.
    """
    try:
        # All reading goes through the file that has the lock: Windows lets nobody else read what is locked.
        with open(journal, "r+b") as stream:
            if not lock_file(stream.fileno()):
                return Finished(str(journal), "in-use", note="it is being recorded, or finished")
            if not is_still_at(stream.fileno(), journal):
                return Finished(str(journal), "gone")
            finished, put_at = _deal_with(journal, stream, laboratory)
            if not keeps_what_is_open():
                move_file(journal, put_at)
        if keeps_what_is_open():
            move_file(journal, put_at)
    except FileNotFoundError:
        if journal.exists():
            raise
        return Finished(str(journal), "gone")
    return finished


def _deal_with(journal: Path, stream: BinaryIO, laboratory: Laboratory) -> tuple[Finished, Path]:
    """What has become of a journal, and where it goes now."""
    laboratory.ballast(journal.stem).unlink(missing_ok=True)  # nobody records into it: the room is needed now
    try:
        record = read_journal(journal, stream)
    except InputError as error:
        if error.code == "empty-file":
            return _put_away(journal, "empty", laboratory.lost, note=error.message)
        if error.code not in ("header-lost", "not-a-journal"):
            raise
        finished, taken = _put_away(journal, "lost", laboratory.lost, note=error.message)
        if error.code == "header-lost":
            finished = replace(finished, salvaged=str(salvage(stream, taken)))
        return finished, taken
    uuid, rows = record.header.uuid, record.n_rows
    if rows == 0:
        return _put_away(journal, "empty", laboratory.archive, uuid=uuid, note="no rows")
    if rows == 1:
        return _put_away(journal, "lost", laboratory.lost, uuid=uuid, note="1 row, a run has at least 2", rows=1)
    layout = layout_of(record)
    target = _run_file(record, layout, stream, laboratory)
    finished = Finished(
        journal=str(journal),
        outcome="run",
        path=str(target),
        uuid=uuid,
        state=layout.metadata.state or "",
        note=layout.metadata.state_reason or "",
        rows=rows,
        sha256=file_checksum(target),
    )
    return finished, laboratory.archive / f"{uuid}.runj"


def _put_away(journal: Path, outcome: Outcome, folder: Path, **facts: Any) -> tuple[Finished, Path]:
    taken, number = folder / journal.name, 1
    while taken.exists():
        taken, number = folder / f"{journal.stem}-{number}{journal.suffix}", number + 1
    return Finished(str(journal), outcome, str(taken), **facts), taken


def _run_file(record: JournalRecord, layout: Layout, stream: BinaryIO, laboratory: Laboratory) -> Path:
    """The run file of a journal: the one that is there, if it is whole, or a new one."""
    target = laboratory.run_file(record.header.uuid, layout.metadata, record.header.created_at)
    # Another version may have chosen other words for the name of the same run.
    target = next(target.parent.glob(f"*_{record.header.uuid[:8]}.nc"), target)
    if target.exists():
        digests = _digests(layout, stream)
        if _difference(target, digests, _attributes(layout, digests)) is None:
            return target
        target.chmod(0o644)  # damaged after it was renamed, as a power cut may do: it is made again
    for folder in (target.parent.parent, target.parent):
        folder.mkdir(exist_ok=True)
        sync_folder(folder.parent)
    temporary = target.with_name(f"{target.name}.part")
    try:
        digests = _write(layout, stream, temporary)
        with temporary.open("rb+") as written:
            sync_file(written.fileno())
        difference = _difference(temporary, digests, _attributes(layout, digests))
        if difference is not None:
            raise IpmclabError(
                f"what was read back differs from what was written ({difference})",
                code="write-failed",
                where=str(target),
                repair="the journal is kept: see that the disk is sound and has room, then: ipmclab recover",
            )
        temporary.chmod(0o444)
        move_file(temporary, target)
    finally:
        if temporary.exists():
            temporary.chmod(0o644)
            temporary.unlink()
    return target


def _write(layout: Layout, stream: BinaryIO, path: Path) -> dict[str, str]:
    """Write the run file; the digests are those of the numbers in the journal."""
    import h5netcdf

    checksums = {name: ArrayChecksum() for name in layout.lengths}
    with h5netcdf.File(path, "w") as file:
        add_variables(file, layout.lengths)
        for name, start, values in _pieces(layout, stream):
            checksums[name].update(values)
            file[name][start : start + len(values)] = values
        digests = {name: checksum.digest() for name, checksum in checksums.items()}
        file.attrs.update(_attributes(layout, digests))
    return digests


def _digests(layout: Layout, stream: BinaryIO) -> dict[str, str]:
    """What the arrays of the run file must give."""
    checksums = {name: ArrayChecksum() for name in layout.lengths}
    for name, _, values in _pieces(layout, stream):
        checksums[name].update(values)
    return {name: checksum.digest() for name, checksum in checksums.items()}


def _pieces(layout: Layout, stream: BinaryIO) -> Iterator[tuple[str, int, npt.NDArray[Any]]]:
    """The arrays of a run piece by piece: the name of each, the place where the piece begins, and its values."""
    row = 0
    for block in layout.blocks(stream):
        for name, values in block.items():
            yield name, row, values
        row += len(block["time"])
    for name, values in layout.environment.items():
        yield name, 0, values


def _attributes(layout: Layout, digests: Mapping[str, str]) -> dict[str, str]:
    """What the attributes of the run file must be."""
    about = layout.hold, layout.metadata, content_checksum(layout.hold, digests)
    return attributes_in_file(document_of(*about), attributes_of(*about))


def _difference(path: Path, digests: Mapping[str, str], attributes: Mapping[str, str]) -> str | None:
    """The first thing in a run file that is not as it should be; None for a whole file."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            for name, text in attributes.items():
                if file.attrs.get(name) != text:
                    return name
            for name, expected in digests.items():
                if _digest_of(file[name]) != expected:
                    return name
    except Exception as error:  # a damaged file makes HDF5 raise nearly anything
        return _first_line(error)
    return None


def _first_line(error: Exception) -> str:
    """What an error says, without what HDF5 adds for its programmers."""
    return str(error).partition("\n")[0] or type(error).__name__


def _digest_of(variable: Any) -> str:
    checksum = ArrayChecksum()
    for start in range(0, len(variable), CHUNK_ROWS):
        piece: npt.NDArray[Any] = np.asarray(variable[start : start + CHUNK_ROWS])
        checksum.update(piece)
    return checksum.digest()


def main(arguments: list[str]) -> None:
    """``python -m ipmclab.store.journal.finalise JOURNAL LABORATORY``: one JSON line says what became of it."""
    journal, root = arguments
    try:
        answer: dict[str, Any] = asdict(finish_here(Path(journal), Laboratory.open(root)))
    except IpmclabError as error:
        answer = {"error": error.as_dict()}
    except (OSError, RuntimeError) as error:  # HDF5 raises RuntimeError on a full disk
        reason = getattr(error, "strerror", None) or _first_line(error)
        failed = IpmclabError(
            f"the run file cannot be written: {reason}",
            code="write-failed",
            where=journal,
            repair="the journal is kept: see that the disk has room and may be written, then: ipmclab recover",
        )
        answer = {"error": failed.as_dict()}
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
