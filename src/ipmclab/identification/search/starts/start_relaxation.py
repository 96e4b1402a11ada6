"""The slow modes of displacement and force found beside a d(s) that is known."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.search.starts.slow_modes import slow_modes, slow_poles, slow_values
from ipmclab.identification.search.starts.start_coupling import motion_series, of_output, sensors
from ipmclab.identification.search.varpro import search_poles
from ipmclab.model import Actuator

_IS_SLOW: Final = re.compile(r"relaxation\..*\.(ratio|lead)$")


def relaxation_start(
    actuator: Actuator, records: Sequence[PreparedRun], delays: Mapping[int, float], outputs: Sequence[str]
) -> dict[str, float]:
    """The slow modes of these outputs, for the circuit and the coupling of an actuator.

    What the fast part of the drive leaves of a reading is a sum of responses to the node voltage, whose poles
    variable projection finds.

    Parameters
    ----------
    actuator : Actuator
        With the circuit, the coupling and the beam near their final values; its slow modes are not used.
    records : sequence of PreparedRun
    delays : mapping of place to float [s]
    outputs : sequence of str
        ``displacement``, ``force``, or both.
    """
    values: dict[str, float] = {}
    off = {name: 0.0 for name in actuator.parameter_values if _IS_SLOW.match(name)}
    static = actuator["coupling.gain"] * actuator["coupling.zero"] / actuator["coupling.p2"]
    motion = motion_series(actuator, records, delays, known_part=actuator.replace(**off))
    for output in outputs:
        of, slow = of_output(motion, output), slow_poles(actuator, output)
        if not of or not slow:
            continue
        found = search_poles([one.run for one in of], slow, sensors(of))
        values |= slow_values(actuator, output, slow_modes(found.poles, found.residues, static))
    return values
