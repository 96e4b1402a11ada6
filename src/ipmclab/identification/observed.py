"""What a fit says of each run: how it was read, and what is left of its readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ipmclab.fit.observation import Observation
from ipmclab.fit.row_marks import RowMarks
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.model.order import Order
from ipmclab.run import FloatArray, Run


def observation(correlated: Correlated, record: PreparedRun, run: Run, order: Order) -> Observation:
    """How the readings of one run were read: its delay, its start, its sensors and their noise."""
    problem, theta, place = correlated.problem, correlated.solution.theta, record.place

    def own(what: str) -> dict[str, float]:
        return {
            unknown.base.rsplit(".", 1)[1]: unknown.value(float(entry))
            for unknown, entry in zip(problem.unknowns, theta, strict=True)
            if unknown.place == place and unknown.base.startswith(f"observation.{what}.")
        }

    def of_noise(what: Mapping[tuple[int, str], float]) -> dict[str, float]:
        return {output: value for (at, output), value in what.items() if at == place}

    state: dict[str, float] = {}
    if record.start == "free":
        found = problem.responder.initial_state(record, problem.values(theta, place), problem.start(theta, place))
        state = {order(name): value for name, value in found.items()}
    return Observation(
        label=record.label,
        content_sha256=run.content_sha256,
        hold=record.run.hold,
        delay=problem.delay(theta, record),
        start=record.start,
        initial_state=state,
        offset=_sum({**record.known_offset, **own("offset")}, of_noise(correlated.offset)),
        drift=_sum({**record.known_drift, **own("drift")}, of_noise(correlated.drift)),
        noise={
            output: correlated.deviation.get((place, output), problem.noise[place, output])
            for output in record.readings
        },
        samples={output: int(np.count_nonzero(reading.used)) for output, reading in record.readings.items()},
        span={name: float(np.ptp(one.values[one.used])) for name, one in record.readings.items() if one.used.any()},
        series_resistance=record.series_resistance,
        noise_model={output: model for (at, output), model in correlated.noise.items() if at == place},
        mounting=record.run.metadata.mounting_id or "",
        # With the water content at which its readings are met best.
        state=None if record.state is None else replace(record.state, found=problem.water(theta, place)),
        marks=RowMarks.of(run),
    )


def _sum(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    return {name: one.get(name, 0.0) + other.get(name, 0.0) for name in (*one, *other)}


def residuals(correlated: Correlated) -> tuple[dict[str, FloatArray], ...]:
    """Readings less the free-running model of each run and output [SI], NaN where a row is not used."""
    problem = correlated.problem
    found: dict[int, dict[str, FloatArray]] = {record.place: {} for record in problem.records}
    for key, reading in problem.readings.items():
        column = np.full(len(reading.values), np.nan)
        column[reading.used] = -correlated.plain.residual[problem.pieces[key]] * problem.noise[key]
        found[key[0]][key[1]] = column - correlated.beside(key)
    return tuple(found.values())
