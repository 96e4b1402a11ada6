"""A bench without internet: a name space with nothing but loopback, no HOME, another locale, little memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

EXPERIMENT = """
sample = "friend-2"
rig = "virtual"
signal = "step 1 V"
rate = "50 Hz"
duration = "1 s"
measured = ["current"]
fingerprint = false
"""

LOOPBACK = """
import fcntl, os, socket, struct, sys
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
    fcntl.ioctl(one, 0x8914, struct.pack("16sh", b"lo", 0x41))  # SIOCSIFFLAGS: up and running
os.execv(sys.executable, [sys.executable, "-P", "-m", "ipmclab", *sys.argv[1:]])
"""


def bare(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command in a network of its own, with 3 GB of addresses and next to no environment."""
    line = ["bash", "-c", 'ulimit -v 3000000; exec "$@"', "bash", sys.executable, "-c", LOOPBACK, *words]
    return subprocess.run(
        ["unshare", "--user", "--map-root-user", "--net", *line],
        cwd=folder,
        env={"LC_ALL": "C", "PATH": "/usr/bin:/bin", "OPENBLAS_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )


def has_name_spaces() -> bool:
    if sys.platform != "linux":
        return False
    asked = subprocess.run(["unshare", "--user", "--map-root-user", "--net", "true"], capture_output=True, check=False)
    return asked.returncode == 0


@pytest.mark.skipif(not has_name_spaces(), reason="this system gives nobody a network of its own")
def test_a_run_is_recorded_and_recovered(tmp_path: Path) -> None:
    (tmp_path / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    done = bare(tmp_path, "record", "experiment.toml", "--yes")
    assert done.returncode == 0, done.stderr
    assert "complete" in done.stdout
    assert "next: ipmclab check" in done.stdout
    again = bare(tmp_path, "recover", "runs")
    assert (again.returncode, again.stdout) == (0, "nothing to recover in runs\n"), again.stderr
