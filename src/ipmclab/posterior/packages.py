"""The packages behind the extra ``bayes``, imported where they are needed."""

from __future__ import annotations

import importlib
import warnings
from types import ModuleType

from ipmclab.errors import InputError


def bayes_package(name: str) -> ModuleType:
    """Emcee or ArviZ.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        with warnings.catch_warnings():
            # ArviZ announces its next version once a day.
            warnings.filterwarnings("ignore", message=r"\s*ArviZ is undergoing", category=FutureWarning)
            return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"{name} is not installed",
            code="missing-package",
            where="posterior",
            repair="install it with: pip install 'ipmclab[bayes]'",
        ) from error
