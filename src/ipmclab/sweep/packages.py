"""PyArrow and SALib, behind the extra ``sweep``, imported where they are needed."""

from __future__ import annotations

from typing import Any

from ipmclab.extras import package


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
    return package(module, extra="sweep", where="sweep")
