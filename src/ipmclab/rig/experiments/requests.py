"""What an operator asks of an experiment while it continues, from any thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Literal

from ipmclab.rig.recording.control import Control

Ending = Literal["stop", "abort", "zero"]


class Requests:
    """How an experiment is to end, and what is to be noted; a run that is being recorded gets it at once."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._control: Control | None = None
        self._marks: list[tuple[float, str]] = []
        self.ending: Ending | None = None
        self.reason = ""

    def is_over(self) -> bool:
        """Whether it was asked to end."""
        return self.ending is not None

    def end(self, how: Ending, reason: str) -> None:
        """End it: the first word counts, but that a stop may become an abort."""
        with self._lock:
            if self.ending is None or (self.ending == "stop" and how != "stop"):
                self.ending, self.reason = how, reason
            control = self._control
        if control is None:
            return
        if how == "stop":
            control.stop()
        elif how == "abort":
            control.abort(reason)
        else:
            control.zero(reason)

    def mark(self, text: str) -> bool:
        """Note something at this moment: whether a run is being recorded, or else the next one will begin with it."""
        with self._lock:
            if self._control is not None:
                self._control.mark(text)
                return True
            self._marks.append((time.monotonic(), text))
        return False

    def begin_run(self) -> Control | None:
        """What ends and marks the run that begins now, with the marks that came before it; None where all is over."""
        with self._lock:
            if self.is_over():
                return None
            self._control = Control()
            for noted, text in self._marks:
                self._control.mark(f"{text} ({time.monotonic() - noted:.0f} s before the run)")
            self._marks.clear()
            return self._control

    def end_run(self) -> None:
        """No run is recorded any more: marks that came too late for it are kept for the next one."""
        with self._lock:
            control, self._control = self._control, None
            if control is not None:
                late = [request.text for request in control.take() if request.kind == "mark"]
                self._marks += [(time.monotonic(), text) for text in late]

    @property
    def unheard(self) -> Sequence[str]:
        """The marks that stand in no run."""
        return [text for _, text in self._marks]
