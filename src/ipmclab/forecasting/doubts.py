"""What speaks against a forecast: parameters that no run determined, old readings, a strip beyond its length."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.model import Actuator
from ipmclab.model.declared import stage_outputs
from ipmclab.model.left_open import entries_of, first_of, open_names
from ipmclab.model.stages.relaxation import mode_ratios
from ipmclab.prediction.open_coupling import NOT_IDENTIFIED, open_coupling
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

_OLD: Final = 0.1
"""Share of the horizon beyond which the last usable reading is called old (convention)."""
_FEW_ROWS: Final = 5  # rows that are never called old (convention)
_TOO_OLD: Final = 10.0
"""Seconds, or the horizon where that is longer, beyond which nothing is forecast any more (a limit)."""


def left_open(model: Actuator | Fit | None, channel: str) -> tuple[str, ...]:
    """The parameters of an actuator that its fit did not determine, of those that the channel depends on.

    Parameters
    ----------
    model : Actuator, Fit or None
        Of an actuator, what the ``[fit]`` table of its file says.
    channel : "displacement" or "force"
    """
    if model is None:
        return ()
    if isinstance(model, Fit):
        of_strip = model.actuator.parameter_values
        names = tuple(name for name, one in model.parameters.items() if not one.determined and name in of_strip)
    else:
        names = open_names(model)
    other = "force" if channel == "displacement" else "displacement"
    return tuple(name for name in names if stage_outputs(name) != (other,))


def circuit_alone(actuator: Actuator) -> list[Finding]:
    """A finding where the fit that an actuator carries asked for nothing that moves the strip."""
    names = [str(one["name"]) for one in entries_of(actuator.fit_table)]
    of_circuit = all(stage_outputs(name) == ("current",) for name in names if name in actuator.parameter_values)
    return [one for one in open_coupling(actuator) if one.code == NOT_IDENTIFIED] if names and of_circuit else []


def without_open_ratios(actuator: Actuator, channel: str, names: Sequence[str]) -> tuple[Actuator, tuple[str, ...]]:
    """The actuator with each ratio that no run determined at 0, and which those are: such a value is no prior."""
    ratios = mode_ratios(names, channel)
    return (actuator.replace(**dict.fromkeys(ratios, 0.0)) if ratios else actuator), ratios


def undetermined_finding(names: Sequence[str], ratios: Sequence[str]) -> Finding | None:
    """Which parameters of the fit are none, and what the forecast made of them."""
    if not names:
        return None
    as_they_are = [name for name in names if name not in ratios]
    lines = []
    if ratios:
        lines.append(f"{first_of(ratios)} counted as 0")
    if as_they_are:
        lines.append(
            f"{first_of(as_they_are)} stay as they are: the actuator counts by what it missed earlier in this record, "
            "but a change of voltage beyond the origin is answered with them"
        )
    return Finding(
        "model-undetermined",
        "warning",
        f"the runs of the fit did not determine {len(names)} of its parameters: {'; '.join(lines)}",
        "forecast with a fit of fewer parameters, and compare it with the forecast without an actuator: "
        "ipmclab forecast - RUN, in Python forecast(None, run)",
        values={"undetermined": len(names)},
    )


def age_finding(time: FloatArray, used: npt.NDArray[np.bool_], horizon: float, channel: str) -> Finding | None:
    """Whether the last usable reading before the origin, the end of ``time``, is old.

    Raises
    ------
    InputError
        It is older than the horizon and 10 s.
    """
    rows = np.flatnonzero(used)
    if not len(rows):
        return None  # refused elsewhere: there are too few readings
    last, origin = float(time[rows[-1]]), float(time[-1])
    age, period = origin - last, float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    text = f"the last usable {channel} before the origin {origin:.6g} s was read at {last:.6g} s, {age:.3g} s earlier"
    if age > max(horizon, _TOO_OLD):
        raise InputError(
            text,
            code="readings-too-old",
            where="origin",
            repair=f"give an origin up to {last + _OLD * horizon:.6g} s; ipmclab check says why no reading was used",
        )
    if age <= max(_OLD * horizon, _FEW_ROWS * period):
        return None
    return Finding(
        "readings-old",
        "warning",
        f"{text}: the forecast reaches {age + horizon:.3g} s beyond it",
        "give an earlier origin, or read the strip again",
        channel=channel,
        values={"age": age},
    )


def reach_finding(time: FloatArray, mean: FloatArray, free_length: float) -> Finding | None:
    """Whether a forecast displacement goes beyond the free length, where no strip can be."""
    beyond = np.flatnonzero(np.abs(mean) > free_length)
    if not len(beyond):
        return None
    furthest = int(np.argmax(np.abs(mean)))
    return Finding(
        "beyond-free-length",
        "warning",
        f"the forecast displacement passes the free length of {1e3 * free_length:.4g} mm from {time[beyond[0]]:.6g} s "
        f"on (at most {1e3 * abs(mean[furthest]):.4g} mm): no strip goes there",
        "correct the actuator or the voltage planned; a strip that bends far is modelled with the stage laser",
        channel="displacement",
        values={"largest": float(abs(mean[furthest]))},
    )


def not_shown_finding(channel: str) -> Finding:
    """That no reading shows how the strip answers an edge, which the plan has: how far that may be off is unknown."""
    return Finding(
        "plan-not-shown",
        "warning",
        f"no readings of the {channel} from before and after the first edge of the voltage show how the strip answers, "
        "and the plan moves the voltage: the band does not hold how far that answer may be off",
        "give a record that begins at 0 V and an origin after its first edge, or validate the actuator with another "
        "run of this strip",
        channel=channel,
    )


def table_without(table: Mapping[str, Any] | None, gone: Sequence[str]) -> dict[str, Any] | None:
    """A ``[fit]`` table without some parameters: what it says of the others, of its runs and findings, stays."""
    entries, rows = entries_of(table), (table or {}).get("correlations")
    if table is None or not isinstance(rows, Sequence):
        return None
    if [len(row) if isinstance(row, Sequence) else 0 for row in rows] != len(entries) * [len(entries)]:
        return None
    kept = [place for place, one in enumerate(entries) if one["name"] not in gone]
    correlations = [[rows[row][column] for column in kept] for row in kept]
    return {**table, "parameters": [entries[place] for place in kept], "correlations": correlations}


def free_length(actuator: Actuator | None, channel: str) -> float:
    """How far a displacement can go [m]; infinite where nothing bounds the channel."""
    return math.inf if actuator is None or channel != "displacement" else actuator["geometry.free_length"]
