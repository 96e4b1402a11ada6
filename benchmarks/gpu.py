"""The rows of many parameter sets on a GPU beside this machine's processors.

``uv run --extra gpu python -m benchmarks.gpu``

1,000, 100,000 and a million strips of 2,000 samples, five metrics, through ``simulate_many`` from arrays of parameters
to metrics. Both are held against each other first: 1e-12 of the largest. Time is what one waits, for a GPU takes no
processor's time; run it where nothing else runs. Where no GPU is, it says so and ends.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.core import RATE, ROWS
from benchmarks.harness import Ratio, finish
from ipmclab.model.device import Device, on_gpu
from ipmclab.platform import processors

SOURCES = ("benchmarks/core.py", "src/ipmclab/model")

STRIP: Final = ipmclab.load_actuator("friend-2")
SETS: Final = (1_000, 100_000, 1_000_000)
METRICS: Final = ("displacement.peak", "displacement.rms", "force.rms", "current.rms", "current.final")
CHANGED: Final = ("beam.modulus", "coupling.gain", "circuit.dc_resistivity", "circuit.branches.0.resistivity")

Array = npt.NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--gate", action="store_true", help="nothing is gated: no GPU has been measured yet")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/gpu.md")
    options = parser.parse_args()
    loaded = time.perf_counter()
    try:
        on_gpu("gpu")
    except ipmclab.InputError as error:
        print(f"no device: {error}")
        return
    loaded = time.perf_counter() - loaded

    random = np.random.default_rng(20261126)
    rows, ratios = [], []
    for sets in SETS:
        parameters = {name: STRIP[name] * np.exp(0.2 * random.normal(size=sets)) for name in CHANGED}
        on = partial(simulated, parameters)
        first, ours = waited(on, "gpu")
        apart = farthest(ours, on("cpu"))
        if not apart <= 1e-12:
            raise SystemExit(f"{sets} sets: GPU and processors are apart by {apart:.1e} of the largest")
        turns = [[waited(on, device)[0] for device in ("cpu", "gpu")] for _ in range(options.rounds)]
        cpu, gpu = np.array(turns).T
        rows.append(f"| {sets:,} | {np.median(cpu):.3f} | {np.median(gpu):.3f} | {first:.3f} | {apart:.1e} |")
        ratios.append(Ratio(f"processors / GPU, {sets:,} sets", cpu / gpu))
    body = (
        f"{device_name()} beside {processors()} processors: friend-2, {ROWS:,} samples, five metrics, one voltage, "
        f"{options.rounds} rounds. Seconds that one waits. Loading CUDA and the smallest loop took {loaded:.1f} s "
        "before. Sets are set up by processors in both.\n\n"
        "| sets | processors [s] | GPU [s] | GPU, first call [s] | apart, of the largest |\n|---|---|---|---|---|\n"
        + "\n".join(rows)
    )
    finish("gpu", "Many parameter sets on a GPU", body, ratios, record=options.record, gate=options.gate)


def simulated(parameters: Mapping[str, Array], device: Device) -> dict[str, Array]:
    voltage = np.sin(0.2 * np.pi * np.arange(ROWS) / RATE) + 0.5
    return ipmclab.simulate_many(
        STRIP, voltage, parameters, duration=ROWS / RATE, rate=RATE, reduce=METRICS, device=device
    )


def waited(call: Callable[[Device], dict[str, Array]], device: Device) -> tuple[float, dict[str, Array]]:
    """How long it took [s], and what it gave."""
    begun = time.perf_counter()
    found = call(device)
    return time.perf_counter() - begun, found


def farthest(one: Mapping[str, Array], other: Mapping[str, Array]) -> float:
    return max(float(np.abs(one[name] - other[name]).max() / np.abs(other[name]).max()) for name in METRICS)


def device_name() -> str:
    from numba import cuda

    untyped: Any = cuda
    name = untyped.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


if __name__ == "__main__":
    main()
