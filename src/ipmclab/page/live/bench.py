"""The bench as the page has it: the recorder that is followed, who holds it, and what may be asked of it."""

from __future__ import annotations

import time
from typing import Any, Final

from ipmclab.errors import IpmclabError
from ipmclab.page.lab import Lab
from ipmclab.page.live.follower import Follower
from ipmclab.page.live.seats import Seats

RIGHT: Final = 10.0
"""How long [s] after the page was started again in mid-run only who held the bench before may take it."""

OPERATOR_ONLY: Final = ("start", "stop", "abort", "mark", "answer")
"""What only the operator may ask for. Anybody may bring the output to 0 V."""


class Bench:
    """The bench of a lab.

    Parameters
    ----------
    lab : Lab
    recorder : str
        The program of the recorder's process.
    right : float [s]
        How long a bench that runs when the page begins is kept for who says that it was theirs.
    """

    def __init__(self, lab: Lab, recorder: str, right: float = RIGHT) -> None:
        self.follower = Follower(lambda: lab.laboratory_folder)
        self.seats = Seats()
        self._recorder = recorder
        self._right = right
        self._until = 0.0

    def start(self) -> None:
        """The page listens from now on: look for recorders, and let who held the bench come back."""
        self._until = time.monotonic() + self._right
        self.follower.start()

    def take(self, seat: str, *, again: bool = False) -> None:
        """Let a browser hold the bench; ``again`` where it did before the page was started again.

        Raises
        ------
        IpmclabError
            Another one does, or may.
        """
        follower = self.follower
        if not again and self.seats.is_new and time.monotonic() < self._until and follower.may_drive:
            raise IpmclabError(
                "the page was started again: who held the bench may take it again first",
                code="bench-kept",
                where="bench",
                repair=f"try again in {RIGHT:g} s; STOP and ZERO work for everybody",
            )
        self.seats.take(seat)

    def prepare(self, seat: str, job: dict[str, Any]) -> None:
        """Start a recorder for an experiment; it plans, and waits for the start.

        Raises
        ------
        InputError, IpmclabError
            Somebody else holds the bench, something runs at it, or what the recorder refuses.
        """
        self.take(seat)
        self.follower.launch(self._recorder, {"yes": False, "plan": False, "interactive": True, "answers": {}, **job})

    def ask(self, seat: str, what: str, **values: Any) -> str:
        """Ask the recorder for something; what came of it, in words. May take long where it hangs.

        Raises
        ------
        IpmclabError
            It is not for this browser to ask, or no recorder is there.
        """
        taken = what in OPERATOR_ONLY and not self.seats.holds(seat)
        if taken:
            # It is free, or this says whose it is. Who ends a run does not wait for who held the bench.
            self.take(seat, again=what in ("stop", "abort"))
        if what == "zero" and self.seats.held and not self.seats.holds(seat):
            values["text"] = "emergency zero by somebody who watched the page"
        if not self._reached(what, **values):
            if taken:
                self.seats.release(seat)
            if self.follower.may_drive:
                raise IpmclabError(
                    "the recorder at the bench cannot be reached, and may be driving the output",
                    code="recorder-unreached",
                    where="bench",
                    repair="switch the amplifier off if in doubt; its record is kept",
                )
            if trouble := self.follower.state.trouble:
                raise IpmclabError(
                    f"no recorder is at the bench that could do it; {trouble}",
                    code="output-unsure",
                    where="bench",
                    repair="guardian.log in the laboratory folder says what the guardian tries",
                )
            raise IpmclabError(
                "no recorder is at the bench, so nothing drives the output from here",
                code="no-recorder",
                where="bench",
                repair="if the strip is driven all the same, switch its amplifier off",
            )
        trouble = self.follower.state.trouble
        return f"asked of the recorder; {trouble}" if trouble else _SAID.get(what, "")

    def _reached(self, what: str, **values: Any) -> bool:
        """Whether the recorder took a request in, joined again where that must be: STOP and ZERO do not wait for it."""
        if self.follower.request(what, **values):
            return True
        self.follower.reach()
        return self.follower.request(what, **values)

    def document(self, seat: str) -> dict[str, Any]:
        """What a browser gets."""
        document = self.follower.state.document()
        plan = document["plan"] or {}
        return {
            "kind": "state",
            **document,
            "rig_is_virtual": bool(plan) and not plan.get("rig_proof"),
            "mine": self.seats.holds(seat),
            "held": self.seats.held,
            "watching": self.seats.watching,
        }


_SAID: Final = {
    "start": "started",
    "stop": "stopping: what was recorded is kept",
    "abort": "aborting: what was recorded is kept, marked as aborted",
    "zero": "output to 0 V: asked of the recorder",
    "mark": "marked",
}
