"""The page of constants: what each hand-set number of the rooms that estimate is, and where it comes from.

The docs are built with it. A number beside which nobody wrote what it is fails a test.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

SOURCE: Final = Path(__file__).resolve().parents[1] / "src" / "ipmclab"
ROOMS: Final = (
    "quality",
    "identification",
    "fit",
    "statespace",
    "strip_state",
    "prediction",
    "refitting",
    "choosing",
    "forecasting",
    "posterior",
    "consistency",
    "procedure",
)

WITH_ORIGIN: Final = ("quality", "consistency", "forecasting", "prediction")
"""Rooms whose numbers decide what a user is told: each of theirs also says where it comes from."""
_ORIGIN: Final = re.compile(
    r"\bconvention\b|\bderived\b|\ba limit\b|physical constant|data sheet|literature|\bthesis\b|\(Friend, |\bMATLAB\b"
    r"|\bmeasured\b|benchmark|\(`\w+`[^)]*\)|\b[A-Z]\w+(?: and [A-Z]\w+| and others)? (?:19|20)\d\d\b"
)


@dataclass(frozen=True)
class Constant:
    """One number, or a few, set by hand at the top of a file.

    Parameters
    ----------
    file, name, value, words : str
        ``words`` say what it is and where it comes from; empty where nobody wrote that.
    line : int
    """

    file: str
    line: int
    name: str
    value: str
    words: str

    @property
    def has_origin(self) -> bool:
        """Whether the words say where it comes from: derived, measured, a convention, a limit, or a publication."""
        return _ORIGIN.search(self.words) is not None


def constants_of(room: str, source: Path = SOURCE) -> Iterator[Constant]:
    """Every such constant of a room, file by file.

    What stands in one block, without an empty line, shares the docstring that ends it.
    """
    for path in sorted((source / room).rglob("*.py")):
        text = path.read_text("utf-8")
        lines, tree = text.splitlines(), ast.parse(text).body
        for number, node in enumerate(tree):
            name, value = _assigned(node)
            if value is None or not _is_set_by_hand(name, value):
                continue
            words = _comment(lines, node) or _docstring(tree, number)
            if node.end_lineno != node.lineno:  # comments within it say what its entries are
                words = _docstring(tree, number) or words
            shown = " ".join(ast.unparse(value).split())
            where = path.relative_to(source).as_posix()
            yield Constant(where, node.lineno, name, shown if len(shown) < 60 else f"{shown[:57]}...", words)


def page(source: Path = SOURCE) -> str:
    """The page, a table for each room."""
    parts = []
    for room in ROOMS:
        rows = [
            f"| `{one.name}` | `{one.value}` | {_in_a_cell(one.words)} | `{one.file}` |"
            for one in constants_of(room, source)
        ]
        parts.append(
            "\n".join([f"## {room}", "", "| constant | value | what it is | where |", "|---|---|---|---|", *rows])
        )
    return "\n\n".join(parts) + "\n"


def _in_a_cell(words: str) -> str:
    """Without what Markdown takes for the end of a cell, or for mathematics."""
    return words.replace("|", "\\|").replace("$", "\\$").replace("``", "`")


def _assigned(node: ast.stmt) -> tuple[str, ast.expr | None]:
    if isinstance(node, ast.AnnAssign):
        return ast.unparse(node.target), node.value
    return (ast.unparse(node.targets[0]), node.value) if isinstance(node, ast.Assign) else ("", None)


def _is_set_by_hand(name: str, value: ast.expr) -> bool:
    numbers = [
        one
        for one in ast.walk(value)
        if isinstance(one, ast.Constant) and isinstance(one.value, int | float) and not isinstance(one.value, bool)
    ]
    return bool(numbers) and re.match(r"\(?_?[A-Z][A-Z]", name) is not None


def _comment(lines: list[str], node: ast.stmt) -> str:
    """What stands behind it, or alone on the lines before it."""
    for line in lines[node.lineno - 1 : node.end_lineno]:
        if "  # " in line:
            return line.split("  # ", 1)[1].strip()
    above = []
    for line in reversed(lines[: node.lineno - 1]):
        if not line.startswith("# "):
            break
        above.append(line[2:])
    return " ".join(reversed(above))


def _docstring(tree: list[ast.stmt], number: int) -> str:
    """The docstring of the block in which it stands."""
    for node, following in zip(tree[number:], tree[number + 1 :], strict=False):
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            return " ".join(str(following.value.value).split())
        if following.lineno != (node.end_lineno or node.lineno) + 1:
            break
    return ""
