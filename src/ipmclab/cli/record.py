"""``ipmclab record``: an experiment, from the strip to its run files."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.options import Answer, Json, Yes, answers_in
from ipmclab.cli.output import print_json
from ipmclab.cli.record_view import View, files_typed, print_plan, print_results, short
from ipmclab.errors import INTERRUPTED, InputError, IpmclabError
from ipmclab.platform import as_typed
from ipmclab.toml_file import parse_table, read_text

if TYPE_CHECKING:
    from ipmclab.rig.process.client import Recorder
    from ipmclab.rig.process.messages import Message

RECORDER: Final = "ipmclab.cli.recorder"
"""The program of the recorder's own process."""

_LOOK: Final = 0.05
"""How often [s] keys and signals are looked at."""

_ALONE: Final = 0.3
"""A letter ends an experiment only where no other key came so long [s] before and after it: else it was typed text."""


def record(
    experiment: Annotated[
        Path | None,
        typer.Argument(metavar="EXPERIMENT", help="An experiment file (.toml).", show_default=False),
    ] = None,
    yes: Yes = False,
    answer: Answer = None,
    answers: Annotated[
        Path | None, typer.Option(metavar="FILE", help='Answers in a TOML file: a line STEP = "VALUE" each.')
    ] = None,
    pair: Annotated[bool, typer.Option("--pair", help="Each signal with both polarities.")] = False,
    repeats: Annotated[int | None, typer.Option(metavar="N", help="How often each signal is recorded.")] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Print what would happen, and do nothing.")] = False,
    attach: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Join a recording that runs in this laboratory folder (or a FILE.recorder of it)."
        ),
    ] = None,
    template: Annotated[bool, typer.Option("--template", help="Print an experiment file to start from.")] = False,
    as_json: Json = False,
) -> None:
    """Record an experiment: prepare the strip, apply its signals, keep every row.

    The recording runs in a process of its own. A terminal that closes does not end it: join it again with --attach.
    In a terminal: s stops and keeps, a aborts, z brings the output to 0 V now, m adds a mark. Ctrl-C stops and keeps.

    \b
    ipmclab record step.toml
    """
    if template:
        from ipmclab.rig.experiments.experiment_file import TEMPLATE

        if as_json:
            print_json({"template": TEMPLATE})
        else:
            print(TEMPLATE, end="")
        return
    keys = sys.stdin.isatty() and sys.stderr.isatty()
    view = View(quiet=as_json, keys=keys)
    if attach is not None:
        if experiment is not None or answer or answers or pair or plan or repeats is not None:
            raise InputError(
                "--attach joins a recording and begins none: no other option has an effect with it",
                code="usage",
                where="--attach",
                repair="leave the rest away; or leave --attach away to begin another",
            )
        from ipmclab.rig.process.aftermath import failures
        from ipmclab.rig.process.client import attach as attach_to
        from ipmclab.rig.process.client import others

        for _, text in failures(attach.parent.parent if attach.is_file() else attach):
            print(text, file=sys.stderr)
        recorder = attach_to(attach)
        if attach.is_dir() and (also := others(recorder)):
            about = recorder.about
            print(f"joined the newest: sample {about.get('sample')} on {about.get('rig')}", file=sys.stderr)
            for file, text in also:
                place = as_typed(short(str(file)))
                print(f"also recording here: {text}: ipmclab record --attach {place}", file=sys.stderr)
    elif experiment is None:
        raise InputError(
            "no experiment is named",
            code="usage",
            where="record",
            repair="ipmclab record EXPERIMENT.toml; ipmclab record --template prints one to start from",
        )
    else:
        if repeats is not None:
            from ipmclab.rig.experiments.experiment import MOST_REPEATS

            if not 1 <= repeats <= MOST_REPEATS:
                repair = f"give 1 to {MOST_REPEATS}"
                raise InputError(f"{repeats} repeats", code="out-of-range", where="--repeats", repair=repair)
        from ipmclab.rig.process.client import launch

        job = {
            "experiment": str(experiment),
            "answers": _answers(answer or [], answers),
            "yes": yes or plan,
            "plan": plan,
            "interactive": keys,
            "pair": True if pair else None,
            "repeats": repeats,
        }
        recorder = launch(RECORDER, job)
    terminal = Terminal(recorder, view, ask_first=keys and not yes, plan_only=plan, joined=attach is not None)
    try:
        last = terminal.follow()
    finally:
        view.close()
        recorder.close()
    _finish(terminal, last, as_json)


def _answers(pairs: list[str], file: Path | None) -> dict[str, str]:
    """The answers of the command line, after those of a file."""
    found: dict[str, str] = {}
    if file is not None:
        missing = InputError("no such file", code="no-such-file", where=str(file), repair="see where it was written")
        text = read_text(file, kind="a file of answers", missing=missing)
        for name, value in parse_table(text, where=str(file), repair='write lines such as clamp = "done"').items():
            if not isinstance(value, str):
                raise InputError(
                    f"{value!r} is not a text", code="bad-value", where=f"{file}: {name}", repair="write it in quotes"
                )
            found[name] = value
    return found | answers_in(pairs, example="clamp=done")


class Terminal:
    """The terminal as a client of the recorder: what it shows, what it reads, what its signals mean."""

    def __init__(self, recorder: Recorder, view: View, *, ask_first: bool, plan_only: bool, joined: bool) -> None:
        self._recorder = recorder
        self._view = view
        self._ask_first = ask_first
        self.plan_only = plan_only
        self._joined = joined
        self._signals: list[str] = []
        self._interrupts = 0
        self._question: dict[str, Any] | None = None
        self._unanswerable: dict[str, Any] | None = None
        self._reads_keys = sys.stdin.isatty()
        self._typed: str | None = None
        self._typed_since = 0.0
        self._started = joined
        self._last_key, self._last_letter = -math.inf, ""
        self._pressed = ("", math.inf)
        self.interrupted = False
        self.plan: dict[str, Any] | None = None

    def follow(self) -> Message:
        """Show what happens until it ends, and hand on what is typed.

        Raises
        ------
        IpmclabError
            The recorder's process is gone.
        """
        from ipmclab.platform import key_pressed, single_keys

        reads_keys = self._reads_keys
        before = self._catch_signals()
        self._recorder.request("subscribe", blocks=sys.stderr.isatty(), answers=reads_keys)
        try:
            with single_keys() if reads_keys else nullcontext():
                while True:
                    message = self._recorder.next(_LOOK)
                    if message is not None:
                        if message.kind == "ended":
                            return message
                        self._take(message)
                    elif self._unanswerable is not None:  # and no answer to it was behind it
                        self._leave_question(self._unanswerable)
                    while reads_keys and (key := key_pressed(0.0)):
                        self._key(key)
                        while key == "\x1b" and key_pressed(0.0):
                            pass  # what an arrow key sends after it: the last letter of one is an A
                    self._obey_key()
                    self._obey_signals()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _take(self, message: Message) -> None:
        values = dict(message.values)
        match message.kind:
            case "plan":
                self.plan = values
                print_plan(values, self._view)
                if self._joined:
                    return
                if self.plan_only:
                    return
                if self._ask_first:
                    self._put({"step": "start", "text": "begin?", "choices": ["yes", "no"], "default": "yes"})
                else:
                    self._started = True
                    self._recorder.request("start")
            case "question" if not self._reads_keys:
                self._unanswerable = values
            case "question":
                self._put(values)
            case "answered":
                self._unanswerable = None
                if self._question is not None and self._question.get("number") == values["number"]:
                    self._question = self._typed = None
                self._view.say(f"{values['step']}: {values['value']} (answered {values['by']})")
            case _:
                self._view.show(message)

    def _put(self, question: dict[str, Any]) -> None:
        """Show a question; what is typed from now on is its answer."""
        self._view.close()
        self._question = question
        self._typed = ""
        self._view.say(f"{question['step']}: {question['text']}")
        ways = [*question["choices"], *([f"such as {question['example']}"] if question.get("example") else [])]
        self._view.write(f"  {'/'.join(ways)} [{question['default']}] ")

    def _leave_question(self, question: dict[str, Any]) -> None:
        """Say that an open question is for another client: here is nobody to type an answer."""
        self._unanswerable = None
        self._view.close()
        folder = as_typed(self._recorder.file.parent.parent)
        text = f"{question['step']}: {question['text']}: this question cannot be answered here (no terminal)"
        print(f"{text}; ipmclab record --attach {folder} in a terminal can", file=sys.stderr)

    def _key(self, key: str) -> None:
        """What a key means: typed for a prompt, or a letter that steers.

        What was typed before there was anything to steer, or is a word for the next prompt or the shell, stops and
        aborts nothing. The same letter once more acts at once.
        """
        if self._typed is not None:
            self._type(key)
            return
        now, letter = time.monotonic(), key.lower()
        alone = now - self._last_key > _ALONE
        again = letter == self._last_letter  # who presses a key again and again means it
        self._last_key, self._last_letter, self._pressed = now, letter, ("", math.inf)
        match letter:
            case "s" if (alone or again) and self._started:
                self._pressed = ("stop", now if again else now + _ALONE)
            case "a" if (alone or again) and self._started:
                self._pressed = ("abort", now if again else now + _ALONE)
            case "z":
                self._recorder.request("zero")
            case "m":
                self._view.close()
                self._typed, self._typed_since = "", now
                self._view.write("  mark: ")

    def _obey_key(self) -> None:
        """Ask for what a letter means that stayed alone."""
        what, due = self._pressed
        if time.monotonic() >= due:
            self._pressed = ("", math.inf)
            self._recorder.request(what)

    def _type(self, key: str) -> None:
        assert self._typed is not None
        self._last_key = -math.inf  # a letter after a prompt belongs to none
        if key in ("\r", "\n"):
            typed, self._typed = self._typed.strip(), None
            self._view.write("\n")
            self._enter(typed)
        elif key == "\x04" and self._question is not None:
            self._signals.append("SIGINT")  # Ctrl-D, the end of what is typed: as Ctrl-C
        elif key in ("\x1b", "\x04"):
            self._leave_mark()
        elif key in ("\x7f", "\b"):
            if self._typed:
                self._typed = self._typed[:-1]
                self._view.write("\b \b")
        elif key.isprintable():
            self._typed += key
            self._view.write(key)

    def _leave_mark(self) -> None:
        """Escape or Ctrl-D: no mark. Escape leaves a question as it is."""
        if self._question is None:
            self._typed = None
            self._view.write(" (no mark)\n")

    def _enter(self, typed: str) -> None:
        question, self._question = self._question, None
        if question is None:
            ago = time.monotonic() - self._typed_since
            late = f" ({ago:.1f} s earlier)" if ago > 1.0 else ""
            self._recorder.request("mark", text=(typed or "mark") + late)
            return
        value = typed or question["default"]
        near = [choice for choice in question["choices"] if choice.startswith(value.lower())]
        if len(near) != 1 and question.get("example"):  # the recorder says where it cannot be read
            self._question, self._typed = question, ""
            self._recorder.request("answer", number=question["number"], value=value)
        elif len(near) != 1:
            self._view.say(f"  {value!r} is none of {', '.join(question['choices'])}")
            self._put(question)
        elif question["step"] == "start":
            self._started = near[0] == "yes"
            self._recorder.request("start" if self._started else "stop")
        else:
            self._recorder.request("answer", number=question["number"], value=near[0])

    def _catch_signals(self) -> dict[int, Any]:
        """Let signals be looked at between two messages: what they mean is asked of the recorder."""

        def note(number: int, _frame: object) -> None:
            self._signals.append(signal.Signals(number).name)

        before: dict[int, Any] = {}
        for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
            number = getattr(signal, name, None)
            if number is not None:
                before[number] = signal.signal(number, note)
        return before

    def _obey_signals(self) -> None:
        while self._signals:
            name = self._signals.pop(0)
            if name in ("SIGHUP", "SIGBREAK"):
                # The terminal is gone. The run continues, guarded; --attach joins it.
                os._exit(0)
            self._interrupts += 1
            self.interrupted = True
            if self._interrupts == 1:
                self._view.say("  stopping; what was recorded is kept (once more: abort)")
                self._recorder.request("stop")
            else:
                self._recorder.request("abort")


def _finish(terminal: Terminal, last: Message, as_json: bool) -> None:
    """Say what came of it, and leave with its status."""
    from ipmclab.rig.process.client import error_from

    values = dict(last.values)
    error: IpmclabError | None = error_from(values["error"]) if values["error"] is not None else None
    document: dict[str, Any] = {"how": values["how"], "plan": terminal.plan, "runs": values["runs"]}
    if as_json:
        print_json(document if error is None else {"error": error.as_dict(), **document})
    else:
        print_results(values["runs"])
        if values["how"] in ("stop", "declined") and not values["runs"] and error is None and not terminal.plan_only:
            print("stopped; nothing was recorded")
    if error is not None:
        if as_json:
            print(f"error: {error}", file=sys.stderr)
            raise typer.Exit(error.exit_status)
        raise error
    if not as_json and values["runs"]:
        kept = [run["path"] for run in values["runs"] if run["purpose"] != "fingerprint"]
        print(f"next: ipmclab check {' '.join(files_typed(kept))}")
    if terminal.interrupted:
        raise SystemExit(INTERRUPTED)
