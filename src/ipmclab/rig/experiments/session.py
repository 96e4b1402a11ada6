"""An experiment from its first step to its last: what is asked, waited for, recorded and kept."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Literal
from uuid import uuid4

from ipmclab.errors import InputError, IpmclabError
from ipmclab.quality import pair
from ipmclab.rig.bench import Bench
from ipmclab.rig.experiments import fingerprint
from ipmclab.rig.experiments.desk import Desk, Live
from ipmclab.rig.experiments.earlier import PATIENCE, Earlier
from ipmclab.rig.experiments.equilibrium import Air, wait_for_equilibrium
from ipmclab.rig.experiments.plan import Plan
from ipmclab.rig.experiments.steps import FINGERPRINT, MOST_DRIFT, PlannedRun, PlannedStep, Question, prepare, watched
from ipmclab.rig.process.messages import Message
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.keeping import State
from ipmclab.rig.recording.recorder import capture
from ipmclab.rig.recording.recording import Heartbeat
from ipmclab.rig.recording.zeroing import read_rest, read_tare
from ipmclab.run import Finding, Mark, Run, RunMetadata, ZeroReading
from ipmclab.signals import Step
from ipmclab.signals.signal import shortened
from ipmclab.store.catalogue.catalogue import Catalogue, safely
from ipmclab.store.journal.finalise import finalise
from ipmclab.store.journal.journal import Journal, JournalHeader
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.run_file import read_run

Ending = Literal["stop", "abort", "zero"]

_AIR_TOLD: Final = 10.0
"""How often [s] of its own time the waiting for the environment is told."""

_MOST_CHECKED: Final = 5_000_000
"""Rows of a run that is looked at as soon as it is recorded; a longer one takes too much memory and time for that."""

_MOST_CLAMPINGS: Final = 3
"""How often a strip is clamped again for one fingerprint: each time it is given a voltage."""


@dataclass(frozen=True)
class Recorded:
    """A run that stands on the disk.

    Parameters
    ----------
    path : Path
    purpose : "signal", "baseline" or "fingerprint"
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


class Session:
    """One experiment at one bench.

    Parameters
    ----------
    plan : Plan
    bench : Bench
        Closed; closed again at the end.
    laboratory : Laboratory
    desk : Desk
    inspect : callable
        What is wrong with a run, such as ``ipmclab.check``.
    earlier : callable
        The fingerprints that a sample has in the laboratory, with the mounting of its last run.
    guardian : Heartbeat, optional
        Armed whenever the output may be away from 0 V.

    ``run`` does it all in the calling thread; ``stop``, ``abort``, ``zero`` and ``mark`` may be called from any other.
    """

    def __init__(
        self,
        plan: Plan,
        bench: Bench,
        laboratory: Laboratory,
        desk: Desk,
        *,
        inspect: Callable[[Run], Sequence[Finding]],
        earlier: Callable[[str], Earlier] | None = None,
        guardian: Heartbeat | None = None,
    ) -> None:
        self._plan = plan
        self._experiment = plan.experiment
        self._bench = bench
        self._laboratory = laboratory
        self._desk = desk
        self._inspect = inspect
        self._earlier = earlier or (lambda _: Earlier())
        self._guardian = guardian
        self._control: Control | None = None
        self._marks: list[tuple[float, str]] = []
        self._lock = threading.RLock()
        self._ending: Ending | None = None
        self._reason = ""
        self._recorded: list[Recorded] = []
        self._clock = _Clock()
        self._known: dict[str, Any] = {}
        self._mounting = self._experiment.mounting_id
        self._fingerprint: fingerprint.Fingerprint | None = None
        self._remarks: list[str] = []
        self._first_of_pair: dict[tuple[str, int | None], Path] = {}
        self._tares: tuple[ZeroReading, ...] = ()
        self._names = {step.name for step in plan.steps}

    @property
    def recorded(self) -> tuple[Recorded, ...]:
        """The runs so far."""
        return tuple(self._recorded)

    @property
    def ended_early(self) -> Ending | None:
        """How the operator ended it before its last step."""
        return self._ending

    @property
    def reason(self) -> str:
        """Why it was ended early; empty when it was not."""
        return self._reason

    def stop(self) -> None:
        """End the run now, keep it as it is, and do nothing more."""
        self._end("stop", "stopped by the operator")

    def abort(self, reason: str = "aborted by the operator") -> None:
        """End the run now, keep it marked as aborted, and do nothing more."""
        self._end("abort", reason)

    def zero(self) -> None:
        """Emergency: the output to 0 V now, then as ``abort``."""
        self._end("zero", "emergency zero")

    def mark(self, text: str) -> None:
        """Note something at this moment of the run."""
        with self._lock:
            if self._control is not None:
                self._control.mark(text)
                return
            self._marks.append((time.monotonic(), text))
        self._note(f"no run is being recorded: {text!r} is noted at the start of the next one")

    def run(self) -> tuple[Recorded, ...]:
        """Do every step.

        Raises
        ------
        InputError
            An environment that never settles, before the strip has seen a volt.
        IpmclabError
            The hardware or the disk failed; ``recorded`` has what was kept.
        """
        if self._experiment.fingerprint and not any(step.name == "fingerprint" for step in self._plan.steps):
            self._note("no fingerprint is taken: the current is not among what is measured")
        try:
            for step in self._plan.steps:
                if self._over():
                    break
                self._do(step)
        finally:
            self._safe()
            for _, text in self._marks:
                self._note(f"{text!r} came after the last run: it is noted in none")
        return self.recorded

    def _over(self) -> bool:
        return self._ending is not None

    def _end(self, how: Ending, reason: str) -> None:
        with self._lock:
            if self._ending is None or (self._ending == "stop" and how != "stop"):
                self._ending, self._reason = how, reason
            control = self._control
        if control is not None:
            if how == "stop":
                control.stop()
            elif how == "abort":
                control.abort(reason)
            else:
                control.zero()

    def _safe(self) -> None:
        """Output to 0 V, whatever happened; a second failure must not hide the first."""
        with contextlib.suppress(IpmclabError):
            self._bench.zero()
        with contextlib.suppress(IpmclabError):
            self._bench.close()

    def _do(self, step: PlannedStep) -> None:
        about = {"name": step.name, "text": step.text, "seconds": step.seconds, "asks": step.question is not None}
        self._desk.tell(Message("step", about))
        if step.name == "fingerprint":
            self._take_fingerprint(step)
            return
        answer = self._ask(step.question) if step.question is not None else ""
        if step.name == "zero" and answer == "skip":
            self._note("no tare is read: a tip that does not touch is told from the end of the sensor only")
        if self._over():
            return
        for words in step.hands if answer not in ("skip", "kept") else ():
            self._hands(words)
        match step.name:
            case "hydrate":
                self._clock.start("out of water")
            case "clamp":
                self._tares = ()  # of another clamping
                self._clamp(kept=answer == "kept")
            case "chamber-on":
                self._known["chamber"] = "on"
                self._clock.start("in environment")
            case "equilibrium":
                self._wait_for_equilibrium()
            case "chamber-off":
                self._known["chamber"] = "off"
            case "zero":
                self._tares = ()  # of another run
                if answer == "done":
                    self._read_tare()
            case "pause":
                self._rest(step.seconds)
            case "apply":
                assert step.run is not None
                self._record(step.run)

    def _ask(self, question: Question) -> str:
        return self._desk.ask(question, self._over)

    def _hands(self, words: str) -> None:
        """What an operator would do, at a bench that has no operator."""
        hands = getattr(self._bench, "hands", None)
        if hands is not None and self._bench.origin == "virtual bench":
            hands(words)

    def _clamp(self, *, kept: bool) -> None:
        if self._experiment.mounting_id is not None:
            return
        if kept:
            self._mounting = self._earlier(self._experiment.sample.id).mounting_id
            if self._mounting is not None:
                return
            self._note(f"no earlier mounting of {self._experiment.sample.id} is known here: it gets a new id")
        # Its date tells people which clamping it was, the rest keeps two rigs apart.
        self._mounting = f"{datetime.now():%Y%m%d-%H%M%S}-{uuid4().hex[:4]}"

    def _wait_for_equilibrium(self) -> None:
        environment = self._experiment.environment
        seen = watched(self._experiment, self._bench.rig)
        if environment is None or not seen:
            return
        told, began = -_AIR_TOLD, self._clock.now

        def on_air(air: Air) -> bool:
            nonlocal told
            if air.time - told >= _AIR_TOLD:
                told = air.time
                self._note(f"{air}, within tolerance for {air.settled_for:.0f} s", passing=True)
            return self._over()

        air = wait_for_equilibrium(self._bench, environment, seen, on_air)
        self._clock.passed(air.time, since=began)
        for name in ("temperature", "relative_humidity"):
            value = getattr(air, name)
            if value is not None:
                self._known[name] = value

    def _rest(self, seconds: float) -> None:
        """Wait at 0 V by the clock of the bench."""
        rate, began = 10.0, self._clock.now
        try:
            self._bench.open(["voltage"], rate)
            for _ in self._bench.apply(Step(0.0), max(1, round(seconds * rate))):
                if self._over():
                    return
        finally:
            self._bench.close()
        self._clock.passed(seconds, since=began)

    def _note(self, text: str, *, passing: bool = False) -> None:
        self._desk.tell(Message("note", {"text": text, "passing": passing}))

    def _take_fingerprint(self, step: PlannedStep) -> None:
        """A fingerprint, and what is to be done when it is not like the earlier ones."""
        assert step.run is not None
        known = self._earlier(self._experiment.sample.id).fingerprints
        clampings = 0
        while not self._over():
            recorded = self._record(step.run)
            if recorded is None or recorded.state != "complete":
                return
            found = self._fingerprint
            if found is None:
                self._note("the fingerprint tells nothing: no step of the current, or a strip still discharging")
                return
            self._note(f"fingerprint: {found}")
            told = fingerprint.differences(found, known)
            if not told:
                return
            self._note("; ".join(told))
            if clampings == _MOST_CLAMPINGS:
                raise IpmclabError(
                    f"clamped again {clampings} times, and still {'; '.join(told)}",
                    code="fingerprint-outside",
                    where=f"sample {self._experiment.sample.id}",
                    repair="look at the strip and its contacts; --answer fingerprint=continue records it as it is",
                )
            question = replace(FINGERPRINT, text=f"{'; '.join(told)}: {FINGERPRINT.text}", again=clampings > 0)
            answer = self._ask(question)
            if self._over():
                return
            self._remarks.append(f"fingerprint outside the earlier ones ({'; '.join(told)}): {answer}")
            if answer == "continue":
                return
            again = ("hydrate", "clamp") if answer == "hydrate" else ("clamp",)
            clampings += 1
            for name in (*again, *(["equilibrium"] if answer == "hydrate" and "equilibrium" in self._names else [])):
                self._do(self._once_more(prepare(name, self._experiment, self._bench.rig)))
            if self._experiment.pause and not self._over():
                self._rest(self._experiment.pause)  # what the last fingerprint charged must not show in the next

    def _once_more(self, step: PlannedStep) -> PlannedStep:
        """A step that is done again: what was answered to it beforehand was said of the first time."""
        if step.question is None or self._bench.origin == "virtual bench":  # its hands are simulated
            return step
        choices = tuple(choice for choice in step.question.choices if choice != "kept")
        return replace(step, question=replace(step.question, choices=choices, again=True))

    def _record(self, planned: PlannedRun) -> Recorded | None:
        """Record one run, make its file, and say what is wrong with it."""
        with self._lock:
            if self._over():
                return None
            control = self._control = Control()
            for noted, text in self._marks:
                control.mark(f"{text} ({time.monotonic() - noted:.0f} s before the run)")
            self._marks.clear()
        uuid = str(uuid4())
        rows = planned.rows
        signal = shortened(str(planned.signal))
        about = {"signal": signal, "purpose": planned.purpose, "rate": planned.rate, "rows": rows}
        place = sum(one.purpose != "fingerprint" for one in self._recorded) + 1
        of = sum(one.purpose != "fingerprint" for one in self._plan.runs)
        self._desk.tell(Message("run", {"uuid": uuid, **about, "place": place, "of": of}))
        kept: list[Journal] = []
        live = Live(self._desk, rows)

        def on_end(mark: Mark, rows: int) -> None:
            live.mark(mark, "limit" if mark.kind == "limit" else self._ending or "abort", rows)

        def make_journal(header: JournalHeader) -> Journal:
            journal = Journal.create(self._laboratory, header, on_commit=live.committed)
            kept.append(journal)
            self._desk.tell(Message("begun", {"uuid": header.uuid, "journal": str(journal.path)}))
            safely(lambda: self._catalogue().begin(header.uuid, header.metadata))
            return journal

        began = self._clock.now
        short = planned.purpose == "fingerprint"
        force = "force" in planned.measured and "preload" in self._names and not short
        try:
            outcome = capture(
                self._bench,
                planned.signal,
                duration=planned.duration,
                rate=planned.rate,
                measured=planned.measured,
                rest_before=planned.rest_before,
                rest_after=planned.rest_after,
                metadata=self._metadata(planned, uuid),
                limits=self._plan.limits,
                journal=make_journal,
                control=control,
                heartbeat=self._guardian,
                on_block=live.block,
                on_mark=live.mark,
                tares=() if short else self._tares,
                zero_time=planned.zero_before,
                zero_after=planned.zero_after,
                most_drift=MOST_DRIFT if force else None,
                on_preload=self._tell_preload,
                on_air=live.air,
                on_end=on_end,
                finish=self._tare_again if force and self._tares else None,
            )
        except BaseException:
            with contextlib.suppress(IpmclabError):
                self._keep(kept, planned)
            raise
        finally:
            with self._lock:
                self._control = None
                late = [request.text for request in control.take() if request.kind == "mark"]
                self._marks += [(time.monotonic(), text) for text in late]
        self._clock.passed(planned.zero_before + planned.seconds + planned.zero_after, since=began)
        try:
            recorded = self._keep(kept, planned, outcome.state, outcome.reason)
        except IpmclabError as error:
            if error.code != "journal-empty":
                raise outcome.error or error from error
            recorded = None
        if outcome.error is not None:
            raise outcome.error
        is_whole = recorded is not None and recorded.state == "complete" and rows <= _MOST_CHECKED
        if recorded is not None and is_whole and planned.pair_id is not None:
            self._tell_pair(planned.pair_id, planned.repeat, recorded.path)
        if outcome.state == "aborted" and not self._over():
            # What the guard ended is not begun again: the strip, or the signal, is not what it was thought to be.
            self._ending, self._reason = "abort", outcome.reason
        return recorded

    def _look_at(self, path: Path, rows: int) -> tuple[Run | None, list[Finding]]:
        """A run that was kept, and what is wrong with it; what fails here ends no experiment."""
        later = f"it was not looked at; ipmclab check {path} does that"
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

    def _keep(
        self, kept: Sequence[Journal], planned: PlannedRun, state: State = "aborted", reason: str = ""
    ) -> Recorded | None:
        """The run file of what was recorded, with what is wrong with it."""
        if not kept:
            return None
        try:
            path = finalise(kept[-1].path, self._laboratory)
        except IpmclabError as error:
            if error.code == "journal-empty":
                safely(lambda: self._catalogue().discard(kept[-1].path.stem))
            raise
        run, findings = self._look_at(path, kept[-1].acknowledged)
        about = run.metadata if run is not None else RunMetadata(state=state, state_reason=reason or None)
        if planned.purpose == "fingerprint":
            self._fingerprint = fingerprint.read_fingerprint(run) if run is not None else None
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
        self._recorded.append(recorded)
        self._desk.tell(Message("recorded", recorded.as_dict()))
        return recorded

    def _tell_pair(self, pair_id: str, repeat: int | None, path: Path) -> None:
        """What the two polarities have in common, once both are there."""
        first = self._first_of_pair.pop((pair_id, repeat), None)
        if first is None:
            self._first_of_pair[pair_id, repeat] = path
            return
        try:
            found = pair(read_run(first), read_run(path))
        except (InputError, MemoryError) as error:
            self._note(f"the pair tells nothing: {error}")
            return
        for text in found.texts():
            self._note(text)

    def _catalogue(self) -> Catalogue:
        return Catalogue(self._laboratory.root, patience=PATIENCE)

    def _metadata(self, planned: PlannedRun, uuid: str) -> RunMetadata:
        experiment = self._experiment
        remarks = [experiment.notes] if experiment.notes else []
        about = RunMetadata(
            uuid=uuid,
            sample=experiment.sample,
            mounting_id=self._mounting,
            purpose=planned.purpose,
            pair_id=planned.pair_id,
            repeat=planned.repeat,
            experiment=experiment.title,
            rig=self._bench.rig.name,
            rig_proof=self._plan.rig_proof or None,
            operator=experiment.operator,
            notes="; ".join([*remarks, *self._remarks]) or None,
            clamp_pressure=experiment.clamp_pressure,
            minutes_out_of_water=self._clock.minutes_since("out of water"),
            minutes_in_environment=self._clock.minutes_since("in environment"),
        )
        return replace(about, **self._known)

    def _read_tare(self) -> None:
        """What the load cell tells with the tip clear of it."""
        began = self._clock.now
        tare = read_tare(self._bench, self._experiment.rate, when="before", duration=self._experiment.zero_time)
        self._tares = (tare,)
        self._clock.passed(self._experiment.zero_time, since=began)
        self._note(f"tare {1e3 * tare.value:.3g} mN")

    def _tell_preload(self, preload: ZeroReading) -> None:
        drift = f", drifts by {1e6 * preload.drift:.2g} uN/s" if preload.drift is not None else ""
        self._note(f"preload {1e3 * preload.value:.3g} mN{drift}", passing=True)

    def _tare_again(self, bench: Bench) -> Sequence[ZeroReading]:
        """The tare after a run, with the bench still open."""
        step = prepare("zero", self._experiment, bench.rig)
        assert step.question is not None
        if self._over() or self._ask(replace(step.question, text=f"after the run: {step.question.text}")) == "skip":
            return ()
        for words in step.hands:
            self._hands(words)
        experiment = self._experiment
        names, seconds = ("voltage", "force"), experiment.zero_time
        return (read_rest(bench, names, experiment.rate, when="after", duration=seconds, force="tare")["force"],)


class _Clock:
    """How much time has passed: that of the wall, or that of a bench whose clock runs faster.

    At a simulated bench half an hour passes in a second; at a real one both say the same.
    """

    def __init__(self) -> None:
        self._ahead = 0.0
        self._marks: dict[str, float] = {}

    @property
    def now(self) -> float:
        """Time [s]."""
        return time.monotonic() + self._ahead

    def passed(self, seconds: float, *, since: float) -> None:
        """So much time has passed at the bench since a moment."""
        self._ahead += max(0.0, seconds - (self.now - since))

    def start(self, what: str) -> None:
        """Count the time of something from now on."""
        self._marks[what] = self.now

    def minutes_since(self, what: str) -> float | None:
        """Minutes since it was started, None if it was not."""
        began = self._marks.get(what)
        return None if began is None else round((self.now - began) / 60.0, 3)
