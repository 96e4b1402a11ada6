"""A fit, with everything that is shown of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame
from ipmclab.page.wire import FloatArray

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit
    from ipmclab.page.jobs.tasks import Progress
    from ipmclab.run import Run


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Identify ``actuator`` from the files ``runs`` (``labels``), as the command does; the fit is written to ``out``.

    ``free``, ``per_run``, ``per_mounting`` and ``prior`` are lists of names; ``named`` is the actuator as messages name
    it.

    Raises
    ------
    InputError
        What ``identify`` refuses.
    """
    from ipmclab import load_actuator
    from ipmclab.fit.first_answer import first_rows
    from ipmclab.fit.fit_file import write_fit
    from ipmclab.page.jobs.tasks.given import read_runs, rows_of
    from ipmclab.progress import first_answer_to
    from ipmclab.workflows.fitting import fit_of_runs

    progress("reading the runs", 0.0)
    given = arguments["actuator"]
    actuator = replace(load_actuator(given), loaded_as=arguments.get("named", given))
    runs = read_runs(arguments["runs"])
    with first_answer_to(lambda found: progress("the first answer", first=rows_of(first_rows(found)))):
        fit = fit_of_runs(
            actuator,
            runs,
            free=arguments["free"],
            per_run=arguments.get("per_run") or (),
            per_mounting=arguments.get("per_mounting") or (),
            prior=arguments.get("prior") or (),
            labels=arguments["labels"],
            progress=progress,
        )
    write_fit(fit, arguments["out"], overwrite=True)
    return fit_frame(fit, runs)


def fit_frame(fit: Fit, runs: list[Run]) -> Frame:
    """A fit as the page shows it; arrays ``RUN.OUTPUT.measured``, ``.model``, ``.residual`` and ``.time``."""
    from ipmclab.fit.answer import known_title
    from ipmclab.fit.output_diagnosis import WORDS
    from ipmclab.fit.verdict import verdict
    from ipmclab.identification.mountings.mountings import why_unknown
    from ipmclab.page.jobs.tasks.given import comparison_arrays, finding_row, rows_of
    from ipmclab.prediction.fitted import fitted_outputs
    from ipmclab.prediction.remarks import averages
    from ipmclab.reporting.many_runs import left_out_rows
    from ipmclab.reporting.profiles import profiles_csv, profiles_part
    from ipmclab.reporting.svg import standalone_svg
    from ipmclab.reporting.tables import fit_rows, known_rows, parameter_rows
    from ipmclab.units import CHANNELS

    fitted = [fitted_outputs(fit, one, place) for place, one in enumerate(runs)]
    arrays: dict[str, FloatArray] = {}
    for place, comparisons in enumerate(fitted):
        for output, comparison in comparisons.items():
            arrays |= comparison_arrays(f"{place}.{output}", comparison)
    left = {
        (one.label, CHANNELS[one.output].name): WORDS[one.verdict] for one in fit.diagnoses if one.output in CHANNELS
    }
    profiles = profiles_part(fit)
    if profiles is not None:
        profiles["files"] = {"svg": standalone_svg(profiles["svg"]), "csv": profiles_csv(fit)}
    document = {
        "converged": fit.converged,
        "message": fit.message,
        "verdict": verdict(fit),
        "rank": fit.rank,
        "free": len(fit.parameters),
        "parameters": rows_of(parameter_rows(fit)),
        "known": rows_of(known_rows(fit)),
        "known_title": known_title(fit),
        "averaged": sorted(averages(fit)),
        "next_mounting_unknown": why_unknown(fit),
        "undetermined": [one.sentence for one in fit.undetermined],
        "outputs": [
            {**row, "left": left.get((row["run"], row["output"]), "")} for row in rows_of(fit_rows(fit, fitted))
        ],
        "profiles": profiles,
        "left_out": rows_of(left_out_rows(fit)),
        "runs": [{"label": one.label} for one in fit.observations],
        "findings": [finding_row(one) for one in fit.findings if one.code != "undetermined"],
    }
    return Frame(document, arrays)
