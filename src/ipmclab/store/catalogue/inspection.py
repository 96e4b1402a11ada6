"""What is wrong with the runs of a catalogue, found once and kept there."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ipmclab.errors import InputError
from ipmclab.store.catalogue.facts import finding_columns, problem_text
from ipmclab.store.catalogue.query import CatalogueRow
from ipmclab.store.catalogue.sweep import Problem, Progress
from ipmclab.store.catalogue.write import choose_shown, put_findings, put_run_file
from ipmclab.store.run_file import read_run

if TYPE_CHECKING:
    from ipmclab.run import Finding, Run
    from ipmclab.store.catalogue.database import Database

_BETWEEN_WRITES: Final = 2.0
"""Findings are written at least this often [s], so that what was inspected is kept when it is stopped."""

Inspect = Callable[["Run"], Sequence["Finding"]]


def inspect_files(
    database: Database,
    root: Path,
    laboratory: str,
    rows: Sequence[CatalogueRow],
    inspect: Inspect,
    on_progress: Progress | None = None,
) -> tuple[Problem, ...]:
    """Inspect the runs of a folder that were not inspected yet, as ``Catalogue.inspect`` says."""
    todo = [
        row
        for row in rows
        if row.finding_codes is None and row.path and row.problem is None and row.laboratory == laboratory
    ]
    problems: list[Problem] = []
    kept: list[tuple[CatalogueRow, Sequence[Finding] | InputError]] = []
    last = time.monotonic()
    for done, row in enumerate(todo, start=1):
        path = root / str(row.path)
        try:
            kept.append((row, tuple(inspect(read_run(path)))))
        except InputError as error:
            if path.exists():
                kept.append((row, error))
                problems.append(Problem(str(row.path), *problem_text(error)))
        except Exception as error:  # a run that no check foresaw must not stop the others
            problems.append(Problem(str(row.path), "not-checked", f"it could not be checked: {problem_text(error)[1]}"))
        if on_progress is not None:
            on_progress(done, len(todo))
        if time.monotonic() - last > _BETWEEN_WRITES:
            _keep(database, root, laboratory, kept)
            kept, last = [], time.monotonic()
    _keep(database, root, laboratory, kept)
    return tuple(problems)


def _keep(
    database: Database,
    root: Path,
    laboratory: str,
    kept: Sequence[tuple[CatalogueRow, Sequence[Finding] | InputError]],
) -> None:
    if not kept:
        return
    # Always in the same order: two writers that lock rows crosswise would wait for each other.
    with database.write() as connection:
        for row, found in sorted(kept, key=lambda pair: pair[0].id):
            if isinstance(found, InputError):
                stamp = _stamp(root / str(row.path))
                choose_shown(connection, *put_run_file(connection, laboratory, str(row.path), found, stamp))
            else:
                put_findings(connection, row.id, *finding_columns(found))


def _stamp(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except OSError:
        return -1, -1
    return found.st_size, found.st_mtime_ns
