"""The child processes import nothing from the folder that they are started in."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest

import ipmclab
from benchmarks.kills import prepare, start
from ipmclab.page.jobs.jobs import Jobs
from ipmclab.platform import python_child
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian import Guardian
from ipmclab.store.journal.finalise import finish
from ipmclab.store.journal.journal import Journal, JournalHeader
from tests.cli.test_bare_system import EXPERIMENT
from tests.waiting import HANGS, until

NAMES = [
    "queue",
    "json",
    "signal",
    "struct",
    "socket",
    "secrets",
    "h5netcdf",
    "h5py",
    "numpy",
    "nidaqmx",
    "scipy",
    "numba",
]


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with modules in it that leave a file behind when they are run."""
    folder = tmp_path / "lab folder"
    folder.mkdir()
    for name in NAMES:
        code = f"open({str(tmp_path / 'sprung')!r}, 'a').write({name!r})\nraise SystemExit(7)\n"
        (folder / f"{name}.py").write_text(code)
    monkeypatch.chdir(folder)
    return tmp_path / "sprung"


def test_the_guardian(trap: Path, tmp_path: Path) -> None:
    with Guardian(Target("file", str(tmp_path / "output.txt"))) as guardian:
        guardian.wait()
    assert not trap.exists()


def test_what_writes_run_files(trap: Path, tmp_path: Path) -> None:
    journal = Journal.create(tmp_path / "lab", JournalHeader(str(uuid4()), 50.0, ("voltage",)), ballast=0)
    journal.append(0, np.ones((10, 1)))
    assert finish(journal.end("complete"), tmp_path / "lab").outcome == "run"
    assert not trap.exists()


def test_the_recorder(trap: Path) -> None:
    """With a folder of its own beside the traps, as a user's experiment has."""
    Path("experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    recorder = prepare(Path.cwd())
    assert start(recorder)
    while (message := recorder.next(HANGS)) is not None and message.kind != "ended":
        pass
    assert message is not None
    assert message["status"] == 0
    assert len(list(Path("runs").rglob("*.nc"))) == 1
    assert not trap.exists()


def test_the_worker_of_the_page(trap: Path) -> None:
    with Jobs() as jobs:
        job = jobs.submit("simulate", {})
        until(lambda: job.is_over)
        assert "KeyError" in str(job.error)  # it was asked, and lacks its arguments
    assert not trap.exists()


def test_every_child_is_started_in_one_way() -> None:
    """The recorder, the worker of the page and that of ``rig prove`` too."""
    source = Path(ipmclab.__file__).parent
    starters = {
        str(path.relative_to(source)) for path in source.rglob("*.py") if "sys.executable" in path.read_text("utf-8")
    }
    assert starters == {"platform.py"}
    texts = "".join(path.read_text("utf-8") for path in source.rglob("*.py"))
    modules = set(re.findall(r'python_child\(\s*"([a-z._]+)"', texts))
    assert modules == {
        "ipmclab.rig.chambers.keeper_process",
        "ipmclab.rig.safety.guardian_process",
        "ipmclab.rig.checks.prove_child",
        "ipmclab.page.jobs.worker",
        "ipmclab.store.journal.finalise",
    }  # and the recorder, whose name is handed to ``launch``


READER = """
import threading
from ipmclab.platform import own_stdin
stream = own_stdin()
heard = []
thread = threading.Thread(target=lambda: heard.append(stream.readline()))
thread.start()
import sys
nothing = sys.stdin.read()  # as what is imported later looks at it: at its end, while the other one still waits
print(repr(nothing), thread.is_alive(), flush=True)
thread.join()
print(heard, flush=True)
"""


def test_who_looks_at_stdin_while_a_thread_reads_it_does_not_wait() -> None:
    """The Fortran runtime below SciPy does so on Windows when it is first imported."""
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", READER], stdin=pipe, stdout=pipe, text=True) as reader:
        assert reader.stdin is not None
        assert reader.stdout is not None
        assert reader.stdout.readline() == "'' True\n"
        reader.stdin.write("a word\n")
        reader.stdin.flush()
        assert reader.stdout.readline() == "[b'a word\\n']\n"


@pytest.mark.parametrize("module", ["ipmclab.page.jobs.worker", "ipmclab.rig.safety.guardian_process"])
def test_children_that_listen_leave_nothing_at_descriptor_0(module: str, tmp_path: Path) -> None:
    if not Path("/proc/self/fd/0").exists():
        pytest.skip("this system does not show the descriptors of a process")
    arguments = [Target("file", str(tmp_path / "output.txt")).to_json(), "", ""] if "guardian" in module else []
    pipe = subprocess.PIPE
    with subprocess.Popen(python_child(module, *arguments), stdin=pipe, stdout=pipe) as child:
        until(lambda: os.readlink(f"/proc/{child.pid}/fd/0") == os.devnull)
        assert child.stdin is not None
        child.stdin.close()
        assert child.wait(HANGS) == 0
