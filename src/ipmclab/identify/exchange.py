"""The series resistance against the branches, where readings tell them apart too weakly to be of use.

Current alone shows one number less than there are: every series resistance below the largest possible one has branches
to go with it. A force that follows the voltage behind the electrodes ends that, unless the coupling is free too and a
slow mode imitates what the electrodes do. The series resistance may then look known to a tenth, which is worth nothing:
the first branch takes up thirty times as much. What determines both is a measurement of the series resistance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ipmclab.identify.cures import SERIES, measured
from ipmclab.identify.fit import Direction

FloatArray = npt.NDArray[np.float64]


def series_against_branches(
    names: Sequence[str], covariance: FloatArray, limit: float, outputs: Sequence[str]
) -> tuple[Direction, FloatArray] | None:
    """Name the series resistance where knowing it would determine a branch that is not determined.

    Parameters
    ----------
    names : sequence of str
    covariance : float array, shape (n, n)
        Of the relative changes.
    limit : float
        The standard error up to which a parameter counts as determined.
    outputs : sequence of str
        What was read.

    Returns
    -------
    direction, covariance : Direction, float array
        How the others move with the series resistance, and their covariance once that is known; None where it is not
        the reason.
    """
    held = next((place for place, name in enumerate(names) if name in SERIES), None)
    if held is None or not covariance[held, held] > 0.0:
        return None
    variance = covariance.diagonal()
    column = covariance[:, held]
    own = float(column[held])
    known = covariance - np.outer(column, column) / own
    branches = np.array([name.startswith("circuit.") for name in names])
    open_ones = np.flatnonzero((np.sqrt(np.maximum(variance, 0.0)) > limit) & branches)
    cured = [int(k) for k in open_ones if k == held or known[k, k] <= limit**2]
    if not cured:
        return None
    # Measured to s, a parameter keeps C_kk - C_ks^2/(C_ss + s^2).
    left = [k for k in cured if k != held]
    squares = [column[k] ** 2 / (variance[k] - limit**2) - own for k in left]
    need = math.sqrt(max(min(squares), 0.0)) if squares else limit
    row = column / np.linalg.norm(column)
    row *= np.sign(row[np.abs(row).argmax()])
    of_branches = ", ".join(f"{names[k]} to a factor of {math.exp(math.sqrt(variance[k])):.3g}" for k in left)
    beside = f" and with it {of_branches} only" if left else " only"
    free = any(name.startswith("coupling.") for name in names)
    read = " and ".join(outputs)
    why = f"{read}, with the coupling free too, hardly tell" if free else f"{read} hardly tells"
    no_cure = "; more force or displacement does not help while the coupling is free" if free else ""
    sentence = (
        f"{names[held]} is practically not determined: it is known to {_percent(math.sqrt(own))}{beside}, because "
        f"{why} the series resistance from the branches; {measured(names[held])} to {_percent(need)} or better{no_cure}"
    )
    found = Direction(
        dict(zip(names, map(float, row), strict=True)),
        sentence,
        float(np.linalg.norm(column)) / math.sqrt(own),
        (f"measure {names[held].split('[')[0]}",),
    )
    return found, known


def _percent(part: float) -> str:
    return f"{100.0 * part:.2g} %"
