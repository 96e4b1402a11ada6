"""How well a fit tells its parameters apart, as the command line prints it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ipmclab.cli.output import print_paragraph, print_table, significant

if TYPE_CHECKING:
    from ipmclab.identify import Fit


def print_identifiability(fit: Fit) -> None:
    """Print the profile's interval and the collinearity of each parameter, and the sets that nearly change places."""
    if fit.practical is None:
        return
    from ipmclab.identify.practical import COLLINEAR

    known = fit.actuator.parameters()
    rows = []
    for name, one in fit.profiles.items():
        base = known.get(name.partition("[")[0])
        factor = base.quantity.to_display(1.0) if base is not None else 1.0
        low, high = (significant(factor * number, 5) for number in one.interval)
        below, above = one.is_open
        said = (
            "open" if below and above else f"below {high}" if below else f"above {low}" if above else f"{low} to {high}"
        )
        unit = base.quantity.display_unit if base is not None else fit.parameters[name].unit
        index = fit.practical.collinearity.get(name, math.inf)
        rows.append([name, said, unit, significant(index, 3) if math.isfinite(index) else "infinite"])
    if rows:
        print_table(["profile of the likelihood", "95 % interval", "unit", "collinearity"], rows)
    worst = next((one for one in fit.practical.sets if one.index >= COLLINEAR), None)
    if worst is not None:
        *most, last = worst.names
        size = f"to one part in {worst.index:.2g}" if math.isfinite(worst.index) else "altogether"
        print_paragraph(f"{', '.join(most)} and {last} can change places {size}.")


def identifiability_document(fit: Fit) -> dict[str, Any]:
    """What stands in a JSON document of it."""
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
