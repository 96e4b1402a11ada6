"""The program of a recorder's own process: ``ipmclab record`` starts it, and its job comes as JSON on stdin.

It answers with one line on stdout, the file that says where it listens, or an error; all else goes to its clients.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from ipmclab.errors import IpmclabError
    from ipmclab.model import Actuator
    from ipmclab.rig.bench import Bench
    from ipmclab.rig.chambers.watch import ChamberWatch
    from ipmclab.rig.channels import Rig
    from ipmclab.rig.experiments.experiment import Experiment
    from ipmclab.rig.experiments.operator import Operator
    from ipmclab.rig.experiments.plan import Plan
    from ipmclab.rig.experiments.session import Session
    from ipmclab.rig.process.server import ClientOperator
    from ipmclab.rig.recording.recording import Heartbeat
    from ipmclab.store.journal.laboratory import Laboratory

FIRST_CLIENT: Final = 10.0
"""How long [s] a recorder that has ended waits for its first client."""


def main() -> int:
    """Do one experiment."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from ipmclab.errors import InputError, IpmclabError
    from ipmclab.platform import go_first
    from ipmclab.rig.process.client import forget_dead_recorders
    from ipmclab.rig.process.hub import Hub
    from ipmclab.rig.process.server import ClientOperator, end_on_signals
    from ipmclab.store.journal.laboratory import Laboratory

    go_first()  # before its threads begin: the guardian takes one that is held up for half a second as hanging
    job = json.load(sys.stdin)
    operator = ClientOperator()
    operator.unattended = not job["interactive"]
    try:
        experiment = read_experiment(job)
        rig = rig_of(experiment)
        laboratory = Laboratory.open(experiment.folder)
        forget_dead_recorders(laboratory.root)
        about = {"sample": experiment.sample.id, "rig": rig.name, "experiment": experiment.where}
        hub = operator.hub = Hub(laboratory.recording, operator.on_request, about)
        log = _log_next_to(hub.file)
    except IpmclabError as error:
        return _refuse(error)
    except OSError as error:
        refused = InputError(
            f"the laboratory folder cannot be written: {error.strerror or error}",
            code="write-failed",
            where=str(error.filename or job["experiment"]),
            repair="ask for the right to write there, or name another folder in the experiment file",
        )
        return _refuse(refused)
    end_on_signals(operator)
    _say({"file": str(hub.file)})
    try:
        return _record(job, experiment, rig, laboratory, operator)
    finally:
        # Whoever started this is about to come: it must not be gone before it was heard.
        hub.had_clients.wait(FIRST_CLIENT)
        hub.close()
        sys.stderr.flush()
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # Windows removes no file that is open
        with contextlib.suppress(OSError):
            if not log.stat().st_size:
                log.unlink()


def read_experiment(job: Mapping[str, Any]) -> Experiment:
    """The experiment of a job, with what its command line changes."""
    from ipmclab.rig.experiments.experiment_file import load_experiment

    if job.get("campaign"):
        from ipmclab.campaign.asked import experiment_asked_for

        return experiment_asked_for(job["experiment"], job["campaign"])
    experiment = load_experiment(job["experiment"])
    changes = {key: job[key] for key in ("pair", "repeats") if job.get(key) is not None}
    return replace(experiment, **changes)


def rig_of(experiment: Experiment) -> Rig:
    """The rig that an experiment names.

    Raises
    ------
    InputError
        With the key of the experiment.
    """
    from ipmclab.errors import InputError
    from ipmclab.rig.files.rig_file import load_rig

    if isinstance(experiment.rig, Path) and not experiment.rig.is_file():
        raise InputError(
            f"there is no rig {str(experiment.rig)!r}",
            code="no-rig",
            where=f"{experiment.where}: rig",
            repair='name a rig file in the folder of the experiment, or "virtual" for the rig that needs no hardware',
        )
    rig = load_rig(experiment.rig)
    if isinstance(experiment.rig, str) and experiment.actuator is not None:
        rig = replace(rig, virtual=replace(rig.virtual, actuator=experiment.actuator))
    return rig


def plan_of(experiment: Experiment, rig: Rig, laboratory: Laboratory, strip: Actuator | None = None) -> Plan:
    """What an experiment is going to do.

    Parameters
    ----------
    experiment : Experiment
    rig : Rig
    laboratory : Laboratory
    strip : Actuator, optional
        A model of the strip, where another is known than the one that experiment or rig name.

    Raises
    ------
    InputError
        What cannot be done.
    """
    from ipmclab import load_actuator
    from ipmclab.rig.checks.proof import proof_of
    from ipmclab.rig.experiments.plan import make_plan
    from ipmclab.run import RunMetadata
    from ipmclab.signals.signal import shortened

    named = experiment.actuator or (rig.virtual.actuator if rig.bench == "virtual" else None)
    plan = make_plan(
        experiment,
        rig,
        bytes_free=laboratory.free_space(),
        actuator=strip or (load_actuator(named) if named else None),
        rig_proof=proof_of(rig, experiment.rig) if rig.bench == "ni" else "",
    )
    for run in plan.runs:
        name = RunMetadata(
            rig=rig.name, sample=experiment.sample, purpose=run.purpose, signal=shortened(str(run.signal))
        )
        laboratory.check_name(name)
    return plan


def answers_of(job: Mapping[str, Any], plan: Plan) -> dict[str, str]:
    """What is answered before anybody asks.

    Raises
    ------
    InputError
        An answer that fits no question, or a question that nobody would be there to answer.
    """
    from ipmclab.errors import InputError
    from ipmclab.rig.experiments.plan import check_answers, unanswered
    from ipmclab.rig.experiments.steps import FINGERPRINT

    given: dict[str, str] = dict(job["answers"])
    check_answers(plan, given)
    asked = {step.name: step.question for step in plan.steps if step.question is not None}
    known = {name: question.default for name, question in asked.items()}
    if plan.rig.bench == "virtual":
        # Its operator is simulated too; but nobody ever takes its strip out of the clamp.
        simulated = {**known, **({"clamp": "kept"} if "clamp" in known else {})}
        return {**({FINGERPRINT.step: FINGERPRINT.default} if job["yes"] else {}), **simulated, **given}
    if job["yes"]:
        unattended = {name: question.unattended or question.default for name, question in asked.items()}
        return {FINGERPRINT.step: FINGERPRINT.default, **unattended, **given}
    open_ones = unanswered(plan, given)
    if open_ones and not job["interactive"]:
        listed = " ".join(f"--answer {name}={known[name]}" for name in open_ones)
        raise InputError(
            f"{', '.join(open_ones)} ask for an operator, and there is no terminal",
            code="nobody-answers",
            where="record",
            repair=f"run it in a terminal, or give {listed}, or --yes",
        )
    return given


def recover_first(laboratory: Laboratory) -> Iterator[str]:
    """Make runs of what an earlier crash left in the folder, and report what became of it."""
    from ipmclab.cli.recover import what_is_left
    from ipmclab.store.catalogue.catalogue import Catalogue, safely
    from ipmclab.store.journal.recover import recover

    recovery = recover(laboratory)
    for finished in recovery.finished:
        if finished.outcome == "run":
            yield f"{finished.state} from an earlier crash: {finished.path}, {finished.rows} rows"
            safely(partial(Catalogue(laboratory.root).add, finished.path))
        elif finished.is_loss:
            yield what_is_left(finished)
    for path, error in recovery.failed:
        yield f"{path} could not be recovered: {error}"


def session_of(
    plan: Plan,
    laboratory: Laboratory,
    operator: Operator,
    guardian: Heartbeat | None,
    bench: Bench | None = None,
    chamber: ChamberWatch | None = None,
) -> Session:
    """The session of a plan, at its own bench where none is given."""
    from ipmclab.cli.benches import make_bench
    from ipmclab.rig.experiments.earlier import earlier_runs
    from ipmclab.rig.experiments.fingerprint import inspect
    from ipmclab.rig.experiments.session import Session

    return Session(
        plan,
        bench or make_bench(plan.rig),
        laboratory,
        operator,
        inspect=inspect,
        earlier=partial(earlier_runs, laboratory),
        guardian=guardian,
        chamber=chamber,
    )


@contextmanager
def chamber_of(plan: Plan, bench: Bench, log: Path) -> Iterator[ChamberWatch | None]:
    """The chamber of a rig, as far as the plan sets it, with who lets it stand by when this process no longer can.

    Raises
    ------
    InputError
        A condition that it does not have.
    ChamberError
        It cannot be reached.
    """
    from ipmclab.cli.benches import make_chamber
    from ipmclab.errors import InputError
    from ipmclab.rig.chambers.keeper import Keeper
    from ipmclab.rig.chambers.watch import ChamberWatch
    from ipmclab.rig.experiments.steps import planned_visits

    settings, visits = plan.rig.chamber, planned_visits(plan.experiment)
    chamber = make_chamber(plan.rig, bench) if visits else None
    if chamber is None or settings is None:
        yield None
        return
    try:
        for visit in visits:
            chamber.ranges.check(visit.environment.temperature, visit.environment.relative_humidity)
    except InputError as error:
        chamber.close()
        where = f"{plan.experiment.where}: environments: {error.where}"
        raise error.at(where) from error
    keeper = None if settings.is_virtual else Keeper(settings, log)
    clock = getattr(bench, "elapsed", None) if settings.is_virtual else None
    watch = ChamberWatch(chamber, clock=clock, keeper=None if keeper is None else keeper.hold)
    try:
        yield watch
    finally:
        watch.close()
        if keeper is not None:
            keeper.close()


@contextmanager
def guardian_of(rig: Rig, log: Path, status: Path | None = None) -> Iterator[Heartbeat | None]:
    """Who brings the output to 0 V when this process no longer can; a simulated strip needs nobody."""
    if rig.bench == "virtual":
        yield None
        return
    import ipmclab.rig.ni  # noqa: F401  # its imports take a second, which passes before the start
    from ipmclab.rig.safety.guardian import Guardian

    guardian = Guardian(rig, log=log, status=status)
    try:
        yield guardian
    finally:
        guardian.close()


def _record(
    job: Mapping[str, Any], experiment: Experiment, rig: Rig, laboratory: Laboratory, operator: ClientOperator
) -> int:
    """Plan, wait for the word to start, do it, and report how it ended."""
    from ipmclab.cli.benches import make_bench
    from ipmclab.errors import IpmclabError
    from ipmclab.rig.process.aftermath import SUFFIX, failures
    from ipmclab.rig.process.messages import Message
    from ipmclab.rig.process.server import ended

    session = None
    failed: IpmclabError | None = None
    how: str | None = None
    try:
        failed_before = failures(laboratory.root)
        for _, text in failed_before:
            operator.tell(Message("note", {"text": text, "passing": False}))
        for text in recover_first(laboratory):
            operator.tell(Message("note", {"text": text, "passing": False}))
        plan = plan_of(experiment, rig, laboratory)
        operator.answer_beforehand(answers_of(job, plan))
        operator.tell(Message("plan", plan.as_dict()))
        if job.get("plan"):
            how = "declined"
        else:
            # While the plan is being read: the guardian, and what drives the bench, take a moment to be ready.
            assert operator.hub is not None
            status = operator.hub.file.with_suffix(SUFFIX)
            bench = make_bench(rig)
            with (
                guardian_of(rig, laboratory.root / "guardian.log", status) as guardian,
                chamber_of(plan, bench, laboratory.root / "guardian.log") as chamber,
            ):
                session = session_of(plan, laboratory, operator, guardian, bench, chamber)
                started = operator.wait_for_start()
                operator.steer(session)
                if started or session.ended_early in ("abort", "zero"):
                    for file, _ in failed_before:
                        file.unlink(missing_ok=True)  # it was reported, and somebody said to continue
                    session.run()  # one that was aborted before it began does no step: the output goes to 0 V
                else:
                    how = "declined"
    except IpmclabError as error:
        failed = error
    except Exception as error:
        traceback.print_exc()
        failed = IpmclabError(
            f"{type(error).__name__}: {error}",
            code="fault",
            where="recorder",
            repair=f"this is a fault in ipmclab: please report it with the newest .log in {laboratory.recording}",
        )
    how = how or (session.ended_early if session else None)
    last = ended(session.recorded if session else (), how, failed, session.reason if session else None)
    operator.tell(last)
    return int(last["status"])


def _log_next_to(file: Path) -> Path:
    """Let what nobody expected go to a file: the terminal of whoever started this may be gone long before."""
    log = file.with_suffix(".log")
    stream = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(stream, sys.stderr.fileno())
    os.close(stream)
    return log


def _refuse(error: IpmclabError) -> int:
    """Say why nothing is recorded."""
    status = int(error.exit_status)
    _say({"error": {**error.as_dict(), "exit_status": status}})
    return status


def _say(document: Mapping[str, str | Mapping[str, Any]]) -> None:
    print(json.dumps(document), flush=True)
    # Nobody reads on: what a library prints must not fail on a closed pipe.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
