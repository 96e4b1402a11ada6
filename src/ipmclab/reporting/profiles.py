"""What a report says of how well the runs separate the parameters."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, Any

from ipmclab.fit.rows import listed
from ipmclab.identification.undetermined.practical import COLLINEAR
from ipmclab.refitting.profiles import WHY_NOT_PROFILE, flat_within
from ipmclab.reporting.figures.profiles import profiles_figure
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.wording import NO_BREAK

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit


def profiles_part(fit: Fit) -> dict[str, Any] | None:
    """The figure of all profiles, and a sentence on nearly collinear parameters; None without profiles."""
    if not fit.profiles:
        return None
    count = len(fit.profiles)
    names = f"{count} parameters" if count > 1 else "one parameter"
    return {
        "svg": inline_svg(profiles_figure(fit), "profiles", f"Excess of chi-square over the values of {names}"),
        "caption": "Each parameter is held at other values while all others are fitted again. Where chi-square "
        f"exceeds its least by the dashed level the 95{NO_BREAK}% interval ends; a curve that stays below leaves its "
        "side open.",
        "sentence": " ".join(filter(None, (_flat(fit), _elsewhere(fit), _collinear(fit)))),
    }


def profiles_csv(fit: Fit) -> str:
    """The points of all profiles as a table."""
    made = io.StringIO()
    writer = csv.writer(made, lineterminator="\n")
    writer.writerow(["parameter", "value [SI]", "excess of chi-square"])
    for name, one in fit.profiles.items():
        writer.writerows((name, value, excess) for value, excess in zip(one.values, one.excess, strict=True))
    return made.getvalue()


def _flat(fit: Fit) -> str:
    flat = [name for name in fit.profiles if flat_within(fit, name)]
    if not flat:
        return ""
    return (
        f"Every value within the interval of {', '.join(flat)} explains these runs as well: it ends only where another "
        "parameter would have to become negative."
    )


def _elsewhere(fit: Fit) -> str:
    if all(fit.parameters[name].interval == one.interval for name, one in fit.profiles.items()):
        return ""
    return f"Where a curve ends elsewhere than its 95{NO_BREAK}% interval, quote the interval: {WHY_NOT_PROFILE}."


def _collinear(fit: Fit) -> str:
    worst = next((one for one in fit.practical.sets if one.index >= COLLINEAR), None) if fit.practical else None
    if worst is None:
        return ""
    together = listed(worst.names)
    if math.isinf(worst.index):
        return f"{together} are collinear: these runs show only a combination of them."
    return (
        f"{together} are nearly collinear: the others make up for a change of one to one part in "
        f"{worst.index:.2g} (collinearity index)."
    )
