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


def netlist(voltage: np.ndarray, time: np.ndarray, table: Path) -> str:
    """Electrodes, dc resistance and two RC branches, fed with straight lines through the rows."""
    points = [f"+ {t:.10g} {v:.15g}" for t, v in zip(time, voltage, strict=True)]
    lines = ["* equivalent circuit of an ipmc", "Vin in 0 pwl(", *points, "+ )"]
    lines += [f"Re1 in node {FRIEND_2.electrode_resistance}", f"Re2 bottom 0 {FRIEND_2.electrode_resistance}"]
    lines += [f"Rdc node bottom {FRIEND_2.dc_resistance}"]
    for i, (r, c) in enumerate(zip(FRIEND_2.branch_resistances, FRIEND_2.branch_capacitances, strict=True)):
        lines += [f"R{i} node mid{i} {r:.15g}", f"C{i} mid{i} bottom {c:.15g} ic=0"]
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


@pytest.mark.parametrize(("text", "hold"), [("step 1 V", "zero"), ("sine 1 V 0.1 Hz", "first")])
def test_circuit_agrees_with_ngspice(
    text: str, hold: str, tmp_path: Path, require: Callable[[str, object], None]
) -> None:
    program = shutil.which("ngspice")
    require("ngspice", program)
    assert program is not None
    run = ipmclab.simulate(ipmclab.load_actuator("friend-2"), text, duration=DURATION, rate=RATE, hold=hold)
    table = tmp_path / "out.txt"
    circuit = tmp_path / "strip.cir"
    circuit.write_text(netlist(run.voltage, run.time, table), encoding="utf-8")
    subprocess.run([program, "-b", str(circuit)], check=True, capture_output=True, timeout=100, cwd=tmp_path)
    columns = np.loadtxt(table)
    time, current, node = columns[:, 0], -columns[:, 1], columns[:, 2]
    assert run.current is not None
    assert run.applied_voltage is not None
    rows = slice(2, None)  # ngspice has no solution at 0+ when it starts from given charges
    for ours, spice in ((run.current, current), (run.applied_voltage, node)):
        difference = np.abs(ours - np.interp(run.time, time, spice))[rows]
        worst = np.max(difference) / np.max(np.abs(ours))
        assert worst < 1e-5, f"{text}: {worst:.1e} of peak at row {int(np.argmax(difference)) + 2}"
