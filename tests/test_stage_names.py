"""Who spells the names of a stage's parameters: the model, one start a stage, and few others."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from ipmclab.model.kinds import kinds

SOURCES = Path(__file__).parent.parent / "src" / "ipmclab"

WORDS = {kind.prefix.split(".")[0] for kind in kinds()} - {"geometry", "environment"}
LAWS = {kind.prefix.rstrip(".") for kind in kinds() if kind.prefix.startswith("environment.")}
SPELL = re.compile(rf"({'|'.join(sorted(WORDS | LAWS))})\.([a-z]|$)")
"""A literal, or the fixed part of one, that is such a name or begins with it. Dimensions are no stage's. An experiment
has a table [environment] too, so that a law counts by its whole name."""

THEIR_SUBJECT = ("model", "procedure", "consistency", "data", "codegen")
STARTS = re.compile(r"search/starts/start_\w+\.py")

KNOWN = {
    "cli/conflict.py": "the sentence about numbers of the thesis that contradict each other",
    "identification/build.py": "fixed values that a fit says it leans on",
    "identification/search/doublet.py": "a pole of the coupling beside its zero",
    "identification/search/starts/start.py": "the order of the starts, and the series resistance",
    "identification/undetermined/diagnosis.py": "gain against zero, and other exchanges that have a name",
}
"""Files that know something of certain parameters that no stage can declare for itself, and what."""


def literals(path: Path) -> Iterator[str]:
    tree = ast.parse(path.read_text("utf-8"))
    bodies = [node.body for node in ast.walk(tree) if isinstance(getattr(node, "body", None), list)]
    prose = {
        id(line.value)
        for body in bodies
        for line in body
        if isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            yield node.value


def test_few_files_spell_the_names_of_parameters() -> None:
    found = set()
    for path in SOURCES.rglob("*.py"):
        name = path.relative_to(SOURCES).as_posix()
        if name.split("/")[0] in THEIR_SUBJECT or STARTS.search(name):
            continue
        if any(SPELL.match(literal) for literal in literals(path)):
            found.add(name)
    assert found == set(KNOWN)
    assert len(KNOWN) <= 6
