"""TOML files that people write: what is said of one that is missing, no text, or no TOML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ipmclab.errors import InputError


def read_text(path: Path, *, kind: str, missing: InputError, repair: str = "give a TOML file") -> str:
    """The text of a file.

    Parameters
    ----------
    path : Path
    kind : str
        What it should be, as "an import map".
    missing : InputError
        What is said where there is none.
    repair : str
        What is said where it is no text.

    Raises
    ------
    InputError
        No such file, a folder, or no text.
    """
    where = str(path)
    try:
        if path.is_dir():
            raise InputError(
                f"this is a folder, not {kind}", code="is-a-folder", where=where, repair="name a file in it"
            )
        return path.read_text(encoding="utf-8-sig")  # Windows' own editor may put a mark at the start
    except InputError:  # which is a ValueError too
        raise
    except FileNotFoundError:
        raise missing from None
    except (OSError, ValueError) as error:
        raise InputError(
            f"the file cannot be read as text: {error}", code="bad-file", where=where, repair=repair
        ) from error


def parse_table(text: str, *, where: str, repair: str = "correct the line that it names") -> dict[str, Any]:
    """What a TOML text holds.

    Parameters
    ----------
    text : str
    where : str
        The file, for messages.
    repair : str

    Raises
    ------
    InputError
        It is not TOML.
    """
    import tomllib  # 2 ms of every start, also of one that reads no file

    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a huge integer or deep nesting raises another than TOMLDecodeError
        raise InputError(f"not a TOML file: {error}", code="bad-toml", where=where, repair=repair) from error


def glance(path: Path) -> dict[str, Any] | None:
    """What a TOML file holds, to see what kind it is; None where it cannot be read, which its reader will say."""
    import tomllib

    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return None
