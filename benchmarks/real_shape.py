"""How well one structure follows the real records, where one of them cannot be followed, and their leak.

Run ``python -m benchmarks.real_shape [--record]``; ``IPMCLAB_REAL_RUNS`` names the folder of the records.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from benchmarks.real_leak import leak
from benchmarks.real_records import StepRecord, cut, records, strip
from ipmclab.forecasting.forecast import with_slow_modes
from ipmclab.model.sensitivity import sensitivities

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "benchmarks/real_leak.py",
    "benchmarks/real_records.py",
)

Array = npt.NDArray[np.float64]

SHORTEST, LONGEST, MODES = 0.4, 600.0, 12
AMPLITUDE = 1.2e-3  # m/V, standard deviation of what a slow mode does
DELAYS = (-0.08, -0.04, 0.0, 0.04)  # s: rows by which the laser leads the voltage channel
REFERENCE = {"step_1V": (None, 0.9), "step_2V": (0.5, 0.6), "step_2V_poor": (2.7, None), "step_3V": (3.0, 2.4)}
"""Three exponentials and a free trend, % of range: over 60 s, over the whole record."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/real_shape.md")
    options = parser.parse_args()
    found = records()
    body = "\n\n".join([in_sample(found), jump(found), leak(found)])
    finish("real_shape", "What the real records hold", body, [], record=options.record, gate=False)


def in_sample(found: Mapping[str, StepRecord]) -> str:
    """The table of root mean square errors within the records."""
    lines = [
        "## Within the records",
        "",
        f"`friend-2+relaxation.displacement={MODES}` with the strip's dimensions: time constants spread from "
        f"{SHORTEST:g} to {LONGEST:g} s, ratios free (prior {1e3 * AMPLITUDE:g} mm/V each), an offset, and a drift "
        "whose prior is the drift before the step with its standard error and the change of drift of the other three. "
        "One structure for all records. Root mean square error of displacement from the contact on, in % of the range; "
        "in brackets three exponentials with a free trend. In `step_1V` the rows that `rate-jump` names are left "
        "out.",
        "",
        "| record | first 60 s | whole record | drift before | drift found (60 s) |",
        "|---|---|---|---|---|",
    ]
    drifts = {name: before(record) for name, record in found.items()}
    changes = {name: _slope(record) - drifts[name][0] for name, record in found.items()}
    for name, record in found.items():
        curl = float(np.sqrt(np.mean([change**2 for other, change in changes.items() if other != name])))
        slope, error = drifts[name]
        short = follow(record, 60.0, slope, float(np.hypot(error, curl)))
        whole = follow(record, np.inf, slope, float(np.hypot(error, curl)))
        cells = [
            f"{100 * one[0]:.2f} ({'-' if reference is None else f'{reference:g}'})"
            for one, reference in zip((short, whole), REFERENCE[name], strict=True)
        ]
        lines.append(
            f"| {name} | {' | '.join(cells)} | {1e6 * slope:.1f} ± {1e6 * error:.1f} µm/s | "
            f"{1e6 * short[1]:.1f} ± {1e6 * short[2]:.1f} µm/s |"
        )
    return "\n".join(lines)


def follow(record: StepRecord, last: float, slope: float, deviation: float) -> tuple[float, float, float]:
    """Error as a share of the range, and the drift with its standard error [m/s]."""
    fit = ipmclab.identify(strip(), [cut(record, -2.0, 15.0)], free=["electrical", "circuit.sheet_resistance"])
    actuator = with_slow_modes(fit.actuator, shortest=SHORTEST, longest=LONGEST, modes=MODES)
    names = [f"relaxation.displacement.{place}.ratio" for place in range(MODES)]
    since = record.since
    rows = (since >= 0.0) & (since <= last)
    assert record.run.displacement is not None
    readings = record.run.displacement[rows]
    used = record.usable("displacement")[rows]
    volts = record.run.voltage[rows]
    per_volt = sensitivities(
        actuator, names, np.linspace(0.0, 30.0 * LONGEST, 300), np.ones(300), "zero", outputs=["displacement"]
    ).parameters[0, -1]
    answers = []
    for delay in DELAYS:
        response = sensitivities(actuator, names, since[rows], volts, "zero", outputs=["displacement"], delay=delay)
        columns = np.column_stack([np.ones(rows.sum()), since[rows], response.parameters[0]])
        mean = np.concatenate([[0.0, slope], np.zeros(MODES)])
        spread = np.concatenate([[1.0, deviation], AMPLITUDE / np.abs(per_volt)])
        answers.append(_ridge(columns[used], (readings - response.values[0])[used], mean, spread))
    error, drift, uncertainty = min(answers)
    return error / float(np.ptp(readings[used])), drift, uncertainty


def _ridge(columns: Array, readings: Array, mean: Array, spread: Array) -> tuple[float, float, float]:
    """Error, drift and its standard error of the most likely coefficients; the noise is what is left over."""
    sigma = float(np.std(readings))
    for _ in range(12):
        # Residuals of neighbouring rows are alike: a hundredth of the rows tells as much as independent ones would.
        weighted = columns * spread / (10.0 * sigma)
        system = weighted.T @ weighted + np.eye(columns.shape[1])
        found = mean + spread * np.linalg.solve(system, weighted.T @ (readings - columns @ mean) / (10.0 * sigma))
        sigma = float(np.sqrt(np.mean((readings - columns @ found) ** 2)))
    covariance = np.linalg.inv(system)
    return sigma, float(found[1]), float(spread[1] * np.sqrt(covariance[1, 1]))


def jump(found: Mapping[str, StepRecord]) -> str:
    """What the finding says, and what lies near 5 s."""
    record = found["step_1V"]
    finding = next(finding for finding in ipmclab.check(record.run) if finding.code == "rate-jump")
    lost = next(finding for finding in ipmclab.check(record.run) if finding.code == "contact-lost")
    since = record.since
    usual = float(finding.values["usual_change"])  # type: ignore[arg-type]
    near = record.rows(4.0, 6.5)
    assert record.run.displacement is not None
    readings = record.run.displacement[near.start - 10 : near.stop + 10]
    place = np.arange(10) - 4.5
    slopes = np.convolve(readings, place[::-1] / (place @ place), mode="valid") / 0.040
    bends = slopes[10:] - slopes[:-10]
    top = int(np.abs(bends).argmax())
    at = since[near.start - 10 + top + 10]
    row = finding.samples[0][0]
    height = abs(float(finding.values["after"]) - float(finding.values["before"]))  # type: ignore[arg-type]
    most = 1e6 * np.abs(np.diff(record.run.displacement[near])).max()
    return "\n".join(
        [
            "## The jump of `step_1V`",
            "",
            f"`rate-jump`: {finding.message}. That is {since[row]:.2f} s after the step; rows {row} to "
            f"{finding.samples[0][1]} are left out. Its cause is in the current: {lost.message}.",
            "",
            f"Near 5 s after the step nothing jumps: from 4 to 6.5 s the rate changes most by {1e3 * bends[top]:.3f} "
            f"mm/s, at {at:.2f} s, {abs(bends[top]) / usual:.1f} times the usual change (the jump: "
            f"{height / usual:.1f} times), and no row differs from the next by more than {most:.1f} µm. The "
            f"step itself is at {record.run.time[record.contact]:.2f} s of the record.",
        ]
    )


def before(record: StepRecord) -> tuple[float, float]:
    """Slope of the readings before the contact and its standard error [m/s], the latter from eight blocks."""
    assert record.run.displacement is not None
    rows = np.flatnonzero(record.since < 0.0)[:-3]
    time, read = record.since[rows], record.run.displacement[rows]
    slopes = [np.polyfit(*pair, 1)[0] for pair in zip(np.array_split(time, 8), np.array_split(read, 8), strict=True)]
    return float(np.polyfit(time, read, 1)[0]), float(np.std(slopes)) / math.sqrt(8)


def _slope(record: StepRecord) -> float:
    rows = record.rows(20.0, 60.0)
    assert record.run.displacement is not None
    return float(np.polyfit(record.run.time[rows], record.run.displacement[rows], 1)[0])


if __name__ == "__main__":
    main()
