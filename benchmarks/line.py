"""The electrodes as a line: how many modes or segments are enough, and how far the error bound is above the error.

Run ``python -m benchmarks.line [--record]``. friend-2, with and without its clamped section fed at once. Over frequency
the errors are against the transmission line's own formulas (tests/model/test_line.py), over time against 100 modes.
"""

from __future__ import annotations

import argparse

import numpy as np

import ipmclab
from benchmarks.harness import finish
from ipmclab.model import line_error_bound
from tests.independent.thesis import FRIEND_2
from tests.model.test_line import lined, transmission_line

SOURCES = ("src/ipmclab/model",)

FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 60)])
CASES: tuple[tuple[str, float | None, float], ...] = (
    ("friend-2 as a line", None, 0.0),
    ("friend-2 as a line, clamped section fed at once, contacts of 2 ohm", 1.0, 2.0),
)
COUNTS = [*(("modes", count) for count in (1, 2, 3, 4, 6, 8, 12, 24))]
COUNTS += [*(("segments", count) for count in (3, 5, 10, 20, 40, 80))]
CHANNELS = ("current", "applied_voltage", "displacement")


def step(actuator: ipmclab.Actuator) -> np.ndarray:
    run = ipmclab.simulate(actuator, "step 1 V", duration=20.0, rate=50.0)
    return np.array([run.channels[name] for name in CHANNELS])


def table(share: float | None, contact: float) -> str:
    strip = FRIEND_2.changed(contact_resistance=contact)
    current, voltage = transmission_line(strip, share or 0.0, 2j * np.pi * FREQUENCIES)
    fine = step(lined(strip, share=share, modes=100))
    peaks = np.max(np.abs(fine), axis=1)
    lines = [
        f"Peak of the step {1e3 * peaks[0]:.2f} mA, where V/(2 R_e + R_contact) is "
        f"{1e3 / (strip.series_resistance):.1f} mA.",
        "",
        "| | at row 0 | step, in parts of the peak: current | applied voltage | displacement | "
        "over frequency: current | bound | applied voltage | bound |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind, count in COUNTS:
        actuator = lined(strip, share=share, **{kind: count})
        ours = step(actuator)
        of_peak = np.max(np.abs(ours - fine), axis=1) / peaks
        answer = actuator.frequency_response(FREQUENCIES, ["current", "applied_voltage"])
        errors = [np.max(np.abs(answer[0] - current)), np.max(np.abs(answer[1] - voltage))]
        bounds = ["", ""]
        if kind == "modes":
            bounds = [f"{part:.1e}" for part in line_error_bound(actuator)]
        lines.append(
            f"| {count} {kind} | {1e3 * ours[0, 0]:.2f} mA | "
            + " | ".join(f"{part:.1e}" for part in of_peak)
            + f" | {errors[0]:.1e} A/V | {bounds[0]} | {errors[1]:.1e} V/V | {bounds[1]} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/line.md")
    options = parser.parse_args()
    body = "\n\n".join(f"## {title}\n\n{table(share, contact)}" for title, share, contact in CASES)
    finish("line", "Electrodes as a line", body, [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
