"""A zero that rounding hides: a converter whose steps are larger than the noise reads a small zero as none at rest."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.run import FloatArray

_DITHERED: Final = 0.3  # of a step: with so much noise the mean of the readings shows what lies between two steps


def hidden_zeros(problem: Problem, rows: int) -> FloatArray:
    """What the zeros that rounding hides add to the residuals, for one standard deviation of each.

    A zero of up to half a step to both sides (a rectangular distribution) is rounded away at rest, and is in every
    reading after it.

    Parameters
    ----------
    problem : Problem
    rows : int
        Of its residuals, those of priors among them.

    Returns
    -------
    columns : float array, shape (n_rows, n_hidden)
    """
    found = []
    for record in problem.records:
        resting = record.resting
        for output, reading in record.readings.items():
            step = reading.quantum if resting else 0.0
            if not step or not np.std(record.run.channels[output][:resting]) < _DITHERED * step:
                continue
            key = record.place, output
            after = np.flatnonzero(reading.used) >= resting
            column = np.zeros(rows)
            size = step / math.sqrt(12.0) / problem.noise[key]
            column[problem.pieces[key]] = problem.whitened(key, np.where(after, size, 0.0)[None])[0]
            found.append(column)
    return np.array(found).reshape(len(found), rows).T
