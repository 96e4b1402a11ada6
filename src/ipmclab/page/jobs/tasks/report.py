"""The report of a fit, or what a report would say first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Write the report of the fit in the file ``fit`` from the files ``runs`` and ``validation`` to ``out``.

    ``overwrite`` says whether a report of that name may be replaced.

    Raises
    ------
    InputError
        What ``report`` refuses.
    """
    from ipmclab.fit.fit_file import read_fit
    from ipmclab.page.jobs.tasks.given import read_runs
    from ipmclab.reporting import report

    progress("reading the runs")
    fit = read_fit(arguments["fit"])
    used, unseen = read_runs(arguments["runs"]), read_runs(arguments.get("validation") or [])
    progress("writing the report")
    report(
        fit,
        runs=used,
        validation_runs=unseen,
        path=arguments["out"],
        command=arguments.get("command", ""),
        overwrite=bool(arguments.get("overwrite")),
    )
    return Frame({"out": arguments["out"]}, {})
