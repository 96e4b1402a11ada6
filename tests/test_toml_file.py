"""TOML files that people write, and everything that may stand there instead."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.errors import InputError
from ipmclab.toml_file import glance, parse_table, read_text

MISSING = InputError("no such file", code="no-such-file", where="x.toml", repair="write one")


def test_a_mark_at_the_start_is_no_part_of_the_text(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text('name = "strip"', encoding="utf-8-sig")
    assert read_text(path, kind="a rig file", missing=MISSING) == 'name = "strip"'
    assert glance(path) == {"name": "strip"}


def test_what_is_no_text_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_text(tmp_path / "x.toml", kind="a rig file", missing=MISSING)
    assert caught.value is MISSING
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, kind="a rig file", missing=MISSING)
    assert str(caught.value) == f"{tmp_path}: this is a folder, not a rig file; name a file in it"
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "bytes.toml", tmp_path / ("a" * 300), Path("null\0")):
        with pytest.raises(InputError, match="the file cannot be read as text"):
            read_text(path, kind="a rig file", missing=MISSING)
        assert glance(path) is None


@given(text=st.text() | st.sampled_from(["a = " + "[" * 100_000, f"a = 1{'0' * 5000}"]))
def test_any_text_is_a_table_or_told(text: str) -> None:
    try:
        assert repr(tomllib.loads(text)) == repr(parse_table(text, where="x.toml"))
    except (ValueError, RecursionError):
        with pytest.raises(InputError, match=r"x\.toml: not a TOML file: "):
            parse_table(text, where="x.toml")
