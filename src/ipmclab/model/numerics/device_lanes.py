"""Many parameter sets of one linear actuator on a GPU (CUDA), by the loop that is written out for processors.

What is set up for each set is set up by processors, with the same digits. A GPU adds and multiplies as a processor
does; an exponential of its own may differ in the last bit, which a slow mode or poles that nearly meet make larger.

It is imported where a GPU was asked for: Numba's CUDA takes a second to load.
"""

from __future__ import annotations

import hashlib
import threading
import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from numba import cuda as _untyped

from ipmclab.model.numerics import lanes_loop
from ipmclab.model.numerics.lanes import Gathered, Lanes

FloatArray = npt.NDArray[np.float64]

cuda: Any = _untyped

_THREADS: Final = 128
"""Systems of one block."""

_one_at_a_time: Final = threading.Lock()
"""Threads that set up the next sets meanwhile are fine, two that speak to one device are not faster than one."""


@cuda.jit(device=True)  # type: ignore[untyped-decorator]
def _plus(x: Any, y: Any, z: Any) -> Any:
    return cuda.fma(y, z, x)


@cuda.jit(device=True)  # type: ignore[untyped-decorator]
def _above(x: Any, y: Any, there: Any, otherwise: Any) -> Any:
    return there if x > y else otherwise


@cuda.jit(device=True)  # type: ignore[untyped-decorator]
def _size(x: Any) -> Any:
    return abs(x)


@cuda.jit(device=True)  # type: ignore[untyped-decorator]
def _alike(x: Any) -> Any:
    return x


_WORDS: Final = {
    "cuda": cuda,
    "plus": _plus,
    "above": _above,
    "size": _size,
    "alike": _alike,
    "inf": np.inf,
    "nan": np.nan,
}
"""What the source of a loop speaks of, for a device (``lanes_loop.WORDS`` for processors)."""


class DeviceLanes(Lanes):
    """As ``Lanes``, whose rows a GPU carries."""

    def outputs(self, voltage: FloatArray, found: FloatArray) -> None:
        """As ``Lanes.outputs``; ``found`` has no gaps."""
        with _one_at_a_time:
            there = cuda.device_array(found.shape, np.float64)
            self._launch(voltage, None, cuda.device_array((1, 1), np.float64), there)
            there.copy_to_host(found)

    def gather(self, voltage: FloatArray, gathered: Gathered) -> FloatArray:
        """As ``Lanes.gather``."""
        with _one_at_a_time:
            there = cuda.device_array((len(gathered), self.sets), np.float64)
            self._launch(voltage, gathered, there, cuda.device_array((1, 1, 1), np.float64))
            found: FloatArray = there.copy_to_host()
        return found

    def _launch(self, voltage: FloatArray, gathered: Gathered | None, tallied: Any, outputs: Any) -> None:
        run = kernel_of(self._pattern.shape, self._pattern.tobytes(), self._outputs, gathered)
        start = self._start * voltage[:, :1]
        given = [cuda.to_device(np.ascontiguousarray(array)) for array in (self._entries, start, voltage)]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Grid size", category=Warning)  # a small batch is small
            run[-(-self.sets // _THREADS), _THREADS](*given, tallied, outputs)


@lru_cache(maxsize=64)
def kernel_of(shape: tuple[int, int], pattern: bytes, outputs: int, gathered: Gathered | None) -> Any:
    """The kernel of a pattern, which is compiled where it is first launched."""
    asked = repr((shape, pattern, outputs, gathered))
    name = f"device_lanes_{hashlib.sha256(asked.encode()).hexdigest()[:16]}"
    entries = np.frombuffer(pattern, dtype=np.int8).reshape(shape)
    made: dict[str, Callable[..., None]] = {}
    exec(compile(lanes_loop.device_source(name, entries, outputs, gathered), __file__, "exec"), _WORDS, made)
    return cuda.jit(made[name])


def try_it() -> None:
    """Compile and run the smallest loop.

    Raises
    ------
    Exception
        Whatever stands in the way.
    """
    one = np.ones((1, 1))
    pattern = np.array([[lanes_loop.ENTRY, lanes_loop.NONE], [lanes_loop.ONE, lanes_loop.ONE]], dtype=np.int8)
    last = DeviceLanes(pattern, 3.0 * one, one).gather(np.ones((1, 4)), ((0, "final"),))
    if last.tolist() != [[12.0]]:
        raise ArithmeticError(f"3 times 4 is {last[0, 0]} on this device")
