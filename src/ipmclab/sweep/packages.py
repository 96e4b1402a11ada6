"""PyArrow and SALib, behind the extra ``sweep``, imported where they are needed."""

from __future__ import annotations

import importlib
from typing import Any

from ipmclab.errors import InputError


def parquet() -> tuple[Any, Any]:
    """``pyarrow`` and ``pyarrow.parquet``.

    Raises
    ------
    InputError
        It is not installed.
    """
    return _imported("pyarrow"), _imported("pyarrow.parquet")


def salib(module: str) -> Any:
    """A module of SALib.

    Raises
    ------
    InputError
        It is not installed.
    """
    return _imported(module)


def _imported(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f"{module.partition('.')[0]} is not installed",
            code="missing-package",
            where="sweep",
            repair="install it with: pip install 'ipmclab[sweep]'",
        ) from error
