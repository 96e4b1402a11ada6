"""A little of each stage that an actuator lacks: what it would change in the readings of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.identify.free_run import seen_from_sensor
from ipmclab.identify.observation import Record, model_hold
from ipmclab.model import Actuator
from ipmclab.model.sensitivity import simulate_outputs
from ipmclab.model.structure import Structure
from ipmclab.model.validity import ELECTROLYSIS
from ipmclab.model.variants import with_stages
from ipmclab.run import Run

FloatArray = npt.NDArray[np.float64]

_LITTLE: Final = 0.01
"""Size of a dose that is a part or a ratio: small, and far from the rounding of a simulation."""

_CURRENT: Final = 1e-3
"""Part of the largest current that a dose draws."""

_LAGS: Final = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Time constants that are tried, of the length of the longest record."""

_FEWEST_ROWS: Final = 3.0  # and the fastest, in rows

_SCALES: Final = (0.2, 1.0)
"""Voltage scales of an exponential leak that are tried [V]."""

_SIZES: Final = (".cubic", ".current_density", ".growth", ".ratio", ".amplitude", ".direct_share", ".permittivity")
"""Parameters that go with the size of a dose."""

_LINES: Final = {True: "line.segments", False: "line.modes"}


_PART_OF_LINE: Final = 0.3
"""Part of the electrodes' resistance that a dose of a line spreads."""


@dataclass(frozen=True)
class Dose:
    """A little of something that is not there.

    Parameters
    ----------
    name : str
        The stage as it is named after a plus.
    outputs : tuple of str
        Those whose readings would show it.
    parameters : int
        How many numbers it has.
    values : mapping of name to float [SI]
        The dose.
    both_ways : bool
        Whether less than none of it can be too.
    lag : float [s], optional
        Its time constant, where it is tried at several.
    """

    name: str
    outputs: tuple[str, ...]
    parameters: int
    values: Mapping[str, float] = field(default_factory=dict)
    both_ways: bool = False
    lag: float | None = None

    def sized(self, size: float) -> dict[str, float]:
        """The values of so many doses."""
        found = dict(self.values)
        for name in self.values:
            if name.endswith(_SIZES):
                found[name] *= size
            elif name.endswith(".resistivity"):
                found[name] /= size
        return found

    def given_to(self, actuator: Actuator) -> Actuator:
        """The actuator with the dose."""
        richer = with_stages(actuator, self.name)
        values = dict(self.values)
        if self.name.startswith("line."):
            # A part of the electrodes' resistance stands before a line of the rest.
            sheet = actuator["circuit.sheet_resistance"]
            before = actuator["circuit.contact_resistance"] + (1.0 - _PART_OF_LINE) * _lumped_sheet(actuator)
            values |= {"circuit.sheet_resistance": _PART_OF_LINE * sheet, "circuit.contact_resistance": before}
        return richer.replace(**values)


def _lumped_sheet(actuator: Actuator) -> float:
    """What the electrodes have in series [ohm]."""
    series = float(actuator.circuit.elements(actuator.parameter_values).series.real)
    return series - actuator["circuit.contact_resistance"]


def doses(actuator: Actuator, runs: Sequence[Run], outputs: Sequence[str]) -> list[Dose]:
    """Every stage that an actuator lacks and these runs could show.

    Parameters
    ----------
    actuator : Actuator
        With fitted values.
    runs : sequence of Run
    outputs : sequence of str
        That were fitted.
    """
    structure = actuator.structure
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    row = min(1.0 / run.rate for run in runs)
    lags = [part * longest for part in _LAGS if part * longest >= _FEWEST_ROWS * row]
    found: list[Dose] = []
    if "current" in outputs:
        found += _electrical(actuator, structure, runs, lags, tuple(outputs))
    for output, modes in (
        ("displacement", structure.displacement_modes + structure.displacement_pairs),
        ("force", structure.force_modes + structure.force_pairs),
    ):
        if output in outputs:
            found += _slow(output, modes, lags)
    if {"displacement", "force"} & set(outputs):
        found += _mechanical(structure, lags, outputs)
    return found


def _electrical(
    actuator: Actuator, structure: Structure, runs: Sequence[Run], lags: Sequence[float], shown: tuple[str, ...]
) -> Iterator[Dose]:
    """What changes the current changes the node voltage too, and so all outputs."""
    from ipmclab.model import geometry

    most = max(float(np.abs(run.voltage).max()) for run in runs)
    values = actuator.parameter_values
    area = float(np.real(geometry.area_per_thickness(values))) * values["geometry.thickness"]
    currents = [float(np.nanmax(np.abs(run.current))) for run in runs if run.current is not None]
    size = _CURRENT * max(currents, default=0.0) / area  # a current density
    if not structure.leak and structure.line != "modes":
        yield Dose("leak.cubic", shown, 1, {"leak.cubic.cubic": size / most**3})
        if most > ELECTROLYSIS:
            for scale in _SCALES:
                above = np.expm1((most - ELECTROLYSIS) / scale)
                yield Dose(
                    "leak.exponential",
                    shown,
                    3,
                    {
                        "leak.exponential.current_density": size / above,
                        "leak.exponential.threshold": ELECTROLYSIS,
                        "leak.exponential.voltage_scale": scale,
                    },
                )
    elif structure.leak and not structure.slow_leak:
        for lag in lags:
            values = {"leak.slow.growth": _LITTLE, "leak.slow.time_constant": lag}
            yield Dose("leak.slow", shown, 2, values, both_ways=True, lag=lag)
    if not structure.clamp and not structure.line and actuator["geometry.clamped_length"] > 0.0:
        yield Dose("clamp", shown, 1, {"clamp.direct_share": _LITTLE})
    if not structure.line and actuator["circuit.sheet_resistance"] > 0.0:
        yield Dose(_LINES[bool(structure.leak)], shown, 1)
    last = structure.branches
    resistivity = actuator["circuit.dc_resistivity"] / _CURRENT
    for lag in lags:
        values = {
            f"circuit.branches.{last}.resistivity": resistivity,
            f"circuit.branches.{last}.permittivity": lag / resistivity,  # their product is its time constant
        }
        yield Dose(f"branches={last + 1}", shown, 2, values, lag=lag)


def _slow(output: str, modes: int, lags: Sequence[float]) -> Iterator[Dose]:
    name = f"relaxation.{output}"
    for lag in lags:
        values = {f"{name}.{modes}.ratio": _LITTLE, f"{name}.{modes}.time_constant": lag}
        yield Dose(name if not modes else f"{name}={modes + 1}", (output,), 2, values, both_ways=True, lag=lag)


def _mechanical(structure: Structure, lags: Sequence[float], outputs: Sequence[str]) -> Iterator[Dose]:
    last = structure.viscoelastic
    if "force" in outputs:
        for lag in lags:
            name = f"viscoelastic.{last}"
            values = {
                f"{name}.amplitude": _LITTLE,
                f"{name}.damping_ratio": 2.0,
                f"{name}.frequency": 4.0 / lag,  # well damped: the slow one of its poles is about w/(2 zeta)
            }
            stage = "viscoelastic" if not last else f"viscoelastic={last + 1}"
            yield Dose(stage, ("force",), 3, values, lag=lag)
    if "displacement" in outputs and not structure.laser:
        yield Dose("laser", ("displacement",), 1)


def response(
    dose: Dose, actuator: Actuator, record: Record, delay: float, state: Mapping[str, float] | None
) -> dict[str, FloatArray] | None:
    """What a dose changes in the readings of those outputs that it has; None where it does not go with the actuator.

    Parameters
    ----------
    dose : Dose
    actuator : Actuator
        With the values of this run.
    record : Record
    delay : float [s]
    state : mapping of state name to float, optional
        At the first row.
    """
    run = record.run

    def values(model: Actuator) -> FloatArray:
        seen = seen_from_sensor(model, record.series_resistance)
        return simulate_outputs(
            seen, run.time, run.voltage, model_hold(record), outputs=shown, initial_state=state, delay=delay
        )

    shown = [output for output in dose.outputs if output in record.readings]
    try:
        changed = values(dose.given_to(actuator)) - values(actuator)
    except (IpmclabError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return dict(zip(shown, changed, strict=True)) if np.isfinite(changed).all() else None
