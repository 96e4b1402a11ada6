"""A little of each stage that an actuator lacks: what it would change in the readings of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ipmclab.errors import IpmclabError
from ipmclab.identification.problem.free_run import seen_from_sensor
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun, model_hold
from ipmclab.model import Actuator
from ipmclab.model.excitation import excitation
from ipmclab.model.kinds import kinds
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.stages.kind import Trial
from ipmclab.model.variants import with_stages
from ipmclab.run import FloatArray, Run


def score_directions(actuator: Actuator, runs: Sequence[Run], outputs: Sequence[str]) -> list[Trial]:
    """Every stage that an actuator lacks and these runs could show, each with the outputs that would show it.

    Parameters
    ----------
    actuator : Actuator
        With fitted values.
    runs : sequence of Run
    outputs : sequence of str
        That were fitted.
    """
    asked = excitation(actuator, runs, outputs)
    found = []
    for kind in kinds():
        if kind.electrical and "current" not in outputs:
            continue
        for trial in kind.trials(actuator.parameter_values, asked):
            # What changes the current changes the node voltage too, and so all outputs.
            shown = trial.outputs or (asked.outputs if kind.electrical else kind.outputs)
            if set(shown) & set(outputs):
                found.append(replace(trial, outputs=shown))
    return found


def one_step_along(direction: Trial, actuator: Actuator) -> Actuator:
    """An actuator with a little of a stage that it lacks."""
    changes = direction.changes(actuator.parameter_values) if direction.changes is not None else {}
    return with_stages(actuator, direction.stage).replace(**direction.values, **changes)


def _response(
    direction: Trial, actuator: Actuator, record: PreparedRun, delay: float, state: Mapping[str, float] | None
) -> dict[str, FloatArray] | None:
    """What a direction changes in the readings of the outputs that it has; None where it does not go with an actuator.

    Parameters
    ----------
    direction : Trial
    actuator : Actuator
        With the values of this run.
    record : PreparedRun
    delay : float [s]
    state : mapping of state name to float, optional
        At the first row.
    """
    run = record.run

    def values(model: Actuator) -> FloatArray:
        as_read = seen_from_sensor(model, record.series_resistance)
        return simulate_outputs(
            as_read, run.time, run.voltage, model_hold(record), outputs=shown, initial_state=state, delay=delay
        )

    shown = [output for output in direction.outputs if output in record.readings]
    try:
        changed = values(one_step_along(direction, actuator)) - values(actuator)
    except (IpmclabError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return dict(zip(shown, changed, strict=True)) if np.isfinite(changed).all() else None


def along_directions(
    problem: Problem, theta: FloatArray, actuator: Actuator, directions: Sequence[Trial], output: str
) -> tuple[list[Trial], FloatArray]:
    """Those that go with an actuator, and what each changes in one output; shape (n_directions, n_residual)."""
    kept, rows = [], []
    for direction in directions:
        row = np.zeros(problem.beforehand.stop)
        for record in problem.records:
            if output not in record.readings:
                continue
            values = problem.values(theta, record.place)
            state = None
            if record.start == "free":
                state = problem.responder.initial_state(record, values, problem.start(theta, record.place))
            found = _response(direction, actuator.replace(**values), record, problem.delay(theta, record), state)
            if found is None:
                break
            key = record.place, output
            row[problem.pieces[key]] = found[output][record.readings[output].used] / problem.noise[key]
        else:
            kept.append(direction)
            rows.append(row)
    return kept, np.array(rows).reshape(len(rows), problem.beforehand.stop)
