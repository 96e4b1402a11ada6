"""The page that says where things are names nothing that is not there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
NAMED = re.compile(r"`([\w/-]+(?:\.(?:py|md|toml)|/))`")


def test_every_file_and_folder_that_the_house_names_is_there() -> None:
    there = {
        f"/{path.relative_to(ROOT).as_posix()}{'/' if path.is_dir() else ''}"
        for room in ("src", "tests", "benchmarks", "docs")
        for path in (ROOT / room).rglob("*")
    }
    named = set(NAMED.findall((ROOT / "docs" / "house.md").read_text("utf-8")))
    assert len(named) > 200
    assert not [name for name in sorted(named) if not any(path.endswith(f"/{name}") for path in there)]
