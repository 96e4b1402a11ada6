"""``ipmclab plot``: a figure of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ipmclab.cli.files import actuator_files, check_output, named_by_file, read_runs
from ipmclab.cli.options import Force, Json, RunFiles
from ipmclab.cli.output import print_json, progress
from ipmclab.errors import InputError

SUFFIXES = (".svg", ".png", ".pdf")


def plot(
    runs: RunFiles,
    out: Annotated[Path, typer.Option(metavar="FILE.svg|.png|.pdf", help="The figure to write.")],
    characteristic: Annotated[
        bool, typer.Option("--characteristic", help="Current over voltage, instead of channels over time.")
    ] = False,
    before: Annotated[
        str | None, typer.Option(metavar="ACTUATOR", help="A model before its estimation, next to the one of --after.")
    ] = None,
    after: Annotated[
        str | None, typer.Option(metavar="ACTUATOR", help="The model after its estimation, also alone.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Plot runs over time, one panel for each channel.

    \b
    ipmclab plot step.nc sine.nc --out runs.svg
    ipmclab plot sine.nc --characteristic --out v_i.svg
    ipmclab plot step.nc --after fitted.toml --out fit.svg
    ipmclab plot step.nc sine.nc --before friend-2 --after fitted.toml --out estimation.svg
    """
    if characteristic and (before or after):
        raise InputError(
            "--characteristic is a figure without a model",
            code="usage",
            where="plot",
            repair="leave --before and --after out, or --characteristic",
        )
    if before is not None and after is None:
        raise InputError(
            "a model before its estimation was given, and none after it",
            code="usage",
            where="--before",
            repair=f"add --after ACTUATOR, or draw it alone: --after {before}",
        )
    check_output(out, force=force, suffixes=SUFFIXES, reads=[*runs, *actuator_files(before, after)])
    loaded = read_runs(runs)
    with progress("drawing"):
        from ipmclab import reporting

        if after is not None:
            first = None if before is None else named_by_file(before)
            figure = reporting.before_and_after(loaded, first, named_by_file(after))
            reporting.save_figure(figure, out, overwrite=force)
        elif characteristic:
            reporting.save_figure(reporting.characteristic(loaded), out, overwrite=force)
        else:
            reporting.plot(loaded, out, overwrite=force)
    if as_json:
        print_json({"runs": runs, "out": out})
    else:
        print(f"wrote {out}")
