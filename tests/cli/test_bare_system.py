"""A bench without internet: nothing but loopback, an install that cannot be written, no HOME, another locale, little
memory.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import ipmclab

EXPERIMENT = """
sample = "friend-2"
rig = "virtual"
signal = "step 1 V"
rate = "50 Hz"
duration = "1 s"
measured = ["current"]
fingerprint = false
"""

INSTALLED = (sys.prefix, str(Path(ipmclab.__file__).parents[1]))
"""Where the packages are, and the program."""

ENVIRONMENT = {
    "LC_ALL": "C",
    "PATH": "/usr/bin:/bin:/usr/sbin:/sbin",
    "OPENBLAS_NUM_THREADS": "1",
    # Where no compiled module may lie beside its source each process would compile all of them.
    **{name: os.environ[name] for name in ("PYTHONPYCACHEPREFIX",) if name in os.environ},
}
"""Next to nothing."""

BARE = """
ulimit -v 3000000
for folder in "$1" "$2"; do mount --bind "$folder" "$folder" && mount -o remount,bind,ro "$folder" || exit 90; done
shift 2
exec "$@"
"""

LOOPBACK = """
import fcntl, os, socket, struct, sys
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
    fcntl.ioctl(one, 0x8914, struct.pack("16sh", b"lo", 0x41))  # SIOCSIFFLAGS: up and running
os.execv(sys.executable, [sys.executable, "-P", *sys.argv[1:]])
"""

ASK = """
import re, subprocess, sys, urllib.request
page = subprocess.Popen([sys.executable, "-P", "-m", "ipmclab", "page", "."], stdout=subprocess.PIPE, text=True)
try:
    for line in page.stdout:
        address = re.search("http://[^ ]+", line.strip())
        if address:
            answer = urllib.request.urlopen(address[0], timeout=300)
            print(answer.status, "ipmclab" in answer.read().decode())
            break
finally:
    page.terminate()
"""


def bare(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """What Python does with these words in a network of its own, with 3 GB of addresses and next to no environment."""
    line = ["bash", "-c", BARE, "bash", *INSTALLED, sys.executable, "-c", LOOPBACK, *words]
    return subprocess.run(
        ["unshare", "--user", "--map-root-user", "--net", "--mount", *line],
        cwd=folder,
        env=ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=300,
        check=False,
    )


def ipmclab_command(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of the program there."""
    return bare(folder, "-m", "ipmclab", *words)


def has_name_spaces() -> bool:
    if sys.platform != "linux":
        return False
    words = ["unshare", "--user", "--map-root-user", "--net", "--mount", "true"]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0


pytestmark = pytest.mark.skipif(not has_name_spaces(), reason="this system gives nobody a network of its own")


def test_a_run_is_recorded_and_recovered(tmp_path: Path) -> None:
    (tmp_path / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    done = ipmclab_command(tmp_path, "record", "experiment.toml", "--yes")
    assert done.returncode == 0, done.stderr
    assert "complete" in done.stdout
    assert "next: ipmclab check" in done.stdout
    again = ipmclab_command(tmp_path, "recover", "runs")
    assert (again.returncode, again.stdout) == (0, "nothing to recover in runs\n"), again.stderr


def test_nothing_of_the_install_can_be_written(tmp_path: Path) -> None:
    tried = [bare(tmp_path, "-c", f"open({str(Path(one) / 'new')!r}, 'w')") for one in INSTALLED]
    assert all("Read-only file system" in one.stderr for one in tried), tried


def test_the_demo_comes_to_its_end(tmp_path: Path) -> None:
    done = ipmclab_command(tmp_path, "demo")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "ipmclab-demo" / "report.html").is_file()


def test_the_page_answers(tmp_path: Path) -> None:
    done = bare(tmp_path, "-c", ASK)
    assert done.stdout == "200 True\n", done.stderr
