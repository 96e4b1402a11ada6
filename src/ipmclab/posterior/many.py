"""Residuals of one problem at many vectors, without derivatives: side by side where the model has loops for that."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun

FloatArray = npt.NDArray[np.float64]


def residuals(problem: Problem, thetas: FloatArray) -> dict[tuple[int, str], FloatArray]:
    """Weighted residuals of the readings of each run and output, not whitened.

    Parameters
    ----------
    problem : Problem
    thetas : float array, shape (n, n_unknown)

    Returns
    -------
    residuals : dict of (place, output) to float array, shape (n, n_readings)
        Those of ``problem.plain.evaluate`` at each vector, but for what was known beforehand.
    """
    found = {}
    with np.errstate(over="ignore", invalid="ignore"):
        for record in problem.records:
            outputs = _outputs(problem, record, thetas)
            for row, (output, reading) in enumerate(record.readings.items()):
                away = problem.away(record, output, thetas, outputs[:, row])
                away /= problem.noise[record.place, output]
                if reading.has_bounds:
                    away[away * reading.side > 0] = 0.0
                if reading.weights is not None:
                    away *= reading.weights
                found[record.place, output] = away if reading.complete else away[:, reading.used]
    return found


def _outputs(problem: Problem, record: PreparedRun, thetas: FloatArray) -> FloatArray:
    """The outputs of one run at each vector, shape (n, n_outputs, n_time) [SI].

    Here it is decided how. Strips that begin at rest, under a voltage that all of them share, go side by side where
    their responder can do that.
    """
    if record.start != "free" and record.state is None and not record.delay_is_free:
        values = in_reference(problem, thetas, record.place)
        found = problem.responder.respond_many(record, values, len(thetas), record.known_delay or 0.0)
        if found is not None:
            return found
    return np.stack([problem.outputs(theta, record) for theta in thetas])


def in_reference(problem: Problem, thetas: FloatArray, place: int) -> Mapping[str, Any]:
    """``problem.in_reference`` of many vectors: what they move is an array of shape (n,)."""
    moved = {unknown.base: unknown.values(thetas[:, column]) for column, unknown in problem.places[place].columns}
    return {**problem.base, **moved}
