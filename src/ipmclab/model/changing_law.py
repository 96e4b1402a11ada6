"""A strip that leaks while its environment changes, by modes: see ``numerics.drifting_law_loop``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System, assemble
from ipmclab.model.changing_general import Asked, go_through, way_along
from ipmclab.model.environment.charge import charged
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.panels import Panels
from ipmclab.model.environment.transport import WaterCourse
from ipmclab.model.environment.walk import Way
from ipmclab.model.numerics.drifting_law import law_numbers_at
from ipmclab.model.numerics.law_modal import JUMPS, behind, goes_by_modes, without_leak
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest
from ipmclab.model.stages.circuit import Circuit
from ipmclab.model.structure import Structure
from ipmclab.run import Hold

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

    driven = Driven(volts, way.begin, period, JUMPS[hold], strip.form, strip.coefficients, strip.area)
    fronts = np.empty((4, len(volts) if strip.moving else 0))
    walk, course = way.set_out()
    march = March(np.vstack([at_rest(), at_rest()]), np.zeros((2, NUMBERS)), walk)
    row, wanted = 0, math.log(way.at_begin.water_content)
    while row < len(volts):
        panel, knots = strip.panels.at(wanted)
        if knots is None:
            return None
        row = drifting_law(driven, way.track, panel, knots, row, march, course, values, fronts)
        wanted = walk[WANTED]
    if strip.moving:
        _move(actuator, strip.moving, period, fronts, way, values[2:])
    return way.given.course(course)


@dataclass(frozen=True, eq=False)
class _Strip:
    """What is worked out of a strip for one period; ``moving`` is its structure without the leak where that is rich."""

    panels: Panels[FloatArray | None]
    form: int
    coefficients: FloatArray
    area: float
    moving: Structure | None

    @classmethod
    def of(cls, actuator: Actuator, period: float, way: Way) -> _Strip | None:
        """None where modes cannot answer."""
        structure, stated = actuator.structure, actuator.parameter_values
        if not goes_by_modes(structure, period):
            return None
        linear, plain = without_leak(structure)
        panels = Panels(stated, way.cold, way.warm, _Making(plain, stated, period))
        ((_, _, area),), (law,) = structure.law_ports(stated), structure.laws(stated)
        k = np.array(law.coefficients, dtype=np.float64)
        return cls(panels, law.form, k, float(abs(area)), None if linear == plain else linear)


class _Making:
    """Makes the numbers of ``drifting_law_loop`` at the states of a panel; None where modes are not of one kind."""

    def __init__(self, plain: Structure, stated: Mapping[str, float], period: float) -> None:
        self._plain, self._stated, self._period = plain, stated, period
        self._turning: FloatArray | None = None

    def __call__(self, states: Sequence[Mapping[str, float]]) -> FloatArray | None:
        found = []
        for there in states:
            blocks = self._plain.blocks(there)
            scale = charged([name for block in blocks for name in block.states], there, self._stated)
            series = Circuit(self._plain.branches).elements(there).series.real
            numbers = law_numbers_at(blocks, scale, series, self._period)
            if numbers is None:
                return None
            found.append(numbers)
        knots = np.array(found)
        turning = knots[:, [9, 17]] != 0.0  # pairs of modes that are complex
        self._turning = turning[0] if self._turning is None else self._turning
        return knots if np.all(turning == self._turning) else None


def _move(
    actuator: Actuator, linear: Structure, period: float, fronts: FloatArray, way: Way, values: FloatArray
) -> None:
    """Displacement and force of a strip that moves less plainly."""

    def behind_electrodes(there: Mapping[str, float]) -> System:
        return assemble(
            linear.blocks(there), inputs=("voltage",), outputs=OUTPUT_PORTS[2:], at_rest=left_at_rest(["voltage"])
        )

    asked = Asked(np.array([period]), behind(fronts), fronts[3, 1:].copy())
    go_through(actuator, behind_electrodes, asked, np.zeros(len(actuator.state_names)), way, values)
