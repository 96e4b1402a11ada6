"""A GPU's numbers beside the processors', for every structure and every reduction; also as a process of its own.

``NUMBA_ENABLE_CUDASIM=1 python -m tests.model.on_device`` has Numba's simulator of CUDA for a GPU: a process decides
that when it loads Numba. It writes what it found as JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator

import numpy as np

from ipmclab import InputError, load_actuator, simulate_many
from ipmclab.model import Actuator
from ipmclab.model.device import on_gpu
from ipmclab.model.numerics import device_lanes
from tests.model.sets import LANES, METRICS, RATE, rough, scattered

STRUCTURES = (*LANES, "friend-2+relaxation.force", "friend-2+line.modes=3")
REFUSED = "friend-2+leak.exponential"


def deviations(sets: int, rows: int) -> Iterator[tuple[str, float]]:
    """What was compared, and how far the two are apart, as a part of the largest of the output."""
    volts = rough(rows) - 1.0  # to both sides, so that no metric is what rounding left of 0
    for name in STRUCTURES:
        actuator = load_actuator(name)
        parameters = scattered(actuator, sets)
        for hold in ("zero", "zero-before", "first") if name == STRUCTURES[0] else ("first",):
            yield f"{name}, {hold}", apart(actuator, volts, parameters, hold)
    friend = load_actuator("friend-2")
    # Poles that nearly meet in some sets: these go by another loop than the others.
    p1 = 2.0 * np.sqrt(friend["coupling.p2"]) * (1.0 + np.linspace(0.0, 1.0, sets) ** 8)
    yield "poles that nearly meet", apart(friend, volts, {"coupling.p1": p1}, "zero")
    voltages = volts * np.linspace(0.5, 2.0, sets)[:, None]
    yield "a voltage for each set", apart(friend, voltages, scattered(friend, sets), "first")


def apart(actuator: Actuator, volts: np.ndarray, parameters: dict[str, np.ndarray], hold: str) -> float:
    rows = volts.shape[-1]

    def simulated(reduce: list[str] | Callable | None, device: str) -> dict[str, np.ndarray]:
        found = simulate_many(
            actuator, volts, parameters, duration=rows / RATE, rate=RATE, hold=hold, reduce=reduce, device=device
        )
        return found if isinstance(found, dict) else found.outputs

    def last(outputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {output: values[:, -3:] for output, values in outputs.items()}

    largest = {output: float(np.abs(values).max()) for output, values in simulated(None, "cpu").items()}
    worst = 0.0
    for reduce in (None, METRICS, last):
        ours, theirs = simulated(reduce, "cpu"), simulated(reduce, "gpu")
        assert ours.keys() == theirs.keys()
        for key, values in ours.items():
            output, _, metric = key.partition(".")
            scale = rows / RATE if metric == "peak_time" else largest[output]
            assert theirs[key].shape == values.shape
            worst = max(worst, float(np.abs(theirs[key] - values).max()) / scale)
    return worst


def main() -> None:
    assert on_gpu("gpu")
    device_lanes._THREADS = 1  # those of the simulator would change words of one module at the same time
    found: dict[str, object] = {"apart": dict(deviations(sets=5, rows=40))}
    try:
        simulate_many(load_actuator(REFUSED), "step 1 V", duration=1.0, rate=RATE, reduce="force.peak", device="gpu")
    except InputError as error:
        found["refused"] = str(error)
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
