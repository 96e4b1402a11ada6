"""Every command of the commands page, run as it stands, in its order."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from ipmclab.cli.app import GROUPS, VERBS, run

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"


@pytest.mark.usefixtures("finished_here")
def test_the_commands_page_runs(tmp_path: Path, monkeypatch, capsys) -> None:
    page = PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r"```(\w+)\n(.*?)```", page, flags=re.DOTALL)
    (tmp_path / "foreign.toml").write_text(next(text for kind, text in blocks if kind == "toml"), encoding="utf-8")
    for name, text in re.findall(r"```toml name=(\S+)\n(.*?)```", page, flags=re.DOTALL):
        (tmp_path / name).write_text(text, encoding="utf-8")
    lines = [line[2:] for kind, text in blocks if kind == "console" for line in text.splitlines()]
    monkeypatch.chdir(tmp_path)
    shown = set()
    for line in lines:
        program, *words = shlex.split(line)
        assert program == "ipmclab"
        shown.add(words[0])
        if words[0] in ("demo", "page"):
            continue  # test_demo.py runs it; a page is served until it is ended, tests/page/browser does that
        assert run([*words, "--json"]) == 0, line
        captured = capsys.readouterr()
        document = json.loads(captured.out)
        assert "error" not in document
        if "--out" in words:
            assert document["out"] == words[words.index("--out") + 1]
            assert (tmp_path / document["out"]).stat().st_size > 0
        assert captured.err == ""
    assert shown == {*VERBS, *GROUPS}
