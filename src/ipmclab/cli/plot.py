"""``ipmclab plot``: a figure of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ipmclab.cli.files import check_output, read_runs
from ipmclab.cli.options import Force, Json, RunFiles
from ipmclab.cli.output import print_json, progress

SUFFIXES = (".svg", ".png", ".pdf")


def plot(
    runs: RunFiles,
    out: Annotated[Path, typer.Option(metavar="FILE.svg|.png|.pdf", help="The figure to write.")],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Plot runs over time, one panel a channel.

    \b
    ipmclab plot step.nc sine.nc --out runs.svg
    """
    check_output(out, force=force, suffixes=SUFFIXES, reads=runs)
    loaded = read_runs(runs)
    with progress("drawing"):
        from ipmclab.reporting import plot as plot_runs

        plot_runs(loaded, out, overwrite=force)
    if as_json:
        print_json({"runs": runs, "out": out})
    else:
        print(f"wrote {out}")
