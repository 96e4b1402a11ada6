"""``ipmclab smooth``: a copy of a run without the vibration of a fan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ipmclab.cli.files import check_output, read_runs
from ipmclab.cli.options import Force, Json, RunFile
from ipmclab.cli.output import print_json, print_table, read, with_unit
from ipmclab.units import CHANNELS, FREQUENCY, parse_quantity


def smooth(
    run: RunFile,
    below: Annotated[
        str,
        typer.Option(
            metavar="FREQUENCY", help='Frequency: what is slower stays, what is faster goes, for example "5 Hz".'
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.nc", help="The run to write.")],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a copy of a run without what is fast in its displacement and force, such as the vibration of a fan.

    \b
    ipmclab smooth run.nc --below "5 Hz" --out quiet.nc
    """
    frequency = parse_quantity(below, FREQUENCY, where="--below")
    check_output(out, force=force, suffixes=(".nc",), reads=[run])
    from ipmclab import write_run
    from ipmclab.measurement.smooth import smooth as smooth_run

    (loaded,) = read_runs([run])
    smoothed, taken_out = smooth_run(loaded, frequency)
    write_run(smoothed, out, overwrite=force)
    if as_json:
        found = {
            name: {
                "rms": with_unit(one.rms, CHANNELS[name].unit),
                "frequency": with_unit(one.frequency, "Hz"),
                "share": one.share,
            }
            for name, one in taken_out.items()
        }
        print_json({"run": run, "below": with_unit(frequency, "Hz"), "taken_out": found, "out": out})
        return
    rows = [
        [name, read(one.rms, CHANNELS[name], digits=3), f"{one.frequency:.3g} Hz", f"{100 * one.share:.0f} %"]
        for name, one in taken_out.items()
    ]
    print_table(["channel", "taken out (rms)", "most of it at", "share there"], rows)
    print(f"wrote {out}")
