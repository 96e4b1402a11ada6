"""``ipmclab import``: a foreign record becomes a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.files import check_output
from ipmclab.cli.options import Force, Json
from ipmclab.cli.output import print_json, print_paragraph, print_table, progress, read, with_unit
from ipmclab.units import CHANNELS, TIME

if TYPE_CHECKING:
    from ipmclab.run import Run


def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The foreign record.", show_default=False)],
    out: Annotated[Path, typer.Option(metavar="RUN.nc", help="The run to write.")],
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="MAP.toml", help="What its columns are. A file of `export` needs none."),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Import a foreign record (CSV, XLSX, MAT, TDMS, LVM, the thesis's binary) with a map of its columns.

    \b
    ipmclab import step.csv.gz --map platform.toml --out step.nc
    """
    from ipmclab import import_run, write_run
    from ipmclab.quality.record import Record
    from ipmclab.store import load_import_map

    check_output(out, force=force, suffixes=(".nc",), reads=[file] if map_file is None else [file, map_file])
    import_map = None if map_file is None else load_import_map(map_file)
    with progress(f"importing {file.name}"):
        run = import_run(file, import_map)
        write_run(run, out, overwrite=force)

    responses = Record.of(run).channels
    far_out = {name: responses[name].beyond if name in responses else () for name in run.channels}
    channels = {name: _describe(run, name, far_out[name]) for name in run.channels}
    sentinels = {} if import_map is None else {name: each.sentinels for name, each in import_map.channels.items()}
    notes = _notes(channels, sentinels)
    period_known = run.metadata.sampling_period_known
    if as_json:
        print_json(
            {
                "source": file,
                "rows": len(run),
                "duration": with_unit(float(run.time[-1] - run.time[0]), "s"),
                "period": with_unit(1.0 / run.rate, "s"),
                "sampling_period_known": period_known,
                "hold": run.hold,
                "channels": {
                    name: {
                        "low": with_unit(entry["low"], CHANNELS[name].unit),
                        "high": with_unit(entry["high"], CHANNELS[name].unit),
                        "sentinels": entry["sentinels"],
                        "missing": entry["missing"],
                        "far_out": len(entry["far_out"]),
                    }
                    for name, entry in channels.items()
                },
                "out": out,
            }
        )
        return
    rows = [
        [
            CHANNELS[name].name,
            read(entry["low"], CHANNELS[name]),
            read(entry["high"], CHANNELS[name]),
            str(entry["sentinels"]),
            str(entry["missing"]),
        ]
        for name, entry in channels.items()
    ]
    period = read(1.0 / run.rate, TIME) + (" between rows" if run.is_uniform else " between rows on average")
    length = read(float(run.time[-1] - run.time[0]) + 1.0 / run.rate, TIME)
    print_table(
        ["channel", "lowest", "highest", "sentinels", "missing"],
        rows,
        title=f"{file.name}: {period}, {len(run)} rows, {length} in all",
    )
    for note in notes:
        print_paragraph(note)
    if not period_known:
        print("The file does not hold its sampling period: every time constant scales with the one in the map.")
    print(f"wrote {out}")


def _describe(run: Run, name: str, far_out: Sequence[float]) -> dict[str, Any]:
    from ipmclab.run import QUALITY_FLAGS

    values = run.channels[name]
    lost = values != values  # NaN
    present = values[~lost]
    flags = run.quality.get(name)
    sentinels = 0 if flags is None else int(((flags & QUALITY_FLAGS["sentinel"]) > 0).sum())
    return {
        "low": float(present.min()) if len(present) else None,
        "high": float(present.max()) if len(present) else None,
        "sentinels": sentinels,
        "missing": int(lost.sum()) - sentinels,
        "far_out": far_out,
    }


def _notes(channels: Mapping[str, Mapping[str, Any]], sentinels: Mapping[str, Sequence[float]]) -> list[str]:
    """What the numbers of the table alone do not say."""
    from ipmclab.quality.record import counted

    notes = []
    for name, entry in channels.items():
        quantity = CHANNELS[name]
        if sentinels.get(name) and not entry["sentinels"]:
            listed = " or ".join(f"{sentinel:g}" for sentinel in sentinels[name])
            notes.append(f"No reading of the {quantity.name} is {listed}: see sentinels in the map.")
        if entry["far_out"]:
            shown = ", ".join(read(value, quantity) for value in entry["far_out"][:3])
            more = ", ..." if len(entry["far_out"]) > 3 else ""
            notes.append(
                f"Beside lost readings the {quantity.name} has {counted(len(entry['far_out']), 'reading')} far out of "
                f"the others ({shown}{more}): identification leaves such readings out."
            )
    return notes
