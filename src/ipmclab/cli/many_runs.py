"""What several runs and mountings say of each other, as ``identify`` prints it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ipmclab.cli.output import print_paragraph, print_table, read, significant
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit


def print_many_runs(fit: Fit) -> None:
    """Print how far mountings differ, the state of the strip in each run, and each run as the others predict it."""
    from ipmclab.fit.mountings import NEXT_STRIP
    from ipmclab.fit.state_rows import HEAD, state_rows
    from ipmclab.identification.mountings.mountings import why_unknown
    from ipmclab.prediction.remarks import left_out_remarks

    why = why_unknown(fit)
    if why:
        print_paragraph(f"{why[0].upper()}{why[1:]}; {NEXT_STRIP}.")
    if fit.mountings is not None and fit.mountings.between:
        rows = []
        for name, size in fit.mountings.between.items():
            known = fit.actuator.parameters()[name]
            is_log = name in fit.mountings.logarithms
            far = f"factor {significant(math.exp(size), 3)}" if is_log else read(size, known.quantity, digits=3)
            rows.append([name, far])
        print_table([f"between {len(fit.mountings.each)} mountings", "one standard deviation"], rows)
        for name, reason in fit.mountings.unknown.items():
            print_paragraph(f"The next mounting's {name} {reason}.")
    states = state_rows(fit)
    if states:
        print_table(list(HEAD), [row.cells for row in states])
    rows = []
    for one, remark in zip(fit.left_out, left_out_remarks(fit), strict=True):
        most = max(one.shifts, key=lambda name: abs(one.shifts[name]), default=None)
        change = "-" if most is None else f"{most}, {significant(one.shifts[most], 2)} of its errors"
        outputs = list(one.rmse) or ["-"]
        for output in outputs:
            percent, inside = one.fit_percent.get(output), one.inside.get(output)
            rows.append(
                [
                    one.label,
                    CHANNELS[output].name if output in CHANNELS else "-",
                    "-" if percent is None else f"{percent:.1f} %",
                    read(one.rmse[output], CHANNELS[output], digits=3) if output in one.rmse else "-",
                    "-" if inside is None else f"{100.0 * inside:.0f} %",
                    change if output == outputs[0] else "",
                    remark if output == outputs[0] else "",
                ]
            )
    if rows:
        print_table(["run left out", "output", "fit", "RMSE", "in 95 % band", "largest change without it", ""], rows)


def many_runs_document(fit: Fit) -> dict[str, Any]:
    """The same as it is written to a JSON document."""
    from ipmclab.identification.mountings.mountings import why_unknown
    from ipmclab.prediction.remarks import left_out_remarks

    remarks = left_out_remarks(fit)
    return {
        "mountings": None if fit.mountings is None else fit.mountings.to_table(),
        "next_mounting_unknown": why_unknown(fit) or None,
        "left_out": [{**one.to_table(), "remark": said} for one, said in zip(fit.left_out, remarks, strict=True)],
    }
