"""Motion that is read for a series resistance alone, of a strip whose coupling the file does not have."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ipmclab.identification.problem.edge_delay import starts_of
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.search.doubts import HALF, is_noise
from ipmclab.identification.search.starts.start import allowed, starting_points
from ipmclab.identification.search.starts.start_coupling import motion_series
from ipmclab.identification.search.starts.start_in_state import in_one_state, there_alone
from ipmclab.model import Actuator
from ipmclab.model.stages.circuit import SERIES
from ipmclab.run import Finding
from ipmclab.statespace.columns import constants


def motion_of_another_coupling(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun], outputs: Collection[str]
) -> list[Finding]:
    """A finding for each output of motion of which the coupling of the file explains nothing, a current beside it.

    Where the coupling is not free and belongs to another strip, what the motion says of a series resistance is wrong.
    The currents alone, their series resistance that of the file, say what drives the motion: a fit that read the motion
    too would be pulled by a drift of its sensor. A straight line is that sensor's, and none of what could be explained.
    A motion of which the coupling leaves no more than its noise contradicts nothing.

    Parameters
    ----------
    actuator : Actuator
    names : FreeParameters
    records : sequence of PreparedRun
    outputs : collection of str
        Those that are read for a series resistance alone.
    """
    alike = in_one_state(records)
    if alike is not None:
        (actuator, names), records = there_alone(actuator, names, alike), alike
    asked = sorted({output for record in records for output in record.readings} & set(outputs))
    shown = [record.without(outputs) for record in records if "current" in record.readings]
    if not asked or not shown:
        return []
    fewer = names.of(set(names.actuator) - set(SERIES))
    point = next(starting_points(actuator, fewer, shown), None) if fewer.actuator else None
    strip = actuator if point is None else actuator.replace(**allowed(actuator, point.values))
    delays = {} if point is None else starts_of(point.delays)
    explained = set()
    every = motion_series(actuator, records, delays), motion_series(actuator, records, delays, known_part=strip)
    for read, left in zip(*every, strict=True):
        used = read.run.weight > 0.0
        columns = constants(read.run.time[used])
        values, residual = (
            one[used] - columns @ np.linalg.lstsq(columns, one[used], rcond=None)[0]
            for one in (read.run.readings, left.run.readings)
        )
        size, varies = (
            read.scale * float(np.linalg.norm(one)) / np.sqrt(max(len(one), 1)) for one in (residual, values)
        )
        if size <= HALF * varies or is_noise(size, read.record.readings[read.output]):
            explained.add(read.output)
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
