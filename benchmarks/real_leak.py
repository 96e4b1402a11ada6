"""The leak current of the 2 V and 3 V records by one static law, and its later rise by the slow leak."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import scipy.optimize

import ipmclab
from benchmarks.real_records import StepRecord, strip
from ipmclab import Actuator
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.variants import with_stages

Array = npt.NDArray[np.float64]

NAMES = ("step_2V", "step_3V")
OWN = (
    "circuit.sheet_resistance",
    "circuit.branches.0.resistivity",
    "circuit.branches.0.permittivity",
    "circuit.branches.1.resistivity",
    "circuit.branches.1.permittivity",
)
"""Of each run: the strip was not in the same state."""
SHARED = ("leak.exponential.current_density", "leak.exponential.voltage_scale")
STEP, LAST = 0.2, 60.0  # s
REACH = 7.0
"""How far the logarithm of a parameter may go from its start."""


def leak(found: Mapping[str, StepRecord]) -> str:
    """The table of the static law, and of the slow leak."""
    base = with_stages(strip(50.0).replace(**{"circuit.dc_resistivity": 3319 * 0.3}), "leak.exponential")
    start = np.log([50.0 / 12.0, 1.0, 0.03, 40.0, 0.07] * len(NAMES) + [10.0, 0.4])
    measured = {name: _means(found[name], LAST) for name in NAMES}

    def residual(logs: Array) -> Array:
        parts = []
        for place, name in enumerate(NAMES):
            current = _current(_actuator(base, logs, place), found[name], LAST)
            known = np.isfinite(measured[name])
            parts.append((current - measured[name])[known] / 1e-3)
        return np.concatenate([*parts, 0.03 * (logs - start)])

    solution = scipy.optimize.least_squares(
        residual, start, bounds=(start - REACH, start + REACH), x_scale="jac", max_nfev=60
    )
    lines = [
        "## Leak",
        "",
        "One static law, `leak.exponential` from 1.23 V, for both runs; the circuit in front of it belongs to each run "
        "(they were not in the same state). Total current, means over 5 s, found on the first 60 s.",
        "",
        "| record | " + " | ".join(f"{a}-{a + 5} s" for a in range(5, 40, 5)) + " | worst |",
        "|---|" + "---|" * 8,
    ]
    worst = []
    for place, name in enumerate(NAMES):
        actuator = _actuator(base, solution.x, place)
        model, read = _current(actuator, found[name], LAST), measured[name]
        cells, off = [], []
        for first in range(5, 40, 5):
            window = slice(round(first / STEP), round((first + 5) / STEP))
            one, other = float(np.nanmean(read[window])), float(np.mean(model[window]))
            off.append(other / one - 1.0)
            cells.append(f"{1e3 * one:.1f} / {1e3 * other:.1f} mA ({100 * off[-1]:+.0f} %)")
        worst.append(max(off, key=abs))
        lines.append(f"| {name} | {' | '.join(cells)} | {100 * worst[-1]:+.0f} % |")
    density, scale = np.exp(solution.x[-2:])
    lines += [
        "",
        f"Measured / model. j_0 = {density:.3g} A/m^2, V_s = {scale:.3g} V, one pair of many: two voltages do not tell "
        f"them apart. The bound of 20 % {'holds' if max(map(abs, worst)) <= 0.2 else 'does not hold'}.",
        "",
        *_later(found["step_3V"], _actuator(base, solution.x, 1)),
    ]
    return "\n".join(lines)


def _later(record: StepRecord, actuator: Actuator) -> list[str]:
    """The rise at constant voltage: what check says, what the static leak gives, and the slow leak."""
    rising = next(finding for finding in ipmclab.check(record.run) if finding.code == "current-rises")
    end = float(record.since[-1])
    read = _means(record, end)
    windows = [slice(round(a / STEP), round(b / STEP)) for a, b in ((5, 40), (20, 40), (100, 200), (200, 400))]
    grown = with_stages(actuator, "leak.slow")
    names = ("leak.slow.growth", "leak.slow.time_constant", SHARED[0])
    start = np.log([0.6, 150.0, actuator[SHARED[0]]])

    def changed(logs: Array) -> Actuator:
        return grown.replace(**dict(zip(names, np.exp(logs).tolist(), strict=True)))

    # Every second would do: means over 2 s keep the early transient small beside the minutes.
    def residual(logs: Array) -> Array:
        difference = (_current(changed(logs), record, end) - read)[round(5.0 / STEP) :]
        return np.nan_to_num(difference[: len(difference) // 10 * 10].reshape(-1, 10).mean(axis=1)) / 1e-3

    solution = scipy.optimize.least_squares(
        residual, start, bounds=(start - REACH, start + REACH), x_scale="jac", max_nfev=40
    )
    slow = changed(solution.x)
    growth, slowness = slow["leak.slow.growth"], slow["leak.slow.time_constant"]
    static, with_slow = _current(actuator, record, end), _current(slow, record, end)
    lines = [
        f"`step_3V`, later. `current-rises`: {rising.message}; {rising.repair}. A static leak in parallel with "
        "resistors and capacitors answers a constant voltage with a current that never rises: the static law cannot "
        "give it at any values. The optional slow leak can:",
        "",
        "| | 5-40 s | 20-40 s | 100-200 s | 200-400 s |",
        "|---|---|---|---|---|",
    ]
    for label, values in (("measured", read), ("static leak", static), ("with `leak.slow`", with_slow)):
        cells = [f"{1e3 * float(np.nanmean(values[window])):.1f} mA" for window in windows]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    lines += [
        "",
        f"Growth {growth:.3g}, time constant {slowness:.3g} s: one pair of many, for the record is too short to show "
        "where the rise ends.",
    ]
    return lines


def _actuator(base: Actuator, logs: Sequence[float] | Array, place: int) -> Actuator:
    count = len(OWN)
    own = dict(zip(OWN, np.exp(logs[place * count : (place + 1) * count]), strict=True))
    shared = dict(zip(SHARED, np.exp(logs[len(NAMES) * count :]), strict=True))
    return base.replace(**{name: float(value) for name, value in {**own, **shared}.items()})


def _means(record: StepRecord, last: float) -> Array:
    """Mean current over steps from the contact on, less that before the voltage stepped."""
    assert record.run.current is not None
    before = float(np.nanmean(record.run.current[: record.contact - 150]))
    rows = record.rows(0.0, last)
    current = np.where(record.usable("current"), record.run.current, np.nan)[rows] - before
    each = round(STEP / 0.040)
    return np.nanmean(current[: len(current) // each * each].reshape(-1, each), axis=1)


def _current(actuator: Actuator, record: StepRecord, last: float) -> Array:
    """The model's, over the same steps, for the final voltage from the contact on."""
    rows = record.rows(0.0, last)
    volts = np.full(rows.stop - rows.start, float(np.median(record.run.voltage[rows])))
    current = simulate_outputs(actuator, 0.040 * np.arange(len(volts)), volts, "zero", outputs=["current"])[0]
    each = round(STEP / 0.040)
    return current[: len(current) // each * each].reshape(-1, each).mean(axis=1)
