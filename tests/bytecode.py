"""Compiled modules of the suite where the environment lets Python keep none (``PYTHONDONTWRITEBYTECODE``).

Each worker would compile every module that it imports, and so would each of the hundreds of programs that tests start:
three quarters of a second each time. They are kept in pytest's own cache, so that none lies beside the sources.
"""

from __future__ import annotations

import os
import sys

import pytest


def keep(config: pytest.Config) -> None:
    """Let this process, its workers and what tests start share their compiled modules."""
    cache = getattr(config, "cache", None)
    if not sys.dont_write_bytecode or cache is None:
        return
    sys.pycache_prefix = str(cache.mkdir("bytecode"))
    sys.dont_write_bytecode = False
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
