"""Runs that were recorded: each becomes a file, is looked at, and is known to the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import as_typed
from ipmclab.quality import pair
from ipmclab.rig.experiments.earlier import PATIENCE
from ipmclab.rig.experiments.fingerprint import Fingerprint, read_fingerprint
from ipmclab.rig.experiments.live import Live
from ipmclab.rig.experiments.operator import Operator
from ipmclab.rig.experiments.steps import PlannedRun
from ipmclab.rig.process.messages import Message
from ipmclab.rig.recording.keeping import State
from ipmclab.run import Finding, Run, RunMetadata
from ipmclab.signals.signal import shortened
from ipmclab.store.catalogue.catalogue import Catalogue, safely
from ipmclab.store.journal.finalise import finalise
from ipmclab.store.journal.guardian_word import EVENT as GUARDIAN
from ipmclab.store.journal.journal import Journal, JournalHeader
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.run_file import read_run

_MOST_CHECKED: Final = 5_000_000
"""Rows of a run that is looked at as soon as it is recorded; a longer one takes too much memory and time for that."""


@dataclass(frozen=True)
class Recorded:
    """A run that is on the disk.

    Parameters
    ----------
    path : Path
    purpose : "signal", "baseline", "fingerprint" or "reference"
    signal : str
    state : "complete" or "aborted"
    state_reason : str, optional
    findings : tuple of Finding
    """

    path: Path
    purpose: str
    signal: str
    state: str
    state_reason: str | None
    findings: tuple[Finding, ...]

    def as_dict(self) -> dict[str, Any]:
        """The run as a JSON document."""
        return {
            "path": str(self.path),
            "purpose": self.purpose,
            "signal": shortened(self.signal),
            "state": self.state,
            "state_reason": self.state_reason,
            "findings": [
                {"code": one.code, "severity": one.severity, "channel": one.channel, "message": one.message}
                for one in self.findings
            ],
        }


class Archive:
    """Keeps the runs of one experiment.

    Parameters
    ----------
    laboratory : Laboratory
    operator : Operator
        Gets each run.
    inspect : callable
        What is wrong with a run, such as ``ipmclab.check``.
    """

    def __init__(self, laboratory: Laboratory, operator: Operator, inspect: Callable[[Run], Sequence[Finding]]) -> None:
        self._laboratory = laboratory
        self._operator = operator
        self._inspect = inspect
        self._journal: Journal | None = None
        self._first_of_pair: dict[tuple[str, int | None], Path] = {}
        self.recorded: list[Recorded] = []
        self.fingerprint: Fingerprint | None = None
        """Of the last run that was one; None where it shows nothing."""

    def begin(self, header: JournalHeader, live: Live, guardian: Path | None = None) -> Journal:
        """A journal for the rows of a run that begins; it names the file in which a guardian says what became of it."""
        journal = self._journal = Journal.create(self._laboratory, header, on_commit=live.committed)
        if guardian is not None:
            journal.event(GUARDIAN, 0.0, guardian.name)
        self._operator.tell(Message("begun", {"uuid": header.uuid, "journal": str(journal.path)}))
        safely(lambda: self._catalogue().begin(header.uuid, header.metadata))
        return journal

    def keep(self, planned: PlannedRun, state: State = "aborted", reason: str = "") -> Recorded | None:
        """The run file of the journal that was begun last, with what is wrong with it; None where none was begun."""
        journal, self._journal = self._journal, None
        if journal is None:
            return None
        try:
            path = finalise(journal.path, self._laboratory)
        except IpmclabError as error:
            if error.code == "journal-empty":
                safely(lambda: self._catalogue().discard(journal.path.stem))
            raise
        run, findings = self._look_at(path, journal.acknowledged)
        about = run.metadata if run is not None else RunMetadata(state=state, state_reason=reason or None)
        if planned.purpose == "fingerprint":
            self.fingerprint = read_fingerprint(run) if run is not None else None
        failed = safely(lambda: self._catalogue().add(path, findings))
        if failed is not None:
            self._note(f"the catalogue does not know this run yet: {failed}")
        recorded = Recorded(
            path=path,
            purpose=planned.purpose,
            signal=about.signal or str(planned.signal),
            state=about.state or "complete",
            state_reason=about.state_reason,
            findings=tuple(findings),
        )
        self.recorded.append(recorded)
        self._operator.tell(Message("recorded", recorded.as_dict()))
        if recorded.state == "complete" and planned.rows <= _MOST_CHECKED and planned.pair_id is not None:
            self._report_pair(planned.pair_id, planned.repeat, recorded.path)
        return recorded

    def _look_at(self, path: Path, rows: int) -> tuple[Run | None, list[Finding]]:
        """A run that was kept, and what is wrong with it; what fails here ends no experiment."""
        later = f"it was not looked at; ipmclab check {as_typed(path)} does that"
        if rows > _MOST_CHECKED:
            self._note(f"{rows} rows are more than the {_MOST_CHECKED} that are read back at once: {later}")
            return None, []
        run: Run | None = None
        try:
            run = read_run(path)
            return run, list(self._inspect(run))
        except Exception as error:  # whatever it is, the run is on the disk, and the next one waits
            self._note(f"{type(error).__name__}: {error}: {later}")
            return run, []

    def _report_pair(self, pair_id: str, repeat: int | None, path: Path) -> None:
        """What the two polarities have in common, once both are there."""
        first = self._first_of_pair.pop((pair_id, repeat), None)
        if first is None:
            self._first_of_pair[pair_id, repeat] = path
            return
        try:
            found = pair(read_run(first), read_run(path))
        except (InputError, MemoryError) as error:
            self._note(f"the pair shows nothing: {error}")
            return
        for text in found.texts():
            self._note(text)

    def _catalogue(self) -> Catalogue:
        return Catalogue(self._laboratory.root, patience=PATIENCE)

    def _note(self, text: str) -> None:
        self._operator.tell(Message("note", {"text": text, "passing": False}))
