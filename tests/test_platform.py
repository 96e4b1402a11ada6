"""What differs between systems: the twins for Windows, with stand-ins for what Windows gives them."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ipmclab import platform
from ipmclab.destination import replacing
from ipmclab.errors import InputError
from ipmclab.rig.process import hub
from ipmclab.rig.safety.guarded_output import Target, connect
from ipmclab.rig.safety.guardian_process import Watch
from ipmclab.run import RunMetadata
from ipmclab.store.journal import laboratory as laboratory_module
from ipmclab.store.journal.guardian_word import read_word
from ipmclab.store.journal.laboratory import Laboratory
from tests.windows import as_on_windows


def pressed(monkeypatch: pytest.MonkeyPatch, codes: str) -> list[str]:
    """What the keys come to whose codes the terminal of Windows gives, one look after the other."""
    left = list(codes)
    terminal = SimpleNamespace(kbhit=lambda: bool(left), getwch=lambda: left.pop(0))
    platform = as_on_windows(monkeypatch, {"msvcrt": terminal})
    seen = []
    while left:
        seen.append(platform.key_pressed(0.0))
    assert platform.key_pressed(0.0) == ""
    return seen


@pytest.mark.parametrize(
    "codes",
    [
        "\xe0S",  # Delete: the S of stop
        "\xe0s",  # Ctrl and left arrow
        "\0a",  # Ctrl and F4: the a of abort
        "\xe0z",  # none, but read as zero
        "\0;",  # F1
        "\xe0H",  # up
    ],
)
def test_a_key_that_is_no_character_steers_nothing(monkeypatch: pytest.MonkeyPatch, codes: str) -> None:
    assert pressed(monkeypatch, codes) == [""]
    assert pressed(monkeypatch, f"m{codes}s") == ["m", "", "s"]


def test_letters_are_what_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    assert pressed(monkeypatch, "saz") == ["s", "a", "z"]
    assert pressed(monkeypatch, "\xe0") == ["\xe0"]  # a letter of French keyboards


class OpenFiles:
    """The rule of Windows: no file is replaced that somebody has open."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *held: Path) -> None:
        self.held = set(held)
        self.refused = 0
        real = Path.replace

        def replace(source: Path, target: Path) -> Path:
            if target in self.held or source in self.held:
                self.refused += 1
                raise PermissionError(13, "The process cannot access the file because it is being used", str(target))
            return real(source, target)

        monkeypatch.setattr(Path, "replace", replace)
        monkeypatch.setattr(platform, "_KEEPS_WHAT_IS_OPEN", True)

    def close_after(self, seconds: float) -> None:
        threading.Timer(seconds, self.held.clear).start()


def test_a_guardian_s_word_is_not_lost_while_the_last_one_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, status = Target("file", str(tmp_path / "output.txt")), tmp_path / "a.guardian"
    watch = Watch(target, None, open(tmp_path / "said", "w", encoding="utf-8"), connect(target), status)  # noqa: SIM115
    watch.note("armed")
    files = OpenFiles(monkeypatch, status)
    files.close_after(0.2)
    watch.note("zero", "the recorder is gone")
    watch._tell.close()
    assert files.refused > 1
    assert read_word(status).state == "zero"


def test_a_file_that_a_scanner_looks_at_is_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out.txt"
    out.write_text("old")
    files = OpenFiles(monkeypatch, out)
    files.close_after(0.2)
    with replacing(out, overwrite=True) as temporary:
        temporary.write_text("new")
    assert (out.read_text(), files.refused > 1) == ("new", True)
    # Elsewhere a refusal is a refusal, at once.
    monkeypatch.setattr(platform, "_KEEPS_WHAT_IS_OPEN", False)
    files.held, files.refused = {out}, 0
    with pytest.raises(PermissionError):
        platform.replace_file(out, tmp_path / "other")
    assert files.refused == 1


def test_rights_are_given_by_the_number_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[str]] = []

    def run(command: list[str], **_: Any) -> SimpleNamespace:
        asked.append(command)
        return SimpleNamespace(stdout=b'"lab\\m\xfcller","S-1-5-21-7-8-1001"\r\n')

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setenv("SYSTEMROOT", r"C:\Windows")
    windows = as_on_windows(monkeypatch, {"msvcrt": SimpleNamespace()})
    assert windows.write_for_owner_only(tmp_path / "a", "token") == ""
    assert (tmp_path / "a").read_text() == "token"
    assert asked[1][-3:] == ["/inheritance:r", "/grant:r", "*S-1-5-21-7-8-1001:F"]
    assert all(Path(command[0]).name in ("whoami.exe", "icacls.exe") for command in asked)
    assert all(command[0].startswith("C:") for command in asked)  # not the first of that name on the path


@pytest.mark.parametrize(
    ("program", "failure", "why"),
    [
        ("icacls.exe", subprocess.CalledProcessError(5, "", stderr=b"No.\r\n"), "icacls failed with 5: No."),
        ("icacls.exe", subprocess.CalledProcessError(1332, ""), "icacls failed with 1332"),
        ("icacls.exe", FileNotFoundError("no such file"), "icacls could not be run: no such file"),
        ("whoami.exe", PermissionError("refused"), "whoami could not be run: refused"),
        ("whoami.exe", None, "whoami did not give the number of the user"),
    ],
)  # fmt: skip
def test_rights_that_cannot_be_given_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, failure: Exception | None, why: str
) -> None:
    def run(command: list[str], **_: Any) -> SimpleNamespace:
        if command[0].endswith(program) and failure is not None:
            raise failure
        return SimpleNamespace(stdout=b"" if failure is None else b'"lab","S-1-5-21-7-8-1001"\r\n')

    monkeypatch.setattr(subprocess, "run", run)
    windows = as_on_windows(monkeypatch, {"msvcrt": SimpleNamespace()})
    assert windows.write_for_owner_only(tmp_path / "token", "token") == why
    assert (tmp_path / "token").read_text() == "token"
    # The recorder goes on, and whoever looks at it is told.
    monkeypatch.setattr(hub, "write_for_owner_only", windows.write_for_owner_only)
    with contextlib.closing(hub.Hub(tmp_path, lambda _: None)) as recorder:
        (note,) = recorder._past
    assert (note.kind, why in note["text"], note["passing"]) == ("note", True, False)
    assert note["text"].startswith("other users of this computer may be able to steer this recorder")


def test_what_must_be_in_time_goes_first_where_the_system_grants_it(monkeypatch: pytest.MonkeyPatch) -> None:
    if not hasattr(os, "setpriority"):
        pytest.skip("this system has no nice")
    asked: list[tuple[int, ...]] = []
    monkeypatch.setattr(os, "setpriority", lambda *which: asked.append(which))
    platform.go_first()
    assert asked == [(os.PRIO_PROCESS, 0, -10)]

    def refuse(*_: int) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "setpriority", refuse)
    platform.go_first()


def test_on_windows_it_goes_before_what_has_no_class_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []

    class SetPriorityClass:
        argtypes = ()

        def __call__(self, process: int, level: int) -> int:
            asked.append((process, level))
            return 1

    kernel = SimpleNamespace(GetCurrentProcess=type("Call", (), {"__call__": lambda _: -1})())
    kernel.SetPriorityClass = SetPriorityClass()
    types = SimpleNamespace(HANDLE="handle", DWORD="word")
    ctypes = SimpleNamespace(WinDLL=lambda *_, **__: kernel, wintypes=types)
    monkeypatch.setattr(subprocess, "ABOVE_NORMAL_PRIORITY_CLASS", 0x8000, raising=False)
    as_on_windows(monkeypatch, {"msvcrt": SimpleNamespace(), "ctypes": ctypes, "ctypes.wintypes": types}).go_first()
    assert asked == [(-1, 0x8000)]
    assert kernel.GetCurrentProcess.restype == "handle"  # of 64 bits, where an int would be cut
    assert kernel.SetPriorityClass.argtypes == ("handle", "word")


def test_the_pipes_of_children_are_utf_8_whatever_the_locale_is(tmp_path: Path) -> None:
    script = "import sys; print(sys.stdout.encoding, sys.flags.utf8_mode, 'Ω 通道')"
    (tmp_path / "said_in_utf8.py").write_text(script, encoding="utf-8")
    environment = {"PYTHONPATH": str(tmp_path), "PYTHONIOENCODING": "", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(platform.python_child("said_in_utf8"), env=environment, capture_output=True, check=True)
    assert done.stdout.decode("utf-8").split() == ["utf-8", "1", "Ω", "通道"]


def test_what_a_mac_acknowledges_went_through_the_memory_of_its_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, int]] = []
    synced: list[int] = []
    monkeypatch.setitem(
        sys.modules, "fcntl", SimpleNamespace(F_FULLFSYNC=51, fcntl=lambda file, what: asked.append((file, what)))
    )
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(os, "fsync", synced.append)
    platform.sync_file(7)
    assert (asked, synced) == ([(7, 51)], [])

    def refuse(file: int, what: int) -> None:
        raise OSError(45, "Operation not supported")

    monkeypatch.setattr(sys.modules["fcntl"], "fcntl", refuse)
    platform.sync_file(7)
    assert synced == [7]


def test_a_path_that_windows_cannot_open_is_found_when_planning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = RunMetadata(rig="rig of a long name", signal="multisine 1 V 0.1 Hz 10 Hz")
    deep = tmp_path / ("f" * (200 - len(str(tmp_path))))
    laboratory = Laboratory.open(deep)
    laboratory.check_name(about)
    monkeypatch.setattr(laboratory_module, "LONGEST_PATH", 259)
    with pytest.raises(InputError, match=r"the run would be at a path of \d+ letters, this system opens 259") as caught:
        laboratory.check_name(about)
    # The folder that the message asks for is short enough, and no shorter than it must be.
    length = len(str(laboratory.run_file("0" * 32, about, "2026-11-21T14:32:05"))) + 5
    assert f"{length - 259} letters shorter" in caught.value.repair
    monkeypatch.setattr(laboratory_module, "LONGEST_PATH", length)
    laboratory.check_name(about)
