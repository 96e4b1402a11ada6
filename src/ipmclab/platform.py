"""What differs between systems, in one place: every Unix call with its Windows counterpart."""

from __future__ import annotations

import os
import re
import shlex
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, Final


def as_typed(word: str | os.PathLike[str]) -> str:
    """A word of a command, such as a path with a blank in it, as a terminal of this system takes it.

    Examples
    --------
    >>> as_typed("runs"), as_typed("my runs") in ("'my runs'", '"my runs"')
    ('runs', True)
    """
    text = os.fspath(word)
    return subprocess.list2cmdline([text]) if os.name == "nt" else shlex.quote(text)


_DEVICE: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d) *(\.|$)", re.IGNORECASE)


def is_device(name: str) -> bool:
    """Whether Windows takes a name of a file for one of its devices, whatever its ending is.

    Every system is asked the same, for files travel.

    Examples
    --------
    >>> is_device("com1.toml"), is_device("common.toml")
    (True, False)
    """
    return _DEVICE.match(name) is not None


def detached() -> dict[str, Any]:
    """What ``subprocess.Popen`` needs for a process that a closing terminal and its Ctrl-C do not reach."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
    else:  # noqa: RET505  # a checker for the other system finds code after a return unreachable
        return {"start_new_session": True}


def go_first() -> None:
    """Have a processor before other programs from now on: what this process does must be in time.

    Threads that are there already wait as before. Linux and macOS grant it to an administrator, and to whom
    ``limits.conf`` allows ``nice``; who is not granted it continues as one of all.
    """
    if sys.platform == "win32":
        import ctypes
        from ctypes import wintypes

        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.GetCurrentProcess.restype = wintypes.HANDLE
        kernel.SetPriorityClass.argtypes = (wintypes.HANDLE, wintypes.DWORD)
        kernel.SetPriorityClass(kernel.GetCurrentProcess(), subprocess.ABOVE_NORMAL_PRIORITY_CLASS)
    else:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, -10)


PROCESSORS: Final = "IPMCLAB_PROCESSORS"
"""A variable of the environment: how many processors a process may use, where others have the rest."""


def processors() -> int:
    """How many processors this process may use."""
    mine: Callable[[int], set[int]] | None = getattr(os, "sched_getaffinity", None)  # of Linux
    there = os.cpu_count() or 1 if mine is None else len(mine(0))
    told = os.environ.get(PROCESSORS, "")
    return min(there, max(int(told), 1)) if told.isdecimal() else there


def python_child(module: str, *arguments: str) -> list[str]:
    """The command of a child process that runs a module of ours.

    It imports nothing from the folder that it is started in (``-P``): a user's ``queue.py`` beside the experiments
    would stand in the way of Python's own, and a shared folder would be a way to run code. Its pipes are UTF-8
    whatever the locale is: what a code page cannot say would be lost between them.
    """
    return [sys.executable, "-P", "-X", "utf8", "-m", module, *arguments]


def own_stdin() -> BinaryIO:
    """Standard input for whoever calls this first; everybody else reads nothing from it any more.

    A thread that waits for a pipe holds its descriptor. On Windows the Fortran runtime below SciPy looks at
    descriptor 0 when it is first imported, and waits behind that read for ever (numpy, issue 24290): it finds an empty
    one.
    """
    stream = os.fdopen(os.dup(0), "rb")
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)
    return stream


def write_for_owner_only(path: Path, text: str) -> str:
    """Write a small file that no other user can read.

    Returns
    -------
    str
        Why others may be able to read it all the same; empty where only its owner can.

    Raises
    ------
    OSError
        Also when the file exists.
    """
    why = ""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
        if sys.platform == "win32":
            why = _leave_to_owner(path)
        stream.write(text)
    return why


def _leave_to_owner(path: Path) -> str:
    """Take the inherited rights to a file of Windows away, where its mode means nothing, and leave the owner his.

    By the number of the user, for a name may be another one's, or spelled otherwise in the system's language. Where a
    disk knows no rights (a USB stick) they stay as they are: that is no reason not to record, and is reported.

    Returns
    -------
    str
        What failed; empty where nothing did.
    """
    system = Path(os.environ.get("SYSTEMROOT", r"C:\Windows"), "System32")
    quiet: dict[str, Any] = {"creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0), "capture_output": True}
    asked = "whoami"
    try:
        told = subprocess.run([str(system / "whoami.exe"), "/user", "/fo", "csv", "/nh"], check=True, **quiet).stdout
        number = told.decode(errors="replace").strip().rsplit(",", 1)[1].strip('"')
        rights = ["/inheritance:r", "/grant:r", f"*{number}:F"]
        asked = "icacls"
        subprocess.run([str(system / "icacls.exe"), str(path), *rights], check=True, **quiet)
    except subprocess.CalledProcessError as error:
        said = (error.stderr or b"").decode(errors="replace").strip()
        return f"{asked} failed with {error.returncode}" + (f": {said}" if said else "")
    except IndexError:
        return "whoami did not give the number of the user"
    except (OSError, subprocess.SubprocessError) as error:
        return f"{asked} could not be run: {error}"
    return ""


if sys.platform == "win32":
    import msvcrt
    import time

    @contextmanager
    def single_keys() -> Iterator[None]:
        """Let ``key_pressed`` see each key of the terminal at once, without Enter and without echo."""
        yield

    def key_pressed(within: float) -> str:
        """The key that was pressed within so many seconds, or nothing, also for one that stands for no character."""
        until = time.monotonic() + within
        while not msvcrt.kbhit():
            if time.monotonic() >= until:
                return ""
            time.sleep(0.02)
        key = msvcrt.getwch()
        # Arrows, Delete, function keys come as two: a prefix, and a number that reads as some letter. The second prefix
        # is also the letter a with a grave accent, which comes alone.
        if key == "\0" or (key == "\xe0" and msvcrt.kbhit()):
            msvcrt.getwch()
            return ""
        return key

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
_KEEPS_WHAT_IS_OPEN = os.name == "nt"  # Windows replaces and removes no file that somebody has open
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


def folder_of_the_machine() -> Path:
    """A folder in which every user of this computer may make files, wherever a process has its own temporary ones."""
    if sys.platform == "win32":
        folder = Path(os.environ.get("PROGRAMDATA", r"C:\ProgramData"), "ipmclab")
        folder.mkdir(exist_ok=True)
        return folder
    else:  # noqa: RET505  # a checker for the other system finds code after a return unreachable
        for shared in (Path("/run/lock"), Path("/tmp")):
            with suppress(OSError):
                if stat.S_IMODE(shared.stat().st_mode) & 0o1777 == 0o1777:
                    return shared
        return Path("/tmp")


def open_for_all_users(path: Path) -> int:
    """The descriptor of a small file that any user may lock, made where it is not there; for reading at least.

    Raises
    ------
    PermissionError
        Another user made it so that nobody else can open it.
    """
    follow = getattr(os, "O_NOFOLLOW", 0)
    while True:
        # Not with O_CREAT at once: Linux refuses that for another user's file in a folder of all users.
        for flags in (os.O_RDWR, os.O_RDONLY):
            try:
                return os.open(path, flags | follow)
            except FileNotFoundError:
                break
            except PermissionError:
                if flags == os.O_RDONLY:
                    raise
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | follow, 0o666)
        except FileExistsError:
            continue  # somebody made it just now
        if sys.platform != "win32":
            os.fchmod(descriptor, 0o666)  # whatever the umask takes away
        return descriptor


def is_still_at(descriptor: int, path: Path) -> bool:
    """Whether an open file has not been renamed or removed by someone else."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


LONGEST_PATH = 259 if os.name == "nt" else 4095
"""Letters of a path that every library can open: Windows counts 260 with the end of the text."""


def sync_file(descriptor: int) -> None:
    """Bring what was written to an open file to the disk, through the disk's own memory.

    Raises
    ------
    OSError
    """
    if sys.platform == "darwin":
        import fcntl  # noqa: TID251

        # There ``fsync`` ends when the disk has it in its memory, which a power cut empties.
        with suppress(OSError):  # not every file system can: a network share
            fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
            return
    os.fsync(descriptor)


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk: new, renamed and removed files."""
    if sys.platform == "win32":
        return  # a folder cannot be flushed there; the file system logs its names itself
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def keeps_what_is_open() -> bool:
    """Whether this system replaces, renames and removes no file that somebody has open."""
    return _KEEPS_WHAT_IS_OPEN


def replace_file(source: Path, target: Path) -> None:
    """Rename a file within one folder, over another of that name: who reads it has the one or the other, whole.

    Raises
    ------
    OSError
        On Windows only after some seconds, for another program (who reads it, a virus scanner) may have it open.
    """
    until = time.monotonic() + _SHARING_TIME
    while True:
        try:
            source.replace(target)
            return
        except PermissionError:
            if not keeps_what_is_open() or time.monotonic() > until:
                raise
            time.sleep(0.02)


def move_file(source: Path, target: Path) -> None:
    """Rename a file within one disk, over another of that name, and bring both names to the disk.

    Raises
    ------
    OSError
        On Windows only after some seconds, for another program may have the file open for a moment.
    """
    replace_file(source, target)
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
def on_end_request(act: Callable[[], None]) -> Iterator[None]:
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
