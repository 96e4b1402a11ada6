"""What contradicts a fit, although its search ended well."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun, Reading
from ipmclab.identification.problem.response import lumped
from ipmclab.identification.search.solve import Solution
from ipmclab.model.stages.circuit import SERIES
from ipmclab.model.structure import Structure
from ipmclab.run import Finding, FloatArray
from ipmclab.units import CHANNELS

_NOTHING: Final = "model-explains-nothing"
HALF: Final = 0.5  # of what the readings vary
_NOISE: Final = 1.3  # times the noise between neighbours: what is left is noise
_MISSED: Final = 2.0  # times what a circuit can draw: it misses more than half of the largest reading
_SURELY: Final = 6.0  # times the noise between neighbours: no reading of many lies so far off by chance
_ENOUGH: Final = 50  # readings from which the noise between neighbours is known


def unexplained(problem: Problem, left_of: Callable[[tuple[int, str]], FloatArray]) -> list[Finding]:
    """A finding for each run and output of which the model leaves half or more, and which is not merely noisy.

    Parameters
    ----------
    problem : Problem
    left_of : function of (place, output)
        What is left of an output of a run about the zero and the slope of its sensor, in units of the problem's noise.
    """
    found = []
    for (place, output), reading in problem.readings.items():
        record, left, values = problem.record_at(place), left_of((place, output)), reading.measured
        if not len(values):
            continue
        if reading.has_bounds:
            left = left[reading.exact[reading.used]]
        about = values - values.mean()
        residual = problem.noise[record.place, output] * math.sqrt(float(left @ left) / len(left))
        varies = math.sqrt(float(about @ about) / len(about))
        if residual < HALF * varies or is_noise(residual, reading) or varies == 0.0:
            continue
        lines = [CHANNELS[output].text(size, digits=3) for size in (residual, varies)]
        percent = math.floor(100.0 * (1.0 - (residual / varies) ** 2))
        share = f"only {percent} % of the variance of" if percent > 0 else "nothing of"
        found.append(
            Finding(
                _NOTHING,
                "error",
                f"{record.label}: the model explains {share} the {output}: it "
                f"leaves {lines[0]} (rms) of readings that vary by {lines[1]} about their mean",
                "do not use this fit: look at what check says of the run, at what is fixed, and give more rows",
                channel=output,
                values={"residual": residual, "varies": varies},
            )
        )
    return found


def is_noise(residual: float, reading: Reading) -> bool:
    """Whether what is left of a reading (rms) [SI] is no more than its noise, as neighbouring readings show that."""
    return len(reading.measured) >= _ENOUGH and residual <= _NOISE * reading.noise


def largest_current(record: PreparedRun, added: FloatArray) -> tuple[float, float]:
    """The largest current of the strip: as read, less what its sensor adds, and what is beyond noise [A]; 0 without."""
    reading = record.readings["current"]
    if not len(reading.measured):
        return 0.0, 0.0
    largest = float(np.abs(reading.measured - added[reading.exact]).max())
    return largest, max(largest - _SURELY * reading.noise, 0.0)


def largest_swing(voltage: FloatArray) -> float:
    """The largest change of a voltage that begins at 0 [V]: over a resistance the most that a passive circuit draws."""
    return max(float(voltage.max()), 0.0) - min(float(voltage.min()), 0.0)


def contradicted_currents(
    problem: Problem, solution: Solution, record: PreparedRun, added: FloatArray
) -> list[Finding]:
    """A current that not even a short circuit behind the electrodes could draw; or twice what the circuit could."""
    values = problem.values(solution.theta, record.place)
    structure = Structure.of(values)
    largest, read = largest_current(record, added)
    if not replace(structure, leak="").is_lumped or read == 0.0 or problem.noise[record.place, "current"] <= 0.0:
        return []
    parts = lumped(structure.branches, values, record.series_resistance)
    swing = largest_swing(record.run.voltage)
    less = " (the zero of its sensor taken off)" if added.any() else ""
    reaches = f"{record.label}: the current reaches {1e3 * largest:.4g} mA{less}"
    # One that was free is what the readings made of it: what it does not allow the model lacks.
    is_given = parts.series and not any(u.base in SERIES and u.beforehand is None for u in problem.unknowns)
    if is_given and read > swing / parts.series and largest > 1.02 * swing / parts.series:
        most = swing / parts.series
        return [
            Finding(
                "impossible-current",
                "error",
                f"{reaches} where {parts.series:.4g} ohm in series with the branches allow {1e3 * most:.4g} mA at most",
                "the sheet or contact resistance is too high, or the clamp feeds part of the strip directly: measure "
                "it, free circuit.sheet_resistance, or add the stage clamp or line.segments to the actuator",
                channel="current",
                values={"current": largest, "largest": most, "series_resistance": parts.series},
            )
        ]
    most = swing / (parts.series + 1.0 / (1.0 / parts.leak + float(np.sum(1.0 / parts.resistances))))
    if structure.leak or read <= _MISSED * most:
        return []
    return [
        Finding(
            "inrush-missed",
            "warning",
            f"{reaches}, and the fitted circuit draws {1e3 * most:.4g} mA at most: it misses the largest readings, "
            "mostly the first after an edge",
            "fit the circuit to the current alone (--free electrical), then the rest with the circuit fixed; or give "
            "the circuit another branch",
            channel="current",
            values={"current": largest, "largest": most},
        )
    ]


def message(solution: Solution, findings: Sequence[Finding]) -> str:
    """How the search ended, and in the same breath what contradicts the fit."""
    errors = dict.fromkeys(f.code for f in findings if f.severity == "error" and f.code != "not-converged")
    if not errors:
        return solution.message
    what = "the model does not follow what was read" if _NOTHING in errors else "errors contradict this fit"
    return f"{solution.message}, but {what} (see the findings {', '.join(errors)})"
