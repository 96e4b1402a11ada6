"""What an actuator answers, in all its views, for one position of the sliders."""

from __future__ import annotations

import contextlib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ipmclab.page.jobs.frames import Frame
from ipmclab.page.lab import files_of
from ipmclab.page.replay import ASSUMED_HOLD
from ipmclab.page.wire import FloatArray

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.page.jobs.tasks import Progress
    from ipmclab.run import Run

MOST_ROWS: Final = 20_000
"""Of an interactive simulation: more is what ``ipmclab simulate`` is for."""

_MOST_SENT: Final = 4000
"""Rows that are sent as they are."""

_FREQUENCIES: Final = 161
_PLACES: Final = 24
_PICTURES: Final = 120
_OUTPUTS: Final = ("current", "applied_voltage", "displacement", "force")


def run(arguments: dict[str, Any], progress: Progress) -> Frame:  # noqa: ARG001  # it is over before anyone could cancel
    """Simulate a signal, or the voltage of a run; frequency response and shape in addition.

    ``actuator`` (name or file), ``changes`` (name to SI value), then ``signal`` with ``duration`` [s],
    ``rate`` [Hz], ``hold`` and the ``folder`` of files that it names, or ``run`` (file). Arrays are in SI units.

    Raises
    ------
    InputError
        What ``simulate`` refuses, or more rows than an interactive answer can have.
    """
    run_, measured, changed, assumed_hold = answered(arguments)
    document: dict[str, Any] = {
        "actuator": changed.name,
        "rows": len(run_),
        "findings": [one.message for one in run_.metadata.findings],
        "values": changed.parameter_values,
        "stamps": stamps(arguments),
    }
    arrays = {"time": run_.time, "voltage": run_.voltage}
    arrays |= {name: run_.channels[name] for name in _OUTPUTS if name in run_.channels}
    if measured is not None:
        arrays |= {f"measured.{name}": measured.channels[name] for name in _OUTPUTS if name in measured.channels}
    if assumed_hold is not None:
        document["assumed_hold"] = assumed_hold
    arrays = thinned_where_long(arrays)
    arrays |= _frequency_arrays(changed)
    shape_arrays, document["shape"] = _shape_arrays(changed, run_)
    return Frame(document, {**arrays, **shape_arrays})


def answered(arguments: dict[str, Any]) -> tuple[Run, Run | None, Actuator, str | None]:
    """The answer, the run that it is laid over, the actuator with its changes, and a hold that had to be assumed.

    Raises
    ------
    InputError
        What ``simulate`` refuses, or more rows than an interactive answer can have.
    """
    from ipmclab.errors import InputError
    from ipmclab.model.simulate import simulate
    from ipmclab.signals.text import parse

    actuator = _actuator(arguments["actuator"], stamp(arguments["actuator"]))
    changes = arguments.get("changes") or {}
    changed = actuator.replace(**changes) if changes else actuator
    if arguments.get("run"):
        measured, assumed_hold = _measured(arguments["run"], stamp(arguments["run"])), None
        if measured.hold == "unknown":
            from dataclasses import replace

            measured, assumed_hold = replace(measured, hold=ASSUMED_HOLD), ASSUMED_HOLD
        return simulate(changed, measured), measured, changed, assumed_hold
    duration, rate = float(arguments.get("duration", 40.0)), float(arguments.get("rate", 50.0))
    if duration * rate > MOST_ROWS:
        raise InputError(
            f"{duration * rate:.0f} rows, at most {MOST_ROWS} follow a slider",
            code="too-many-rows",
            where="rate",
            repair="give a shorter duration or a lower rate, or use ipmclab simulate",
        )
    signal = parse(arguments["signal"], folder=arguments.get("folder", ""))
    run_ = simulate(changed, signal, duration=duration, rate=rate, hold=arguments.get("hold", "zero"))
    return run_, None, changed, None


def thinned_where_long(arrays: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Each curve at times of its own, without losing a peak: a slider must not wait for a long record to be sent."""
    from ipmclab.page.thin import thin

    if len(arrays["time"]) <= _MOST_SENT:
        return arrays
    found: dict[str, FloatArray] = {}
    for name, values in arrays.items():
        if name != "time":
            found[f"{name}.time"], found[name] = thin(arrays["time"], values)
    return found


def _frequency_arrays(actuator: Actuator) -> dict[str, FloatArray]:
    """Gain [SI unit per V] and phase [deg] of each output."""
    frequencies = np.geomspace(1e-3, 100.0, _FREQUENCIES)
    response = actuator.frequency_response(frequencies)
    arrays: dict[str, FloatArray] = {"frequency": frequencies}
    for name, values in zip(_OUTPUTS, response, strict=True):
        arrays[f"gain.{name}"] = np.abs(values)
        arrays[f"phase.{name}"] = np.degrees(np.unwrap(np.angle(values)))
    return arrays


def _shape_arrays(actuator: Actuator, run_: Run) -> tuple[dict[str, FloatArray], dict[str, Any]]:
    """Where each place of the strip is at some times, for an animation."""
    from ipmclab.model.curvature import curvature
    from ipmclab.model.shape import shape
    from ipmclab.model.stages.circuit import Circuit

    length = actuator["geometry.free_length"]
    rows = np.unique(np.linspace(0, len(run_) - 1, min(_PICTURES, len(run_))).astype(int))
    lumped = isinstance(actuator.structure.electrical, Circuit)
    places = np.array([0.5]) if lumped else (np.arange(_PLACES) + 0.5) / _PLACES
    bent = np.broadcast_to(curvature(actuator, run_, places * length)[:, rows], (_PLACES, len(rows)))
    shapes = [shape(bent[:, place], length) for place in range(len(rows))]
    about = {
        "places": _PLACES + 1,
        "pictures": len(rows),
        "length": length,
        "laser": actuator["geometry.sensing_length"],
    }
    return {
        "shape.time": run_.time[rows],
        "shape.x": np.concatenate([one.x for one in shapes]),
        "shape.y": np.concatenate([one.y for one in shapes]),
    }, about


def stamps(arguments: dict[str, Any]) -> list[str]:
    """What changes when the file of the actuator does, and when those of the voltage do: their answers are others."""
    folder = Path(arguments.get("folder", ""))
    files = [arguments["run"]] if arguments.get("run") else [folder / one for one in files_of(arguments["signal"])]
    return [stamp(arguments["actuator"]), " ".join(map(stamp, files))]


def stamp(path: str | Path) -> str:
    """What changes when a file does, also with stages behind a plus; 0 for a name of the library."""
    for name in (str(path), str(path).partition("+")[0]):
        with contextlib.suppress(OSError, ValueError):
            return str(Path(name).stat().st_mtime_ns)
    return "0"


@lru_cache(maxsize=16)
def _actuator(name: str, stamp: str) -> Actuator:  # noqa: ARG001
    from ipmclab import load_actuator

    return load_actuator(name)


@lru_cache(maxsize=4)
def _measured(path: str, stamp: str) -> Run:  # noqa: ARG001
    from ipmclab.page.jobs.tasks.given import read_runs

    return read_runs([path])[0]
