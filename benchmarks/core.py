"""One record of 2,000 samples of friend-2: hand-written C, our kernel, the public call, scipy's lsim.

Run ``python -m benchmarks.core [--rounds 301] [--gate] [--record]``. One process, candidates take short turns
(``harness.interleave``), medians of the ratios of each round. Every candidate is first held against dense matrix
exponentials of the thesis's equations (1e-9 of peak). The C loop computes the same four outputs as the kernel:
current, node voltage, displacement, force. The rows with a leak are the same strip at 3 V with an exponential leak, an
equation to be solved at every sample; they are held against the path without poles (1e-11 of peak), and their time
against the same linear C loop. At hold zero a sine jumps at every row, which makes two equations of one: that row is
reported and has no gate. So are the general loop alone and whole calls of richer models.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import scipy.signal

import ipmclab
from benchmarks.harness import Ratio, finish, interleave
from ipmclab.model import simulate_outputs
from ipmclab.model.numerics import kernels
from ipmclab.model.numerics.dense import Dense
from ipmclab.model.numerics.timeline import timeline
from ipmclab.model.outputs import leaking_loop, modal_coefficients
from ipmclab.run import Hold
from tests.independent.thesis import FRIEND_2, OUTPUTS, circuit, respond, series, side_by_side, transfer_function

SOURCES = ("src/ipmclab/model",)

RATE, ROWS = 50.0, 2000
Array = npt.NDArray[np.float64]


def minimal_state_space() -> tuple[Array, Array, Array, Array]:
    """The same outputs with six states: the form in which a user would hand the model to lsim."""
    a, b, c, d = circuit(FRIEND_2)
    strip = FRIEND_2
    node = (a, b, c[1:2], d[1:2])
    coupling = transfer_function([strip.gain, strip.gain * strip.zero], [1.0, strip.p1, strip.p2])
    wn = strip.natural_frequency
    bend = 3.0 * strip.sensing_length**2 / strip.thickness**2
    push = 3.0 * strip.thickness * strip.width * strip.modulus / (4.0 * strip.sensing_length)
    beam = (
        np.array([[0.0, wn], [-wn, -2.0 * strip.damping_ratio * wn]]),
        np.array([[0.0], [wn]]),
        np.array([[1.0, 0.0]]),
        np.array([[0.0]]),
    )
    wire = (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[1.0]]))
    motion = series(coupling, side_by_side([beam, wire]))
    whole = series(node, motion)
    n = len(whole[0])
    electrical = np.zeros((2, n))
    electrical[:, :2] = c[:2]
    mechanical = np.array([[bend], [push]]) * whole[2]
    return whole[0], whole[1], np.vstack([electrical, mechanical]), np.vstack([d[:2], np.zeros((2, 1))])


class Job(ctypes.Structure):
    """The argument of the C loop, in the order of modal.c."""

    _fields_ = (
        ("n", ctypes.c_long),
        ("voltage", ctypes.c_void_p),
        ("current", ctypes.c_void_p),
        ("node", ctypes.c_void_p),
        ("displacement", ctypes.c_void_p),
        ("force", ctypes.c_void_p),
        ("decay", ctypes.c_double * 4),
        ("pair", ctypes.c_double * 2),
        ("current_weight", ctypes.c_double * 2),
        ("current_direct", ctypes.c_double),
        ("force_weight", ctypes.c_double * 4),
        ("displacement_weight", ctypes.c_double * 4),
        ("pair_weight", ctypes.c_double * 2),
        ("series_resistance", ctypes.c_double),
    )


def modal_job(voltage: Array, outputs: Array) -> Job:
    """Poles and residues of friend-2 by eigenvectors, discretised for a zero-order hold."""
    a, b, c, d = minimal_state_space()
    poles, vectors = np.linalg.eig(a)
    inputs = np.linalg.solve(vectors, b.astype(complex))[:, 0]
    decay = np.exp(poles / RATE)
    # Every mode is driven by the voltage itself; what it gains in one period is folded into its weights.
    weights = (c @ vectors) * inputs * (decay - 1.0) / poles
    real = np.flatnonzero(np.abs(poles.imag) < 1e-9 * np.abs(poles))
    pair = int(np.flatnonzero(poles.imag > 1.0)[0])
    electrical = sorted(real, key=lambda i: -abs(weights[0, i]))  # the circuit's two come first
    order = [*electrical[:2], *electrical[2:]]
    job = Job(n=len(voltage), voltage=voltage.ctypes.data)
    for name, row in zip(("current", "node", "displacement", "force"), outputs, strict=True):
        setattr(job, name, row.ctypes.data)
    job.decay[:] = decay[order].real.tolist()
    job.pair[:] = [decay[pair].real, decay[pair].imag]
    job.current_weight[:] = weights[0, order[:2]].real.tolist()
    job.current_direct = d[0, 0]
    job.force_weight[:] = weights[3, order].real.tolist()
    job.displacement_weight[:] = weights[2, order].real.tolist()
    job.pair_weight[:] = [2.0 * weights[2, pair].real, -2.0 * weights[2, pair].imag]
    job.series_resistance = FRIEND_2.series_resistance
    return job


def compile_modal(folder: Path) -> Callable[[object], None] | None:
    """The C loop, compiled on the spot; None where there is no compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        if "cc" in os.environ.get("IPMCLAB_REQUIRE", "").split(","):
            raise SystemExit("cc is required here (IPMCLAB_REQUIRE) and was not found")
        return None
    library = folder / "modal.so"
    source = Path(__file__).with_name("modal.c")
    options = "-O3 -march=native -ffp-contract=fast -fno-math-errno -fno-trapping-math -shared -fPIC"
    subprocess.run([compiler, *options.split(), "-o", str(library), str(source)], check=True)
    function = ctypes.CDLL(str(library)).modal
    function.restype = None
    function.argtypes = None
    return function  # type: ignore[no-any-return]


def leaks() -> dict[str, Callable[[], None]]:
    """A step and sines of 3 V through the loop with a leak; at hold zero a sine jumps, and asks twice, at every row."""
    actuator = ipmclab.load_actuator("friend-2+leak.exponential")
    time = np.arange(ROWS) / RATE
    sine = 3.0 * np.sin(0.2 * np.pi * time)
    found: dict[str, Callable[[], None]] = {}
    cases: tuple[tuple[str, Hold, Array], ...] = (
        ("leak, step", "zero", np.full(ROWS, 3.0)),
        ("leak, sine at hold first", "first", sine),
        ("leak, sine at hold zero", "zero", sine),
    )
    for name, hold, voltage in cases:
        loop, values = leaking_loop(actuator, 1.0 / RATE, hold), np.empty((len(OUTPUTS), ROWS))
        assert loop is not None  # its structure has the closed form
        loop(voltage, values)
        state = np.zeros(len(actuator.state_names))
        dense = simulate_outputs(actuator, time, voltage, hold, initial_state=state)
        check(name, values, dict(zip(OUTPUTS, dense, strict=True)), within=1e-11)
        found[name] = partial(loop, voltage, values)
    return found


CHANGED: Final = "simulate, new parameters each time"

RICHER: Final = {
    "leak": "friend-2+leak.exponential",
    "leak, slow modes": "friend-2+leak.exponential+relaxation.displacement+relaxation.force",
    "leak, viscoelastic": "friend-2+leak.exponential+viscoelastic",
    "leak that grows": "friend-2+leak.exponential+leak.slow",
    "leak, clamped section": "friend-2+leak.exponential+clamp",
    "leak on 10 segments": "friend-2+leak.exponential+line.segments=10",
    "slow modes": "friend-2+relaxation.displacement+relaxation.force",
}
"""Whole calls of ``simulate`` that are reported."""


def richer() -> dict[str, Callable[[], object]]:
    """Sines of 3 V at hold first: the general loop alone, and whole calls."""
    time = np.arange(ROWS) / RATE
    sine = 3.0 * np.sin(0.2 * np.pi * time)
    system = ipmclab.load_actuator(RICHER["leak"]).system
    line = timeline(time, sine, "first", delay=0.0, from_rest=True)
    dense, values = Dense.of(system, line.durations), np.empty((len(system.outputs), ROWS))

    def general() -> None:
        state = np.zeros(len(system.states))
        dense.run(line.course, state, values)

    def whole(actuator: ipmclab.Actuator) -> ipmclab.Run:
        return ipmclab.simulate(actuator, sine, duration=ROWS / RATE, rate=RATE, hold="first")

    calls = {f"simulate, {name}": partial(whole, ipmclab.load_actuator(text)) for name, text in RICHER.items()}
    return {"general loop, leak": general, **calls}


def check(name: str, values: Array, expected: dict[str, Array], within: float = 1e-9) -> None:
    """Refuse to time what is wrong."""
    for row, output in zip(values, OUTPUTS, strict=True):
        error = np.max(np.abs(row - expected[output])) / np.max(np.abs(expected[output]))
        if not error < within:
            raise SystemExit(f"{name}: {output} is off by {error:.1e} of its peak")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=301)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/core.md")
    options = parser.parse_args()

    actuator = ipmclab.load_actuator("friend-2")
    voltage = np.ones(ROWS)
    time = np.arange(ROWS) / RATE
    expected = respond(FRIEND_2, voltage, RATE, "zero")

    numbers = modal_coefficients(actuator, 1.0 / RATE, "zero")
    assert numbers is not None  # friend-2 has the closed form
    kernel_values = np.empty((len(OUTPUTS), ROWS))

    def kernel() -> None:
        kernels.modal(voltage, numbers, kernel_values)

    kernel()
    check("kernel", kernel_values, expected)

    def call() -> ipmclab.Run:
        return ipmclab.simulate(actuator, "step 1 V", duration=40.0, rate=RATE)

    run = call()
    check("simulate", np.stack([getattr(run, name) for name in OUTPUTS]), expected)

    sheet = actuator.parameters()["circuit.sheet_resistance"].value
    turns = iter(range(10**9))

    def changed_call() -> ipmclab.Run:
        other = actuator.replace(**{"circuit.sheet_resistance": sheet * (1.0 + 1e-9 * next(turns))})
        return ipmclab.simulate(other, "step 1 V", duration=40.0, rate=RATE)

    system = scipy.signal.StateSpace(*minimal_state_space())

    def lsim() -> Array:
        return scipy.signal.lsim(system, voltage, time, interp=False)[1]  # type: ignore[no-any-return]

    check("lsim", lsim().T, expected)
    candidates: dict[str, Callable[[], object]] = {
        "kernel": kernel,
        "simulate": call,
        CHANGED: changed_call,
        "scipy.signal.lsim": lsim,
        **leaks(),
        **richer(),
    }
    with tempfile.TemporaryDirectory() as folder:
        modal = compile_modal(Path(folder))
        if modal is not None:
            outputs = np.empty((4, ROWS))
            job = modal_job(voltage, outputs)
            reference = ctypes.byref(job)
            modal(reference)
            check("C", outputs, expected)
            candidates = {"C": lambda: modal(reference), **candidates}
        times = interleave(candidates, rounds=options.rounds)

    rows = "\n".join(
        f"| {name} | {np.median(values) * 1e6:.1f} | {np.median(values) / ROWS * 1e9:.2f} |"
        for name, values in times.items()
    )
    body = (
        "One record of 2,000 samples of friend-2 (1 V step, 50 S/s, zero-order hold), four outputs; "
        f"{options.rounds} rounds. `simulate` is the whole public call from the signal's text to a Run, "
        "without its Dataset; the calls of richer models are given the samples of a sine of 3 V, at hold first.\n\n"
        f"| candidate | microseconds per record | nanoseconds per sample |\n|---|---|---|\n{rows}"
    )
    lsim_times = times["scipy.signal.lsim"]
    ratios = [
        Ratio("lsim / simulate", lsim_times / times["simulate"], at_least=20.0),
        Ratio("lsim / kernel", lsim_times / times["kernel"], at_least=300.0),
        Ratio("simulate / kernel", times["simulate"] / times["kernel"]),
        Ratio("simulate, new parameters each time / simulate", times[CHANGED] / times["simulate"], at_most=3.0),
    ]
    if "C" in times:
        ratios.insert(0, Ratio("kernel / C", times["kernel"] / times["C"], at_most=1.3))
        ratios += [
            Ratio(f"{name} / C", values / times["C"], at_most=15.0)
            for name, values in times.items()
            if name.startswith("leak") and "hold zero" not in name
        ]
        reported = ("leak, sine at hold zero", *richer())
        ratios += [Ratio(f"{name} / C", times[name] / times["C"]) for name in reported]
    else:
        body += "\n\nThe C loop was left out: no `cc` on this machine."
    finish("core", "One record", body, ratios, record=options.record, gate=options.gate)


if __name__ == "__main__":
    main()
