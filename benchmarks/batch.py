"""1,000 parameter sets of friend-2 for 2,000 samples each: hand-written C in vector lanes, our loop, the public call.

Run ``python -m benchmarks.batch [--rounds 101] [--record]``. One process, candidates take turns
(``harness.interleave``), medians of the ratios of each round; processor time of all threads together, so that a second
processor halves what a user waits. The C code has poles and residues given and does the least that the answer takes:
``lanes`` writes all four outputs, sixteen strips side by side, ``placed`` those of each strip behind each other, as
ours does, ``fused`` keeps only their mean squares. All write to memory that was written before. Ours is held against
``simulate`` (1e-12 of peak), C as well (1e-9). The sweep is the whole command in this process: 2^17 strips, five
metrics, on the disk.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.core import RATE, ROWS
from benchmarks.harness import Ratio, clock, finish, interleave
from ipmclab.model import OUTPUTS, Actuator
from ipmclab.model.batch import Batch, Record
from ipmclab.model.batch_lanes import lanes_of
from ipmclab.model.many import reduce_batch
from ipmclab.model.outputs import modal_coefficients
from ipmclab.model.reductions import Reduced
from ipmclab.sweep.sweep_file import sweep_from_text

SOURCES = ("benchmarks/batch.c", "benchmarks/core.py", "src/ipmclab/model", "src/ipmclab/sweep")

SETS: Final = 1000
SIDE_BY_SIDE: Final = 16
Array = npt.NDArray[np.float64]

SWEEP = """
actuator = "friend-2"
signal = "sine 1 V 0.5 Hz"
duration = "40 s"
rate = "50 Hz"
metrics = ["displacement.peak", "displacement.rms", "force.rms", "current.rms", "current.final"]
[design]
kind = "sobol"
base = 131072
[ranges]
"beam.modulus" = { low = "0.8 GPa", high = "2 GPa", scale = "log" }
"coupling.gain" = { low = "5e-9 m/V/s", high = "9e-9 m/V/s" }
"circuit.dc_resistivity" = { low = "30 ohm m", high = "60 ohm m" }
"""


class Job(ctypes.Structure):
    """The argument of the C loops, in the order of batch.c."""

    _fields_ = (
        ("groups", ctypes.c_long),
        ("n", ctypes.c_long),
        ("voltage", ctypes.c_void_p),
        ("coefficients", ctypes.c_void_p),
        ("outputs", ctypes.c_void_p),
        ("squares", ctypes.c_void_p),
        ("behind", ctypes.c_void_p),
    )


def aligned(*shape: int) -> Array:
    """Zeros that begin on a cache line, as C's vectors need."""
    size = int(np.prod(shape))
    whole = np.zeros(size + 8)
    begin = (-whole.ctypes.data // 8) % 8
    return whole[begin : begin + size].reshape(shape)


class ByHand:
    """The C loops with the poles and residues of every strip."""

    def __init__(self, strips: list[Actuator], voltage: Array, folder: Path) -> None:
        groups = -(-len(strips) // SIDE_BY_SIDE)
        self._voltage = voltage
        self._numbers = aligned(groups, 26, SIDE_BY_SIDE)
        for k in range(groups * SIDE_BY_SIDE):
            found = modal_coefficients(strips[min(k, len(strips) - 1)], 1.0 / RATE, "zero")
            assert found is not None  # friend-2 has the closed form
            self._numbers[k // SIDE_BY_SIDE, :, k % SIDE_BY_SIDE] = found[:26]
        self.outputs, self.squares = aligned(groups, ROWS, 4, SIDE_BY_SIDE), aligned(groups, 4, SIDE_BY_SIDE)
        self.placed = aligned(groups * SIDE_BY_SIDE, 4, ROWS)
        arrays = (voltage, self._numbers, self.outputs, self.squares, self.placed)
        self._job = Job(groups, ROWS, *(array.ctypes.data for array in arrays))
        library = folder / "batch.so"
        options = "-O3 -march=native -ffp-contract=fast -fno-math-errno -fno-trapping-math -shared -fPIC"
        source = Path(__file__).with_name("batch.c")
        subprocess.run(["cc", *options.split(), "-o", str(library), str(source)], check=True)
        self._library = ctypes.CDLL(str(library))

    def call(self, name: str) -> Callable[[], None]:
        """One of the loops, its argument bound."""
        function, reference = getattr(self._library, name), ctypes.byref(self._job)
        function.restype = None
        return lambda: function(reference)

    def of_set(self, k: int) -> Array:
        """The outputs of one strip, shape (4, n_time)."""
        found: Array = self.outputs[k // SIDE_BY_SIDE, :, :, k % SIDE_BY_SIDE].T
        return found


def check(name: str, found: Array, expected: Array, within: float) -> None:
    """Refuse to time what is wrong."""
    error = float(np.max(np.abs(found - expected) / np.max(np.abs(expected), axis=-1, keepdims=True)))
    if not error < within:
        raise SystemExit(f"{name} is off by {error:.1e} of its peak")


def swept(folder: Path) -> tuple[float, float]:
    """Processor time and time [s] of the sweep."""
    sweep = sweep_from_text(SWEEP)
    begun, waited = clock(), time.perf_counter()
    ipmclab.run_sweep(sweep, folder / "swept")
    return clock() - begun, time.perf_counter() - waited


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=101)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/batch.md")
    options = parser.parse_args()

    actuator = ipmclab.load_actuator("friend-2")
    random = np.random.default_rng(20261121)
    names = ("beam.modulus", "coupling.gain", "circuit.dc_resistivity", "circuit.branches.0.resistivity")
    parameters = {name: actuator[name] * np.exp(0.2 * random.normal(size=SETS)) for name in names}
    strips = [actuator.replace(**{name: float(values[k]) for name, values in parameters.items()}) for k in range(SETS)]
    voltage = np.sin(0.2 * np.pi * np.arange(ROWS) / RATE) + 0.5
    record = Record.of(ROWS / RATE, RATE, "zero")
    mean_squares = Reduced.of([f"{output}.rms" for output in OUTPUTS])
    batch = Batch.of(actuator, voltage, parameters, record, OUTPUTS)
    lanes = lanes_of(batch)
    assert lanes is not None  # friend-2 is linear
    gathered = tuple((place, "squares") for place in range(len(OUTPUTS)))
    kept = np.empty((SETS, len(OUTPUTS), ROWS))

    lanes.outputs(batch.voltage, kept)
    reduced = reduce_batch(batch, mean_squares)
    for k in (0, 1, 500, SETS - 1):
        run = ipmclab.simulate(strips[k], voltage, duration=ROWS / RATE, rate=RATE)
        expected = np.stack([run.channels[output] for output in OUTPUTS])
        check("our loop", kept[k], expected, 1e-12)
        rms = np.sqrt(np.mean(expected**2, axis=1))
        check("our metrics", np.array([reduced[name][k] for name in mean_squares.names])[:, None], rms[:, None], 1e-12)

    candidates: dict[str, Callable[[], object]] = {
        "our loop, outputs written": lambda: lanes.outputs(batch.voltage, kept),
        "our loop, mean squares": lambda: lanes.gather(batch.voltage, gathered),
        "simulate_many, mean squares": lambda: ipmclab.simulate_many(
            actuator, voltage, parameters, duration=ROWS / RATE, rate=RATE, reduce=mean_squares.names
        ),
        "simulate_many, all outputs": lambda: ipmclab.simulate_many(
            actuator, voltage, parameters, duration=ROWS / RATE, rate=RATE
        ),
        "simulate, one after the other (1/100 of them)": lambda: [
            ipmclab.simulate(strip.replace(), voltage, duration=ROWS / RATE, rate=RATE) for strip in strips[:10]
        ],
    }
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        if shutil.which("cc") is None:
            if "cc" in os.environ.get("IPMCLAB_REQUIRE", "").split(","):
                raise SystemExit("cc is required here (IPMCLAB_REQUIRE) and was not found")
        else:
            by_hand = ByHand(strips, voltage, folder)
            by_c = {
                "C lanes, outputs written": by_hand.call("lanes"),
                "C lanes, outputs put where they belong": by_hand.call("placed"),
                "C lanes, mean squares": by_hand.call("fused"),
            }
            for call in by_c.values():
                call()
            for k in (0, 17, SETS - 1):
                check("C", by_hand.of_set(k), kept[k], 1e-9)
                check("C", by_hand.placed[k], kept[k], 1e-9)
            candidates = {**by_c, **candidates}
        times = interleave(candidates, rounds=options.rounds)
        worked, waited = swept(folder)

    times["simulate, one after the other"] = 100.0 * times.pop("simulate, one after the other (1/100 of them)")
    rows = "\n".join(
        f"| {name} | {np.median(values) * 1e3:.2f} | {np.median(values) / (ROWS * SETS) * 1e9:.2f} |"
        for name, values in times.items()
    )
    body = (
        f"{SETS} parameter sets of friend-2 under one voltage, 2,000 samples, zero-order hold, four outputs; "
        f"{options.rounds} rounds. Processor time of all threads together. The loops have everything but the samples "
        "worked out before; `simulate_many` is the whole public call from arrays of parameters, joining and "
        "discretising each strip. C writes its outputs once sixteen strips side by side, and once those of each strip "
        "where they belong, as ours does. Loops write to memory that was written before, `simulate_many` to new.\n\n"
        f"| candidate | milliseconds per batch | nanoseconds per sample |\n|---|---|---|\n{rows}\n\n"
        f"A sweep of 131,072 strips, five metrics, into Parquet: {worked:.2f} s of processor time, {waited:.2f} s "
        f"waited. What it loads before the first strip is in both."
    )
    ratios = [
        Ratio(
            "one after the other / simulate_many, mean squares",
            times["simulate, one after the other"] / times["simulate_many, mean squares"],
            at_least=10.0,
        )
    ]
    if "C lanes, mean squares" in times:
        for ours, by_c, at_most in (
            ("our loop, mean squares", "C lanes, mean squares", 2.0),
            ("our loop, outputs written", "C lanes, outputs written", np.inf),
            ("our loop, outputs written", "C lanes, outputs put where they belong", np.inf),
            ("simulate_many, mean squares", "C lanes, mean squares", np.inf),
        ):
            ratios.append(Ratio(f"{ours} / {by_c}", times[ours] / times[by_c], at_most=at_most))
    else:
        body += "\n\nThe C loops were left out: no `cc` on this machine."
    finish("batch", "Many parameter sets", body, ratios, record=options.record, gate=options.gate)


if __name__ == "__main__":
    main()
