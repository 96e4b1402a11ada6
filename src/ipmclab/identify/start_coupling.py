"""The coupling found from force or displacement and the node voltage of a known circuit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.observation import Record, model_hold
from ipmclab.identify.varpro import Drive, PoleFit, Series, all_minima, responses
from ipmclab.model import Actuator, simulate_outputs

FloatArray = npt.NDArray[np.float64]

_MEETING: Final = 1.3  # ratio of two real poles below which they may be a complex pair
_MINIMA: Final = 2


def coupling_starts(
    actuator: Actuator, records: Sequence[Record], delays: Mapping[int, float], *, stiffness_is_free: bool
) -> list[dict[str, float]]:
    """Starting points of d(s) = K_d (s + Z_d)/(s^2 + P_1d s + P_2d), the most likely first.

    Force and displacement are both d(s) V_appl times a number here: the beam's own resonance is left to
    the fit. The node voltage comes from the circuit, and the poles from variable projection.

    Parameters
    ----------
    actuator : Actuator
        With the circuit and the beam near their final values.
    records : sequence of Record
    delays : mapping of place to float [s]
    stiffness_is_free : bool
        Whether Young's modulus is to be started too, where displacement tells d(s) without it.
    """
    series, labels = _series(actuator, records, delays)
    moving = [run for run, (_, output) in zip(series, labels, strict=True) if output == "displacement"]
    pressing = [run for run, (_, output) in zip(series, labels, strict=True) if output == "force"]
    separate = stiffness_is_free and bool(moving) and bool(pressing)
    if separate:
        series = moving
        labels = [label for label in labels if label[1] == "displacement"]
    nyquist = float(np.pi * max(record.run.rate for record, _ in labels))
    starts: list[tuple[float, float, float, float]] = []
    for found in all_minima(series, 2, _sensors(series, labels))[:_MINIMA]:
        level = abs(float(found.residues @ found.poles[::-1])) or 1e-12  # K_d Z_d
        gain = float(np.sum(found.residues))
        p1, p2 = float(-np.sum(found.poles)), float(np.prod(found.poles))
        seen = level / gain if gain > 0 else np.inf
        # A zero beyond the Nyquist rate hardly shows, and one far beyond it not at all: it is put nearer.
        starts.append((level, min(seen, nyquist), p1, p2))
        if found.poles[0] / found.poles[1] < _MEETING:
            corner = float(np.sqrt(p2))
            for ratio, damping in ((1.0, 0.5), (1.5, 0.2)):
                turned = corner * ratio
                starts.append((level * ratio**2, min(seen, nyquist), 2.0 * damping * turned, turned**2))
    modulus = {}
    if separate:
        least = min(all_minima(moving, 2, _sensors(series, labels)), key=lambda found: found.cost)
        modulus = {"beam.modulus": actuator["beam.modulus"] * _stiffness(least, pressing)}
    return [
        {"coupling.gain": level / zero, "coupling.zero": zero, "coupling.p1": p1, "coupling.p2": p2, **modulus}
        for level, zero, p1, p2 in starts
    ]


def _sensors(series: Sequence[Series], labels: Sequence[tuple[Record, str]]) -> FloatArray:
    """What sensors add: a constant for each series, for a zero is arbitrary, and a slope where the record shows one."""
    total = sum(len(run.time) for run in series)
    columns = []
    begin = 0
    for run, (record, output) in zip(series, labels, strict=True):
        end = begin + len(run.time)
        shapes = [np.ones(len(run.time))]
        if ("drift", output) in record.unsettled:
            shapes.append(run.time / run.time[-1])
        for shape in shapes:
            column = np.zeros(total)
            column[begin:end] = shape
            columns.append(column)
        begin = end
    return np.array(columns)


def _stiffness(found: PoleFit, pressing: Sequence[Series]) -> float:
    """Force over what d(s) from the displacement makes of it: the modulus over the one assumed."""
    above = below = 0.0
    for run in pressing:
        expected = found.residues @ responses(run.drive, found.poles)[0]
        weight = run.weight**2
        mean = np.sum(weight * expected) / np.sum(weight)
        above += float(np.sum(weight * (expected - mean) * run.readings))
        below += float(np.sum(weight * (expected - mean) ** 2))
    return max(above / below, 1e-3) if below > 0 else 1.0


def _series(
    actuator: Actuator, records: Sequence[Record], delays: Mapping[int, float]
) -> tuple[list[Series], list[tuple[Record, str]]]:
    height, width = actuator["geometry.thickness"], actuator["geometry.width"]
    sensing = actuator["geometry.sensing_length"]
    scales = {
        "displacement": 3.0 * sensing**2 / height**2,
        "force": 3.0 * height * width * actuator["beam.modulus"] / (4.0 * sensing),
    }
    found: list[Series] = []
    labels: list[tuple[Record, str]] = []
    for record in records:
        wanted = [output for output in scales if output in record.readings]
        if not wanted:
            continue
        strip = actuator
        if record.series_resistance:
            contact = actuator["circuit.contact_resistance"] + record.series_resistance
            strip = actuator.replace(**{"circuit.contact_resistance": contact})
        node = simulate_outputs(
            strip,
            record.run.time,
            record.run.voltage,
            model_hold(record),
            outputs=["applied_voltage"],
            delay=delays.get(record.place, 0.0),
        )[0]
        durations, kind = np.unique(np.diff(record.run.time), return_inverse=True)
        given = Drive(durations, kind.astype(np.int64), node[:-1], node[1:], node)
        for output in wanted:
            reading = record.readings[output]
            scale = scales[output]
            found.append(
                Series(
                    given,
                    record.run.time - record.run.time[0],
                    reading.values / scale,
                    np.where(reading.exact, scale / max(reading.noise, 1e-300), 0.0),
                    record.start == "free",
                )
            )
            labels.append((record, output))
    return found, labels
