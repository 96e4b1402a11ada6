"""The program of a worker: it reads requests from stdin, does one after another, and answers on stdout.

A request is a frame ``{"id", "task", "arguments"}``. ``{"cancel": id}`` takes it back, and ``{"keep": id}`` lets its
task end soon with what it has. Frames of the answer are ``{"id", "progress", "fraction"}``, once with its ``"first"``
answer, and at last ``{"id", "done"}`` with the arrays, ``{"id", "error"}`` or ``{"id", "cancelled"}``.

It ends when stdin does: a server that died leaves no worker behind.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any, BinaryIO, Final

from ipmclab.page.jobs.frames import Frame, pack, read_frame
from ipmclab.platform import own_stdin

_BETWEEN_REPORTS: Final = 0.1
"""Progress is reported at most this often [s]."""


class Cancelled(BaseException):
    """Raised out of a task that nobody wants any more; no task may take it for a failure."""


class _Inbox:
    """What was asked, and what was taken back meanwhile."""

    def __init__(self, stream: BinaryIO) -> None:
        self.requests: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self.taken_back: set[int] = set()
        self.kept: set[int] = set()
        threading.Thread(target=self._listen, args=(stream,), daemon=True).start()

    def _listen(self, stream: BinaryIO) -> None:
        while (frame := read_frame(stream)) is not None:
            if "cancel" in frame.document:
                self.taken_back.add(frame.document["cancel"])
            elif "keep" in frame.document:
                self.kept.add(frame.document["keep"])
            else:
                self.requests.put(frame.document)
        os._exit(0)  # the server is gone: also a computation that asks for no progress ends


def main() -> int:
    """Serve requests until stdin ends."""
    if hasattr(os, "nice") and "--aside" in sys.argv:
        os.nice(10)  # recording and the server go first
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints must not fall between frames
    inbox = _Inbox(own_stdin())
    while True:
        request = inbox.requests.get()
        frame = _answer(request, inbox, out)
        out.write(frame)
        out.flush()


def _answer(request: dict[str, Any], inbox: _Inbox, out: BinaryIO) -> bytes:
    from ipmclab.errors import IpmclabError
    from ipmclab.page.jobs.tasks import find_task

    this = request["id"]
    last = -_BETWEEN_REPORTS
    latest: dict[str, Any] = {}

    def progress(
        sentence: str, fraction: float | None = None, *, first: Sequence[dict[str, Any]] | None = None
    ) -> None:
        nonlocal last, latest
        if this in inbox.taken_back:
            raise Cancelled
        if this in inbox.kept:
            raise KeyboardInterrupt
        now = time.monotonic()
        if first is None:  # else it is as far as it last said
            latest = {"progress": sentence, "fraction": fraction}
        if first is not None or now - last >= _BETWEEN_REPORTS:
            last = now
            out.write(pack({"id": this, **latest} if first is None else {"id": this, **latest, "first": first}))
            out.flush()

    try:
        if this in inbox.taken_back:
            raise Cancelled
        answer: Frame = find_task(request["task"])(request["arguments"], progress)
        return pack({"id": this, "done": answer.document}, answer.arrays)
    except Cancelled:
        return pack({"id": this, "cancelled": True})
    except KeyboardInterrupt:
        return pack({"id": this, "error": _NOT_KEPT} if this in inbox.kept else {"id": this, "cancelled": True})
    except IpmclabError as error:
        return pack({"id": this, "error": {**error.as_dict(), "exit_status": error.exit_status}})
    except Exception as error:
        import traceback

        traceback.print_exc()
        return pack({"id": this, "error": fault(error)})


_NOT_KEPT: Final = {
    "code": "not-kept",
    "message": "this fit could not be kept: it was ended where nothing of it stood",
    "where": "fit",
    "repair": "start it again, and keep it once its first answer is shown",
    "exit_status": 2,
}


def fault(error: Exception) -> dict[str, Any]:
    """What is said of an error that nobody foresaw."""
    return {
        "code": "fault",
        "message": f"{type(error).__name__}: {error}",
        "where": "worker",
        "repair": "this is a fault in ipmclab: nothing was changed; please report it with what you did",
        "exit_status": 1,
    }


if __name__ == "__main__":
    sys.exit(main())
