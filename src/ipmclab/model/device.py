"""Who carries the rows of many parameter sets: the processors, or a GPU where one is there and it pays."""

from __future__ import annotations

import importlib.util
from functools import cache
from typing import Any, Final, Literal, get_args

from ipmclab.errors import InputError, suggest
from ipmclab.extras import how_to_install
from ipmclab.platform import processors

Device = Literal["auto", "cpu", "gpu"]
DEVICES: Final[tuple[Device, ...]] = get_args(Device)

WORTH: Final = 4_000_000_000
"""Rows of all sets together, for each processor, from which ``auto`` asks for a GPU.

A row takes a processor a nanosecond; CUDA loads and compiles for three seconds before its first. Estimated from these:
no GPU has been measured (decision 25).
"""


def worth(device: Device, sets: int, rows: int) -> Device:
    """What was asked for; ``cpu`` in place of ``auto`` where there is too little to do.

    Parameters
    ----------
    device : "auto", "cpu" or "gpu"
    sets : int
    rows : int
        Of each set.

    Raises
    ------
    InputError
        Another word.

    Examples
    --------
    >>> worth("auto", 1000, 2000), worth("gpu", 1000, 2000)
    ('cpu', 'gpu')
    """
    if device not in DEVICES:
        raise InputError(
            f"no device is called {device!r}", code="unknown-device", where="device", repair=suggest(device, DEVICES)
        )
    return "cpu" if device == "auto" and sets * rows < WORTH * processors() else device


def on_gpu(device: Device) -> bool:
    """Whether the rows go to the GPU of this machine: where one is there, unless the processors were asked for.

    Raises
    ------
    InputError
        A GPU was asked for, and something is missing.
    """
    if device == "cpu":
        return False
    lack = _lack()
    if lack is not None and device == "gpu":
        raise InputError(lack[0], code="no-gpu", where="device", repair=f"{lack[1]}; or leave the device out")
    return lack is None


@cache
def _lack() -> tuple[str, str] | None:
    """What is missing for a GPU to compute, and what to do about it."""
    config: Any = importlib.import_module("numba").config  # its settings are made at run time
    if not config.ENABLE_CUDASIM and importlib.util.find_spec("numba_cuda") is None:
        return "numba-cuda is not installed", how_to_install("gpu")
    try:
        from ipmclab.model.numerics.device_lanes import try_it

        try_it()
    except Exception as error:  # whatever a driver, a compiler or a device of somebody's machine says
        said = " ".join(str(error).split()).rstrip(" :") or type(error).__name__
        return (
            f"no GPU computes here: {said}",
            "see that nvidia-smi lists one of compute capability 5.0 or higher, with a driver for CUDA 12",
        )
    return None
