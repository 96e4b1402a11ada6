"""What differs between systems, in one place: every Unix call beside its Windows twin."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
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


_LOCKED_BYTE = 2**31 - 2  # the largest place that Windows can lock through the C library
_SHARING_TIME = 5.0  # how long [s] a virus scanner or MATLAB may hold a file before we give up


def lock_file(descriptor: int) -> bool:
    """Take the lock of an open file: False where someone else holds it.

    It is given back when the file is closed, also by a process that dies.
    """
    if sys.platform == "win32":
        import msvcrt

        here = os.lseek(descriptor, 0, os.SEEK_CUR)
        # Others cannot read a locked byte there, so it lies where a file seldom reaches.
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(descriptor, here, os.SEEK_SET)
        return True
    import fcntl  # noqa: TID251

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def is_still_at(descriptor: int, path: Path) -> bool:
    """Whether an open file has not been renamed or removed by someone else."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk: new, renamed and removed files."""
    if sys.platform == "win32":
        return  # a folder cannot be flushed there; the file system logs its names itself
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def move_file(source: Path, target: Path) -> None:
    """Rename a file within one disk, over another of that name, and bring both names to the disk.

    Raises
    ------
    OSError
        On Windows only after some seconds, for another program may have the file open for a moment.
    """
    until = time.monotonic() + _SHARING_TIME
    while True:
        try:
            source.replace(target)
            break
        except PermissionError:
            if os.name != "nt" or time.monotonic() > until:
                raise
            time.sleep(0.05)
    sync_folder(target.parent)
    if source.parent != target.parent:
        sync_folder(source.parent)


def reserve(descriptor: int, size: int) -> None:
    """Give an open file so many bytes that are really taken from the disk.

    Raises
    ------
    OSError
        No room.
    """
    if hasattr(os, "posix_fallocate"):  # Linux
        os.posix_fallocate(descriptor, 0, size)
        return
    block = os.urandom(1 << 20)  # zeros might be kept as a hole, or compressed away
    for start in range(0, size, len(block)):
        os.write(descriptor, block[: size - start])


@contextmanager
def told_to_end(act: Callable[[], None]) -> Iterator[None]:
    """While it lasts, a request of the system to end raises SystemExit, so that whoever must clean up can.

    That is SIGTERM and SIGHUP (a closed terminal), or Ctrl-Break. On Windows a console that closes, or a user who logs
    off, leaves the program only moments and no exception: there ``act`` is called at once, from a thread of its own.
    A program that has handlers of its own keeps them, and outside the main thread only the last part applies.

    Parameters
    ----------
    act : callable
        What must not be left undone.
    """

    def leave(number: int, _frame: object) -> None:
        raise SystemExit(128 + number)

    changed: dict[int, object] = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGTERM", "SIGHUP", "SIGBREAK"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) == signal.SIG_DFL:
                changed[number] = signal.signal(number, leave)
    forget = _when_console_closes(act)
    try:
        yield
    finally:
        forget()
        for number in changed:
            signal.signal(number, signal.SIG_DFL)


def _when_console_closes(act: Callable[[], None]) -> Callable[[], None]:
    """Call ``act`` when the console is closed; gives what undoes that."""
    if sys.platform == "win32":
        import ctypes
        from ctypes import wintypes

        kernel = ctypes.WinDLL("kernel32", use_last_error=True)

        @ctypes.WINFUNCTYPE(wintypes.BOOL, wintypes.DWORD)
        def handler(event: int) -> bool:
            if event > 1:  # not Ctrl-C or Ctrl-Break, which Python turns into signals
                act()
            return False

        kernel.SetConsoleCtrlHandler(handler, True)
        return lambda: kernel.SetConsoleCtrlHandler(handler, False)
    else:  # noqa: RET505  # a checker for the other system finds code after a return unreachable
        return lambda: None
