"""The end of a user's session, and sleep: a computer that is about to leave drives no strip.

A process without a window gets neither on Windows once it has loaded the library of windows, which NI's driver
does: so there is a window, which nobody sees, to be told. What these messages come to is in ``answer``. The window was
run with a stand-in for Windows only.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

Act = Callable[[str], None]
"""What must not be left undone, called with the reason: it returns when it is done."""

SESSION_ENDS: Final = "the session of the user ends"
SLEEP: Final = "the computer goes to sleep"

_CLOSE: Final = 0x0010
_QUERY_END: Final = 0x0011
_END: Final = 0x0016
_POWER: Final = 0x0218
_SUSPEND: Final = 4
_LAST: Final = 0x100  # of the levels at which Windows ends programs, from 0x4FF down: those of 0x280 first

_KEEP_AWAKE: Final = 0x80000001  # ES_CONTINUOUS | ES_SYSTEM_REQUIRED: until the thread ends

_PATIENCE: Final = 5.0
"""How long [s] a run waits for the window, to come and to go: without one it is recorded all the same."""


def answer(message: int, detail: int, act: Act) -> int | None:
    """What a window answers to a message of Windows; None for those that are not its business.

    Parameters
    ----------
    message, detail : int
        The number of the message, and its first parameter.
    act : callable of str
        Is called before it answers: Windows waits so long, though no more than 5 s, and 2 s before sleep.
    """
    if message == _QUERY_END:
        return 1  # somebody else may still refuse: nothing is ended by a question
    if message == _END:
        if detail:
            _do(act, SESSION_ENDS)
        return 0
    if message == _POWER and detail == _SUSPEND:
        _do(act, SLEEP)
        return 1
    return None


def _do(act: Act, why: str) -> None:
    with suppress(Exception):  # whatever it is, Windows must get its answer
        act(why)


@contextmanager
def on_session_end(act: Act, *, last: bool = False) -> Iterator[None]:
    """While it lasts, ``act`` is called before the session ends and before the computer sleeps, and it does not sleep
    by itself.

    Parameters
    ----------
    act : callable of str
        From a thread of its own. Elsewhere than on Windows the end of a session is a signal: see
        ``platform.on_end_request``.
    last : bool
        Whether other programs are informed first: a guardian outlives its recorder.
    """
    if sys.platform == "win32":
        window = _Window(act, last)
        window.open()
        try:
            yield
        finally:
            window.close()
    elif sys.platform == "darwin":
        with _caffeine():
            yield
    else:
        yield


@contextmanager
def _caffeine() -> Iterator[None]:
    """A Mac does not sleep by itself while this lasts, or this process lives."""
    command = ["/usr/bin/caffeinate", "-i", "-w", str(os.getpid())]
    process = None
    with suppress(OSError):
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        if process is not None:
            process.terminate()
            process.wait()


class _Window:
    """A window that nobody sees, with a thread that waits for its messages.

    One that only takes messages would not do: what goes to all windows does not go to those.
    """

    def __init__(self, act: Act, last: bool) -> None:
        self._act = act
        self._last = last
        self._handle: Any = None
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._live, name="end of session", daemon=True)

    def open(self) -> None:
        """Make it; without one, the system is as it was."""
        self._thread.start()
        self._ready.wait(_PATIENCE)

    def close(self) -> None:
        """End its thread, and with it what kept the computer awake."""
        if sys.platform == "win32" and self._handle:
            import ctypes

            ctypes.WinDLL("user32").PostMessageW(ctypes.c_void_p(self._handle), _CLOSE, 0, 0)
            self._thread.join(_PATIENCE)

    def _live(self) -> None:
        if sys.platform == "win32":
            import ctypes
            from ctypes import wintypes

            user, kernel = ctypes.WinDLL("user32"), ctypes.WinDLL("kernel32")
            signature = (wintypes.HWND, wintypes.UINT, wintypes.WPARAM, wintypes.LPARAM)
            procedure_of = ctypes.WINFUNCTYPE(ctypes.c_ssize_t, *signature)
            otherwise = user.DefWindowProcW
            otherwise.restype, otherwise.argtypes = ctypes.c_ssize_t, signature

            @procedure_of
            def procedure(window: Any, message: int, detail: int, more: int) -> int:
                if message == _CLOSE:
                    user.PostQuitMessage(0)
                    return 0
                found = answer(message, detail, self._act)
                return int(otherwise(window, message, detail, more)) if found is None else found

            class Class(ctypes.Structure):
                _fields_ = (
                    ("style", wintypes.UINT),
                    ("procedure", procedure_of),
                    ("class_extra", ctypes.c_int),
                    ("window_extra", ctypes.c_int),
                    ("instance", wintypes.HINSTANCE),
                    ("icon", wintypes.HANDLE),
                    ("cursor", wintypes.HANDLE),
                    ("background", wintypes.HANDLE),
                    ("menu", wintypes.LPCWSTR),
                    ("name", wintypes.LPCWSTR),
                )

            try:
                if self._last:
                    kernel.SetProcessShutdownParameters(_LAST, 0)
                kernel.SetThreadExecutionState(ctypes.c_uint(_KEEP_AWAKE))
                name = f"ipmclab {os.getpid()} {threading.get_ident()}"
                kernel.GetModuleHandleW.restype = wintypes.HMODULE
                instance = kernel.GetModuleHandleW(None)
                user.RegisterClassW(ctypes.byref(Class(procedure=procedure, instance=instance, name=name)))
                create = user.CreateWindowExW
                create.restype = wintypes.HWND
                create.argtypes = (
                    wintypes.DWORD, wintypes.LPCWSTR, wintypes.LPCWSTR, wintypes.DWORD, *(4 * (ctypes.c_int,)),
                    wintypes.HWND, wintypes.HMENU, wintypes.HINSTANCE, wintypes.LPVOID,
                )  # fmt: skip
                self._handle = create(0, name, name, 0, 0, 0, 0, 0, None, None, instance, None)
            finally:
                self._ready.set()
            message = wintypes.MSG()
            while self._handle and user.GetMessageW(ctypes.byref(message), None, 0, 0) > 0:
                user.DispatchMessageW(ctypes.byref(message))
