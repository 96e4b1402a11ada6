"""No module leans on itself by way of others: imports inside functions and for type checkers are counted too."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[1] / "src"


def modules_of(source: Path) -> dict[str, Path]:
    """Every module below a folder, by its dotted name."""
    return {
        ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__"): path
        for path in source.rglob("*.py")
    }


def imported_by(tree: ast.Module, known: Iterable[str]) -> set[str]:
    """The modules that a file imports anywhere: of ``from a import b``, a.b where that is a module."""
    names = set(known)
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name if name in names else node.module for name in inside}
    return found & names


def circle_in(graph: Mapping[str, set[str]]) -> list[str]:
    """One circle of modules, or nothing."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_circle_of_any_kind() -> None:
    """Neither in the laboratory nor in the stand-in chassis."""
    modules = modules_of(SOURCE)
    assert len(modules) > 500
    graph = {name: imported_by(ast.parse(path.read_text("utf-8")), modules) for name, path in modules.items()}
    assert sum(map(len, graph.values())) > 2000
    assert circle_in(graph) == []


@pytest.mark.parametrize(
    "back",
    [
        "from room.a import thing",
        "from room import a",
        "import room.a",
        "if TYPE_CHECKING:\n    from room.a import Thing",
        "def late():\n    from room.a import thing",
    ],
)
def test_a_circle_is_found_however_it_is_hidden(back: str) -> None:
    """At the top of a file, for type checkers, and inside a function."""
    files = {"room": "", "room.a": "from room.b import other", "room.b": back}
    graph = {name: imported_by(ast.parse(text), files) for name, text in files.items()}
    assert sorted(set(circle_in(graph))) == ["room.a", "room.b"]
