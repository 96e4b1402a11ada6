"""The one way to compile a kernel.

Numba's cache does not notice when a kernel that another kernel calls has changed in a
different module. Every kernel is therefore compiled through ``kernel``, whose cache
folder is named by a hash of all kernel sources: any change starts a fresh cache. Inside
it, kernels stand by the names of their modules: every installation has the same ones.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

import numba
from llvmlite.binding import get_host_cpu_name
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock

from ipmclab.platform import lock_file
from ipmclab.progress import aside

_Function = TypeVar("_Function", bound=Callable[..., Any])

_one_at_a_time: Final = threading.RLock()
"""The folder is a setting of Numba's, which all threads share."""


class _Compiling(event.Listener):
    """Whoever waits for a kernel of this package is told so: half a minute, mostly spent once on a machine."""

    def on_start(self, event: Any) -> None:
        function = getattr((event.data or {}).get("dispatcher"), "py_func", None)
        if getattr(function, "__module__", "").startswith("ipmclab."):
            aside("compiling the model, once on this machine")

    def on_end(self, event: Any) -> None:
        """Said by the next tick."""


event.register("numba:compile", _Compiling())  # type: ignore[no-untyped-call]

_LONGEST_TURN: Final = 60.0
"""So long [s] another process is waited for: it may have been stopped as it compiled. All kernels take that long."""

_BETWEEN_LOOKS: Final = 0.02
"""Seconds between two looks whether it has ended (convention): a kernel takes a second or more."""

_waited_in_vain: Final[list[Path]] = []
"""Of whose turn this process has waited that long: it waits for no other then."""

_PACKAGE = Path(__file__).resolve().parents[2]
_TAKEN: Final = ("normal_equations.py", "model/blocks.py", "model/environment/path.py", "model/numerics/course.py")
"""Files of constants and tuples that kernels take."""


def _user_cache() -> Path:
    """The folder where this platform keeps what can be made again."""
    if "IPMCLAB_CACHE" in os.environ:
        return Path(os.environ["IPMCLAB_CACHE"])
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "ipmclab"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ipmclab"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ipmclab"


def sources() -> list[Path]:
    """The files whose code or constants a kernel holds: where it stands, and what it takes from elsewhere."""
    kernels = [*_PACKAGE.rglob("kernels.py"), *_PACKAGE.rglob("*_loop.py")]
    return sorted([*kernels, *(_PACKAGE / name for name in _TAKEN)])


@cache
def cache_folder() -> Path:
    """The cache folder of this version of the kernels."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sources():
        digest.update(source.read_bytes())
    return _user_cache() / f"kernels-{digest.hexdigest()[:16]}"


class ByModule:
    """Where Numba keeps a kernel (its protocol of a cache locator): in a folder with the name of its module.

    Numba itself names the folder by where the module lies: a second installation would compile everything again.
    """

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        config: Any = numba.config
        self._py_file = file
        self._folder = Path(config.CACHE_DIR, function.__module__)
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> ByModule | None:
        """The place of a function, or None where nothing can be kept."""
        found = cls(function, file)
        try:
            found.ensure_cache_path()
            found.get_source_stamp()
        except OSError:  # no folder that can be written to, or no file of its source
            return None
        return found

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Make the folder, and see that it can be written to."""
        self._folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_source_stamp(self) -> bytes:
        """A hash of the source file: kernels of others, outside the package, are not in the name of the cache."""
        return _hash_of(self._py_file)

    def get_disambiguator(self) -> str:
        """What tells functions of one name in one module apart."""
        return str(self._line)


@cache
def _hash_of(file: str) -> bytes:
    return hashlib.sha256(Path(file).read_bytes()).digest()


def kernel(function: _Function) -> _Function:
    """Compile a function of a ``kernels.py`` module, now or from the cache; each time where none can be kept.

    No fast-math: a kernel gives the same digits as the formula it stands for.
    """
    config: Any = numba.config  # its settings are made at run time: no type checker knows them
    njit: Any = numba.njit
    # Without the last, Numba makes a part of whatever a part calls.
    options: Any = {"error_model": "numpy", "nogil": True, "forceinline": False}
    with _one_at_a_time:
        # An older Numba knows no locators but its own: there each installation has a folder.
        before = config.CACHE_DIR, getattr(config, "CACHE_LOCATOR_CLASSES", "")
        try:
            config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES = str(cache_folder()), f"{__name__}.{ByModule.__name__}"
            compiled: _Function = njit(cache=True, **options)(function)
            # The code of one processor is none of another's.
            processor = config.CPU_NAME or get_host_cpu_name()
            name = f"{function.__name__}-{function.__code__.co_firstlineno}-{processor}.turn"
            if hasattr(compiled, "compile"):  # not where Numba is told to compile nothing, as for a debugger
                _in_turn(compiled, cache_folder() / function.__module__ / name)
        except RuntimeError:  # no home, or no folder that can be written to, as in a read-only container
            compiled = njit(**options)(function)
        finally:
            config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES = before
    return compiled


def _in_turn(dispatcher: Any, file: Path) -> None:
    """Let one process at a time compile a kernel: the others then find it in the cache.

    Workers that start together would each compile the same kernels, for a minute of their processors. A kernel calls
    others and none calls itself, so that nobody waits in a circle.
    """
    compile_here = dispatcher.compile

    def compile_in_turn(signature: Any) -> Any:
        with global_compiler_lock, _turn(file):
            return compile_here(signature)

    dispatcher.compile = compile_in_turn


@contextmanager
def _turn(file: Path) -> Iterator[None]:
    """The turn of this process, or where nothing can be locked, or another takes very long, no turn."""
    try:
        stream = None if _waited_in_vain else file.open("ab")
    except OSError:
        stream = None
    if stream is None:
        yield
        return
    with stream:
        end = time.monotonic() + _LONGEST_TURN
        with suppress(OSError):  # a file system without locks
            while not lock_file(stream.fileno()):
                if time.monotonic() >= end:
                    _waited_in_vain.append(file)  # nor for the next: kernels in it would be waited for one by one
                    break
                time.sleep(_BETWEEN_LOOKS)
        yield


def part(function: _Function) -> _Function:
    """A function that becomes a part of each kernel that calls it, and is kept with these."""
    njit: Any = numba.njit
    compiled: _Function = njit(error_model="numpy", nogil=True, forceinline=True)(function)
    return compiled
