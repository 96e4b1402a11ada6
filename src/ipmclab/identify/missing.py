"""Which stage would explain what a fit leaves: asked of the residuals, with the stage switched off but ready."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.identify.covariance import is_coloured
from ipmclab.identify.free_run import seen_from_sensor
from ipmclab.identify.observation import Record, model_hold
from ipmclab.identify.problem import Problem
from ipmclab.identify.solve import Solution
from ipmclab.model import Actuator
from ipmclab.model.sensitivity import sensitivities
from ipmclab.model.variants import with_stages
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

_SHARE: Final = 0.2  # of the power of the residuals beyond noise that a stage has to explain
_CLEAR: Final = 30.0  # of chi-square, which noise does not reach
_WATER: Final = 1.23  # V
_LAGS: Final = (0.003, 0.01, 0.03, 0.1, 0.3)  # of the length of a record: beside a slow pole a fast one may be missing


@dataclass(frozen=True)
class _Stage:
    """A stage that is not there: its name, the output that it would change, its size and what it would explain."""

    name: str
    output: str
    size: str
    seen: str
    group: str


_STAGES: Final = (
    _Stage(
        "leak.exponential", "current", "leak.exponential.current_density", "a current that grows beyond 1.23 V", "leak"
    ),
    _Stage("clamp", "current", "clamp.direct_share", "an early current that the electrodes do not hold back", "clamp"),
    _Stage(
        "relaxation.displacement",
        "displacement",
        "relaxation.displacement.0.ratio",
        "a displacement that relaxes back",
        "relaxation",
    ),
    _Stage("relaxation.force", "force", "relaxation.force.0.ratio", "a force that relaxes back", "relaxation"),
)


def missing_stages(actuator: Actuator, problem: Problem, solution: Solution) -> list[Finding]:
    """A finding for each stage that would take away a fifth or more of what the model leaves of an output beyond noise.

    The derivative of the readings by the size of a stage that is switched off says what a little of it would change.
    What the free parameters imitate of that does not count, nor what only less than none of it would explain.

    Parameters
    ----------
    actuator : Actuator
    problem : Problem
        With the noise found in the residuals.
    solution : Solution
    """
    structure = actuator.structure
    there = {
        "leak.exponential": bool(structure.leak) or structure.line == "modes",
        "clamp": structure.clamp or bool(structure.line) or not actuator["geometry.clamped_length"],
        "relaxation.displacement": bool(structure.displacement_modes or structure.displacement_pairs),
        "relaxation.force": bool(structure.force_modes or structure.force_pairs),
    }
    findings = []
    basis: FloatArray | None = None
    for stage in _STAGES:
        pieces = {key: piece for key, piece in problem.pieces.items() if key[1] == stage.output}
        residual = -solution.evaluation.residual
        coloured = any(is_coloured(residual[piece]) for piece in pieces.values())
        if there[stage.name] or not coloured or not _asks(stage, problem):
            continue
        if basis is None:
            basis = np.linalg.qr(solution.evaluation.jacobian)[0]
        explained = _explained(actuator, stage, problem, solution, basis)
        if explained < _SHARE:
            continue
        findings.append(
            Finding(
                "stage-missing",
                "warning",
                f"the residuals show {stage.seen}: a stage {stage.name} would take away {100.0 * explained:.0f} % of "
                f"the power that the model leaves of the {stage.output} beyond noise",
                f"identify {actuator.name}+{stage.name} with {stage.group} free, and compare both by choose",
                channel=stage.output,
                values={"explained": explained},
            )
        )
    return findings


def _asks(stage: _Stage, problem: Problem) -> bool:
    """Whether these runs could show a stage at all."""
    if stage.name != "leak.exponential":
        return True
    return any(float(np.abs(record.run.voltage).max()) > _WATER for record in problem.records)


def _explained(actuator: Actuator, stage: _Stage, problem: Problem, solution: Solution, basis: FloatArray) -> float:
    """The part of an output's residual power beyond noise that the best shape of a stage would explain."""
    residual = -solution.evaluation.residual
    chosen = np.zeros(len(residual), dtype=bool)
    for (_, output), piece in problem.pieces.items():
        chosen[piece] |= output == stage.output
    power = float(residual[chosen] @ residual[chosen])
    noise = sum(
        (piece.stop - piece.start) * min(_noise(problem, key) / problem.noise[key], 1.0) ** 2
        for key, piece in problem.pieces.items()
        if key[1] == stage.output
    )
    systematic = max(power - noise, 0.01 * power)
    best = 0.0
    for shape in _shapes(stage, problem.records):
        column = np.zeros(len(residual))
        try:
            for record in problem.records:
                if stage.output in record.readings:
                    _fill(column, actuator, stage, shape, record, problem, solution)
        except (IpmclabError, ArithmeticError):
            continue  # the stage does not go with this actuator
        free = column - basis @ (basis.T @ column)
        size = float(np.linalg.norm(free))
        if size <= 1e-6 * float(np.linalg.norm(column)) or size == 0.0:
            continue
        gain = float(free @ residual) / size
        # Less than none of a stage is no stage, but a strip may also creep on.
        if gain > 0.0 or stage.group == "relaxation":
            best = max(best, gain * gain / systematic if gain * gain > _CLEAR else 0.0)
    return min(best, 1.0)


def _noise(problem: Problem, key: tuple[int, str]) -> float:
    """How much neighbouring readings scatter [SI]."""
    return next(record.readings[key[1]].noise for record in problem.records if record.place == key[0])


def _shapes(stage: _Stage, records: Sequence[Record]) -> list[dict[str, float]]:
    if stage.name == "leak.exponential":
        name = "leak.exponential"
        return [{f"{name}.threshold": _WATER, f"{name}.voltage_scale": scale} for scale in (0.2, 1.0)]
    if stage.group == "relaxation":
        longest = max(float(record.run.time[-1] - record.run.time[0]) for record in records)
        return [{stage.size.replace("ratio", "time_constant"): part * longest} for part in _LAGS]
    return [{}]


def _fill(
    column: FloatArray,
    actuator: Actuator,
    stage: _Stage,
    shape: dict[str, float],
    record: Record,
    problem: Problem,
    solution: Solution,
) -> None:
    values = problem.values(solution.theta, record.place)
    richer = with_stages(actuator.replace(**values), stage.name).replace(**shape, **{stage.size: 0.0})
    state = None
    if record.start == "free":
        state = problem.responder.initial_state(record, values, problem.start(solution.theta, record.place))
    found = sensitivities(
        seen_from_sensor(richer, record.series_resistance),
        [stage.size],
        record.run.time,
        record.run.voltage,
        model_hold(record),
        outputs=[stage.output],
        initial_state=state,
        delay=problem.delay(solution.theta, record),
    )
    key = record.place, stage.output
    reading = record.readings[stage.output]
    column[problem.pieces[key]] = found.parameters[0, :, 0][reading.used] / problem.noise[key]
