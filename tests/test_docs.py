"""Every example in the README and the docs is executed, page by page, in the order it stands.

A fence ``pycon`` holds a Python session, a fence ``console`` holds commands behind ``$``, a fence
named ``toml`` or the like with ``name=FILE`` is written to that file first. Commands run in one folder a page.
"""

from __future__ import annotations

import doctest
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"^```(?P<kind>[\w-]+)(?P<info>[^\n]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)


def pages_with_examples() -> Iterator[Path]:
    for page in PAGES:
        if page.name == "commands.md":
            continue  # tests/acceptance/test_commands_page.py runs it, and reads what each command prints
        if "_build" not in page.parts and re.search(r"^```(pycon|console)", page.read_text("utf-8"), re.MULTILINE):
            yield page


def run_commands(body: str, folder: Path) -> None:
    for line in body.splitlines():
        if not line.startswith("$ "):
            continue
        words = shlex.split(line[2:].partition("  #")[0])
        assert words[0] == "ipmclab", f"only ipmclab is run in examples, not {words[0]!r}"
        command = [sys.executable, "-c", "from ipmclab.cli import main; main()", *words[1:]]
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert result.returncode == 0, f"{line}\n{result.stdout}\n{result.stderr}"


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
            run_commands(fence["body"], tmp_path)
        if fence["kind"] == "pycon":
            line = text[: fence.start()].count("\n") + 1
            example = doctest.DocTestParser().get_doctest(fence["body"], names, page.name, str(page), line)
            runner = doctest.DocTestRunner(optionflags=flags)
            runner.run(example, clear_globs=False)
            names = example.globs
            assert not runner.failures, f"an example in {page.name} near line {line} does not give what it shows"
