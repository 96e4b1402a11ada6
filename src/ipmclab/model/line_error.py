"""How far a line by modes can be off."""

from __future__ import annotations

from typing import NamedTuple

from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds
from ipmclab.model.actuator import Actuator
from ipmclab.model.stages import line_modes


class ErrorBound(NamedTuple):
    """How far a line by modes can be off at any time, for each volt of the largest voltage that was applied.

    ``current`` [A/V] and ``node_voltage`` [V/V], the mean that moves the sensing point.
    """

    current: float
    node_voltage: float


@tell_kinds
def line_error_bound(actuator: Actuator) -> ErrorBound:
    """How far an actuator's line by modes can be off, because modes were left out, at any time and for any voltage.

    Derived in ``line_modes.error_bound``. A line by segments has no such bound: its error is that of a ladder, and
    falls with the square of the number of segments.

    Parameters
    ----------
    actuator : Actuator

    Raises
    ------
    InputError
        The actuator's electrodes are no line by modes.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> bound = line_error_bound(load_actuator("friend-2+line.modes=12"))
    >>> bound.current < 1e-5 and bound.node_voltage < 2e-5
    True
    """
    structure, values = actuator.structure, actuator.parameter_values
    if structure.line != "modes":
        raise InputError(
            f"the electrodes of {actuator.name!r} are no line by modes",
            code="no-modes",
            where="line.modes",
            repair="add the stage, such as friend-2+line.modes=12",
        )
    return ErrorBound(*line_modes.error_bound(values, structure.branches, round(values["line.modes"])))
