"""Whether the laboratory folder that an experiment names is one, or can be made."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ipmclab.errors import InputError


def check_folder(folder: Path, *, where: str) -> None:
    """Refuse what cannot be a laboratory folder. Nothing of it is made.

    Parameters
    ----------
    folder : Path
    where : str
        The file and key that name it.

    Raises
    ------
    InputError
        A file of that name, no folder that it could stand in, or one in which nothing can be made.
    """
    if folder.is_dir():
        return
    if folder.exists():
        raise _refusal(f"{str(folder)!r} is a file", where)
    if not folder.parent.is_dir():
        raise _refusal(f"the folder {str(folder.parent)!r} does not exist", where, "no-such-folder")
    try:
        # Rights alone do not show: some file systems refuse everybody.
        with tempfile.TemporaryDirectory(prefix=".ipmclab-", dir=folder.parent):
            pass
    except OSError as error:
        raise _refusal(f"no folder can be made in {str(folder.parent)!r}: {error.strerror or error}", where) from error


def _refusal(message: str, where: str, code: str = "bad-folder") -> InputError:
    return InputError(
        message, code=code, where=where, repair="name a folder that is there, or that can be made where you may write"
    )
