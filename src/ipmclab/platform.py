"""What differs between systems, in one place: every Unix call beside its Windows twin."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def detached() -> dict[str, Any]:
    """What ``subprocess.Popen`` needs for a process that a closing terminal and its Ctrl-C do not reach."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
    else:  # noqa: RET505  # a checker for the other system finds code after a return unreachable
        return {"start_new_session": True}


def write_for_owner_only(path: Path, text: str) -> None:
    """Write a small file that no other user can read.

    Raises
    ------
    OSError
        Also when the file exists.
    """
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
        if sys.platform == "win32":
            # The mode above means nothing there: take the inherited rights away and leave the owner his.
            user = os.environ.get("USERNAME", "")
            command = ["icacls", str(path), "/inheritance:r", "/grant:r", f"{user}:F"]
            subprocess.run(command, check=True, capture_output=True, creationflags=subprocess.CREATE_NO_WINDOW)
        stream.write(text)


if sys.platform == "win32":
    import msvcrt
    import time

    @contextmanager
    def single_keys() -> Iterator[None]:
        """Let ``key_pressed`` see each key of the terminal at once, without Enter and without echo."""
        yield

    def key_pressed(within: float) -> str:
        """The key that was pressed within so many seconds, or nothing."""
        until = time.monotonic() + within
        while not msvcrt.kbhit():
            if time.monotonic() >= until:
                return ""
            time.sleep(0.02)
        return msvcrt.getwch()

else:
    import select

    @contextmanager
    def single_keys() -> Iterator[None]:
        """Let ``key_pressed`` see each key of the terminal at once, without Enter and without echo."""
        import termios  # noqa: TID251
        import tty

        if not sys.stdin.isatty():
            yield
            return
        before = termios.tcgetattr(sys.stdin)
        try:
            tty.setcbreak(sys.stdin)  # Ctrl-C stays what it is
            yield
        finally:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)

    def key_pressed(within: float) -> str:
        """The key that was pressed within so many seconds, or nothing."""
        # Below the buffer of sys.stdin, which would take more than one key and hide them from the next look.
        ready, _, _ = select.select([sys.stdin.fileno()], [], [], within)
        return os.read(sys.stdin.fileno(), 1).decode(errors="replace") if ready else ""
