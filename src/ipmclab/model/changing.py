"""What outputs read while the environment changes: parameters that drift, and a state that continues.

Parameters are constant in pieces, and renewed long before any has moved by 0.2 %: half of that would be visible in a
reading. What continues where they are renewed is the charge of each capacitor, not its voltage.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System
from ipmclab.model.changing_general import Asked, go_through, way_along
from ipmclab.model.changing_law import leaking
from ipmclab.model.environment.charge import charged
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import SWELLING
from ipmclab.model.environment.panels import values_at
from ipmclab.model.environment.path import path_of, pieces_along
from ipmclab.model.environment.transport import WaterCourse, curl_displacement, water_course
from ipmclab.model.numerics.course import voltage_course
from ipmclab.model.numerics.dense import parts
from ipmclab.model.numerics.timeline import divided, is_regular, side_by_side, timeline
from ipmclab.model.ports import INPUTS, OUTPUTS
from ipmclab.model.request import checked_force, checked_record, state_vector
from ipmclab.model.stages.laser import read_far
from ipmclab.model.stages.leak import Leak
from ipmclab.run import Hold

if TYPE_CHECKING:
    from ipmclab.model.numerics.drifting_modal_loop import Pieces

FloatArray = npt.NDArray[np.float64]


class Changing(NamedTuple):
    """What a changing environment does to the outputs.

    Parameters
    ----------
    values : float array, shape (n_outputs, n_time) [SI]
    water : WaterCourse
    """

    values: FloatArray
    water: WaterCourse


def changing_outputs(
    actuator: Actuator,
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    hold: Hold,
    history: EnvironmentHistory,
    *,
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    external_force: npt.ArrayLike | None = None,
    regular: bool = False,
) -> Changing:
    """What the outputs read at the rows of a record while the environment changes.

    What leaks splits water, which changes what leaks: both go along side by side (``environment.track_loop``).

    Parameters
    ----------
    actuator : Actuator
        With a table ``[hydration]``.
    history : EnvironmentHistory
        Its time 0 is that of the record.
    regular : bool
        Whether time and voltage are known to be right, and all rows one period apart; looked at otherwise.

    The other parameters are those of ``outputs.simulate_outputs``.
    """
    times, volts = (np.asarray(time), np.asarray(voltage)) if regular else checked_record(time, voltage)
    values = np.empty((len(OUTPUTS), len(times)))
    strip, water = actuator, None
    if initial_state is None and external_force is None:
        strip = _without_what_is_quiet(actuator, volts)
        if regular or is_regular(times):
            by_modes = leaking if strip.structure.leak else _in_pieces
            water = by_modes(strip, times, volts, hold, history, values)
    if water is None:
        force = None if external_force is None else checked_force(external_force, len(times))
        inputs = INPUTS[: 1 if force is None else 2]
        asked = _asked(strip.driven_by(inputs), times, volts, hold, force, from_rest=initial_state is None)

        def assembled(there: Mapping[str, float]) -> System:
            return strip.assembled(there, inputs=inputs)

        state = state_vector(strip.state_names, initial_state)
        water = go_through(strip, assembled, asked, state, way_along(strip, times, history), values)
    stated = actuator.parameter_values
    if stated[SWELLING]:
        values[OUTPUTS.index("displacement")] += curl_displacement(stated, water.gradients(times))
    read_far(values, OUTPUTS, stated)
    return Changing(values, water)


def _in_pieces(
    actuator: Actuator,
    times: FloatArray,
    volts: FloatArray,
    hold: Hold,
    history: EnvironmentHistory,
    values: FloatArray,
) -> WaterCourse | None:
    """Write the outputs of a linear strip by modes; None where another way must answer."""
    kept = _kept_pieces(actuator, times, hold, history)
    if kept is None:
        return None
    from ipmclab.model.numerics.drifting_modal_loop import drifting_modal

    pieces, water = kept
    drifting_modal(volts, pieces, values)
    return water


def _without_what_is_quiet(actuator: Actuator, volts: FloatArray) -> Actuator:
    """The strip, without a leak that gives nothing: what is behind the electrodes never exceeds the voltage."""
    structure = actuator.structure
    if not structure.leak:
        return actuator
    onset = Leak(structure.leak, slow=structure.slow_leak).onset(actuator.parameter_values)
    if np.abs(volts).max() >= onset:
        return actuator
    return actuator.keep("without leak", lambda: _without_leak(actuator))


def _without_leak(actuator: Actuator) -> Actuator:
    kept = {name: value for name, value in actuator.parameter_values.items() if not name.startswith("leak.")}
    return replace(actuator, parameter_values=kept, standard_uncertainties={}, fit_table=None)


def _kept_pieces(
    actuator: Actuator, times: FloatArray, hold: Hold, history: EnvironmentHistory
) -> tuple[Pieces, WaterCourse] | None:
    """The modes of a linear strip over a record, kept with the actuator; None where another way must answer."""
    begin, end = float(times[0]), float(times[-1])
    period = (end - begin) / (len(times) - 1)

    def made() -> tuple[Pieces, WaterCourse] | None:
        from ipmclab.model.numerics.drifting_modal import numbers_at, pieces_between

        zero = min(0.0, begin)
        water = water_course(actuator.parameter_values, history, end - zero, start=history.start, begin=zero)
        path = path_of(actuator.parameter_values, water, begin, end)
        grid = path.grid(actuator.parameter_values)
        there = values_at(actuator.parameter_values, grid)
        systems = [actuator.blocks(values) for values in there]
        states = [name for block in systems[0] for name in block.states]
        scales = np.array([charged(states, values, actuator.parameter_values) for values in there])
        numbers = numbers_at(systems, scales, period, hold)
        if numbers is None:
            return None
        _, first, weights = pieces_along(path, water, grid, times + 0.5 * period)
        pieces = pieces_between(numbers, weights, np.append(first, len(times)))
        return None if pieces is None else (pieces, water)

    return actuator.keep(("changing", begin, len(times), period, hold, history.key), made)


def _asked(
    system: System, times: FloatArray, volts: FloatArray, hold: Hold, force: FloatArray | None, *, from_rest: bool
) -> Asked:
    period = float(times[-1] - times[0]) / (len(times) - 1)
    if force is None and from_rest and is_regular(times) and parts(system, np.array([period]))[0] == 1:
        before, after = volts[:-1], volts[1:]
        start, end = (after if hold == "zero-before" else before), (before if hold == "zero" else after)
        kind, row = np.zeros(len(before), dtype=np.int64), np.arange(len(volts), dtype=np.int64)
        return Asked(np.array([period]), voltage_course(kind, start, end, row, volts))
    each = [volts] if force is None else [volts, force]
    lines = [timeline(times, one, hold, delay=0.0, from_rest=from_rest) for one in each]
    lines = [divided(line, parts(system, line.durations)) for line in lines]
    return Asked(lines[0].durations, side_by_side(lines))
