"""What every benchmark reports: a ratio with a bound is judged, one without is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.__main__ import tell_stale
from benchmarks.harness import Ratio
from benchmarks.sources import LINE, RESULTS, digest, stale


@pytest.mark.parametrize(
    ("bounds", "told"),
    [
        ({}, "|  |  |"),
        ({"at_most": 10.0}, "| at most 10 | holds |"),
        ({"at_most": 2.0}, "| at most 2 | FAILS |"),
        ({"at_least": 4.0}, "| at least 4 | FAILS |"),
        ({"at_least": 1.0, "at_most": 3.0}, "| at least 1, at most 3 | holds |"),
    ],
)
def test_a_ratio_is_judged_by_its_bounds_only(bounds: dict[str, float], told: str) -> None:
    assert str(Ratio("one / other", np.array([2.0, 3.0, 4.0]), **bounds)).endswith(told)


def test_every_result_says_what_it_was_measured_with() -> None:
    """A benchmark declares its sources, which are there, and its result has the line of their digest."""
    for path in RESULTS.glob("*.md"):
        assert len(digest(path.stem)) == 16
        assert any(line.startswith(LINE) for line in path.read_text(encoding="utf-8").splitlines()), path.name


def test_a_result_is_stale_once_a_source_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = tmp_path / "src" / "room"
    results = tmp_path / "benchmarks" / "results"
    for folder in (room, results):
        folder.mkdir(parents=True)
    (tmp_path / "benchmarks" / "one.py").write_text('SOURCES = ("src/room",)\n')
    (room / "a.py").write_bytes(b"1\n2\n")
    monkeypatch.setattr("benchmarks.sources.ROOT", tmp_path)
    monkeypatch.setattr("benchmarks.sources.RESULTS", results)
    (results / "one.md").write_text(f"# One\n\n{LINE}{digest('one')}\n")
    assert stale() == []
    (room / "a.py").write_bytes(b"1\r\n2\r\n")  # as git gives it out on Windows
    assert stale() == []
    for change in (
        lambda: (room / "a.py").write_text("1\n3\n"),
        lambda: (room / "b.py").write_text(""),
        lambda: (tmp_path / "benchmarks" / "one.py").write_text('SOURCES = ("src/room",)\nTRIALS = 2\n'),
        lambda: (results / "one.md").write_text("# One\n"),
    ):
        change()
        assert stale() == ["one"]
        (results / "one.md").write_text(f"# One\n\n{LINE}{digest('one')}\n")
        assert stale() == []


@pytest.mark.parametrize(("newest", "released"), [("## 1.2.0 (unreleased)", False), ("## 1.2.0", True)])
def test_only_a_release_fails_for_stale_results(
    newest: str, released: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "CHANGELOG.md").write_text(f"# Changelog\n\n{newest}\n\n## 1.1.0\n")
    monkeypatch.setattr("benchmarks.sources.ROOT", tmp_path)
    monkeypatch.setattr("benchmarks.__main__.stale", lambda: ["one"])
    if released:
        with pytest.raises(SystemExit, match="a release has no stale results, and here are 1"):
            tell_stale()
    else:
        tell_stale()
