"""The packages behind the extra ``bayes``, imported where they are needed."""

from __future__ import annotations

import warnings
from typing import Any

from ipmclab.extras import package


def bayes_package(name: str) -> Any:
    """Emcee or ArviZ.

    Raises
    ------
    InputError
        It is not installed.
    """
    with warnings.catch_warnings():
        # ArviZ announces its next version once a day.
        warnings.filterwarnings("ignore", message=r"\s*ArviZ is undergoing", category=FutureWarning)
        return package(name, extra="bayes", where="posterior")
