"""An experiment from its first step to its last: what is asked, waited for, recorded and kept."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from typing import Final
from uuid import uuid4

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import Bench
from ipmclab.rig.chambers.watch import ChamberWatch
from ipmclab.rig.experiments import fingerprint
from ipmclab.rig.experiments.archive import Archive, Recorded
from ipmclab.rig.experiments.bench_clock import BenchClock
from ipmclab.rig.experiments.conditioning import Conditioning
from ipmclab.rig.experiments.earlier import Earlier
from ipmclab.rig.experiments.live import Live
from ipmclab.rig.experiments.operator import Operator
from ipmclab.rig.experiments.plan import Plan
from ipmclab.rig.experiments.requests import Ending, Requests
from ipmclab.rig.experiments.steps import (
    FINGERPRINT,
    MOST_DRIFT,
    UNKNOWN,
    PlannedRun,
    PlannedStep,
    Question,
    prepare,
)
from ipmclab.rig.process.messages import Message
from ipmclab.rig.recording.recorder import capture
from ipmclab.rig.recording.recording import Heartbeat
from ipmclab.rig.recording.run_request import Listeners, RunRequest
from ipmclab.rig.recording.slow import Air as SlowAir
from ipmclab.rig.recording.zeroing import read_rest, read_tare
from ipmclab.run import Finding, Mark, Run, RunMetadata, ZeroReading
from ipmclab.signals import Step
from ipmclab.signals.signal import shortened
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.units import MASS, parse_quantity

_MOST_CLAMPINGS: Final = 3
"""How often a strip is clamped again for one fingerprint: each time it is given a voltage."""


class Session:
    """One experiment at one bench.

    Parameters
    ----------
    plan : Plan
    bench : Bench
        Closed; closed again at the end.
    laboratory : Laboratory
    operator : Operator
    inspect : callable
        What is wrong with a run, such as ``ipmclab.check``.
    earlier : callable
        The fingerprints that a sample has in the laboratory, with the mounting of its last run.
    guardian : Heartbeat, optional
        Armed whenever the output may be away from 0 V.
    chamber : ChamberWatch, optional
        Set to the conditions of the plan, and set to standby at the end, whatever ended it.

    ``run`` does it all in the calling thread; ``stop``, ``abort``, ``zero`` and ``mark`` may be called from any other.
    """

    def __init__(
        self,
        plan: Plan,
        bench: Bench,
        laboratory: Laboratory,
        operator: Operator,
        *,
        inspect: Callable[[Run], Sequence[Finding]],
        earlier: Callable[[str], Earlier] | None = None,
        guardian: Heartbeat | None = None,
        chamber: ChamberWatch | None = None,
    ) -> None:
        self._plan = plan
        self._experiment = plan.experiment
        self._bench = bench
        self._operator = operator
        self._earlier = earlier or (lambda _: Earlier())
        self._guardian = guardian
        self._requests = Requests()
        self._archive = Archive(laboratory, operator, inspect)
        self._clock = BenchClock()
        self._mass: float | None = None
        self._air = Conditioning(bench, plan.limits, self._clock, self, chamber)
        self._mounting = self._experiment.mounting_id
        self._remarks: list[str] = []
        self._tares: tuple[ZeroReading, ...] = ()
        self._names = {step.name for step in plan.steps}

    @property
    def recorded(self) -> tuple[Recorded, ...]:
        """The runs so far."""
        return tuple(self._archive.recorded)

    @property
    def ended_early(self) -> Ending | None:
        """How the operator ended it before its last step."""
        return self._requests.ending

    @property
    def reason(self) -> str:
        """Why it was ended early; empty when it was not."""
        return self._requests.reason

    def stop(self) -> None:
        """End the run now, keep it as it is, and do nothing more."""
        self._requests.end("stop", "stopped by the operator")

    def abort(self, reason: str = "aborted by the operator") -> None:
        """End the run now, keep it marked as aborted, and do nothing more."""
        self._requests.end("abort", reason)

    def zero(self, reason: str = "emergency zero by the operator") -> None:
        """Emergency: the output to 0 V now, then as ``abort``."""
        self._requests.end("zero", reason)

    def is_over(self) -> bool:
        """Whether it was asked to end."""
        return self._requests.is_over()

    def tell(self, message: Message) -> None:
        """Send to all who listen."""
        self._operator.tell(message)

    def note(self, text: str, *, passing: bool = False) -> None:
        """Something to know."""
        self.tell(Message("note", {"text": text, "passing": passing}))

    def mark(self, text: str) -> None:
        """Note something at this moment of the run."""
        if not self._requests.mark(text):
            self.note(f"no run is being recorded: {text!r} is noted at the start of the next one")

    def run(self) -> tuple[Recorded, ...]:
        """Do every step.

        Raises
        ------
        InputError
            What the bench cannot read or do, before the first step; an environment that never settles, before the strip
            had any voltage.
        IpmclabError
            The hardware is not there, before the first step; it or the disk failed: ``recorded`` has what was kept.
        """
        if self._experiment.fingerprint and not any(step.name == "fingerprint" for step in self._plan.steps):
            self.note("no fingerprint is taken: the current is not among what is measured")
        try:
            self._find_bench()
            for step in self._plan.steps:
                if self._requests.is_over():
                    break
                self._do(step)
        except BaseException:
            self._safe()
            with contextlib.suppress(IpmclabError):  # what failed first is reported
                self._air.leave()
            raise
        else:
            self._safe()
            self._air.leave()
        finally:
            for text in self._requests.unheard:
                self.note(f"{text!r} came after the last run: it is noted in none")
        return self.recorded

    def _find_bench(self) -> None:
        """A bench that does not answer is found before anybody takes the strip out of its water."""
        for run in self._plan.runs[:1]:
            self._bench.open(run.measured, run.rate)
            self._bench.close()

    def _safe(self) -> None:
        """Output to 0 V, whatever happened; a second failure must not hide the first."""
        with contextlib.suppress(IpmclabError):
            self._bench.zero()
        with contextlib.suppress(IpmclabError):
            self._bench.close()

    def _do(self, step: PlannedStep) -> None:
        about = {"name": step.name, "text": step.text, "seconds": step.seconds, "asks": step.question is not None}
        self._operator.tell(Message("step", about))
        if step.name == "fingerprint":
            self._take_fingerprint(step)
            return
        answer = self._ask(step.question) if step.question is not None else ""
        if step.name == "zero" and answer == "skip":
            self.note("no tare is read: that the tip does not touch is known from the sensor's end stop only")
        if self._requests.is_over():
            return
        if answer == UNKNOWN:
            self._leave_open(step)
            return
        for words in step.actions if answer not in ("skip", "kept") else ():
            self._act_as_operator(words)
        self._act(step, answer)

    def _leave_open(self, step: PlannedStep) -> None:
        """Nobody says whether a step was done: what would follow from it is not known, and the run says so."""
        text = f"nobody said whether this was done: {step.name}"
        if step.name == "clamp":
            self._tares = ()
            if self._experiment.mounting_id is None:
                self._mounting = None
                text += "; the run belongs to no known mounting"
        self._remarks.append(text)
        self.note(text)

    def _act(self, step: PlannedStep, answer: str) -> None:
        """What a step does once its question is answered."""
        match step.name:
            case "hydrate":
                self._mass = None
                self._clock.start("out of water")
            case "weigh":
                self._mass = None if answer == "skip" else parse_quantity(answer, MASS, where="answer weigh")
            case "clamp":
                self._tares = ()  # of another clamping
                self._clamp(kept=answer == "kept")
            case "chamber-on":
                self._forget_mass()
                self._air.begin(step.visit)
            case "equilibrium":
                self._air.wait(step.visit)
            case "chamber-off":
                self._air.leave_still()
            case "standby":
                self._air.stand_by()
            case "zero":
                self._tares = ()  # of another run
                if answer == "done":
                    self._read_tare()
            case "pause":
                self._rest(step.seconds)
            case "apply":
                assert step.run is not None
                self._record(step.run)
                self._mass = None  # of the next run nobody weighed it

    def _forget_mass(self) -> None:
        """In the air of the chamber the strip takes up or gives off water before it is recorded."""
        if self._mass is not None:
            self._remarks.append(f"weighed {1e6 * self._mass:.4g} mg before the chamber was set")
        self._mass = None

    def _ask(self, question: Question) -> str:
        return self._operator.ask(question, self._requests.is_over)

    def _act_as_operator(self, words: str) -> None:
        """What an operator would do, at a bench that has no operator."""
        operate = getattr(self._bench, "operate", None)
        if operate is not None and self._bench.origin == "virtual bench":
            operate(words)

    def _clamp(self, *, kept: bool) -> None:
        if self._experiment.mounting_id is not None:
            return
        if kept:
            self._mounting = self._earlier(self._experiment.sample.id).mounting_id
            if self._mounting is not None:
                return
            self.note(f"no earlier mounting of {self._experiment.sample.id} is known here: it gets a new id")
        # Its date shows people which clamping it was, the rest distinguishes two rigs.
        self._mounting = f"{datetime.now():%Y%m%d-%H%M%S}-{uuid4().hex[:4]}"

    def _rest(self, seconds: float) -> None:
        """Wait at 0 V by the clock of the bench."""
        rate, began = 10.0, self._clock.now
        try:
            self._bench.open(["voltage"], rate)
            for _ in self._bench.apply(Step(0.0), max(1, round(seconds * rate))):
                if self._requests.is_over():
                    return
        finally:
            self._bench.close()
        self._clock.passed(seconds, since=began)

    def _take_fingerprint(self, step: PlannedStep) -> None:
        """A fingerprint, and what is to be done when it is not like the earlier ones."""
        assert step.run is not None
        known = self._earlier(self._experiment.sample.id).fingerprints
        clampings = 0
        while not self._requests.is_over():
            recorded = self._record(step.run)
            if recorded is None or recorded.state != "complete":
                return
            found = self._archive.fingerprint
            if found is None:
                self.note("the fingerprint shows nothing: no step of the current, or a strip still discharging")
                return
            self.note(f"fingerprint: {found}")
            differing = fingerprint.differences(found, known)
            if not differing:
                return
            self.note("; ".join(differing))
            if clampings == _MOST_CLAMPINGS:
                raise IpmclabError(
                    f"clamped again {clampings} times, and still {'; '.join(differing)}",
                    code="fingerprint-outside",
                    where=f"sample {self._experiment.sample.id}",
                    repair="look at the strip and its contacts; --answer fingerprint=continue records it as it is",
                )
            question = replace(FINGERPRINT, text=f"{'; '.join(differing)}: {FINGERPRINT.text}", again=clampings > 0)
            answer = self._ask(question)
            if self._requests.is_over():
                return
            self._remarks.append(f"fingerprint outside the earlier ones ({'; '.join(differing)}): {answer}")
            if answer == "continue":
                return
            again = ("hydrate", "clamp") if answer == "hydrate" else ("clamp",)
            clampings += 1
            self._mass = None
            for name in (*again, *(["equilibrium"] if answer == "hydrate" and "equilibrium" in self._names else [])):
                self._do(self._once_more(prepare(name, self._experiment, self._bench.rig, self._air.visit)))
            if self._experiment.pause and not self._requests.is_over():
                self._rest(self._experiment.pause)  # what the last fingerprint charged must not show in the next

    def _once_more(self, step: PlannedStep) -> PlannedStep:
        """A step that is done again: what was answered to it beforehand was said of the first time."""
        if step.question is None or self._bench.origin == "virtual bench":  # its operator is simulated
            return step
        choices = tuple(choice for choice in step.question.choices if choice != "kept")
        return replace(step, question=replace(step.question, choices=choices, again=True))

    def _record(self, planned: PlannedRun) -> Recorded | None:
        """Record one run, with the chamber still where it may be, make its file, and say what is wrong with it."""
        with self._air.recording(planned.zero_before + planned.seconds + planned.zero_after):
            return self._capture(planned)

    def _capture(self, planned: PlannedRun) -> Recorded | None:
        control = self._requests.begin_run()
        if control is None:
            return None
        uuid = planned.uuid or str(uuid4())
        rows = planned.rows
        signal = shortened(str(planned.signal))
        about = {"signal": signal, "purpose": planned.purpose, "rate": planned.rate, "rows": rows}
        place = sum(one.purpose != "fingerprint" for one in self._archive.recorded) + 1
        of = sum(one.purpose != "fingerprint" for one in self._plan.runs)
        self._operator.tell(Message("run", {"uuid": uuid, **about, "place": place, "of": of}))
        live = Live(self._operator, rows)
        word = self._guardian.status if self._guardian is not None else None

        def on_end(mark: Mark, rows: int) -> None:
            live.ends(mark, "limit" if mark.kind == "limit" else self._requests.ending or "abort", rows)

        def on_air(air: SlowAir) -> None:
            live.air(air)
            self._air.look(air)

        began = self._clock.now
        short = planned.purpose == "fingerprint"
        force = "force" in planned.measured and "preload" in self._names and not short
        try:
            outcome = capture(
                self._bench,
                RunRequest(
                    source=planned.signal,
                    duration=planned.duration,
                    rate=planned.rate,
                    measured=planned.measured,
                    rest_before=planned.rest_before,
                    rest_after=planned.rest_after,
                    metadata=self._metadata(planned, uuid),
                    limits=self._plan.limits,
                    tares=() if short else self._tares,
                    zero_time=planned.zero_before,
                    zero_after=planned.zero_after,
                    most_drift=MOST_DRIFT if force else None,
                    slow=self._air.readings,
                ),
                journal=lambda header: self._archive.begin(header, live, word),
                control=control,
                heartbeat=self._guardian,
                listeners=Listeners(live.block, live.mark, on_end, on_air, self._report_preload),
                finish=self._tare_again if force and self._tares else None,
            )
        except BaseException:
            with contextlib.suppress(IpmclabError):
                self._archive.keep(planned)
            raise
        finally:
            self._requests.end_run()
        self._clock.passed(planned.zero_before + planned.seconds + planned.zero_after, since=began)
        try:
            recorded = self._archive.keep(planned, outcome.state, outcome.reason)
        except IpmclabError as error:
            if error.code != "journal-empty":
                raise outcome.error or error from error
            recorded = None
        if outcome.error is not None:
            raise outcome.error
        if outcome.state == "aborted" and not self._requests.is_over():
            # What the guard ended is not begun again: the strip, or the signal, is not what it was thought to be.
            self._requests.end("abort", outcome.reason)
        return recorded

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
            mass=self._mass,
            clamp_pressure=experiment.clamp_pressure,
            minutes_out_of_water=self._clock.minutes_since("out of water"),
            minutes_in_environment=self._clock.minutes_since("in environment"),
        )
        return replace(about, **self._air.known)

    def _read_tare(self) -> None:
        """What the load cell reads with the tip clear of it."""
        began = self._clock.now
        tare = read_tare(self._bench, self._experiment.rate, when="before", duration=self._experiment.zero_time)
        self._tares = (tare,)
        self._clock.passed(self._experiment.zero_time, since=began)
        self.note(f"tare {1e3 * tare.value:.3g} mN")

    def _report_preload(self, preload: ZeroReading) -> None:
        drift = f", drifts by {1e6 * preload.drift:.2g} uN/s" if preload.drift is not None else ""
        self.note(f"preload {1e3 * preload.value:.3g} mN{drift}", passing=True)

    def _tare_again(self, bench: Bench) -> Sequence[ZeroReading]:
        """The tare after a run, with the bench still open."""
        step = prepare("zero", self._experiment, bench.rig)
        assert step.question is not None
        if (
            self._requests.is_over()
            or self._ask(replace(step.question, text=f"after the run: {step.question.text}")) == "skip"
        ):
            return ()
        for words in step.actions:
            self._act_as_operator(words)
        experiment = self._experiment
        names, seconds = ("voltage", "force"), experiment.zero_time
        return (read_rest(bench, names, experiment.rate, when="after", duration=seconds, force="tare")["force"],)
