"""One or several models compared with runs that they may not have been fitted to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame
from ipmclab.page.wire import FloatArray

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Hold ``models`` (names or files) with ``names`` against the files ``runs``.

    Arrays are ``MODEL.RUN.OUTPUT.measured``, ``.model``, ``.residual`` and ``.time``, by places.
    """
    from ipmclab import load_actuator
    from ipmclab.page.jobs.tasks.given import comparison_arrays, finding_row, read_runs, rows_of
    from ipmclab.prediction.validate import validate
    from ipmclab.reporting.tables import score_rows

    progress("reading the runs")
    runs = read_runs(arguments["runs"])
    names: list[str] = arguments["names"]
    validations = []
    for place, model in enumerate(arguments["models"]):
        progress(f"predicting with {names[place]}", place / len(names))
        validations.append(validate(load_actuator(model), runs))
    arrays: dict[str, FloatArray] = {}
    for place, validation in enumerate(validations):
        for at, one in enumerate(validation.runs):
            for output, comparison in one.comparisons.items():
                arrays |= comparison_arrays(f"{place}.{at}.{output}", comparison)
    document = {
        "scores": rows_of(score_rows(validations, names)),
        "runs": [one.label for one in validations[0].runs],
        "used": [[one.used_in_fit for one in validation.runs] for validation in validations],
        "findings": [
            {**finding_row(one), "model": name}
            for name, validation in zip(names, validations, strict=True)
            for one in validation.findings
        ],
    }
    return Frame(document, arrays)
