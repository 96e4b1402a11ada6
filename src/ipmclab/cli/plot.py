"""``ipmclab plot``: a figure of runs."""

from __future__ import annotations

from collections.abc import Sequence
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

        plot_runs(loaded, out, labels=labels(runs), overwrite=force)
    if as_json:
        print_json({"runs": runs, "out": out})
    else:
        print(f"wrote {out}")


def labels(paths: Sequence[Path]) -> list[str]:
    """A name for each run on a figure: that of its file, with its folder where two files are called alike.

    Examples
    --------
    >>> labels([Path("a/step.nc"), Path("sine.nc")])
    ['step.nc', 'sine.nc']
    """
    names = [path.name for path in paths]
    return [path.as_posix() if names.count(path.name) > 1 else path.name for path in paths]
