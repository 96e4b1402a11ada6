"""Small changes to code: which there are, what a file reads with one, and which tests are asked about it."""

from __future__ import annotations

import ast
import math
import os
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from benchmarks import mutants, properties
from benchmarks.mutation.changes import Change, changes_of, draw
from benchmarks.mutation.noticing import Imports
from benchmarks.mutation.trial import Tree, Verdict

SOURCE = '''"""A µ of text, 3 + 4."""
LIMIT: float = 2.5  # 7 µm
@decorated(1)
def least(values: list[int], only: bool = True) -> int:
    if values is not None and len(values) > 3:
        print(f"{1 + 1} values")
    if done():
        return -min(values)
    return values[0] * 2
'''
CHANGES = {
    (2, "2.5", "5.0"),
    (4, "True", "False"),
    (5, "and", "or"),
    (5, "is not", "is"),
    (5, ">", ">="),
    (5, "3", "4"),
    (6, 'print(f"{1 + 1} values")', "None"),
    (7, "done()", "False"),
    (8, "-", ""),
    (8, "min", "max"),
    (9, "*", "/"),
    (9, "0", "1"),
    (9, "2", "3"),
}


def found_in(folder: Path) -> list[Change]:
    (folder / "one.py").write_text(SOURCE, encoding="utf-8")
    return changes_of(folder, "one.py")


def test_what_is_behaviour_is_changed_and_texts_types_and_decorators_are_not(tmp_path: Path) -> None:
    assert {(change.line, change.old, change.new) for change in found_in(tmp_path)} == CHANGES


def test_a_change_stands_where_it_was_found_and_nowhere_else(tmp_path: Path) -> None:
    for change in found_in(tmp_path):
        text = change.applied(SOURCE.encode()).decode()
        ast.parse(text)
        differing = [
            k for k, (old, new) in enumerate(zip(SOURCE.split("\n"), text.split("\n"), strict=True), 1) if old != new
        ]
        assert differing == [change.line]


def test_a_file_that_reads_otherwise_is_not_changed(tmp_path: Path) -> None:
    change = found_in(tmp_path)[0]
    with pytest.raises(ValueError, match="no longer reads"):
        change.applied(b" " + SOURCE.encode())


def test_an_edit_elsewhere_leaves_the_draw_as_it_is(tmp_path: Path) -> None:
    def drawn(source: str) -> list[tuple[str, str]]:
        file = tmp_path / "src" / "ipmclab" / "one.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(source, encoding="utf-8")
        return [(change.old, change.new) for change in draw(tmp_path, 2 * len(CHANGES))]

    before = drawn(SOURCE)
    assert set(before) == {(old, new) for _, old, new in CHANGES}
    assert drawn(f"\n\n{SOURCE}") == before
    assert drawn(SOURCE.replace("2.5", "'text'")) == [change for change in before if change[0] != "2.5"]


def test_the_tests_of_a_module_come_first_after_its_own_examples() -> None:
    imports = Imports(Path(__file__).parents[2])
    for path, test in (
        ("src/ipmclab/quality/kink.py", "tests/quality/test_kink.py"),
        ("src/ipmclab/rig/safety/limits.py", "tests/rig/test_limits.py"),
        ("src/virtual_cdaq/model/buffers.py", "tests/virtual_cdaq/test_buffers.py"),
    ):
        first, *others = imports.tests_of(path)
        assert first == path
        assert test in others[:3]


@pytest.mark.skipif(os.name == "nt" or shutil.which("git") is None, reason="it needs signals and git")
def test_a_change_that_ends_the_process_is_noticed_by_the_test_that_ran(tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    (root / "test_one.py").write_text(
        "import os, signal\n"
        "def test_well(): pass\n"
        "def test_ends_it(): os.kill(os.getpid(), signal.SIGSEGV)\n"
        "def test_after(): pass\n"
    )
    for words in (("init", "-q"), ("add", ".")):
        subprocess.run(["git", *words], cwd=root, check=True)
    tree = Tree(root, tmp_path / "copy")
    assert tree.test(["test_one.py"], 120.0).test == "test_one.py::test_ends_it"
    assert tree.test(["test_one.py::test_well"], 120.0).passed


def test_a_call_goes_on_where_the_last_one_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A verdict is kept under the text of its file. What nobody noticed may be asked again: the last word counts."""
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    noticed, missed, untried = found_in(tmp_path)[:3]
    kept = tmp_path / "build" / "mutants.jsonl"
    for verdict in (Verdict(noticed, "tests/test_one.py::test_it", 1.0), Verdict(missed, None, 2.0)):
        mutants.Known(kept).add(verdict)
    known = mutants.Known(kept)
    assert known.get(noticed) == Verdict(noticed, "tests/test_one.py::test_it", 1.0)
    for again, expected in ((False, [untried]), (True, [missed, untried])):
        assert [change for change in (noticed, missed, untried) if known.is_open(change, again)] == expected
    known.add(Verdict(missed, "tests/test_one.py::test_more", 3.0))
    assert not mutants.Known(kept).is_open(missed, again=True)
    assert [mutants.Known(kept).was_missed(change) for change in (noticed, missed, untried)] == [False, True, False]
    (tmp_path / "one.py").write_text(f"{SOURCE}\n", encoding="utf-8")
    assert mutants.Known(kept).is_open(noticed, again=False)


def test_properties_are_drawn_in_rounds_of_which_each_has_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert list(properties.rounds(6000)) == [(20261121 + k, n) for k, n in enumerate((250, 500, 1000, 2000, 2000, 250))]
    asked = []

    def draw(*told: object) -> tuple[Counter[str], dict[str, str]]:
        asked.append(told)
        return Counter(it=250), {}

    monkeypatch.setattr(properties, "draw", draw)
    for end, expected in ((math.inf, {"it": 250}), (0.0, {"it": 250})):  # what is known needs no time
        drawn = properties.Drawn(tmp_path / "properties.jsonl")
        assert drawn.turn("test_one.py", 250, 20261121, end) == (expected, {})
    assert drawn.turn("test_one.py", 250, 20261122, 0.0) == ({}, {})
    assert asked == [("test_one.py", 250, 20261121)]
