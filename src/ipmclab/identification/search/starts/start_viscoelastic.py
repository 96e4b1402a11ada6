"""The viscoelastic modes found from force and displacement of a strip that is otherwise known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.free_run import seen_from_sensor
from ipmclab.identification.problem.record import PreparedRun, model_hold
from ipmclab.model import Actuator
from ipmclab.model.sensitivity import sensitivities

FloatArray = npt.NDArray[np.float64]

_CORNERS: Final = 9
_DAMPINGS: Final = (0.7, 3.0)
_STARTS: Final = 3
_LEAST: Final = 0.02


def viscoelastic_starts(
    actuator: Actuator, records: Sequence[PreparedRun], delays: Mapping[int, float]
) -> list[dict[str, float]]:
    """Starting points of the modes of the modulus, the most likely first.

    Near zero, force and displacement are linear in the amplitudes, so that over a grid of corner frequencies each mode
    is a linear least squares, beside a factor of the force and what sensors add.

    Parameters
    ----------
    actuator : Actuator
        With everything else near its final values.
    records : sequence of PreparedRun
        Those with force or displacement.
    delays : mapping of place to float [s]
    """
    count = actuator.structure.viscoelastic
    rate = max(record.run.rate for record in records)
    longest = max(float(record.run.time[-1] - record.run.time[0]) for record in records)
    corners = np.exp(np.linspace(np.log(2.0 / longest), np.log(1.5 * rate), _CORNERS))
    shapes = [(float(corner), damping) for corner in corners for damping in _DAMPINGS]
    switched_off = actuator.replace(**{f"viscoelastic.{i}.amplitude": 0.0 for i in range(count)})
    tables = [_columns(switched_off, record, delays.get(record.place, 0.0), shapes) for record in records]
    columns, own, left = (np.concatenate(parts) for parts in zip(*tables, strict=True))
    found = []
    for first in _best(columns, own, left, ())[:_STARTS]:
        chosen: tuple[int, ...] = (first,)
        while len(chosen) < count:
            chosen += (_best(columns, own, left, chosen)[0],)
        table = np.column_stack([columns[:, chosen], own])
        amplitudes = np.linalg.lstsq(table, left, rcond=1e-9)[0]
        values: dict[str, float] = {}
        for number, place in enumerate(chosen):
            values[f"viscoelastic.{number}.amplitude"] = float(np.clip(amplitudes[number], _LEAST, 10.0))
            values[f"viscoelastic.{number}.frequency"], values[f"viscoelastic.{number}.damping_ratio"] = shapes[place]
        found.append(values)
    return found


def _best(columns: FloatArray, own: FloatArray, left: FloatArray, chosen: tuple[int, ...]) -> list[int]:
    """Columns in the order of what they explain beside those that are chosen, no two neighbours before the others."""
    basis = np.linalg.qr(np.column_stack([own, columns[:, chosen]]))[0]
    free = columns - basis @ (basis.T @ columns)
    size = np.maximum(np.linalg.norm(free, axis=0), 1e-9 * np.linalg.norm(columns, axis=0) + 1e-300)
    gains = free.T @ left / size
    order = [int(place) for place in np.argsort(-gains) if place not in chosen]
    apart: list[int] = []
    for place in order:
        if all(abs(place // len(_DAMPINGS) - other // len(_DAMPINGS)) > 1 for other in apart):
            apart.append(place)
    return apart + [place for place in order if place not in apart]


def _columns(
    actuator: Actuator, record: PreparedRun, delay: float, shapes: Sequence[tuple[float, float]]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """For each usable reading: the answer to each mode, what else may move, and what is left to explain; weighted."""
    outputs = [name for name in ("displacement", "force") if name in record.readings]
    strip = seen_from_sensor(actuator, record.series_resistance)
    answers = []
    for corner, damping in shapes:
        at = strip.replace(**{"viscoelastic.0.frequency": corner, "viscoelastic.0.damping_ratio": damping})
        found = sensitivities(
            at,
            ["viscoelastic.0.amplitude"],
            record.run.time,
            record.run.voltage,
            model_hold(record),
            outputs=outputs,
            delay=delay,
        )
        answers.append(found.parameters[:, :, 0])
    columns, own, left = [], [], []
    for row, output in enumerate(outputs):
        reading = record.readings[output]
        used, weight = reading.exact, 1.0 / max(reading.noise, 1e-300)
        model = found.values[row][used] * weight
        columns.append(np.column_stack([answer[row][used] for answer in answers]) * weight)
        shapes_of_sensor = np.zeros((len(model), 4))
        place = 0 if output == "displacement" else 2
        shapes_of_sensor[:, place], shapes_of_sensor[:, place + 1] = model, weight
        own.append(shapes_of_sensor)
        left.append(reading.values[used] * weight - model)
    return np.concatenate(columns), np.concatenate(own), np.concatenate(left)
