"""A campaign carried out: sitting after sitting, each run judged, and continued after any break."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from uuid import UUID

from ipmclab.campaign.blocks import Block, CampaignRun
from ipmclab.campaign.campaign import Campaign
from ipmclab.campaign.facts import measured_facts
from ipmclab.campaign.sitting import Sitting, sittings_of
from ipmclab.campaign.state import State, Verdict
from ipmclab.errors import InputError, IpmclabError
from ipmclab.quality import check
from ipmclab.run import Finding, Run
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.run_file import read_run
from ipmclab.version import __version__

UNREADABLE: Final = "unreadable"
"""The finding of a run whose file cannot be read."""

_SEVERITIES: Final = ("info", "warning", "error")


@dataclass(frozen=True)
class Sat:
    """How a sitting ended.

    Parameters
    ----------
    ended : "done", "stop", "abort" or "zero"
        As an operator, or the guard, ended it.
    reason : str
    """

    ended: str = "done"
    reason: str = ""


def refuse_ended(sat: Sat, *, where: str, repair: str = "look at the strip") -> None:
    """Raise where an operator or the guard ended a sitting.

    Raises
    ------
    IpmclabError
    """
    if sat.ended != "done":
        raise IpmclabError(
            f"the campaign was ended: {sat.reason or sat.ended}",
            code="ended",
            where=where,
            repair=f"{repair}; the same command continues with the next run",
        )


Sit = Callable[[Sitting, State], Sat]
"""Carries a sitting out at the bench of the campaign."""

OnProgress = Callable[[str], None]


class Conduct:
    """Carries a campaign out in a laboratory folder.

    Parameters
    ----------
    campaign : Campaign
    blocks : sequence of Block
        All of them, in their order.
    laboratory : Laboratory
    state : State
        What has been done already.
    sit : callable
        Carries one sitting out.
    on_progress : callable
        Called with what happens, a line at a time.

    ``begin``, then ``run``.
    """

    def __init__(
        self,
        campaign: Campaign,
        blocks: Sequence[Block],
        laboratory: Laboratory,
        state: State,
        *,
        sit: Sit,
        on_progress: OnProgress,
    ) -> None:
        self._campaign = campaign
        self._blocks = blocks
        self._laboratory = laboratory
        self._state = state
        self._sit = sit
        self._tell = on_progress
        self._runs = {run.id: run for block in blocks for run in block.runs}

    @property
    def left(self) -> int:
        """How many runs are still to be recorded."""
        return len(self._runs.keys() - self._state.done)

    def begin(self) -> None:
        """Begin, or continue where it stopped: what a break left on the disk is taken in first.

        Raises
        ------
        InputError
            Another campaign was carried out in this folder.
        """
        begun = self._state.begun
        if begun is None:
            about = {"title": self._campaign.title, "checksum": self._campaign.checksum}
            self._state.add("campaign", **about, version=__version__, plan=list(self._runs), text=self._campaign.text)
        elif (begun["checksum"], begun["plan"]) != (self._campaign.checksum, list(self._runs)):
            raise InputError(
                "this folder has another campaign, or another version of this one",
                code="another-campaign",
                where=str(self._laboratory.root),
                repair="name another folder, or give the file as it was: campaign.log has it",
            )
        self._take_in()

    def _take_in(self) -> None:
        """Find what sittings recorded whose end was never reported."""
        left = self._state.open
        absent = []
        for uuid, name in left.items():
            path = self._file(uuid)
            if path is None:
                absent.append(uuid)
            else:
                self._judge(self._runs[name], uuid, path)
        if absent:
            self._state.add("absent", uuids=absent)

    def _file(self, uuid: str) -> Path | None:
        """The run file of a uuid, of which its name has the beginning."""
        found = sorted(self._laboratory.runs.rglob(f"*_{UUID(uuid).hex[:8]}.nc"))
        return found[0] if found else None

    def run(self) -> None:
        """Record what is left, and what fails its checks once more.

        Raises
        ------
        IpmclabError
            An operator or the guard ended it, or the bench failed: what was recorded is kept, and the next call
            continues from there.
        """
        self._measure_facts()
        while self.left:
            for one in list(sittings_of(self._campaign, self._blocks, self._state.done)):
                self._sit_through(one)

    def _measure_facts(self) -> None:
        """What is known of each strip without a run; at a real bench people weigh and push."""
        known = {(one["sample"], one["name"]) for one in self._state.of("fact")}
        for strip in self._campaign.strips if self._campaign.is_virtual else ():
            for fact in measured_facts(self._campaign, strip):
                if (strip.sample.id, fact.name) not in known:
                    self._state.add("fact", sample=strip.sample.id, **fact.as_dict())

    def _sit_through(self, one: Sitting) -> None:
        self._state.add(
            "sitting",
            block=one.block.number,
            runs={run.id: uuid for run, uuid in zip(one.runs, one.uuids, strict=True)},
        )
        sat = self._sit(one, self._state)
        absent = []
        for run, uuid in zip(one.runs, one.uuids, strict=True):
            if uuid not in self._state.open:
                continue  # reported while the sitting went on
            path = self._file(uuid)
            if path is None:
                absent.append(uuid)
            else:
                self._judge(run, uuid, path, undisturbed=sat.ended == "done")
        if absent:
            self._state.add("absent", uuids=absent)
        self._ask_about_unreadable(one)
        if sat.ended != "done":
            flagged = any(
                self._state.recorded[run.id]["verdict"] == "flagged"
                for run in one.runs
                if run.id in self._state.recorded
            )
            repair = "look at the strip" if flagged else "nothing is lost"
            refuse_ended(sat, where=f"{one.block.strip.sample.id}, {one.block.part}", repair=repair)
        if len(absent) == len(one.runs):
            raise IpmclabError(
                "the sitting ended and recorded nothing",
                code="nothing-recorded",
                where=f"{one.block.strip.sample.id}, {one.block.part}",
                repair="read the messages of the recorder; the same command continues",
            )

    def _ask_about_unreadable(self, one: Sitting) -> None:
        """End the campaign where a run was flagged because its files cannot be read: nobody but a person knows why."""
        for run in one.runs:
            earlier = self._state.recorded.get(run.id)
            if earlier is None or earlier["verdict"] != "flagged":
                continue
            if UNREADABLE in [finding["code"] for finding in earlier["findings"]]:
                raise IpmclabError(
                    f"the file of {run.id} cannot be read; the run was recorded {self._state.failures[run.id]} times",
                    code=UNREADABLE,
                    where=str(self._laboratory.root / earlier["path"]),
                    repair="check that the disk has no errors and that no other program changes its files; the run is "
                    "flagged, and the same command continues with the next run",
                )

    def _judge(self, run: CampaignRun, uuid: str, path: Path, *, undisturbed: bool = False) -> None:
        """Say what a recorded run is good for; ``undisturbed`` where its sitting came to its own end."""
        verdict, verdict_findings = self._verdict(run, path, undisturbed=undisturbed)
        failing = [one.code for one in verdict_findings if self._fails(one)]
        findings = [{"code": one.code, "severity": one.severity, "channel": one.channel} for one in verdict_findings]
        place = path.relative_to(self._laboratory.root).as_posix()
        self._state.add("recorded", run=run.id, uuid=uuid, path=place, verdict=verdict, findings=findings)
        why = f" ({', '.join(failing)})" if failing else ""
        left = f"{len(self._runs) - self.left} of {len(self._runs)}"
        self._tell(f"  {left}: {run.id}: {verdict}{why}")

    def _verdict(self, run: CampaignRun, path: Path, *, undisturbed: bool) -> tuple[Verdict, Sequence[Finding]]:
        try:
            read = read_run(path)
        except InputError as error:
            self._tell(f"  {path} cannot be read: {error}")
            return self._failed(run), (Finding(UNREADABLE, "error", error.message),)
        if read.metadata.state != "complete" or len(read) < run.planned.rows:
            # What a limit ended is not begun again: the strip, or the signal, is not what it was thought to be.
            if _by_guard(read):
                return "flagged", ()
            if not undisturbed:
                return "interrupted", ()
            # Nobody ended it: it would end like this without end.
            rows = f"{len(read)} of {run.planned.rows} rows were recorded, and nobody interrupted the run"
            return self._failed(run), (Finding("incomplete", "error", rows),)
        findings_of_run = check(read)
        if not any(self._fails(one) for one in findings_of_run):
            return "kept", findings_of_run
        return self._failed(run), findings_of_run

    def _failed(self, run: CampaignRun) -> Verdict:
        """What becomes of a run that fails: it is recorded again, as often as the campaign allows."""
        failed = self._state.failures.get(run.id, 0) + 1
        return "flagged" if failed >= self._campaign.attempts else "repeat"

    def _fails(self, finding: Finding) -> bool:
        least = self._campaign.fails_at
        return least != "never" and _SEVERITIES.index(finding.severity) >= _SEVERITIES.index(least)


def _by_guard(run: Run) -> bool:
    """Whether a limit ended a run."""
    return any(mark.kind == "limit" for mark in run.metadata.marks)
