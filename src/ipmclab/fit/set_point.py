"""What a fitted relaxation means for holding a set point: r against 1, with its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.fit import Fit
from ipmclab.model.set_point import DRIVES, Drive, ratio_names, set_point
from ipmclab.named_matrix import matrix_of
from ipmclab.run import Finding


def set_point_findings(fit: Fit) -> list[Finding]:
    """One ``set-point`` finding for each drive of which a slow mode was fitted.

    Parameters
    ----------
    fit : Fit
        With its fitted actuator.
    """
    found = []
    for drive in DRIVES:
        names = ratio_names(fit.actuator, drive)
        if set(names) & set(fit.parameters):
            found.append(_finding(fit, drive, names))
    return found


def _finding(fit: Fit, drive: Drive, names: Sequence[str]) -> Finding:
    point = set_point(fit.actuator, drive)
    low, high = _interval(fit, names, point.ratio)
    numbers: dict[str, float | int | str | None] = {"ratio": point.ratio, "kind": point.kind}
    numbers |= {"low": low if math.isfinite(low) else None, "high": high if math.isfinite(high) else None}
    if not (high <= 1.0 or low >= 1.0):  # a bound that is no number bounds nothing
        known = f"{low:.5g} to {high:.5g}" if math.isfinite(low) or math.isfinite(high) else "any number"
        return Finding(
            "set-point",
            "warning",
            f"these runs do not show whether a set point of the {drive} can be held: the 95 % interval of r is "
            f"{known}, 1 in it; the fit took r = {point.ratio:.4g}",
            "record a step for several times the slowest time constant, and a second polarity against drift",
            channel=drive,
            values=numbers,
        )
    text = f"{point.sentence}; 95 % interval of r {low:.5g} to {high:.5g}"
    return Finding(
        "set-point",
        "info" if point.can_be_held else "warning",
        text,
        "" if point.can_be_held else f"do not hold a set point of the {drive} by integral action on this strip",
        channel=drive,
        values=numbers,
    )


def _interval(fit: Fit, names: Sequence[str], ratio: float) -> tuple[float, float]:
    """Of the sum of the ratios, 95 %: that of the parameter itself where one alone is free."""
    free = [name for name in names if name in fit.parameters]
    if len(free) == 1:
        fixed = ratio - fit.parameters[free[0]].value
        low, high = fit.parameters[free[0]].interval
        return low + fixed, high + fixed
    errors = np.array([fit.parameters[name].standard_error for name in free])
    variance = float(errors @ matrix_of(fit.correlations, free) @ errors) if np.all(np.isfinite(errors)) else math.inf
    reach = NORMAL_95 * math.sqrt(max(variance, 0.0)) if math.isfinite(variance) else math.inf
    return ratio - reach, ratio + reach
