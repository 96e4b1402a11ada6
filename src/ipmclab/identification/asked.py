"""What is asked of a fit: its runs, their names, the channels that its free parameters need; what cannot be asked."""

from __future__ import annotations

from collections.abc import Sequence, Set
from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.record import READ_OUTPUTS, PreparedRun, label_of
from ipmclab.model import Actuator
from ipmclab.model.declared import outputs_of, stage_outputs
from ipmclab.model.stages.circuit import SERIES
from ipmclab.quality.noise import noise_level
from ipmclab.quality.record import NO_VOLTAGE
from ipmclab.run import Run

_ABOVE_NOISE: Final = 10.0  # times the noise: no white noise reaches it (convention)


def given_runs(runs: Sequence[Run] | Run) -> list[Run]:
    """The runs of a fit; ``InputError`` where there are none."""
    given = [runs] if isinstance(runs, Run) else list(runs)
    if not given:
        raise InputError("no runs were given", code="no-runs", where="runs", repair="give at least one run")
    return given


def given_labels(labels: str | Sequence[str] | None, runs: int) -> list[str] | None:
    """The short names of the runs; ``InputError`` where these are not as many."""
    if labels is None:
        return None
    given = [labels] if isinstance(labels, str) else list(labels)
    if len(given) != runs:
        raise InputError(
            f"{len(given)} label(s) for {runs} run(s)",
            code="bad-labels",
            where="labels",
            repair=f"give {runs}, one for each run in the order of the runs, or none",
        )
    return given


def refuse_counts(actuator: Actuator, names: FreeParameters) -> None:
    """Refuse a count among the free parameters."""
    for name, moved in names.moved.items():
        if actuator.structure.declarations[moved].transform == "count":
            raise InputError(
                f"{name!r} is a count, which a fit does not move",
                code="count-not-fitted",
                where="free",
                repair="compare actuators with different counts: ipmclab choose",
            )


def need_mountings(runs: Sequence[Run], names: FreeParameters) -> None:
    """Refuse a parameter of each mounting where a run does not say of which it is."""
    for place, run in enumerate(runs):
        if names.per_mounting and not run.metadata.mounting_id:
            raise InputError(
                f"each mounting is to have its own {names.per_mounting[0]}, and this run does not say of which it is",
                code="no-mounting",
                where=label_of(run, place),
                repair="give the run a mounting_id, or name the parameter in per_run",
            )


def outputs_of_fit(names: FreeParameters) -> tuple[str, ...]:
    """The channels that the free parameters need.

    Force and displacement also depend on the circuit, through the drop over its series resistance; but
    while the coupling is fixed, perhaps at values of another strip, they would spoil what the current knows
    better. They are asked where current alone is known not to be enough.
    """
    asked, all_of_them = _beside_series(names), bool(set(SERIES) & set(names.moved.values()))
    return tuple(output for output in READ_OUTPUTS if all_of_them or output in asked)


def for_series_alone(names: FreeParameters) -> set[str]:
    """Channels of motion that are read only because a series resistance is free."""
    return {"displacement", "force"} - _beside_series(names)


def _beside_series(names: FreeParameters) -> set[str]:
    """Channels that are needed whether a series resistance is free or not."""
    others = [stage_outputs(name) for name in names.moved.values() if name not in SERIES]
    return {output for outputs in others for output in outputs} | {name.split(".")[2] for name in names.observation}


def need_readings(
    names: FreeParameters, given: Sequence[Run], records: Sequence[PreparedRun], silent: Sequence[Set[str]]
) -> None:
    """Refuse a free parameter that no run can show."""
    for name, moved in names.moved.items():
        channels = outputs_of(moved)
        shows = [
            any(record.readings[one].exact.any() for one in record.readings.keys() & channels) for record in records
        ]
        wanting = [record for record, is_shown in zip(records, shows, strict=True) if not is_shown]
        if name in names.per_mounting:
            shown = {record.run.metadata.mounting_id for record in records if record not in wanting}
            wanting = [record for record in wanting if record.run.metadata.mounting_id not in shown]
        own = name in (*names.per_run, *names.per_mounting)
        if channels and ((own and wanting) or (not own and len(wanting) == len(records))):
            noisy = sorted({output for record in wanting for output in silent[record.place] & set(channels)})
            because = f": the {' and '.join(noisy)} held nothing but noise" if noisy else ""
            raise InputError(
                f"{name} is free, and there is no usable {' or '.join(channels)}{because}",
                code="no-readings",
                where=wanting[0].label if own or len(records) == 1 else "runs",
                repair="add runs that have it, or fix the parameter",
            )
    # More than no voltage: above 10 mV, or above its noise.
    limits = [min(NO_VOLTAGE, _ABOVE_NOISE * noise_level(record.run.voltage)) for record in records]
    excited = any(np.abs(one.run.voltage).max() > limit for one, limit in zip(records, limits, strict=True))
    for run, record in zip(given, records, strict=True):
        if run.voltage.any() and not record.run.voltage.any():
            raise InputError(
                "no current flows after the voltage has stepped, to the end of the run: the strip had no contact",
                code="no-contact",
                where=record.label,
                repair="clean or tighten the clamp and record the run again, or leave it out",
            )
        if not record.run.voltage.any() or not excited:
            raise InputError(
                f"the voltage is {_how_little(record)}: nothing answers to it",
                code="no-excitation",
                where=record.label,
                repair="leave the run out, or give the voltage that was applied",
            )
        if not any(reading.exact.any() for reading in record.readings.values()):
            noisy = sorted(silent[record.place])
            because = f": its {' and '.join(noisy)} held nothing but noise" if noisy else ""
            raise InputError(
                f"this run has no usable reading of what the free parameters need{because}",
                code="no-readings",
                where=record.label,
                repair="see what check says of it, and leave the run out",
            )


def _how_little(record: PreparedRun) -> str:
    largest = float(np.abs(record.run.voltage).max())
    return f"never more than {1e3 * largest:.2g} mV from 0 V, as its noise is" if largest else "zero throughout"
