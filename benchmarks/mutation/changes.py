"""The small changes that a source file allows, and the draw of some of them.

A change replaces one piece of text: a comparison by its neighbour, a number by twice itself, a sum by a difference, a
guard by one that never holds. What is not code of ours to be wrong (annotations, decorators, texts) is left alone.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

SEED: Final = 20261121

STRICT: Final = ("rig/safety", "store/journal")
"""Rooms where a change that nobody notices costs a strip or a record."""

STRICT_SHARE: Final = 0.1
"""Of the draw that each strict room gets, whatever its size: a score of few changes says little."""

COMPARISONS: Final[dict[type[ast.cmpop], tuple[str, str]]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}
OPERATORS: Final[dict[type[ast.operator], tuple[str, str]]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"),
    ast.Mod: ("%", "//"),
    ast.Pow: ("**", "*"),
    ast.MatMult: ("@", "*"),
}
NAMES: Final = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any"}


@dataclass(frozen=True)
class Change:
    """One piece of a file's text, and what stands there instead."""

    path: str
    line: int
    begin: int
    end: int
    old: str
    new: str

    @property
    def room(self) -> str:
        """Of the house: the package, and the room where it is a strict one."""
        parts = Path(self.path).parts[1:-1]
        inside = "/".join(parts[1:3])
        if inside in STRICT:
            return inside
        return parts[0] if parts[0] != "ipmclab" else parts[1] if len(parts) > 1 else "ipmclab"

    def applied(self, text: bytes) -> bytes:
        """The file with the change."""
        if text[self.begin : self.end] != self.old.encode():
            raise ValueError(f"{self.path}:{self.line} no longer reads {self.old!r}")
        return text[: self.begin] + self.new.encode() + text[self.end :]


class _Finder(ast.NodeVisitor):
    """Walks over a file and notes what could be changed."""

    def __init__(self, path: str, source: bytes) -> None:
        self.path, self.source = path, source
        lines = source.splitlines(keepends=True)
        self.starts = np.concatenate([[0], np.cumsum([len(line) for line in lines])])
        self.found: list[Change] = []

    def begin(self, node: ast.AST) -> int:
        return int(self.starts[node.lineno - 1]) + node.col_offset  # type: ignore[attr-defined]

    def end(self, node: ast.AST) -> int:
        return int(self.starts[node.end_lineno - 1]) + node.end_col_offset  # type: ignore[attr-defined]

    def note(self, node: ast.AST, begin: int, end: int, new: str) -> None:
        old = self.source[begin:end].decode()
        self.found.append(Change(self.path, node.lineno, begin, end, old, new))  # type: ignore[attr-defined]

    def between(self, left: ast.AST, right: ast.AST, old: str, new: str) -> None:
        """Replace an operator that stands between two operands."""
        start = self.end(left)
        gap = self.source[start : self.begin(right)].decode()
        pattern = rf"\b{old.replace(' ', chr(92) + 's+')}\b" if old.isalpha() or " " in old else re.escape(old)
        match = re.search(pattern, re.sub(r"#[^\n]*", lambda comment: " " * len(comment[0]), gap))
        if match:
            offset = len(gap[: match.start()].encode())
            self.note(left, start + offset, start + offset + len(match[0].encode()), new)

    # What is no behaviour of ours.
    def visit_JoinedStr(self, node: ast.JoinedStr) -> None: ...

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
            self.visit(default)
        for statement in node.body:
            self.visit(statement)

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            self.visit(statement)

    # What is.
    def visit_If(self, node: ast.If) -> None:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return
        if isinstance(node.test, ast.Name | ast.Attribute | ast.Call) and not node.orelse:
            self.note(node.test, self.begin(node.test), self.end(node.test), "False")
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, kind, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            self.between(left, right, *COMPARISONS[type(kind)])
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        sides = (node.left, node.right)
        is_text = any(isinstance(s, ast.JoinedStr) or isinstance(getattr(s, "value", 0), str) for s in sides)
        if type(node.op) in OPERATORS and not is_text:
            self.between(*sides, *OPERATORS[type(node.op)])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        words = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        self.between(node.values[0], node.values[1], *words)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.Not | ast.USub):
            self.note(node, self.begin(node), self.begin(node.operand), "")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            new = str(not value)
        elif isinstance(value, int):
            new = str(value + 1)
        elif isinstance(value, float) and np.isfinite(value):
            new = repr(2.0 * value if value else 1.0)
        else:
            return
        self.note(node, self.begin(node), self.end(node), new)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in NAMES:
            self.note(node, self.end(node.func) - len(name), self.end(node.func), NAMES[name])
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self.note(node, self.begin(node), self.end(node), "None")
        self.generic_visit(node)


def changes_of(root: Path, path: str) -> list[Change]:
    """Everything that could be changed in one file, path relative to the root."""
    source = (root / path).read_bytes()
    finder = _Finder(path, source)
    finder.visit(ast.parse(source))
    return finder.found


def draw(root: Path, count: int) -> list[Change]:
    """Changes drawn over ``src``, each as likely as another, with a fixed share from the strict rooms.

    The order is drawn too, so that the first ones are a fair sample of them all. What is drawn hangs on the changed
    line alone: an edit elsewhere leaves the draw as it is.
    """
    files = sorted(str(path.relative_to(root).as_posix()) for path in (root / "src").rglob("*.py"))
    everything = sorted((pair for path in files for pair in _in_drawn_order(root, path)), key=lambda pair: pair[0])
    share = round(STRICT_SHARE * count)
    picked = [change for _, change in everything[: count - share * len(STRICT)]]
    for room in STRICT:
        there = [change for _, change in everything if change.room == room and change not in picked]
        picked += there[:share]
    return picked


def _in_drawn_order(root: Path, path: str) -> Iterator[tuple[str, Change]]:
    """The changes of a file, each with its place in the draw: a digest of its line and how often it stood before."""
    lines = (root / path).read_bytes().splitlines()
    before: Counter[tuple[str, str, str]] = Counter()
    for change in changes_of(root, path):
        key = lines[change.line - 1].decode().strip(), change.old, change.new
        text = repr((SEED, path, *key, before[key]))
        before[key] += 1
        yield hashlib.sha256(text.encode()).hexdigest(), change
