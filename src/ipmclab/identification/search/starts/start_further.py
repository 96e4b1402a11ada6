"""Where a further stage or the modulus starts: from its own function, or else from the trials that it declares."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from ipmclab.identification.problem.record import READ_OUTPUTS, PreparedRun, as_read
from ipmclab.model import Actuator
from ipmclab.model.excitation import excitation
from ipmclab.model.kinds import kind_of
from ipmclab.model.stages.beam import VISCOELASTIC
from ipmclab.model.stages.kind import StageKind

Start = Callable[[Actuator, Sequence[PreparedRun], Mapping[int, float]], list[dict[str, float]]]
"""A function of an actuator with everything else near its final values, of records and of their delays [s] by place:
values of the stage's parameters, the most likely first."""

_CLEARLY: Final = 30.0  # trials: so much of a stage that its shape shows

_starts: Final[dict[str, Start]] = {}


def register_start(stage: str, start: Start) -> None:
    """Say how the parameters of a registered stage are found from data, where its trials are no good start.

    Parameters
    ----------
    stage : str
        Its name.
    start : Start
    """
    _starts[stage] = start


def without_further(actuator: Actuator, free: set[str]) -> dict[str, float]:
    """What switches off the stages of which something is free: the rest is looked for as if they were not there."""
    kinds = _free_kinds(actuator, free)
    return {name: 0.0 for name in free for kind in kinds if kind_of(name) is kind and kind.ending(name) in kind.off}


def further_starts(
    actuator: Actuator, free: set[str], records: Sequence[PreparedRun], delays: Mapping[int, float]
) -> list[dict[str, float]]:
    """Values of the free parameters of further stages and of the modulus; one empty mapping where there are none.

    Parameters
    ----------
    actuator : Actuator
        With everything else near its final values.
    free : set of str
    records : sequence of PreparedRun
    delays : mapping of place to float [s]
    """
    starts: list[dict[str, float]] = [{}]
    for kind in _free_kinds(actuator, free):
        own = _starts.get(kind.name)
        found = own(actuator, records, delays) if own is not None else _from_trials(actuator, kind, records)
        starts = [{**start, **{n: v for n, v in more.items() if n in free}} for start in starts for more in found]
    return starts


def _free_kinds(actuator: Actuator, free: set[str]) -> list[StageKind]:
    declared = [VISCOELASTIC, *(kind for kind, _ in actuator.structure.further)]
    return [kind for kind in declared if any(kind_of(name) is kind for name in free)]


def _from_trials(actuator: Actuator, kind: StageKind, records: Sequence[PreparedRun]) -> list[dict[str, float]]:
    """A clear amount of the stage, at each of the shapes that it has itself tried where it is missing."""
    read = [output for output in READ_OUTPUTS if any(output in record.readings for record in records)]
    asked = excitation(actuator, [as_read(record) for record in records], read)
    rest = {name: value for name, value in actuator.parameter_values.items() if kind_of(name) is not kind}
    usual = {
        name: declared.usual
        for name, declared in actuator.structure.declarations.items()
        if kind_of(name) is kind and declared.usual is not None
    }
    return [{**usual, **trial.sized(kind, _CLEARLY)} for trial in kind.trials(rest, asked)] or [usual]
