"""What a recording says at its end."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab.cli.options import matching_files
from ipmclab.cli.record_view import files_typed, print_plan
from ipmclab.platform import as_typed


def test_many_runs_are_named_by_patterns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After ten runs the command that was proposed had ten paths; a pattern works in every shell, also of Windows."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "my runs"
    folder.mkdir()
    names = [f"20261128_0{k}_rig_strip_{kind}_{k}.nc" for kind in ("sine", "step") for k in range(5)]
    for name in [*names, "20261128_00_rig_strip_fingerprint_0.nc"]:
        (folder / name).touch()
    paths = [str(folder / name) for name in names]
    patterns = [str(Path("my runs", f"20261128_0*_{kind}_*.nc")) for kind in ("sine", "step")]
    assert files_typed(paths) == [as_typed(one) for one in patterns]
    found = [str(tmp_path / name) for one in patterns for name in matching_files(one)]
    assert sorted(found) == sorted(paths)
    assert files_typed(paths[:2]) == [as_typed(str(Path("my runs", name))) for name in names[:2]]
    (folder / "20261128_09_rig_strip_step_9.nc").touch()  # of an earlier recording: a pattern would name it too
    assert files_typed(paths) == [as_typed(str(Path("my runs", name))) for name in names]


def test_what_the_guard_watches_is_in_lines_of_readable_length() -> None:
    said: list[str] = []

    class View:
        say = staticmethod(said.append)

    sizes = dict.fromkeys(("seconds", "longest", "rows", "bytes_needed", "bytes_free"), 1)
    names = dict.fromkeys(("title", "sample", "rig", "folder"), "one")
    limits = {f"limit_{k}": "300 mA for 0.05 s, then zero" for k in range(9)}
    plan = {**names, **sizes, "steps": [], "conditions": [], "limits": limits, "remarks": ["a word " * 40]}
    print_plan(plan, View())  # type: ignore[arg-type]
    assert max(map(len, said)) <= 100
    assert "limit_8 300 mA for 0.05 s, then zero remark: a word" in " ".join(" ".join(said).split())
