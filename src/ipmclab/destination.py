"""Where a file is written: next to its target first, then renamed over it, so that no half file ever is there."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import replace_file, sync_file


def target_of(path: str | os.PathLike[str], *, overwrite: bool) -> Path:
    """Where a file of this name will stand: refused before the work if it could not be written after it.

    Parameters
    ----------
    path : str or path
        The file to be, or a link to it.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        No file can have this name, the folder does not exist or may not be written in, the path is a folder, or the
        file exists and ``overwrite`` is False.
    """
    try:
        # A link stays: what it points to is replaced, as when a program writes through it.
        target = Path(os.path.realpath(path))
        there, is_folder, has_folder = target.exists(), target.is_dir(), target.parent.is_dir()
    except (OSError, ValueError) as error:  # too long a name, a character that no name holds, a folder that is closed
        raise InputError(
            f"this cannot be the name of a file here: {getattr(error, 'strerror', None) or error}",
            code="bad-path",
            where=str(path),
            repair="give another name",
        ) from error
    if not has_folder:
        raise InputError(
            f"the folder {str(Path(path).parent)!r} does not exist",
            code="no-such-folder",
            where=str(path),
            repair="make the folder, or write elsewhere",
        )
    if is_folder:
        raise InputError("this is a folder", code="is-a-folder", where=str(path), repair="name a file in it")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        given = Path(path).parent
        folder = given if given.resolve() == target.parent else target.parent  # where a link leads
        raise InputError(
            f"you may not write in the folder {str(folder)!r}",
            code="folder-closed",
            where=str(path),
            repair="ask for the right to write there, or write elsewhere",
        )
    if there and not overwrite:
        raise InputError(
            "the file exists already",
            code="file-exists",
            where=str(path),
            repair="choose another name, or allow overwriting (--force, overwrite=True)",
        )
    return target


def keep_what_is_read(
    path: str | os.PathLike[str], reads: Iterable[str | os.PathLike[str]], *, where: str | None = None
) -> None:
    """Refuse to write over a file from which the same work is made: when it ends that file would be gone.

    Parameters
    ----------
    path : str or path
        The file to be.
    reads : iterable of str or path
        Files that are read; those that do not exist do not matter.
    where : str, optional
        What the message names, if not the path.

    Raises
    ------
    InputError
        ``path`` is one of them: by another spelling, through a link, by another name of the same file.
    """
    for one in reads:
        if _is_same(path, one):
            raise InputError(
                f"this is {str(one)!r}, which is read here: its content would be lost",
                code="output-is-input",
                where=where or str(path),
                repair="choose another name; what is read is never replaced, not by --force either",
            )


def _is_same(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    try:
        # The system knows two names of one file, also where capitals do not count.
        return os.path.samefile(one, other)
    except (OSError, ValueError):  # one of them is not there: nothing is lost
        return False


@contextmanager
def replacing(path: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary path next to ``path`` that takes its place when the block ends well.

    Parameters
    ----------
    path : str or path
    overwrite : bool

    Raises
    ------
    InputError
        What ``target_of`` refuses.
    IpmclabError
        The system refuses to write there.
    """
    target = target_of(path, overwrite=overwrite)
    temporary = target.with_name(f".{target.name}.{os.urandom(4).hex()}.part")
    try:
        yield temporary
        # The data must be on the disk before the name is: a power cut must not leave an empty file under it.
        with temporary.open("rb+") as stream:
            sync_file(stream.fileno())
        replace_file(temporary, target)
    except (OSError, RuntimeError) as error:  # HDF5 raises RuntimeError on a full disk
        raise IpmclabError(
            f"the file cannot be written: {getattr(error, 'strerror', None) or error}",
            code="write-failed",
            where=str(path),
            repair="see that the disk has room, that you may write there and that no program has the file open",
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(text: str, path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Write a text in UTF-8, its lines ended alike on every system; what ``replacing`` raises."""
    with replacing(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
