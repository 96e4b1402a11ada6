"""What was set by hand has words beside it, and the page of the docs shows it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def constants() -> ModuleType:
    spec = importlib.util.spec_from_file_location("constants", DOCS / "constants.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_every_number_says_what_it_is(constants: ModuleType) -> None:
    every = [one for room in constants.ROOMS for one in constants.constants_of(room)]
    assert len(every) > 300
    assert [f"{one.file}:{one.line} {one.name}" for one in every if len(one.words) < 6] == []


def test_every_number_that_decides_a_message_says_where_it_comes_from(constants: ModuleType) -> None:
    every = [one for room in constants.WITH_ORIGIN for one in constants.constants_of(room)]
    assert len(every) > 100
    assert [f"{one.file}:{one.line} {one.name}" for one in every if not one.has_origin] == []


def test_words_without_an_origin_are_found(constants: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "one.py").write_text(
        "BARE = 1.0  # rows of a mean\n"
        "CHOSEN = 2.0  # rows of a mean (convention)\n"
        "BOUND = 3  # rows at most: a limit\n"
        "FOUND = 0.1  # of the range (`fuzz`)\n",
        "utf-8",
    )
    found = {one.name: one.has_origin for one in constants.constants_of("room", tmp_path)}
    assert found == {"BARE": False, "CHOSEN": True, "BOUND": True, "FOUND": True}


def test_words_are_found_behind_above_and_below(constants: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "one.py").write_text(
        "FIRST = 1.0  # of a row\n"
        "SECOND, THIRD = 2, 3\n"
        '"""Rows | that are few."""\n'
        "\n"
        "# Of a length.\n"
        "_FOURTH: float = 4.0\n"
        "\n"
        "_BARE = 5\n"
        "\n"
        'NAME = "no number"\n'
        "TRUE = True\n",
        "utf-8",
    )
    found = {one.name: one.words for one in constants.constants_of("room", tmp_path)}
    assert found == {
        "FIRST": "of a row",
        "(SECOND, THIRD)": "Rows | that are few.",
        "_FOURTH": "Of a length.",
        "_BARE": "",
    }


def test_the_page_has_a_table_for_each_room(constants: ModuleType) -> None:
    page = constants.page()
    assert page.count("| constant | value |") == len(constants.ROOMS)
    assert "| `AS_CLOSE` | `1.1` | Times the least held-out error" in page
