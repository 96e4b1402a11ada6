"""How well a fit separates its parameters, as the command line prints it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from ipmclab.cli.output import print_paragraph, significant

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit

_VISIBLE: Final = 0.1  # of the width of an interval


def collinearity(fit: Fit, name: str) -> str:
    """How many times larger the error of a parameter is because the others are free, as a table shows it."""
    index = fit.practical.collinearity.get(name, math.inf) if fit.practical is not None else math.inf
    return significant(index, 3) if math.isfinite(index) else "-"


def print_profiles(fit: Fit) -> None:
    """Say where profiles end elsewhere than the intervals of the table, and which to quote."""
    from ipmclab.refitting.profiles import WHY_NOT_PROFILE, flat_within

    known = fit.actuator.parameters()
    flat = [name for name in fit.profiles if flat_within(fit, name)]
    if flat:
        print_paragraph(
            f"Every value within the interval of {', '.join(flat)} explains these runs as well: it ends only where "
            "another parameter would have to become negative."
        )
    elsewhere = []
    for name in fit.profiles:
        base = known.get(name.partition("[")[0])
        text = _profile_ends(fit, name, base.quantity.to_display(1.0) if base is not None else 1.0)
        if text:
            elsewhere.append(f"{name} {text}{f' {base.quantity.display_unit}' if base is not None else ''}".rstrip())
    if elsewhere:
        print_paragraph(
            f"The profile of the likelihood ends elsewhere than the 95 % interval: {'; '.join(elsewhere)}. Quote the "
            f"interval: {WHY_NOT_PROFILE}."
        )


def _profile_ends(fit: Fit, name: str, factor: float) -> str:
    """What the profile says of a parameter, where that is not what its interval says."""
    one = fit.profiles[name]
    if all(one.is_open):
        return ""
    low, high = one.interval
    least, most = fit.parameters[name].interval
    below, above = one.is_open
    if (low, high) == (least, most):
        return ""
    same = (below or abs(low - least) <= _VISIBLE * (most - least)) and (
        above or abs(high - most) <= _VISIBLE * (most - least)
    )
    if same and math.isfinite(most - least):
        return ""
    ends = [significant(factor * number, 4) for number in (low, high)]
    return f"below {ends[1]}" if below else f"above {ends[0]}" if above else f"{ends[0]} to {ends[1]}"


def print_collinear(fit: Fit) -> None:
    """Print the smallest set of nearly collinear parameters, if there is one."""
    from ipmclab.fit.rows import listed
    from ipmclab.identification.undetermined.practical import COLLINEAR

    sets = fit.practical.sets if fit.practical is not None else ()
    worst = next((one for one in sets if one.index >= COLLINEAR), None)
    if worst is not None:
        together = listed(worst.names)
        if math.isfinite(worst.index):
            print_paragraph(f"{together} are nearly collinear (collinearity index {worst.index:.2g}).")
        else:
            print_paragraph(f"{together} are collinear: these runs show only a combination of them.")


def identifiability_document(fit: Fit) -> dict[str, Any]:
    """What is in a JSON document of it."""
    found: dict[str, Any] = {
        "profiles": {
            name: {
                "values": one.values,
                "excess": one.excess,
                "threshold": one.threshold,
                "interval": one.interval,
                "is_open": one.is_open,
            }
            for name, one in fit.profiles.items()
        }
    }
    if fit.practical is not None:
        found["collinearity"] = fit.practical.collinearity
        found["collinear_sets"] = [{"names": one.names, "index": one.index} for one in fit.practical.sets]
        found["combinations"] = [
            {"coefficients": one.coefficients, "error": one.error} for one in fit.practical.combinations
        ]
    return found
