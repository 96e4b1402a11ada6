"""Which sources a result hangs on, and whether it is older than they are.

A benchmark declares its own, as a constant of its module: ``SOURCES``, files and folders from the root of the
repository. Its result carries their digest; where that differs from the digest of today the result is stale.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
LINE = "* sources "
"""So the line of a result begins that names the digest."""


def declared(name: str) -> tuple[str, ...]:
    """What a benchmark declares, read without importing it: it may need what is not installed here."""
    module = ast.parse((ROOT / "benchmarks" / f"{name}.py").read_text(encoding="utf-8"))
    for statement in module.body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "SOURCES":
            return tuple(ast.literal_eval(statement.value))
    raise ValueError(f"benchmarks/{name}.py declares no SOURCES")


def files(name: str) -> Iterator[Path]:
    """Every file that the result of a benchmark hangs on, its own module among them."""
    for path in (f"benchmarks/{name}.py", *declared(name)):
        if not (ROOT / path).exists():
            raise FileNotFoundError(f"benchmarks/{name}.py declares {path}, which is not there")
        found = sorted((ROOT / path).rglob("*")) if (ROOT / path).is_dir() else [ROOT / path]
        yield from (one for one in found if one.is_file() and "__pycache__" not in one.parts)


def digest(name: str) -> str:
    """Of the names and contents of these files; line ends do not count."""
    made = hashlib.sha256()
    for path in files(name):
        made.update(f"{path.relative_to(ROOT).as_posix()}\n".encode())
        made.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return made.hexdigest()[:16]


def stated(name: str) -> str:
    """The digest that a result carries."""
    lines = (RESULTS / f"{name}.md").read_text(encoding="utf-8").splitlines()
    return next((line.removeprefix(LINE) for line in lines if line.startswith(LINE)), "none")


def stale() -> list[str]:
    """The benchmarks that are to be run again."""
    names = sorted(path.stem for path in RESULTS.glob("*.md"))
    return [name for name in names if stated(name) != digest(name)]


def is_release() -> bool:
    """Whether the changelog calls its newest version released."""
    lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
    newest = next(line for line in lines if line.startswith("## "))
    return "(unreleased)" not in newest
