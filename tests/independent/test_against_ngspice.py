"""The circuit of Fig. 4.3 in ngspice, held against ``simulate``."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ipmclab
from tests.independent.thesis import FRIEND_2

RATE = 50.0
DURATION = 20.0


AREA = FRIEND_2.width * (FRIEND_2.free_length + FRIEND_2.clamped_length)

LEAKS = {
    "cubic": f"{AREA} * (0.5*v(u) + 1.5*v(u)*abs(v(u)) + 3*v(u)^3)",
    "exponential": f"abs(v(u)) > 1.23 ? sgn(v(u)) * {AREA}*10 * (exp((abs(v(u)) - 1.23)/0.5) - 1) : 0",
    "butler_volmer": f"abs(v(u)) > 1.23 ? sgn(v(u)) * {AREA}*10 * 2*sinh((abs(v(u)) - 1.23)/(2*0.5)) : 0",
}
"""What a behavioural source draws at the voltage of node u [A]: the laws of the leak in the words of ngspice."""


def netlist(voltage: np.ndarray, time: np.ndarray, table: Path, leak: str = "") -> str:
    """Electrodes, dc resistance and two RC branches, fed with straight lines through the rows."""
    points = [f"+ {t:.10g} {v:.15g}" for t, v in zip(time, voltage, strict=True)]
    lines = ["* equivalent circuit of an ipmc", "Vin in 0 pwl(", *points, "+ )"]
    lines += [f"Re1 in node {FRIEND_2.electrode_resistance}", f"Re2 bottom 0 {FRIEND_2.electrode_resistance}"]
    lines += [f"Rdc node bottom {FRIEND_2.dc_resistance}"]
    for i, (r, c) in enumerate(zip(FRIEND_2.branch_resistances, FRIEND_2.branch_capacitances, strict=True)):
        lines += [f"R{i} node mid{i} {r:.15g}", f"C{i} mid{i} bottom {c:.15g} ic=0"]
    if leak:
        lines += ["Bseen u 0 v = v(node)-v(bottom)", "Rseen u 0 1k", f"Bleak node bottom i = {LEAKS[leak]}"]
    lines += [
        ".options method=gear reltol=1e-7 abstol=1e-15 vntol=1e-12 chgtol=1e-18",
        ".control",
        f"tran 2m {time[-1]:.10g} 0 2m uic",
        "set wr_singlescale",
        "set numdgt=14",
        f"wrdata {table} i(Vin) v(node)-v(bottom)",
        "quit 0",
        ".endc",
        ".end",
    ]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "hold", "leak"),
    [
        ("step 1 V", "zero", ""),
        ("sine 1 V 0.1 Hz", "first", ""),
        ("step 3 V", "zero", "exponential"),
        ("sine 3 V 0.1 Hz", "first", "butler_volmer"),
        ("step 2.5 V", "zero", "cubic"),
    ],
)
def test_circuit_agrees_with_ngspice(
    text: str, hold: str, leak: str, tmp_path: Path, require: Callable[[str, object], None]
) -> None:
    program = shutil.which("ngspice")
    require("ngspice", program)
    assert program is not None
    actuator = ipmclab.load_actuator(f"friend-2+leak.{leak}" if leak else "friend-2")
    if leak == "cubic":
        actuator = actuator.replace(**{"leak.cubic.linear": 0.5, "leak.cubic.quadratic": 1.5})
    run = ipmclab.simulate(actuator, text, duration=DURATION, rate=RATE, hold=hold)
    table = tmp_path / "out.txt"
    circuit = tmp_path / "strip.cir"
    circuit.write_text(netlist(run.voltage, run.time, table, leak), encoding="utf-8")
    subprocess.run([program, "-b", str(circuit)], check=True, capture_output=True, timeout=300, cwd=tmp_path)
    columns = np.loadtxt(table)
    time, current, node = columns[:, 0], -columns[:, 1], columns[:, 2]
    assert run.current is not None
    assert run.applied_voltage is not None
    rows = slice(2, None)  # ngspice has no solution at 0+ when it starts from given charges
    for ours, spice in ((run.current, current), (run.applied_voltage, node)):
        difference = np.abs(ours - np.interp(run.time, time, spice))[rows]
        worst = np.max(difference) / np.max(np.abs(ours))
        assert worst < 1e-5, f"{text}: {worst:.1e} of peak at row {int(np.argmax(difference)) + 2}"
