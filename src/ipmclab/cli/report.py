"""``ipmclab report``: one HTML file of a fit."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ipmclab.cli.files import check_output, read_runs
from ipmclab.cli.options import Force, Json
from ipmclab.cli.output import print_json, progress


def report(
    fitted: Annotated[Path, typer.Argument(metavar="FITTED.toml", help="What identify wrote.", show_default=False)],
    runs: Annotated[list[Path], typer.Option(metavar="RUN...", help="The runs it was identified from.")],
    out: Annotated[Path, typer.Option(metavar="FILE.html", help="The report to write.")],
    validation: Annotated[
        list[Path] | None, typer.Option(metavar="RUN...", help="Runs to predict, not used by the fit.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write one self-contained HTML report of a fit.

    \b
    ipmclab report fitted.toml --runs step.nc sine.nc --validation square.nc --out report.html
    """
    from ipmclab import read_fit

    check_output(out, force=force, suffixes=(".html",), reads=[fitted, *runs, *(validation or [])])
    fit = read_fit(str(fitted))  # a text may also name an actuator of the library, which has no fit
    used, unseen = read_runs(runs), read_runs(validation or [])
    with progress("writing the report"):
        from ipmclab.reporting import report as write_report

        command = shlex.join(["ipmclab", "report", str(fitted), "--runs", *map(str, runs)])
        if validation:
            command += " " + shlex.join(["--validation", *map(str, validation)])
        write_report(fit, runs=used, validation_runs=unseen, path=out, command=command, overwrite=force)
    if as_json:
        print_json({"fitted": fitted, "runs": runs, "validation_runs": validation or [], "out": out})
    else:
        print(f"wrote {out}")
