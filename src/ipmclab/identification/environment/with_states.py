"""Runs as a fit has them, each with the state in which its strip was."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.model import Actuator
from ipmclab.model.environment.age import Age
from ipmclab.run import Run
from ipmclab.strip_state.dose import added_by, doses_of
from ipmclab.strip_state.run_state import RunState
from ipmclab.strip_state.state_of_run import states_of


def with_states(
    actuator: Actuator, runs: Sequence[Run], records: Sequence[PreparedRun], ages: Iterable[str]
) -> list[PreparedRun]:
    """The runs with the state in which the strip was in each, where the actuator has laws or something ages.

    Raises
    ------
    InputError
        A run that does not say its temperature and humidity; a dose that the runs do not state.
    """
    follows = bool(actuator.structure.environment)
    scales = list(dict.fromkeys(Age.of(name).scale for name in ages))
    if not follows and not scales:
        return list(records)
    doses = {scale: doses_of(runs, scale) for scale in scales}
    labels = [record.label for record in records]
    states = states_of(actuator, runs, labels) if follows else [RunState()] * len(runs)
    return [
        replace(
            record,
            state=replace(
                state,
                doses={scale: doses[scale][place] for scale in scales},
                adds={scale: added_by(run, scale, place) for scale in scales},
            ),
        )
        for place, (state, record, run) in enumerate(zip(states, records, runs, strict=True))
    ]
