"""One program at a time drives a module: whoever it belongs to, and wherever it keeps its temporary files."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path
from uuid import uuid4

import pytest

from ipmclab.platform import open_for_all_users
from ipmclab.rig.bench import BenchError
from ipmclab.rig.daqmx.in_use import Hold, lock_of

HOLDER = """
import sys
from ipmclab.rig.daqmx.in_use import Hold
hold = Hold("127.0.0.1:31799", [sys.argv[1]])
print("held", flush=True)
sys.stdin.read()
"""


def test_a_program_with_another_temporary_folder_is_kept_out(tmp_path: Path) -> None:
    module = f"module {uuid4().hex}"
    environment = {**os.environ, "TMPDIR": str(tmp_path), "TEMP": str(tmp_path), "TMP": str(tmp_path)}
    pipe = subprocess.PIPE
    umask = {"umask": 0o077} if os.name != "nt" else {}
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, module], stdin=pipe, stdout=pipe, text=True, env=environment, **umask
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdin is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(BenchError, match=f"another run is being recorded on it, by process {holder.pid}"):
            Hold("localhost:31799", [module])
        made = lock_of("localhost:31799", module)
        if os.name != "nt":  # another user may open it, whatever the umask of the first one is
            assert stat.S_IMODE(made.stat().st_mode) == 0o666
        holder.stdin.close()
    Hold("localhost:31799", [module]).release()
    made.unlink()


def refusing(*refused: int) -> object:
    """``os.open`` as another user's file gives it."""
    real = os.open

    def opened(path: object, flags: int, *more: int) -> int:
        if flags & (os.O_RDWR | os.O_WRONLY) in refused:
            raise PermissionError(errno.EACCES, "Permission denied")
        return real(path, flags, *more)  # type: ignore[call-overload, no-any-return]

    return opened


def test_another_user_s_lock_is_respected_also_where_it_cannot_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    module = f"module {uuid4().hex}"
    theirs = Hold(None, [module])
    made = lock_of(None, module)
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refusing(os.O_RDWR))
        with pytest.raises(BenchError, match="another run is being recorded on it") as caught:
            Hold(None, [module])
        assert (caught.value.code, caught.value.exit_status) == ("bench-in-use", 2)
        theirs.release()
        Hold(None, [module]).release()
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refusing(os.O_RDWR, os.O_RDONLY))
        with pytest.raises(BenchError, match=r"it is not known whether another run .* cannot be opened") as caught:
            Hold(None, [module])
        assert "ask the user" in caught.value.repair
    made.unlink()


def test_a_link_that_somebody_put_there_is_not_followed(tmp_path: Path) -> None:
    if not hasattr(os, "O_NOFOLLOW"):
        pytest.skip("this system has no such flag")
    target = tmp_path / "precious"
    target.write_text("mine")
    (tmp_path / "lock").symlink_to(target)
    with pytest.raises(OSError, match="symbolic"):
        open_for_all_users(tmp_path / "lock")
    assert target.read_text() == "mine"
