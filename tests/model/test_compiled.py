"""Compiled functions where nothing can be kept on the disk."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from ipmclab.model.numerics.compiled import cache_folder, kernel

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
    subprocess.run([sys.executable, "-c", PROGRAM], check=True, timeout=300)


def test_threads_that_compile_at_once_all_keep_their_code_where_it_belongs() -> None:
    """Numba has one setting for the folder, which one thread must not put back while another reads it."""

    def folder_of(_: int) -> str:
        def nothing() -> None:
            pass

        return kernel(nothing)._cache.cache_path

    with ThreadPoolExecutor(8) as pool:
        folders = set(pool.map(folder_of, range(400)))
    assert len(folders) == 1
    assert next(iter(folders)).startswith(str(cache_folder()))
