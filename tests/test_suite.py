"""What the suite says of the machine that it runs on."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests import bytecode
from tests.workers import Sharing, group_of, pytest_collection_modifyitems


def test_what_is_missing_is_skipped_with_its_reason(
    require: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("IPMCLAB_REQUIRE", raising=False)
    require("real_runs", found=True)
    with pytest.raises(pytest.skip.Exception, match="real_runs was not found; it is on the shelf"):
        require("real_runs", None, hint="; it is on the shelf")


def test_what_is_required_and_missing_fails(require: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IPMCLAB_REQUIRE", "chromium,real_runs")
    with pytest.raises(pytest.fail.Exception, match="real_runs is required here"):
        require("real_runs", None)
    with pytest.raises(pytest.skip.Exception):
        require("postgres", None)


@dataclass
class Item:
    """As much of a test as is asked of it."""

    nodeid: str
    fixturenames: tuple[str, ...] = ()
    marks: list[pytest.Mark] = field(default_factory=list)

    def add_marker(self, marker: pytest.MarkDecorator) -> None:
        self.marks.append(marker.mark)

    def get_closest_marker(self, name: str) -> pytest.Mark | None:
        return next((mark for mark in self.marks if mark.name == name), None)


def test_what_is_held_to_time_and_what_drives_a_browser_come_first_each_in_turn() -> None:
    """The order in which tests are given out, and the groups that no two workers share."""
    plain, fitting = Item("tests/store/test_a.py::test_a"), Item("tests/identification/test_b.py::test_b")
    browsed = Item("tests/page/browser/test_c.py::test_c", ("open_page", "chromium"))
    timed = Item("tests/rig/test_d.py::test_d", marks=[pytest.mark.real_time.mark])
    items = [plain, fitting, browsed, timed]
    pytest_collection_modifyitems(items)
    assert items == [timed, browsed, fitting, plain]
    assert [group_of(item) for item in items] == ["real-time", "browser", None, None]


def test_what_is_repeated_on_another_processor_hangs_on_its_name_alone() -> None:
    """By its place among all, one new test changed which others are repeated, and an old failure looked like its."""
    names = [f"tests/{room}/test_b.py::test_c[{number}]" for room in ("fit", "store") for number in range(800)]

    def repeated(names: list[str]) -> list[str]:
        items = [Item(name) for name in names]
        pytest_collection_modifyitems(items)
        return [item.nodeid for item in items if item.get_closest_marker("other_processor")]

    found = repeated(names)
    assert all(name.startswith("tests/fit/") for name in found)
    assert 46 < len(found) < 114  # a tenth of 800, give or take four standard deviations
    assert repeated(names[1::2]) == [name for name in names[1::2] if name in found]


@pytest.mark.parametrize(
    ("identity", "given_out_as"),
    [
        ("tests/rig/test_a.py::test_b@real-time", "real-time"),
        ("tests/rig/test_a.py::test_b[c@d]", "tests/rig/test_a.py"),
        ("tests/rig/test_a.py::Group::test_b", "tests/rig/test_a.py"),
    ],
)
def test_a_module_or_a_group_is_given_out_whole(identity: str, given_out_as: str) -> None:
    assert Sharing._split_scope(Sharing.__new__(Sharing), identity) == given_out_as


WHERE = """
import os
from pathlib import Path

import pytest


{mark}
def test_where() -> None:
    Path("{name}.where").write_text(os.environ["PYTEST_XDIST_WORKER"])
"""


def test_what_is_held_to_time_is_done_by_one_worker_whatever_its_modules(tmp_path: Path) -> None:
    """Of four modules two are held to time: the first two to be given out, to two workers unless they are one."""
    hooks = "pytest_collection_finish, pytest_collection_modifyitems, pytest_xdist_make_scheduler"
    (tmp_path / "conftest.py").write_text(f"from tests.workers import {hooks}\n", encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n real_time\n other_processor\n", encoding="utf-8")
    for name in ("a", "b", "c", "d"):
        mark = "@pytest.mark.real_time" if name in "bd" else ""
        (tmp_path / f"test_{name}.py").write_text(WHERE.format(mark=mark, name=name), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist", "loadgroup", "--no-loadscope-reorder"]
    root = str(Path(__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": root}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    workers = {path.stem: path.read_text() for path in tmp_path.glob("*.where")}
    assert sorted(workers) == ["a", "b", "c", "d"]
    assert workers["b"] == workers["d"]


def test_the_report_names_what_was_repeated(pytestconfig: pytest.Config) -> None:
    """A test in real time that was repeated: pytest counts it, and leaves it out of ``-ra``."""
    (shown,) = [word for word in pytestconfig.getini("addopts") if word.startswith("-r")]
    assert {"a", "R"} <= set(shown)


def test_compiled_modules_are_shared_where_none_may_lie_beside_the_sources(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    """By the process itself and by what a test starts."""
    kept = tmp_path / "cache"

    class Cache:
        def mkdir(self, name: str) -> Path:
            return kept / name

    monkeypatch.setattr(pytestconfig, "cache", Cache())
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("PYTHONPYCACHEPREFIX", "")
    bytecode.keep(pytestconfig)
    assert (sys.dont_write_bytecode, sys.pycache_prefix) == (False, str(kept / "bytecode"))
    (tmp_path / "some.py").write_text("", encoding="utf-8")
    subprocess.run([sys.executable, "-c", "import some"], cwd=tmp_path, check=True)
    assert len(list(kept.rglob("some.*.pyc"))) == 1
    assert not (tmp_path / "__pycache__").exists()
