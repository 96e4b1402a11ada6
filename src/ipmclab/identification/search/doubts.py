"""What contradicts a fit, although its search ended well."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import Solution
from ipmclab.run import Finding
from ipmclab.units import CHANNELS

_HALF: Final = 0.5  # of what the readings vary
_NOISE: Final = 1.3  # times the noise between neighbours: what is left is noise
_ENOUGH: Final = 50  # readings from which the noise between neighbours is known


def unexplained(problem: Problem, solution: Solution) -> list[Finding]:
    """A finding for each run and output of which the model leaves half or more, and which is not merely noisy."""
    found = []
    for record in problem.records:
        for output, reading in record.readings.items():
            piece = problem.pieces[record.place, output]
            left, values = solution.evaluation.residual[piece], reading.measured
            if not len(values):
                continue
            if reading.has_bounds:
                left = left[reading.exact[reading.used]]
            about = values - values.mean()
            residual = problem.noise[record.place, output] * math.sqrt(float(left @ left) / len(left))
            varies = math.sqrt(float(about @ about) / len(about))
            is_noise = len(values) >= _ENOUGH and residual <= _NOISE * reading.noise
            if residual < _HALF * varies or is_noise or varies == 0.0:
                continue
            channel = CHANNELS[output]
            told = [f"{channel.to_display(size):.3g} {channel.display_unit}" for size in (residual, varies)]
            found.append(
                Finding(
                    "model-explains-nothing",
                    "error",
                    f"{record.label}: the model explains nothing of the {output}: it leaves {told[0]} (rms) of "
                    f"readings that vary by {told[1]} about their mean",
                    "do not use this fit: look at what check says of the run, at what is fixed, and give more rows",
                    channel=output,
                    values={"residual": residual, "varies": varies},
                )
            )
    return found


def message(solution: Solution, findings: Sequence[Finding]) -> str:
    """How the search ended, and in the same breath what contradicts the fit."""
    ended = solution.message if solution.converged else f"did not converge: {solution.message}"
    errors = dict.fromkeys(f.code for f in findings if f.severity == "error" and f.code != "not-converged")
    if not errors:
        return ended
    if "model-explains-nothing" in errors:
        return f"{ended}, but the model explains nothing of what was read (see the findings {', '.join(errors)})"
    return f"{ended}, but errors contradict this fit (see the findings {', '.join(errors)})"
