"""What something that a model lacks would change in the weighted residuals of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ipmclab.identification.diagnostics.score_directions import response
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import drive
from ipmclab.model import Actuator
from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.model.stages.kind import Trial
from ipmclab.run import FloatArray

_LAGS: Final = (0.002, 0.006, 0.02, 0.06, 0.2, 0.6)
"""Of the longest record: time constants by which a voltage is filtered."""


def along_directions(
    problem: Problem, theta: FloatArray, actuator: Actuator, directions: Sequence[Trial], output: str
) -> tuple[list[Trial], FloatArray]:
    """Those that go with an actuator, and what each changes in one output; shape (n_directions, n_residual)."""
    kept, rows = [], []
    for direction in directions:
        row = np.zeros(problem.beforehand.stop)
        for record in problem.records:
            if output not in record.readings:
                continue
            values = problem.values(theta, record.place)
            state = None
            if record.start == "free":
                state = problem.responder.initial_state(record, values, problem.start(theta, record.place))
            found = response(direction, actuator.replace(**values), record, problem.delay(theta, record), state)
            if found is None:
                break
            key = record.place, output
            row[problem.pieces[key]] = found[output][record.readings[output].used] / problem.noise[key]
        else:
            kept.append(direction)
            rows.append(row)
    return kept, np.array(rows).reshape(len(rows), problem.beforehand.stop)


def of_voltage(problem: Problem, theta: FloatArray, output: str, *, bent: bool = False) -> FloatArray:
    """The voltage and lagged copies of it, in every run that has an output; shape (n_columns, n_residual).

    Parameters
    ----------
    problem : Problem
    theta : float array, shape (n_unknown,)
    output : str
    bent : bool
        Of the voltage times its magnitude in its place: what no linear model answers to.
    """
    longest = max(float(record.run.time[-1] - record.run.time[0]) for record in problem.records)
    poles = -1.0 / (np.array(_LAGS) * longest)
    found = np.zeros((1 + len(poles), problem.beforehand.stop))
    for record in problem.records:
        if output not in record.readings:
            continue
        driven = drive(record, problem.delay(theta, record))
        if bent:
            start, end, present = (one * np.abs(one) for one in (driven.start, driven.end, driven.present))
            driven = Drive(driven.durations, driven.kind, start, end, present, driven.rows)
        lagged, _ = responses(driven, poles)
        used = record.readings[output].used
        key = record.place, output
        piece = problem.pieces[key]
        found[0, piece] = driven.present[used] / problem.noise[key]
        found[1:, piece] = lagged[:, used] / problem.noise[key]
    return found
