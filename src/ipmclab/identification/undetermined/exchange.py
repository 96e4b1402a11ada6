"""The series resistance against the branches, where readings distinguish them too weakly to be of use.

Current alone shows one number less than there are: every series resistance below the largest possible one has branches
to go with it. A force that follows the voltage behind the electrodes ends that, unless the coupling is free too and a
slow mode imitates what the electrodes do. The series resistance may then look known to a tenth, which is worth nothing:
the first branch takes up thirty times as much. What determines both is a measurement of the series resistance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.fit import Direction
from ipmclab.identification.undetermined.cures import measured
from ipmclab.model.declared import MOTION, in_group, is_of_circuit
from ipmclab.model.stages.circuit import SERIES
from ipmclab.model.stages.coupling import ZERO
from ipmclab.run import FloatArray
from ipmclab.ties import upright

HARDLY: Final = 7.0  # of a logarithm, a factor of a thousand


def series_against_branches(
    names: Sequence[str], covariance: FloatArray, to_rivals: FloatArray, limit: float, outputs: Sequence[str]
) -> tuple[Direction, FloatArray] | None:
    """Name the series resistance where knowing it would determine a branch that is not determined.

    Parameters
    ----------
    names : sequence of str
    covariance : float array, shape (n, n)
        Of the relative changes.
    to_rivals : float array, shape (n,)
        Relative distance of each parameter to the farthest fit that is as good.
    limit : float
        The standard error up to which a parameter counts as determined.
    outputs : sequence of str
        What was read.

    Returns
    -------
    direction, covariance : Direction, float array
        How the others move with the series resistance, and the covariance once that is known; None where it is not the
        reason.
    """
    held = next((place for place, name in enumerate(names) if name in SERIES), None)
    if held is None or not covariance[held, held] > 0.0:
        return None
    known = given(covariance, held)
    # Another fit as good lies at the end of an interval.
    errors = np.maximum(np.sqrt(np.maximum(covariance.diagonal(), 0.0)), to_rivals / NORMAL_95)
    open_ones = [k for k, name in enumerate(names) if is_of_circuit(name) and errors[k] > limit]
    cured = [k for k in open_ones if k != held and known[k, k] <= limit**2]
    if not cured:
        return None
    column = covariance[:, held]
    # Known to s, the series resistance leaves its slope times s of what moves with it.
    need = min(limit * float(column[held]) / abs(float(column[k])) for k in cured)
    followed = ", ".join(f"{names[k]} to a factor of {_factor(errors[k])}" for k in cured)
    free = bool(in_group(MOTION, names))
    read, tell = " and ".join(outputs), "tell" if len(outputs) > 1 else "tells"
    why = f"{read}, with the coupling free too, hardly tell" if free else f"{read} hardly {tell}"
    no_cure = "; more force or displacement does not help while the coupling is free" if free else ""
    base = names[held].split("[")[0]
    enough = f" to {_percent(need)} or better" if need < errors[held] else ""
    cure = f"{measured(base)}{enough}{no_cure}"
    size = _percent(errors[held]) if errors[held] < 1.0 else f"a factor of {_factor(errors[held])}"
    sentence = (
        f"{names[held]} is practically not determined: it is known to {size}, and with it {followed} only, because "
        f"{why} the series resistance from the branches; {cure}"
    )
    # Where gain and zero only show as their product, how they share it is another question.
    zero = names.index(ZERO) if ZERO in names else None
    row = (covariance if zero is None else given(covariance, zero))[:, held]
    error = float(np.linalg.norm(row) / math.sqrt(max(float(row[held]), 1e-300)))
    row = upright(row / max(float(np.linalg.norm(row)), 1e-300))
    cures = (f"measure {base}",)
    return Direction(dict(zip(names, map(float, row), strict=True)), sentence, error, cures), known


def given(covariance: FloatArray, held: int) -> FloatArray:
    """The covariance of all once one is known."""
    column = covariance[:, held]
    return np.asarray(covariance - np.outer(column, column) / max(float(column[held]), 1e-300))


def _percent(part: float) -> str:
    return f"{100.0 * part:.2g} %"


def _factor(error: float) -> str:
    return f"{math.exp(error):.3g}" if error < HARDLY else "over a thousand"
