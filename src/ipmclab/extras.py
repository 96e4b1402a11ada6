"""Packages that only some users need: each comes with an extra, and is imported where it is used."""

from __future__ import annotations

import importlib
from typing import Any

from ipmclab.errors import InputError


def package(module: str, *, extra: str, where: str, known_as: str = "") -> Any:
    """A module of a package that comes with an extra.

    Parameters
    ----------
    module : str
        As it is imported.
    extra : str
        Of ipmclab.
    where : str
        What needs it.
    known_as : str
        What people call the package; the first word of the module where it is left out.

    Raises
    ------
    InputError
        It is not installed.

    Examples
    --------
    >>> package("json", extra="bayes", where="posterior").loads("[1]")
    [1]
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f"{known_as or module.partition('.')[0]} is not installed",
            code="missing-package",
            where=where,
            repair=how_to_install(extra),
        ) from error


def how_to_install(extra: str) -> str:
    """What one does to have an extra.

    Examples
    --------
    >>> how_to_install("bayes")
    'in the folder of ipmclab, write: uv tool install ".[bayes]"'
    """
    return f'in the folder of ipmclab, write: uv tool install ".[{extra}]"'
