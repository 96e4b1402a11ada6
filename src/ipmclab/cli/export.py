"""``ipmclab export``: a run for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ipmclab.cli.files import check_output, read_runs
from ipmclab.cli.options import Force, Json, RunFile
from ipmclab.cli.output import print_json, progress

SUFFIXES = (".csv", ".xlsx", ".mat")


def export(
    run: RunFile,
    out: Annotated[Path, typer.Option(metavar="FILE.csv|.xlsx|.mat", help="The file to write.")],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Export a run as CSV, XLSX or MAT.

    \b
    ipmclab export step.nc --out step.csv
    """
    from ipmclab import export_run

    check_output(out, force=force, suffixes=SUFFIXES, reads=[run])
    (loaded,) = read_runs([run])
    with progress(f"writing {out.name}"):
        export_run(loaded, out, overwrite=force)
    if as_json:
        print_json({"run": run, "rows": len(loaded), "channels": list(loaded.channels), "out": out})
    else:
        print(f"wrote {out}: {len(loaded)} rows of {', '.join(['time', *loaded.channels])}")
