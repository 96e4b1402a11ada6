"""PyArrow, behind the extra ``sweep``, imported where it is needed."""

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
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise InputError(
            "pyarrow is not installed",
            code="missing-package",
            where="sweep",
            repair="install it with: pip install 'ipmclab[sweep]'",
        ) from error
