"""What may be asked of a recording while it runs, from any thread."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Request:
    """Something that was asked for.

    Parameters
    ----------
    kind : "stop", "abort", "zero" or "mark"
    text : str
        Why, or what to note.
    """

    kind: Literal["stop", "abort", "zero", "mark"]
    text: str = ""


class Control:
    """Requests to a recording; it looks at them after each block (every 40 ms at 25 Hz and above).

    Examples
    --------
    >>> control = Control()
    >>> control.mark("fan on")
    >>> control.stop()
    >>> [request.kind for request in control.take()], control.take()
    (['mark', 'stop'], ())
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._requests: list[Request] = []

    def stop(self) -> None:
        """End the run: output to 0 V, the rest after the signal is recorded, and the run is kept as complete."""
        self._ask(Request("stop"))

    def abort(self, reason: str = "aborted by the operator") -> None:
        """End the run at once: output to 0 V, and the run is kept, marked as aborted."""
        self._ask(Request("abort", reason))

    def zero(self, reason: str = "emergency zero by the operator") -> None:
        """Emergency: output to 0 V, the discharge is recorded, and the run is kept, marked as aborted."""
        self._ask(Request("zero", reason))

    def mark(self, text: str) -> None:
        """Note something at this moment of the run."""
        self._ask(Request("mark", text))

    def take(self) -> tuple[Request, ...]:
        """What was asked for since the last call."""
        with self._lock:
            taken, self._requests = tuple(self._requests), []
        return taken

    def _ask(self, request: Request) -> None:
        with self._lock:
            self._requests.append(request)
