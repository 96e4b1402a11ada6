"""Where a file is written: beside its target first, then renamed over it, so that no half file ever stands there."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ipmclab.errors import InputError, IpmclabError


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
        No file can have this name, the folder does not exist, the path is a folder, or the file
        exists and ``overwrite`` is False.
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
    if there and not overwrite:
        raise InputError(
            "the file exists already",
            code="file-exists",
            where=str(path),
            repair="choose another name, or allow overwriting (--force, overwrite=True)",
        )
    return target


@contextmanager
def replacing(path: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary path beside ``path`` that takes its place when the block ends well.

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
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        yield temporary
        # The data must be on the disk before the name is: a power cut must not leave an empty file under it.
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        temporary.replace(target)
    except (OSError, RuntimeError) as error:  # HDF5 raises RuntimeError on a full disk
        raise IpmclabError(
            f"the file cannot be written: {getattr(error, 'strerror', None) or error}",
            code="write-failed",
            where=str(path),
            repair="see that the disk has room, that you may write there and that no program has the file open",
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
