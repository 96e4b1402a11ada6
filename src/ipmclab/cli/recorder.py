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
    from ipmclab.rig.channels import Rig
    from ipmclab.rig.experiments.desk import Desk
    from ipmclab.rig.experiments.experiment import Experiment
    from ipmclab.rig.experiments.plan import Plan
    from ipmclab.rig.experiments.session import Session
    from ipmclab.rig.process.server import ClientDesk
    from ipmclab.rig.recording.recording import Heartbeat
    from ipmclab.store.journal.laboratory import Laboratory

FIRST_CLIENT: Final = 10.0
"""How long [s] a recorder that has ended waits for its first client."""


def main() -> int:
    """Do one experiment."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from ipmclab.errors import IpmclabError
    from ipmclab.rig.process.client import forget_dead_recorders
    from ipmclab.rig.process.hub import Hub
    from ipmclab.rig.process.server import ClientDesk, end_on_signals
    from ipmclab.store.journal.laboratory import Laboratory

    job = json.load(sys.stdin)
    desk = ClientDesk()
    desk.unattended = not job["interactive"]
    try:
        experiment = read_experiment(job)
        rig = rig_of(experiment)
        laboratory = Laboratory.open(experiment.folder)
        forget_dead_recorders(laboratory.root)
        about = {"sample": experiment.sample.id, "rig": rig.name, "experiment": experiment.where}
        hub = desk.hub = Hub(laboratory.recording, desk.on_request, about)
        log = _log_beside(hub.file)
    except IpmclabError as error:
        _say({"error": {**error.as_dict(), "exit_status": error.exit_status}})
        return error.exit_status
    end_on_signals(desk)
    _say({"file": str(hub.file)})
    try:
        return _record(job, experiment, rig, laboratory, desk)
    finally:
        # Whoever started this is about to come: it must not be gone before it was heard.
        hub.had_clients.wait(FIRST_CLIENT)
        hub.close()
        sys.stderr.flush()
        with contextlib.suppress(OSError):
            if not log.stat().st_size:
                log.unlink()


def read_experiment(job: Mapping[str, Any]) -> Experiment:
    """The experiment of a job, with what its command line changes."""
    from ipmclab.rig.experiments.experiment import load_experiment

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
            repair='name a rig file beside the experiment, or "virtual" for the rig that needs no hardware',
        )
    rig = load_rig(experiment.rig)
    if isinstance(experiment.rig, str) and experiment.actuator is not None:
        rig = replace(rig, virtual=replace(rig.virtual, actuator=experiment.actuator))
    return rig


def plan_of(experiment: Experiment, rig: Rig, laboratory: Laboratory) -> Plan:
    """What an experiment is going to do.

    Raises
    ------
    InputError
        What cannot be done.
    """
    from ipmclab import load_actuator
    from ipmclab.rig.checks.proof import proof_of
    from ipmclab.rig.experiments.plan import make_plan

    named = experiment.actuator or (rig.virtual.actuator if rig.bench == "virtual" else None)
    return make_plan(
        experiment,
        rig,
        bytes_free=laboratory.free_space(),
        actuator=load_actuator(named) if named else None,
        rig_proof=proof_of(rig, experiment.rig) if rig.bench == "ni" else "",
    )


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
    known = {step.name: step.question.default for step in plan.steps if step.question is not None}
    if job["yes"]:
        if plan.rig.bench != "virtual" and "zero" in known:
            known["zero"] = "skip"  # nobody has said that the tip is clear of the load cell
        return {FINGERPRINT.step: FINGERPRINT.default, **known, **given}
    if plan.rig.bench == "virtual":
        return {**known, **given}  # its hands are simulated too
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
    """Make runs of what an earlier crash left in the folder, and tell what became of it."""
    from ipmclab.store.catalogue.catalogue import Catalogue, safely
    from ipmclab.store.journal.recover import recover

    recovery = recover(laboratory)
    for finished in recovery.finished:
        if finished.outcome == "run":
            yield f"{finished.state} from an earlier crash: {finished.path}, {finished.rows} rows"
            safely(partial(Catalogue(laboratory.root).add, finished.path))
    for path, error in recovery.failed:
        yield f"{path} could not be recovered: {error}"


def session_of(plan: Plan, laboratory: Laboratory, desk: Desk, guardian: Heartbeat | None) -> Session:
    """The session of a plan, with its bench."""
    from ipmclab.cli.benches import make_bench
    from ipmclab.rig.experiments.earlier import earlier_runs
    from ipmclab.rig.experiments.fingerprint import inspect
    from ipmclab.rig.experiments.session import Session

    return Session(
        plan,
        make_bench(plan.rig),
        laboratory,
        desk,
        inspect=inspect,
        earlier=partial(earlier_runs, laboratory),
        guardian=guardian,
    )


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


def _record(job: Mapping[str, Any], experiment: Experiment, rig: Rig, laboratory: Laboratory, desk: ClientDesk) -> int:
    """Plan, wait for the word to start, do it, and tell how it ended."""
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
            desk.tell(Message("note", {"text": text, "passing": False}))
        for text in recover_first(laboratory):
            desk.tell(Message("note", {"text": text, "passing": False}))
        plan = plan_of(experiment, rig, laboratory)
        desk.answer_beforehand(answers_of(job, plan))
        desk.tell(Message("plan", plan.as_dict()))
        if job.get("plan"):
            how = "declined"
        else:
            # While the plan is being read: the guardian, and what drives the bench, take a moment to be ready.
            assert desk.hub is not None
            status = desk.hub.file.with_suffix(SUFFIX)
            with guardian_of(rig, laboratory.root / "guardian.log", status) as guardian:
                session = session_of(plan, laboratory, desk, guardian)
                started = desk.wait_for_start()
                desk.steer(session)
                if started or session.ended_early in ("abort", "zero"):
                    for file, _ in failed_before:
                        file.unlink(missing_ok=True)  # it was told, and somebody said to go on
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
    desk.tell(last)
    return int(last["status"])


def _log_beside(file: Path) -> Path:
    """Let what nobody expected go to a file: the terminal of whoever started this may be gone long before."""
    log = file.with_suffix(".log")
    stream = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(stream, sys.stderr.fileno())
    os.close(stream)
    return log


def _say(document: Mapping[str, str | Mapping[str, Any]]) -> None:
    print(json.dumps(document), flush=True)
    # Nobody reads on: what a library prints must not fail on a closed pipe.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
