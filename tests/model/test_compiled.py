"""Compiled functions where nothing can be kept on the disk."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import numba.core.caching
numba.core.caching.CacheImpl._locator_classes = []  # what is left of them on a read-only system
from ipmclab.model.numerics.compiled import kernel

@kernel
def twice(x):
    return 2.0 * x

assert twice(21.0) == 42.0
assert twice.nopython_signatures
"""


def test_a_kernel_is_compiled_where_no_folder_can_hold_it() -> None:
    subprocess.run([sys.executable, "-c", PROGRAM], check=True, timeout=60)
