"""Motion that is read for a series resistance alone, of a strip whose coupling the file does not have."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ipmclab.identification.problem.edge_delay import starts_of
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.search.doubts import HALF, is_noise
from ipmclab.identification.search.starts.start import allowed, starting_points
from ipmclab.identification.search.starts.start_coupling import motion_series
from ipmclab.identification.search.starts.start_in_state import in_one_state, moved_back, there_alone
from ipmclab.model import Actuator
from ipmclab.model.stages.circuit import SERIES
from ipmclab.run import Finding
from ipmclab.statespace.columns import constants
from ipmclab.strip_state.in_state import strip_in_state


def motion_of_another_coupling(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun], outputs: Collection[str]
) -> list[Finding]:
    """A finding for each output of motion of which the coupling of the file explains nothing, a current beside it.

    Where the coupling is not free and belongs to another strip, what the motion says of a series resistance is wrong.
    The currents alone, their series resistance that of the file, say what drives the motion: a fit that read the motion
    too would be pulled by a drift of its sensor. A straight line is that sensor's, and none of what could be explained.
    A run in another state is asked in its own. A motion of which the coupling leaves no more than its noise contradicts
    nothing.

    Parameters
    ----------
    actuator : Actuator
    names : FreeParameters
    records : sequence of PreparedRun
    outputs : collection of str
        Those that are read for a series resistance alone.
    """
    asked = sorted({output for record in records for output in record.readings} & set(outputs))
    shown = [record.without(outputs) for record in records if "current" in record.readings]
    if not asked or not shown:
        return []
    strip, delays = _of_currents(actuator, names.of(set(names.actuator) - set(SERIES)), shown, records)
    explained = set()
    for record in records:
        there = strip if record.state is None else strip_in_state(strip, record.state, {})
        for left in motion_series(there, [record], delays, known_part=there):
            reading = record.readings[left.output]
            if not reading.exact.any():  # all of it beyond the range of its instrument
                explained.add(left.output)
                continue
            columns = constants(left.run.time[reading.exact])
            values, residual = (
                one[reading.exact] - columns @ np.linalg.lstsq(columns, one[reading.exact], rcond=None)[0]
                for one in (reading.values, left.scale * left.run.readings)
            )
            size, varies = (float(np.linalg.norm(one)) / np.sqrt(len(one)) for one in (residual, values))
            if size <= HALF * varies or is_noise(size, reading):
                explained.add(left.output)
    return [
        Finding(
            "coupling-not-identified",
            "warning",
            f"the coupling in the file explains nothing of the {output}, which was left out of the fit",
            "free the coupling too: --free electrical,circuit.sheet_resistance,coupling",
            channel=output,
        )
        for output in asked
        if output not in explained
    ]


def _of_currents(
    actuator: Actuator, names: FreeParameters, shown: Sequence[PreparedRun], records: Sequence[PreparedRun]
) -> tuple[Actuator, Mapping[int, float]]:
    """The strip that the currents alone show, as it is in the reference state of its laws, and their delays."""
    alike = in_one_state(shown)
    strip, fewer = (actuator, names) if alike is None else there_alone(actuator, names, alike)
    point = next(starting_points(strip, fewer, alike or shown), None) if fewer.actuator else None
    if point is None:
        return actuator, {}
    if alike is not None:
        point = moved_back(actuator, names, point, alike, records)
    return actuator.replace(**allowed(actuator, point.values)), starts_of(point.delays)
