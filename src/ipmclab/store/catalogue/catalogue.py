"""The catalogue of runs: a database that answers what was recorded, and that can always be made again from the
files."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.store.catalogue.database import Database, parse_url, url_in_folder
from ipmclab.store.catalogue.facts import facts_of, finding_columns, read_facts, storable
from ipmclab.store.catalogue.inspection import Inspect, inspect_files
from ipmclab.store.catalogue.query import STATES as STATES
from ipmclab.store.catalogue.query import CatalogueRow as CatalogueRow
from ipmclab.store.catalogue.query import RunQuery as RunQuery
from ipmclab.store.catalogue.query import select_rows
from ipmclab.store.catalogue.range import Range as Range
from ipmclab.store.catalogue.sweep import Problem as Problem
from ipmclab.store.catalogue.sweep import Progress, sweep_files
from ipmclab.store.catalogue.sweep import Sweep as Sweep
from ipmclab.store.catalogue.write import IDS_AT_ONCE, choose_shown, put_findings, put_new_run, put_run_file
from ipmclab.store.document import metadata_table

if TYPE_CHECKING:
    from ipmclab.run import Finding, RunMetadata

ENVIRONMENT_VARIABLE: Final = "IPMCLAB_CATALOGUE"
"""Where a group says the address of its catalogue once, for every verb."""


@dataclass(frozen=True)
class KeptFinding:
    """A finding as the catalogue has it."""

    code: str
    severity: str
    channel: str | None
    message: str
    values: Mapping[str, float | int | str | None]


class Catalogue:
    """The runs of a folder, or of a group.

    Nothing is opened before the first question, and nothing stays open after an answer.

    Parameters
    ----------
    root : str or path
        The folder of the runs: a laboratory folder, or any other.
    url : str, optional
        ``postgresql://USER@HOST/NAME`` for a group, or the path of an SQLite file. Without it the environment
        variable IPMCLAB_CATALOGUE is used, then ``catalogue.db`` in the folder.
    patience : float, optional [s]
        How long it waits for a server, or for another program that writes.

    Raises
    ------
    InputError
        The folder does not exist, or the url names no database that can be used.

    Examples
    --------
    >>> import tempfile
    >>> from ipmclab import simulate, load_actuator, write_run
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     run = simulate(load_actuator("friend-2"), "sine 1 V 0.1 Hz", duration=20.0, rate=50.0)
    ...     write_run(run, f"{folder}/sine.nc")
    ...     catalogue = Catalogue(folder)
    ...     catalogue.sweep().added
    ...     [(row.path, row.amplitude, row.measured) for row in catalogue.query(RunQuery(signal="sine"))]
    1
    [('sine.nc', 1.0, ('current', 'displacement', 'force', 'applied_voltage'))]
    """

    def __init__(self, root: str | os.PathLike[str], url: str | None = None, *, patience: float | None = None) -> None:
        self.root = Path(os.path.realpath(root))
        if not self.root.is_dir():
            raise InputError(
                "there is no such folder",
                code="no-such-folder",
                where=str(root),
                repair="name the folder that holds the runs",
            )
        url = url or os.environ.get(ENVIRONMENT_VARIABLE) or None
        self._own = url is None
        self._database = Database(url_in_folder(self.root) if url is None else parse_url(url), patience)
        self.laboratory = "" if url is None else storable(f"{socket.gethostname()}:{self.root.as_posix()}")
        """What the folder is called in the catalogue: nothing in its own, computer and folder in one that others
        use too."""

    @property
    def where(self) -> str:
        """The database, for messages; never with its password."""
        return self._database.where

    @property
    def exists(self) -> bool:
        """False for a catalogue next to the runs that was not made yet."""
        return not self._own or Path(self._database.where).exists()

    def begin(self, uuid: str, metadata: RunMetadata) -> None:
        """Note that a run is being recorded.

        Raises
        ------
        IpmclabError
            The catalogue cannot be written; the recording does not need it (see ``safely``).
        """
        columns = facts_of({"metadata": {**metadata_table(metadata), "uuid": uuid}}, identity="")
        columns |= {"state": "recording", "home": self.laboratory}
        with self._database.write() as connection:
            put_new_run(connection, columns)

    def discard(self, uuid: str) -> None:
        """Forget a run that was begun and of which nothing was recorded; one that has a file stays.

        Raises
        ------
        IpmclabError
            The catalogue cannot be written.
        """
        from sqlalchemy import delete, select

        from ipmclab.store.catalogue.tables import file, run

        filed = select(file.c.run_id).where(file.c.run_id.is_not(None))
        begun = (run.c.uuid == uuid) & (run.c.state == "recording") & (run.c.home == self.laboratory)
        with self._database.write() as connection:
            connection.execute(delete(run).where(begun, run.c.id.not_in(filed)))

    def add(self, path: str | os.PathLike[str], findings: Sequence[Finding] | None = None) -> None:
        """Take a run file into the catalogue, or look at it again.

        Parameters
        ----------
        path : str or path
            Below the folder of the catalogue.
        findings : sequence of Finding, optional
            What is known to be wrong with it; None: it was not inspected yet.

        Raises
        ------
        InputError
            A file elsewhere, or one that is no run.
        IpmclabError
            The catalogue cannot be written.
        """
        whole = Path(os.path.realpath(path))
        if not whole.is_relative_to(self.root):
            raise InputError(
                f"it is not in the folder of the catalogue, {str(self.root)!r}",
                code="outside-folder",
                where=str(path),
                repair="move it there, or name its own folder",
            )
        facts = read_facts(whole)
        columns, rows = finding_columns(findings) if findings is not None else ({}, [])
        below = whole.relative_to(self.root).as_posix()
        with self._database.write() as connection:
            stamp = (facts.size, facts.mtime_ns)
            run_id, before = put_run_file(connection, self.laboratory, below, facts, stamp)
            choose_shown(connection, run_id, before)
            if findings is not None and run_id is not None:
                put_findings(connection, run_id, columns, rows)

    def query(self, query: RunQuery | None = None) -> list[CatalogueRow]:
        """The runs that answer a question, the oldest first.

        Parameters
        ----------
        query : RunQuery, optional
            All runs without one.
        """
        with self._database.read() as connection:
            rows = connection.execute(select_rows(query or RunQuery())).all()
        return [CatalogueRow._make(row) for row in rows]

    def sweep(self, inspect: Inspect | None = None, on_progress: Progress | None = None) -> Sweep:
        """Bring the catalogue up to date with the files of its folder.

        Parameters
        ----------
        inspect : callable, optional
            Returns the findings of a run; runs that were not inspected yet are.
        on_progress : callable, optional
            Called with how many files are done, and of how many.

        Returns
        -------
        sweep : Sweep
            With every file that is damaged: one does not stop the others.
        """
        found = sweep_files(self._database, self.root, self.laboratory, on_progress)
        self._look_for_recordings()
        if inspect is not None:
            self.inspect(self.query(self._here()), inspect, on_progress)
        return found

    def rebuild(self, inspect: Inspect | None = None, on_progress: Progress | None = None) -> Sweep:
        """Make the catalogue again from the files of its folder.

        A damaged catalogue next to the runs is kept under another name. Runs of the folder whose files are gone are
        forgotten; those of other folders stay, unless the tables are of another version.

        Parameters
        ----------
        inspect, on_progress : as for ``sweep``
        """
        try:
            self._forget()
            found = self.sweep(None, on_progress)
        except IpmclabError as error:
            if error.code == "catalogue-broken" and self._own:
                self._database.move_aside()
            elif error.code in ("catalogue-broken", "catalogue-newer", "catalogue-older"):
                self._database.reset()
            else:
                raise
            found = self.sweep(None, on_progress)
        self._drop_missing()
        if inspect is not None:
            self.inspect(self.query(self._here()), inspect, on_progress)
        return found

    def inspect(
        self, rows: Sequence[CatalogueRow], inspect: Inspect, on_progress: Progress | None = None
    ) -> tuple[Problem, ...]:
        """Find out what is wrong with runs that were not inspected yet, and keep it.

        Parameters
        ----------
        rows : sequence of CatalogueRow
            Those whose file is in this folder are read.
        inspect : callable
            Returns the findings of a run.
        on_progress : callable, optional

        Returns
        -------
        problems : tuple of Problem
            Files that turned out to be damaged, and runs that could not be inspected.
        """
        return inspect_files(self._database, self.root, self.laboratory, rows, inspect, on_progress)

    def findings(self, rows: Sequence[CatalogueRow]) -> dict[int, tuple[KeptFinding, ...]]:
        """The findings of runs, by the id of their row."""
        from sqlalchemy import select

        from ipmclab.store.catalogue.tables import finding

        found: dict[int, list[KeptFinding]] = {row.id: [] for row in rows if row.codes}
        columns = (finding.c.code, finding.c.severity, finding.c.channel, finding.c.message, finding.c.numbers)
        ids = list(found)
        with self._database.read() as connection:
            for start in range(0, len(ids), IDS_AT_ONCE):
                some = finding.c.run_id.in_(ids[start : start + IDS_AT_ONCE])
                statement = select(finding.c.run_id, *columns).where(some).order_by(finding.c.id)
                for run_id, *values in connection.execute(statement):
                    found[run_id].append(KeptFinding(*values))
        return {run_id: tuple(those) for run_id, those in found.items()}

    def metadata(self, row: CatalogueRow) -> dict[str, Any]:
        """The whole metadata of a run, as they are in its document."""
        from sqlalchemy import select

        from ipmclab.store.catalogue.tables import document

        with self._database.read() as connection:
            found = connection.execute(select(document.c.metadata).where(document.c.run_id == row.id)).scalar()
        return dict(found or {})

    def samples(self) -> list[str]:
        """The ids of all samples."""
        return self._distinct("sample")

    def codes(self) -> list[str]:
        """The codes of all findings."""
        return sorted({code for codes in self._distinct("finding_codes") for code in codes.split()})

    def file_of(self, row: CatalogueRow) -> str | None:
        """Where the file of a run is, as people read it."""
        if row.path is None:
            return None
        if row.laboratory == self.laboratory:
            return str(self.root / row.path)
        return f"{row.laboratory}/{row.path}"

    def _here(self) -> RunQuery:
        return RunQuery(laboratory=self.laboratory)

    def _distinct(self, column: str) -> list[str]:
        from sqlalchemy import select

        from ipmclab.store.catalogue.tables import run

        with self._database.read() as connection:
            chosen = select(run.c[column]).where(run.c[column].is_not(None)).distinct().order_by(run.c[column])
            return [str(value) for value in connection.execute(chosen).scalars()]

    def _look_for_recordings(self) -> None:
        """Let rows of recordings follow the journals: one for each, and none that still says so without its journal."""
        from sqlalchemy import select, update

        from ipmclab.store.catalogue.tables import run
        from ipmclab.store.journal.record import read_header

        journals = {path.stem: path for path in (self.root / "recording").glob("*.runj")}
        with self._database.read() as connection:
            begun = select(run.c.uuid).where(run.c.state == "recording", run.c.home == self.laboratory)
            known = set(connection.execute(begun).scalars())
        gone = sorted(known - journals.keys())
        for uuid in gone:
            if (self.root / "journal-archive" / f"{uuid}.runj").exists():  # put away, and no run was made of it
                self.discard(uuid)
        if gone:
            with self._database.write() as connection:
                lost = run.c.uuid.in_(gone) & (run.c.state == "recording") & (run.c.home == self.laboratory)
                connection.execute(update(run).where(lost).values(state=None))
        for uuid in sorted(journals.keys() - known):
            # One that cannot be read is for `recover`, or on Windows in use by its recorder, which wrote its row.
            with suppress(InputError):
                header = read_header(journals[uuid])
                self.begin(
                    header.uuid, replace(header.metadata, recorded_at=header.metadata.recorded_at or header.created_at)
                )

    def _forget(self) -> None:
        """Take every file of the folder as changed, and its runs as not inspected."""
        from sqlalchemy import select, update

        from ipmclab.store.catalogue.tables import file, run

        with self._database.write() as connection:
            here = file.c.laboratory == self.laboratory
            ours = select(file.c.run_id).where(here)
            connection.execute(update(run).where(run.c.id.in_(ours)).values(finding_codes=None))
            connection.execute(update(file).where(here).values(size=-1))

    def _drop_missing(self) -> None:
        from sqlalchemy import delete, select

        from ipmclab.store.catalogue.tables import file, run

        with self._database.write() as connection:
            filed = select(file.c.run_id).where(file.c.run_id.is_not(None))
            lost = run.c.id.not_in(filed) & (run.c.home == self.laboratory)
            still = run.c.state.is_distinct_from("recording")
            connection.execute(delete(run).where(lost, still))


def safely(action: Callable[[], object]) -> IpmclabError | None:
    """Do something with a catalogue that a recording must not depend on.

    Returns
    -------
    error : IpmclabError or None
        Why it did not work, to be reported and then let be: the next sweep catches up from the files.

    Examples
    --------
    >>> print(safely(lambda: Catalogue("nowhere").query()))
    nowhere: there is no such folder; name the folder that holds the runs
    """
    try:
        action()
    except IpmclabError as error:
        return error
    except Exception as error:  # whatever a database or a disk may do, the recording continues
        return IpmclabError(
            f"{type(error).__name__}: {error}",
            code="catalogue",
            where="catalogue",
            repair="the run is safe in its file; ipmclab runs FOLDER takes it in later",
        )
    return None
