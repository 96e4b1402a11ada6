"""Every example in the README and the docs is executed, page by page, in the order it stands.

A fence ``pycon`` holds a Python session, a fence ``console`` holds commands behind ``$``, a fence
named ``toml`` or the like with ``name=FILE`` is written to that file first. Commands run in one folder a page.
"""

from __future__ import annotations

import doctest
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from ipmclab.cli.app import run
from ipmclab.model.kinds import further_kinds, unregister

ROOT = Path(__file__).parent.parent
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"^```(?P<kind>[\w-]+)(?P<info>[^\n]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)


def pages_with_examples() -> Iterator[Path]:
    for page in PAGES:
        if page.name == "commands.md":
            continue  # tests/acceptance/test_commands_page.py runs it, and reads what each command prints
        if "_build" not in page.parts and re.search(r"^```(pycon|console)", page.read_text("utf-8"), re.MULTILINE):
            yield page


def run_commands(body: str) -> None:
    for line in body.splitlines():
        if not line.startswith("$ "):
            continue
        words = shlex.split(line[2:].partition("  #")[0])
        assert words[0] == "ipmclab", f"only ipmclab is run in examples, not {words[0]!r}"
        assert run(words[1:]) == 0, line


@pytest.fixture
def own_stages() -> Iterator[None]:
    """What a page registers is forgotten after it."""
    yield
    for kind in further_kinds():
        unregister(kind.name)


@pytest.mark.usefixtures("own_stages", "finished_here")
@pytest.mark.parametrize("page", list(pages_with_examples()), ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_on(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's sessions give what they show, and its commands end well."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    text = page.read_text("utf-8")
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    for fence in FENCE.finditer(text):
        named = re.search(r"name=(\S+)", fence["info"])
        if named:
            (tmp_path / named[1]).write_text(fence["body"], "utf-8")
        if fence["kind"] == "console":
            run_commands(fence["body"])
        if fence["kind"] == "pycon":
            line = text[: fence.start()].count("\n") + 1
            example = doctest.DocTestParser().get_doctest(fence["body"], names, page.name, str(page), line)
            runner = doctest.DocTestRunner(optionflags=flags)
            runner.run(example, clear_globs=False)
            names = example.globs
            assert not runner.failures, f"an example in {page.name} near line {line} does not give what it shows"
