"""``ipmclab recover``: what a crash left becomes runs."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ipmclab.cli.options import Json
from ipmclab.cli.output import print_json, print_remarks, progress

if TYPE_CHECKING:
    from ipmclab.store.journal.finalise import Finished

_WORDS = {
    "empty": "nothing was recorded",
    "lost": "cannot be made into a run",
    "in-use": "left alone",
    "gone": "somebody else has dealt with it",
}


def recover(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A laboratory folder.", show_default=False)],
    as_json: Json = False,
) -> None:
    """Finish the recordings that a crash, a full disk or a power cut left.

    Every row that was on the disk is kept, and the run is marked as recovered. Recordings that are in
    progress are left alone, finished runs are not touched, and doing it twice does no harm.

    \b
    ipmclab recover runs
    """
    from ipmclab.store.journal.laboratory import Laboratory
    from ipmclab.store.journal.recover import recover as recover_folder

    laboratory = Laboratory.open(folder, create=False)
    recovery = recover_folder(laboratory, on_progress=_report)
    with progress("bringing the catalogue up to date"):
        remark = _catch_up(laboratory.root)
    if as_json:
        print_json(
            {
                "laboratory": laboratory.root,
                "journals": [asdict(finished) for finished in recovery.finished],
                "failed": [{"journal": path, "error": error.as_dict()} for path, error in recovery.failed],
                "removed": list(recovery.removed),
            }
        )
    else:
        fresh = {Path(finished.salvaged) for finished in recovery.finished if finished.salvaged}
        for finished in recovery.finished:
            print(_line(finished, laboratory.root))
        if not recovery.finished and not recovery.failed:
            print(f"nothing to recover in {folder}")
        if earlier := set(laboratory.salvaged()) - fresh:
            print(
                f"of {len(earlier)} earlier recordings only the rows are left: {', '.join(map(str, sorted(earlier)))}"
            )
    print_remarks([remark] if remark else [])
    for _, error in recovery.failed:
        print(f"error: {error}", file=sys.stderr)
    for finished in recovery.finished:
        if finished.is_loss:
            print(f"error: {what_is_left(finished)}", file=sys.stderr)
    if recovery.failed or any(finished.is_loss for finished in recovery.finished):
        raise typer.Exit(1)


def _report(done: int, total: int, journal: Path) -> None:
    if sys.stderr.isatty():
        size = journal.stat().st_size / 1e6 if journal.exists() else 0.0
        print(f"{done + 1} of {total}: {journal.name} ({size:.1f} MB)", file=sys.stderr)


def _line(finished: Finished, root: Path) -> str:
    """What became of a journal, for people."""
    place = Path(finished.path or finished.journal)
    shown = place.relative_to(root) if place.is_relative_to(root) else place
    if finished.outcome == "run":
        note = f"; {finished.note}" if finished.note else ""
        return f"{finished.state}: {shown}: {finished.rows} rows{note}"
    return f"{_WORDS[finished.outcome]}: {shown}" + (f": {finished.note}" if finished.note else "")


def what_is_left(finished: Finished) -> str:
    """What to do about a journal that could not be made into a run."""
    said = f"a recording could not be made into a run: {finished.note}; it is kept as {finished.path}"
    if not finished.salvaged:
        return said
    return (
        f"{said}, its rows are in {finished.salvaged}: name the columns by what the experiment measured, "
        "then ipmclab import; see that the disk is sound"
    )


def _catch_up(root: Path) -> str | None:
    """Take the runs into the catalogue; what is wrong with it does not stop a recovery."""
    from ipmclab.store.catalogue.catalogue import Catalogue, safely

    error = safely(lambda: Catalogue(root).sweep())
    return str(error) if error else None
