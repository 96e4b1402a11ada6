"""``ipmclab export``: a run for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ipmclab.cli.files import actuator_files, check_output, fit_or_actuator, means_actuator, read_runs
from ipmclab.cli.options import Force, Json
from ipmclab.cli.output import print_json, print_remarks, progress
from ipmclab.errors import InputError, suggest
from ipmclab.platform import as_typed

SUFFIXES = (".csv", ".xlsx", ".mat")


def export(
    what: Annotated[
        str,
        typer.Argument(
            metavar="RUN|ACTUATOR|FOLDER", help="A run (.nc); with --to an actuator, or a folder.", show_default=False
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="FILE", help="The file to write: of a run .csv, .xlsx or .mat; with --to .m or .zip."),
    ],
    to: Annotated[
        str | None,
        typer.Option(metavar="TOOL", help="matlab: an actuator as .m with its .mat. ro-crate: a folder as a .zip."),
    ] = None,
    title: Annotated[str | None, typer.Option(metavar="TEXT", help="Of an RO-Crate: what the data are.")] = None,
    licence: Annotated[
        str | None, typer.Option(metavar="SPDX", help="Of an RO-Crate: its licence, such as CC-BY-4.0.")
    ] = None,
    person: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Of an RO-Crate: 'Ada Example <0000-0002-1825-0097>'.")
    ] = None,
    organisation: Annotated[str, typer.Option(metavar="NAME", help="Of an RO-Crate: who publishes it.")] = "",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Export a run as CSV, XLSX or MAT, an actuator for another tool, or a folder as an RO-Crate.

    \b
    ipmclab export step.nc --out step.csv
    ipmclab export fitted.toml --to matlab --out strip.m
    ipmclab export runs --to ro-crate --out runs.zip --title "Steps" --licence CC-BY-4.0 --person "Ada Example"
    """
    _refuse_other_kind(what, to)
    if to == "ro-crate":
        _export_crate(
            what, out, title, licence, people=person or [], organisation=organisation, force=force, as_json=as_json
        )
        return
    if to is not None:
        _export_actuator(what, out, to, force=force, as_json=as_json)
        return
    from ipmclab import export_run

    run = Path(what)
    check_output(out, force=force, suffixes=SUFFIXES, reads=[run])
    (loaded,) = read_runs([run])
    with progress(f"writing {out.name}"):
        export_run(loaded, out, overwrite=force)
    if as_json:
        print_json({"run": run, "rows": len(loaded), "channels": list(loaded.channels), "out": out})
    else:
        print(f"wrote {out}: {len(loaded)} rows of {', '.join(['time', *loaded.channels])}")


def _refuse_other_kind(what: str, to: str | None) -> None:
    """Refuse what is exported in another way than it is asked for, with the command that does it."""
    from ipmclab.codegen import TARGETS

    if to is not None and to not in (known := (*TARGETS, "ro-crate")):
        raise InputError(f"unknown tool {to!r}", code="unknown-target", where="--to", repair=suggest(to, known))
    path = Path(what)
    if path.is_dir():
        kind, needs, out = "a folder", "ro-crate", f"{path.resolve().name or 'crate'}.zip"
    elif path.suffix.lower() == ".nc":
        kind, needs, out = "a run", None, f"{path.stem}.csv"
    elif means_actuator(what) and to != "matlab" and _is_there(what):
        kind, needs, out = "an actuator", "matlab", "strip.m"
    else:
        return  # who reads it says what is wrong with it
    if needs != to:
        tool = "" if needs is None else f" --to {needs}"
        tool += " --licence CC-BY-4.0" if needs == "ro-crate" else ""
        raise InputError(
            f"this is {kind}",
            code="wrong-kind",
            where=what,
            repair=f"write for example: ipmclab export {as_typed(what)}{tool} --out {as_typed(out)}",
        )


def _is_there(actuator: str) -> bool:
    from ipmclab import load_actuator

    try:
        load_actuator(actuator)
    except InputError:
        return Path(actuator).exists()
    return True


def _export_actuator(name: str, out: Path, to: str, *, force: bool, as_json: bool) -> None:
    """Write an actuator, with the covariance of its fit where its file has one."""
    from ipmclab import export_actuator
    from ipmclab.destination import keep_what_is_read
    from ipmclab.fit.fit import Fit
    from ipmclab.model.left_open import open_sentence

    given = fit_or_actuator(name)
    actuator, covariance = (given.actuator, given.covariance) if isinstance(given, Fit) else (given, {})
    keep_what_is_read(out, actuator_files(name), where=f"--out {out}")
    doubts = [said] if (said := open_sentence(actuator)) else []
    written = export_actuator(actuator, out, to=to, covariance=covariance, overwrite=force)
    if as_json:
        print_json({"actuator": name, "to": to, "out": out, "written": written, "warnings": doubts})
    else:
        print_remarks(doubts, "warning")
        print(f"wrote {' and '.join(str(path) for path in written)}")


def _export_crate(
    folder: str,
    out: Path,
    title: str | None,
    licence: str | None,
    *,
    people: list[str],
    organisation: str,
    force: bool,
    as_json: bool,
) -> None:
    """Write a folder as an RO-Crate."""
    import zipfile

    from ipmclab import export_crate

    if licence is None:
        raise InputError(
            "no licence is given",
            code="no-licence",
            where="--licence",
            repair="add the licence under which the data are published, by its SPDX name, such as --licence CC-BY-4.0, "
            "or its address",
        )
    with progress(f"writing {out.name}"):
        export_crate(
            folder,
            out,
            title=title if title is not None else Path(folder).resolve().name,
            licence=licence,
            people=people,
            organisation=organisation,
            overwrite=force,
        )
    with zipfile.ZipFile(out) as archive:
        names = archive.namelist()
    if as_json:
        print_json({"folder": folder, "to": "ro-crate", "files": names, "out": out})
    else:
        print(f"wrote {out}: {len(names)} files, licence {licence}")
