"""The recorder's own process: bench, guard and journal live here, and every client only talks to it.

A terminal that closes and a page that is reloaded are clients that left: the run continues, guarded, and who comes
later joins it. A signal of the system (SIGINT, SIGTERM, SIGHUP, Ctrl-Break) ends the run at once with the output at 0
V.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any, Final, Protocol

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.experiments.archive import Recorded
from ipmclab.rig.experiments.steps import Question
from ipmclab.rig.process.hub import Hub
from ipmclab.rig.process.messages import Message

PATIENCE: Final = 600.0
"""How long [s] a question, or the start, waits while no client is there that could answer."""

_LOOK: Final = 0.1
"""How often [s] a waiting recorder looks whether it is still to wait."""

FAILED: Final = 1
"""Status of an experiment that was aborted, as of a job that ran and failed."""


class Steered(Protocol):
    """What requests act upon: see ``session.Session``."""

    def stop(self) -> None:
        """End the run and keep it."""

    def abort(self, reason: str = ...) -> None:
        """End the run, kept as aborted."""

    def zero(self, reason: str = ...) -> None:
        """Output to 0 V now."""

    def mark(self, text: str) -> None:
        """Note something."""


class ClientOperator:
    """Answers questions from what was given beforehand, else from whichever client answers first.

    Parameters
    ----------
    patience : float [s]
        How long to wait while no client is there that could answer.
    """

    def __init__(self, patience: float = PATIENCE) -> None:
        self._answers: dict[str, str] = {}
        self._patience = patience
        self._changed = threading.Condition()
        self._asked = 0
        self._open: Question | None = None
        self._answer: str | None = None
        self._started = False
        self._steered: Steered | None = None
        self._before: list[tuple[str, str]] = []
        self.hub: Hub | None = None
        self.unattended = False

    def answer_beforehand(self, answers: Mapping[str, str]) -> None:
        """Give answers to steps that are going to ask."""
        self._answers.update(answers)

    def tell(self, message: Message) -> None:
        """Send to all clients."""
        if self.hub is not None:
            self.hub.tell(message)

    def steer(self, steered: Steered) -> None:
        """Let requests act upon a session from now on, and first those that came before it was there."""
        with self._changed:
            self._steered = steered
            for kind, text in self._before:
                _act(steered, kind, text)
            self._before.clear()

    def on_request(self, request: Message) -> None:
        """What a client asks for, in its thread."""
        # What UTF-8 cannot hold, half a surrogate pair, would make a run that can neither be written nor recovered.
        values = {
            name: value.encode("utf-8", "replace").decode() if isinstance(value, str) else value
            for name, value in request.values.items()
        }
        request = Message(request.kind, values)
        text = str(values.get("text", "")).encode("utf-8", "replace").decode()
        match request.kind:
            case "start":
                with self._changed:
                    self._started = True
                    self._changed.notify_all()
            case "answer":
                self._take_answer(request)
            case "mark" | "stop" | "abort" | "zero" as kind:
                self.end(kind, text)

    def end(self, kind: str, text: str = "") -> None:
        """End what is going on, or what would begin; a mark ends nothing.

        Nothing is lost between two states: what comes before there is a session is handed to it by ``steer``.
        """
        with self._changed:
            if self._steered is None:
                self._before.append((kind, text))
            else:
                _act(self._steered, kind, text)
            self._changed.notify_all()

    def wait_for_start(self) -> bool:
        """Whether a client agrees to the plan; False when it is declined, or nobody is there to agree."""
        since = time.monotonic()
        with self._changed:
            while not self._started and not self._is_ended_before():
                self._changed.wait(_LOOK)
                if self._alone_too_long(since):
                    return False
            return not self._is_ended_before()

    def _is_ended_before(self) -> bool:
        return any(kind != "mark" for kind, _ in self._before)

    def ask(self, question: Question, ended: Callable[[], bool]) -> str:
        """The answer to a question: see ``Operator.ask``."""
        known = self._answers.get(question.step)
        if question.again and known is not None and self.unattended:
            raise IpmclabError(
                f"{question.step!r} is asked once more, and the answer {known!r} that was given beforehand counts once",
                code="nobody-answers",
                where=question.step,
                repair="record it in a terminal, where an operator answers",
            )
        if question.again:
            known = None
        with self._changed:
            self._asked += 1
            number = self._asked
            self._open, self._answer = question, None
        about = {"text": question.text, "choices": list(question.choices), "default": question.default}
        about |= {"example": question.example} if question.example else {}
        if known is None:
            self.tell(Message("question", {"number": number, "step": question.step, **about}))
        since = time.monotonic()
        with self._changed:
            while known is None and not self._is_answered() and not ended():
                self._changed.wait(_LOOK)
                if self._alone_too_long(since):
                    raise IpmclabError(
                        f"{question.step!r} waits for an answer, and nobody has been there for {self._patience:g} s",
                        code="nobody-answers",
                        where=question.step,
                        repair="give the answer beforehand: --answer STEP=VALUE, or --yes",
                    )
            value = known if known is not None else self._answer
            self._open = None
        if value is None:
            return question.default  # it has ended: nobody looks at this any more
        answer = question.check(value)
        by = "beforehand" if known is not None else "here"
        self.tell(Message("answered", {"number": number, "step": question.step, "value": answer, "by": by}))
        return answer

    def _is_answered(self) -> bool:
        return self._answer is not None

    def _take_answer(self, request: Message) -> None:
        with self._changed:
            if self._open is None or request.values.get("number") != self._asked or self._answer is not None:
                return  # another client was quicker
            try:
                self._answer = self._open.check(str(request.values.get("value", "")))
            except InputError as error:
                note: Message | None = Message("note", {"text": str(error), "passing": True})
            else:
                note = None
            self._changed.notify_all()
        if note is not None:
            self.tell(note)

    def _alone_too_long(self, since: float) -> bool:
        """Whether nobody who could answer has been there for too long, counted from the question at the earliest."""
        if self.hub is None or self.hub.answerers:
            return False
        return time.monotonic() - max(self.hub.alone_since, since) > self._patience


def _act(steered: Steered, kind: str, text: str) -> None:
    """Ask a session for what a client, or the system, wants."""
    match kind:
        case "mark":
            steered.mark(text)
        case "stop":
            steered.stop()
        case "zero":
            steered.zero(text or "emergency zero by the operator")
        case _:
            steered.abort(text or "aborted by the operator")


def end_on_signals(operator: ClientOperator) -> None:
    """Let every signal that ends a process end the run first, with the output at 0 V. Of the main thread."""

    def on_signal(number: int, _frame: FrameType | None) -> None:
        reason = f"the recorder was asked to end ({signal.Signals(number).name})"
        # Not here: the main thread may hold a lock that this needs.
        threading.Thread(target=operator.end, args=("abort", reason), daemon=True).start()

    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), on_signal)


def ended(
    recorded: tuple[Recorded, ...], how: str | None, error: IpmclabError | None, why: str | None = None
) -> Message:
    """The last message of an experiment.

    Parameters
    ----------
    recorded : tuple of Recorded
    how : "stop", "abort", "zero" or "declined", optional
        As the operator, or the guard, ended it before its last step. The message has ``"done"`` where nobody did,
        and None where it was refused or failed.
    error : IpmclabError, optional
        What failed.
    why : str, optional
        It was aborted, where no run says it.
    """
    status = 0
    document = None
    if error is not None:
        status = FAILED if recorded else error.exit_status  # what was refused has recorded nothing
        document = {**error.as_dict(), "exit_status": status}
    elif how in ("abort", "zero") or any(run.state == "aborted" for run in recorded):
        status = FAILED
        reason = next((run.state_reason for run in reversed(recorded) if run.state == "aborted"), None)
        document = {
            "message": reason or why or "aborted by the operator",
            "code": "aborted",
            "where": "record",
            "repair": "what was recorded is kept, marked as aborted" if recorded else "nothing was recorded",
            "exit_status": FAILED,
        }
    values: dict[str, Any] = {
        "status": status,
        "how": how or ("done" if document is None else None),
        "error": document,
        "runs": [run.as_dict() for run in recorded],
    }
    return Message("ended", values)
