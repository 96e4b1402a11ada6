"""What is known of the bench, gathered from what its recorder reported: the document that every browser shows."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from ipmclab.page.live.output import ENDINGS, UNSURE, Output
from ipmclab.page.live.words import guard_in_words, in_words
from ipmclab.rig.process.messages import Message

_MOST_NOTES: Final = 60


class State:
    """What a recorder has reported so far. Every method may be called from any thread."""

    def __init__(self) -> None:
        self._at: float | None = None  # when what is taken now was sent
        self._lock = threading.Lock()
        self.version = 0
        """Changes with what happens; readings and progress change only the pulse."""
        self.pulse = 0
        self.generation = 0
        """Counts the runs, so that nobody joins readings of two."""
        self._output = Output()
        self._clear({})
        self._told["bench"] = "idle"

    def _clear(self, about: Mapping[str, Any]) -> None:
        self._told: dict[str, Any] = {
            "bench": "starting",
            "text": "",
            "sample": about.get("sample"),
            "rig": about.get("rig"),
            "experiment": about.get("experiment"),
            "silent": None,
            "plan": None,
            "steps": [],
            "question": None,
            "run": None,
            "progress": None,
            "condition": None,
            "chamber": None,
            "equilibrium": None,
            "ending": None,
            "latest": {},
            "notes": [],
            "recorded": [],
            "ended": None,
        }
        self._step = -1
        self.journal: Path | None = None

    @property
    def bench(self) -> str:
        """What it does, one of the keys of ``words.WORDS``."""
        return str(self._told["bench"])

    @property
    def trouble(self) -> str:
        """What everybody is to know before all else, such as readings that do not come; empty where there is none."""
        with self._lock:
            words = self._in_words()
        return "; ".join(filter(None, (words["alarm"], words["text"]))) if words["trouble"] else ""

    @property
    def run(self) -> dict[str, Any] | None:
        """The run that is being recorded."""
        run: dict[str, Any] | None = self._told["run"]
        return run

    def document(self) -> dict[str, Any]:
        """All of it, as JSON holds it."""
        with self._lock:
            words = {**self._told, "generation": self.generation, "version": self.version}
            for name in ("notes", "recorded", "steps"):
                words[name] = list(words[name])
            words.update(self._in_words())
        return words

    def _in_words(self) -> dict[str, Any]:
        """What the header says, and whether the readings are of now."""
        bench, output, silent = self._told["bench"], self._output, self._told["silent"]
        acted = bench == "recording" and output.guardian == "zero" and output.level != "unsure"
        trouble = output.level == "unsure" or silent is not None or acted
        return {
            "output": output.level,
            "alarm": UNSURE if output.level == "unsure" else "",
            "text": in_words(bench, output, silent, self._told["text"]),
            "guard": guard_in_words(bench, output),
            "trouble": trouble,
            "old": bench != "recording" or trouble,
        }

    def _changed(self, **values: Any) -> None:
        self._told.update(values)
        self.version += 1

    def joined(self, about: Mapping[str, Any], name: str = "") -> None:
        """A recorder was found, by the name of its file."""
        with self._lock:
            self._output.joined(name, about.get("rig"))
            self._clear(about)
            self._changed()

    def lost(self, text: str, *, is_gone: bool) -> None:
        """The recorder's process is gone without a last word, or cannot be reached."""
        with self._lock:
            self._output.lost(is_gone=is_gone)
            self._changed(bench="lost", text=text, question=None, silent=None)
            words = self._in_words()
            self._note("; ".join(filter(None, (words["alarm"], words["text"]))))

    def guarded(self, state: str, text: str = "") -> None:
        """What the recorder's guardian has come to, by its own word."""
        with self._lock:
            if self._output.guarded(state, text):
                self._changed()

    def left(self, found: Mapping[str, tuple[str, str]]) -> None:
        """What the guardians of other recorders have come to: see ``Output.left``."""
        with self._lock:
            if self._output.left(found):
                self._changed()

    def read_nothing(self, seconds: int | None) -> None:
        """So long [s] no reading has come of a run that is given out; None where that is not so."""
        with self._lock:
            if seconds != self._told["silent"]:
                self._changed(silent=seconds)

    def read(self, latest: Mapping[str, float | None]) -> None:
        """The last reading of each channel."""
        with self._lock:
            self._told["latest"] = {**self._told["latest"], **latest}
            self.pulse += 1

    def readings(self) -> dict[str, Any]:
        """The numbers that change all the while, as JSON holds them."""
        with self._lock:
            changing = ("latest", "progress", "chamber", "equilibrium")
            return {"kind": "pulse", **{name: self._told[name] for name in changing}}

    def answered_here(self, number: Any) -> None:
        """A question that was answered from here is shown no more."""
        with self._lock:
            question = self._told["question"]
            if question is not None and question.get("number") == number:
                self._changed(question=None)

    def asked_here(self, how: str) -> None:
        """A recorder that is at work took in that it shall end; that the output is at 0 V only it can say."""
        with self._lock:
            if how in ENDINGS and how != "limit" and self._told["bench"] not in ("idle", "ended", "lost"):
                self._ends(how, at_zero=False)

    def _ends(self, how: str, *, at_zero: bool) -> None:
        before = self._told["ending"] or {"how": how, "at_zero": False}
        how = max(how, before["how"], key=ENDINGS.index)
        self._changed(ending={"how": how, "at_zero": at_zero or before["at_zero"]})

    def _note(self, text: str, passing: bool = False) -> None:
        notes = self._told["notes"]
        if passing and notes and notes[-1]["passing"]:
            notes.pop()
        notes.append({"at": time.time() if self._at is None else self._at, "text": text, "passing": passing})
        del notes[:-_MOST_NOTES]

    def take(self, message: Message) -> None:
        """Something that the recorder reported."""
        taken = _TAKEN_BY.get(message.kind)
        with self._lock:
            self._at = message.at  # whoever comes later hears again what was sent before
            self._output.take(message)
            if taken is not None:
                taken(self, dict(message.values))
            self._at = None

    def _take_plan(self, plan: dict[str, Any]) -> None:
        steps = [{**step, "state": "open"} for step in plan["steps"]]
        self._changed(bench="planned", plan=plan, steps=steps)

    def _take_question(self, question: dict[str, Any]) -> None:
        self._changed(bench="asking", question=question)

    def _take_answer(self, answer: dict[str, Any]) -> None:
        self._note(f"{answer['step']}: {answer['value']}")
        self._changed(bench="preparing", question=None)

    def _take_run(self, run: dict[str, Any]) -> None:
        self.generation += 1
        self.journal = None
        self._changed(bench="recording", run=run, progress=None, latest={}, text="")

    def _take_journal(self, begun: dict[str, Any]) -> None:
        self.journal = Path(begun["journal"])

    def _take_progress(self, progress: dict[str, Any]) -> None:
        self._told["progress"] = progress
        self.pulse += 1

    def _take_condition(self, condition: dict[str, Any]) -> None:
        self._note(f"condition {condition['number']} of {condition['of']}: {condition['name']}")
        self._changed(condition=condition, equilibrium=None)

    def _take_chamber(self, chamber: dict[str, Any]) -> None:
        self._told["chamber"] = chamber
        self.pulse += 1

    def _take_equilibrium(self, equilibrium: dict[str, Any]) -> None:
        self._told["equilibrium"] = None if equilibrium["is_over"] else equilibrium
        self.pulse += 1

    def _take_event(self, event: dict[str, Any]) -> None:
        self._note(f"{event['time']:.2f} s: {event['text']}")
        if event.get("ending") in ENDINGS:
            self._ends(event["ending"], at_zero=True)
        self._changed()

    def _take_note(self, note: dict[str, Any]) -> None:
        self._note(note["text"], bool(note.get("passing")))
        self._changed()

    def _take_recorded(self, recorded: dict[str, Any]) -> None:
        self._told["recorded"].append(recorded)
        self._changed(bench="preparing", run=None, progress=None)

    def _take_step(self, step: dict[str, Any]) -> None:
        steps = self._told["steps"]
        names = [one["name"] for one in steps]
        later = [place for place in range(self._step + 1, len(steps)) if names[place] == step["name"]]
        if later:
            self._step = later[0]
            for place, one in enumerate(steps):
                steps[place] = {**one, "state": "done" if place < self._step else one["state"]}
            steps[self._step] = {**steps[self._step], "state": "now"}
        else:
            self._note(f"{step['name']} once more: {step['text']}")
        self._changed(bench="preparing")

    def _take_end(self, values: dict[str, Any]) -> None:
        error = values.get("error")
        text = error["message"] if error else {"stop": "stopped", "declined": "not begun"}.get(values["how"], "done")
        steps = self._told["steps"]
        if values["how"] == "done":
            steps = [{**one, "state": "done"} for one in steps]
        elif self._step >= 0:
            steps = [*steps[: self._step], {**steps[self._step], "state": "ended"}, *steps[self._step + 1 :]]
        self._note(text)
        gone = dict.fromkeys(("question", "run", "progress", "ending", "condition", "chamber", "equilibrium"))
        self._changed(bench="ended", ended=dict(values), text="", steps=steps, **gone)


_TAKEN_BY: Final[Mapping[str, Callable[[State, dict[str, Any]], None]]] = {
    "plan": State._take_plan,
    "step": State._take_step,
    "question": State._take_question,
    "answered": State._take_answer,
    "run": State._take_run,
    "begun": State._take_journal,
    "progress": State._take_progress,
    "condition": State._take_condition,
    "chamber": State._take_chamber,
    "equilibrium": State._take_equilibrium,
    "event": State._take_event,
    "note": State._take_note,
    "recorded": State._take_recorded,
    "ended": State._take_end,
}
"""What each kind of message changes."""
