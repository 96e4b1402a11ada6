"""The rules of Windows for open files and for names, its code pages, and a decimal comma: over whole programs.

They are laid over every Python process by ``tests/windows_rules/sitecustomize.py``; nobody ran Windows itself.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.test_bare_system import ASK

RULES = Path(__file__).parents[1] / "windows_rules"
ROOT = RULES.parents[1]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="what a process has open is read from /proc")

KILLED = """
import sys
from pathlib import Path
from benchmarks.kill_manners import Manner
from benchmarks.kills import run_kills

killed, wrong = run_kills(Path(sys.argv[1]), [Manner(1.0), Manner(1.0, victim="guardian")])
print(all(one.acknowledged for one in killed), wrong)
"""

TRIED = """
import locale, os
from pathlib import Path

held, kept = Path("held"), Path("kept")
kept.write_text("", encoding="utf-8")
kept.chmod(0o444)
print(locale.getpreferredencoding(False), locale.localeconv()["decimal_point"])
with held.open("w", encoding="utf-8"):
    for act in (
        lambda: held.replace("other"),
        held.unlink,
        kept.unlink,
        lambda: os.mkdir("aux"),
        lambda: os.mkdir("why?"),
        lambda: open("nul.txt", "w", encoding="utf-8"),
    ):
        try:
            act()
        except OSError as error:
            print(error.errno)
held.unlink()
"""


@pytest.fixture(scope="module")
def locales(tmp_path_factory: pytest.TempPathFactory, require: Callable[..., None]) -> Path:
    """German, in the code pages of Windows and of its console."""
    program, folder = shutil.which("localedef"), tmp_path_factory.mktemp("locales")
    require("localedef", program and Path("/usr/share/i18n/charmaps").is_dir())
    assert program is not None
    for charmap in ("CP1252", "IBM850"):
        subprocess.run([program, "-i", "de_DE", "-f", charmap, str(folder / f"de_DE.{charmap}")], check=True)
    return folder


@pytest.fixture
def like_windows(tmp_path: Path, locales: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """What Python does with some words under those rules."""

    def run(page: str, *words: str) -> subprocess.CompletedProcess[str]:
        rules = {
            "PYTHONPATH": os.pathsep.join(map(str, (RULES, ROOT))),
            "IPMCLAB_WINDOWS_BELOW": str(tmp_path),
            "PYTHONWARNDEFAULTENCODING": "1",
            "LOCPATH": str(locales),
            "LC_ALL": f"de_DE.{page}",
            "NO_COLOR": "1",
        }
        return subprocess.run(
            [sys.executable, *words],
            cwd=tmp_path,
            env={**os.environ, **rules},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding=page,
            timeout=300,
            check=False,
        )

    return run


def test_the_rules_hold(like_windows) -> None:
    done = like_windows("IBM850", "-c", TRIED)
    assert done.stdout.split() == ["IBM850", ",", "13", "13", "13", "22", "22", "22"], done.stderr


@pytest.mark.real_time
def test_recorders_and_guardians_are_killed_and_their_runs_recovered(like_windows, tmp_path: Path) -> None:
    done = like_windows("CP1252", "-c", KILLED, str(tmp_path))
    assert done.stdout.splitlines()[-1:] == ["True []"], done.stdout + done.stderr


def test_the_demo_comes_to_its_end(like_windows, tmp_path: Path) -> None:
    done = like_windows("IBM850", "-m", "ipmclab", "demo")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "ipmclab-demo" / "report.html").is_file()


def test_the_page_answers(like_windows) -> None:
    done = like_windows("CP1252", "-c", ASK)
    assert done.stdout == "200 True\n", done.stderr
