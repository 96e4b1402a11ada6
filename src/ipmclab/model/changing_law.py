"""A strip that leaks while its environment changes, by modes: see ``numerics.drifting_law_loop``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System, assemble
from ipmclab.model.changing_general import Assembled, Making, way_along
from ipmclab.model.environment.charge import charged
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.panels import Panels
from ipmclab.model.environment.transport import WaterCourse
from ipmclab.model.environment.walk import Way
from ipmclab.model.numerics.drifting_law import law_numbers_at
from ipmclab.model.numerics.law_modal import JUMPS, goes_by_modes, without_leak
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest
from ipmclab.model.stages.circuit import Circuit
from ipmclab.model.structure import Structure
from ipmclab.run import Hold

if TYPE_CHECKING:
    from ipmclab.model.numerics.drifting_law_loop import Knots

FloatArray = npt.NDArray[np.float64]


def leaking(
    actuator: Actuator,
    times: FloatArray,
    volts: FloatArray,
    hold: Hold,
    history: EnvironmentHistory,
    values: FloatArray,
) -> WaterCourse | None:
    """Write the outputs of a strip that is at rest at first; None where another way must answer."""
    period, way = float(times[-1] - times[0]) / (len(times) - 1), way_along(actuator, times, history)
    strip = actuator.keep(("leaking", period, way.cold, way.warm), lambda: _Strip.of(actuator, period, way))
    if strip is None:
        return None
    from ipmclab.model.environment.track_loop import WANTED
    from ipmclab.model.numerics.drifting_law_loop import NUMBERS, Driven, March, drifting_law
    from ipmclab.model.numerics.law_modal_loop import at_rest

    panel, knots = strip.panels.at(math.log(way.at_begin.water_content))
    if knots is None:
        return None
    driven = Driven(volts, way.begin, period, JUMPS[hold], strip.form, strip.coefficients, strip.area)
    walk, course = way.set_out()
    charges = np.zeros(knots.charges)
    fronts = np.empty((3, len(volts) if len(charges) else 0))
    march = March(at_rest(), np.zeros((2, NUMBERS)), walk, charges)
    row = drifting_law(driven, way.track, panel, knots, 0, march, course, values, fronts)
    while row < len(volts):
        panel, knots = strip.panels.at(walk[WANTED])
        if knots is None:
            return None
        row = drifting_law(driven, way.track, panel, knots, row, march, course, values, fronts)
    return way.given.course(course)


@dataclass(frozen=True, eq=False)
class _Strip:
    """What is worked out of a strip for one period."""

    panels: Panels[Knots | None]
    form: int
    coefficients: FloatArray
    area: float

    @classmethod
    def of(cls, actuator: Actuator, period: float, way: Way) -> _Strip | None:
        """None where modes cannot answer."""
        structure, stated = actuator.structure, actuator.parameter_values
        if not goes_by_modes(structure, period):
            return None
        panels = Panels(stated, way.cold, way.warm, _Making(structure, stated, period))
        ((_, _, area),), (law,) = structure.law_ports(stated), structure.laws(stated)
        k = np.array(law.coefficients, dtype=np.float64)
        return cls(panels, law.form, k, float(abs(area)))


class _Making:
    """Makes the numbers of ``drifting_law_loop`` at the states of a panel; None where modes are not of one kind."""

    def __init__(self, structure: Structure, stated: Mapping[str, float], period: float) -> None:
        linear, self._plain = without_leak(structure)
        self._stated, self._period = stated, period
        self._motion = None if linear == self._plain else Making(_motion(linear), stated, np.array([period]))
        self._turning: FloatArray | None = None

    def __call__(self, states: Sequence[Mapping[str, float]]) -> Knots | None:
        from ipmclab.model.numerics.drifting_law_loop import Knots

        found = []
        for there in states:
            blocks = self._plain.blocks(there)
            scale = charged([name for block in blocks for name in block.states], there, self._stated)
            series = Circuit(self._plain.branches).elements(there).series.real
            numbers = law_numbers_at(blocks, scale, series, self._period)
            if numbers is None:
                return None
            found.append(numbers)
        modes = np.array(found)
        turning = modes[:, [9, 17]] != 0.0  # pairs of modes that are complex
        self._turning = turning[0] if self._turning is None else self._turning
        if not np.all(turning == self._turning):
            return None
        if self._motion is None:
            return Knots(modes, np.empty((len(modes), 0)), np.empty((len(modes), 0)))
        _, _, motion = self._motion(states)
        return Knots(modes, motion.moves[0], motion.reads)


def _motion(linear: Structure) -> Assembled:
    """Displacement and force by the voltage at the front of the electrodes."""

    def behind_electrodes(there: Mapping[str, float]) -> System:
        return assemble(
            linear.blocks(there), inputs=("voltage",), outputs=OUTPUT_PORTS[2:], at_rest=left_at_rest(["voltage"])
        )

    return behind_electrodes
