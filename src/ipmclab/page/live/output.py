"""What is known of the output: at 0 V only where the recorder or its guardian confirmed it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from ipmclab.rig.process.messages import Message

Level = Literal["untouched", "driven", "zero", "unsure"]
"""No voltage was given out yet, one is given out, 0 V is confirmed, or the run is over and nobody has confirmed it."""

UNSURE: Final = "output may not be at 0 V: switch the amplifier off"

ENDINGS: Final = ("stop", "limit", "abort", "zero")
"""How an operator, or a limit, may end a run, what is more urgent later."""

_AT_ZERO: Final = ("zero", "disarmed")
_NOT_ZEROED: Final = "output could not be brought to 0 V"
"""What the bench adds to the failure before which it could not."""

_NOT_READ: Final = "it is not known that the output is at 0 V"
"""What it adds where it could not read the output back."""


_Said = Literal["untouched", "driven", "zero", "over", "gone", "not zero", "not read", "stuck"]

_OWN_WORDS: Final = {
    "not zero": "the recorder could not bring it to 0 V",
    "not read": "the recorder could not read back that it is at 0 V",
}


@dataclass(frozen=True)
class _Doubt:
    """An output that an earlier recorder left, and nobody has confirmed to be at 0 V."""

    rig: str | None
    guardian: str
    why: str
    is_stuck: bool = False


class Output:
    """What the recorder and the guardians reported of the output. Not for several threads at once.

    Examples
    --------
    >>> output = Output()
    >>> output.joined("a.recorder", "rig")
    >>> output.take(Message("begun", {"journal": "x"}))
    >>> output.level
    'driven'
    >>> output.guarded("armed"), output.take(Message("ended", {"how": None, "error": {"code": "bench-frozen"}}))
    (True, None)
    >>> output.level, output.why
    ('unsure', 'the guardian has not said that it is at 0 V')
    >>> output.guarded("zero"), output.level
    (True, 'zero')
    """

    def __init__(self) -> None:
        self.guardian = ""
        """What the guardian of the recorder has come to (``rig/safety/guardian_process.py``); empty without one."""
        self.is_virtual = False
        self._guardian_text = ""
        self._name = ""
        self._rig: str | None = None
        self._said: _Said = "untouched"
        self._doubts: dict[str, _Doubt] = {}
        self._settled: set[tuple[str, str]] = set()

    @property
    def level(self) -> Level:
        """What the output is at, with what earlier recorders left."""
        return "unsure" if self._doubts else self._own

    @property
    def why(self) -> str:
        """Why nobody knows it to be at 0 V; empty where that is known, or not to be."""
        if self._own == "unsure":
            return self._doubt.why
        return next((f"{one.why} (an earlier recorder)" for one in self._doubts.values()), "")

    @property
    def guardian_report(self) -> str:
        """What the guardian has come to that matters most."""
        doubts = [one.guardian for one in self._doubts.values()]
        return self.guardian if self._own == "unsure" or not doubts else doubts[-1]

    def joined(self, name: str, rig: str | None) -> None:
        """Another recorder, by the name of its file, or the same one, which sends everything again."""
        if name != self._name:
            if self._own == "unsure":
                self._doubts[self._name] = self._doubt
            else:
                self._settled.add((self._name, self.guardian))
        self._name, self._rig, self._said, self.is_virtual = name, rig, "untouched", False
        self.guardian = self._guardian_text = ""

    def take(self, message: Message) -> None:
        """Something that the recorder reported."""
        values = message.values
        match message.kind:
            case "plan":
                self.is_virtual = not values.get("rig_proof")
            case "begun":  # the bench was opened, which resets the output
                self._settle(is_stuck=False)
                self._said = "driven"
            case "progress" if self._said == "untouched":
                self._said = "driven"
            case "event" if values.get("ending") in ENDINGS:
                self._said = "zero"
            case "recorded" if self._said in ("driven", "zero"):
                self._said = "zero" if values.get("state") == "complete" else "over"
            case "step" | "question" if self._said == "driven":
                self._said = "over"
            case "ended":
                self._end(values.get("error") or {})
        if self._said != "untouched" and self._own == "zero":
            self._settle(is_stuck=True)

    def _end(self, error: Mapping[str, Any]) -> None:
        code = error.get("code")
        if code == "output-stuck":
            self._said = "stuck"
        elif code == "output-unread" or _NOT_READ in str(error.get("message", "")):
            self._said = "not read"
        elif code == "output-not-zero" or _NOT_ZEROED in str(error.get("message", "")):
            self._said = "not zero"
        elif code == "guardian-lost" and self._said != "untouched":
            self._said = "zero"  # a guardian that is gone says nothing more: the recorder did it, or would say so
        elif self._said == "driven":
            self._said = "over"

    def lost(self, *, is_gone: bool) -> None:
        """The recorder's process is gone without a last word, or cannot be reached and may have begun a run since."""
        if not is_gone and self.guardian not in _AT_ZERO:
            self._said = "driven"
        elif self._own == "driven":
            self._said = "gone"

    def guarded(self, state: str, text: str = "") -> bool:
        """What the recorder's guardian has come to, in its file; whether that is new."""
        before = (self.guardian, self._guardian_text)
        self.guardian, self._guardian_text = state, text
        if self._said != "untouched" and self._own == "zero":
            self._settle(is_stuck=True)
        return before != (state, text)

    def left(self, found: Mapping[str, tuple[str, str]]) -> bool:
        """What guardians of other recorders have come to, by the names of those; whether that changes something."""
        before = dict(self._doubts)
        for name, (state, text) in found.items():
            known = self._doubts.get(name)
            if name == self._name:
                continue
            if state in _AT_ZERO:
                if known is not None and not known.is_stuck:
                    del self._doubts[name]
            elif (name, state) not in self._settled:
                known = known or _Doubt(None, state, "")
                self._doubts[name] = known if known.is_stuck else replace(known, guardian=state, why=_why(state, text))
        return before != self._doubts

    @property
    def _own(self) -> Level:
        """What the output of the recorder that is followed, or was last, is at."""
        guardian, said = self.guardian, self._said
        if said == "stuck" or guardian in ("failed", "unread"):
            return "unsure"
        if guardian == "zero":
            return "zero"
        match said:
            case "untouched":
                return "driven" if guardian == "armed" else "untouched"
            case "driven" | "zero":
                return said
            case "over":
                return "zero" if guardian in ("", "disarmed") else "unsure"
            case "gone":
                return "zero" if guardian == "disarmed" or self.is_virtual else "unsure"
        return "unsure"

    @property
    def _doubt(self) -> _Doubt:
        if self._said == "stuck":
            why = "a voltage is still read, although 0 V was given out"
        elif self._said in _OWN_WORDS and self.guardian not in ("failed", "unread", "armed"):
            why = _OWN_WORDS[self._said]
        else:
            why = _why(self.guardian, self._guardian_text)
        return _Doubt(self._rig, self.guardian, why, self._said == "stuck")

    def _settle(self, *, is_stuck: bool) -> None:
        """This recorder had the output of its rig at 0 V; where a voltage still was read, that takes a whole run."""
        if self.is_virtual:
            return
        for name, one in list(self._doubts.items()):
            if one.rig in (None, self._rig) and (is_stuck or not one.is_stuck):
                self._settled.add((name, one.guardian))
                del self._doubts[name]


def _why(guardian: str, text: str) -> str:
    match guardian:
        case "unread":
            return f"the guardian reset it, but could not read it back ({text})"
        case "failed":
            return f"the guardian could not bring it to 0 V so far ({text})"
        case "":
            return "no guardian was watching it"
    return "the guardian has not said that it is at 0 V"
