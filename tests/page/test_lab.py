"""The folder of the page: nothing outside it, by no way."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.destination import replacing
from ipmclab.errors import InputError
from ipmclab.page.lab import Lab


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../x", "..", "runs/../../x", "a\0b", "//host/share"])
def test_a_path_outside_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="not in the folder"):
        Lab.open(tmp_path).path(name)


@pytest.mark.skipif(os.name != "posix", reason="other systems say of such a name that there is no file")
@pytest.mark.parametrize("name", [300 * "a" + ".nc", "runs/" + 300 * "a", 3000 * "a/" + "b.nc"])
def test_a_name_that_no_file_can_have_is_refused(tmp_path: Path, name: str) -> None:
    """A file system answers a question about it with an error, which nobody who asks would expect."""
    (tmp_path / "runs").mkdir()
    with pytest.raises(OSError, match="too long"):
        (tmp_path / name).is_file()
    with pytest.raises(InputError, match="not in the folder") as refused:
        Lab.open(tmp_path).path(name)
    assert len(str(refused.value)) < 300


@pytest.mark.skipif(os.name != "posix", reason="links need rights elsewhere")
def test_a_link_that_leads_outside_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    (tmp_path / "secret").write_text("x")
    (folder / "link").symlink_to(tmp_path / "secret")
    (folder / "up").symlink_to(tmp_path)
    lab = Lab.open(folder)
    for name in ("link", "up/secret"):
        with pytest.raises(InputError, match="not in the folder"):
            lab.path(name)
    (folder / "out.toml").symlink_to(tmp_path / "secret")
    (folder / "nowhere.toml").symlink_to(tmp_path / "none")
    (folder / "mine.toml").write_text("")
    assert [path.name for path in lab.tables()] == ["mine.toml"]


@pytest.mark.parametrize("name", ["CON", "nul.toml", "com1.x", "aux .x"])
def test_a_file_has_no_name_of_a_device(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="plain file name"):
        Lab.open(tmp_path).new_file(name, ".toml")


def test_a_name_that_only_begins_like_a_device_is_one(tmp_path: Path) -> None:
    for name in ("con-leak", "Aux power", "com1-step", "nul_2"):
        assert Lab.open(tmp_path).new_file(name, ".toml").name == f"{name}.toml"


@pytest.mark.parametrize("letter", ["a", "é", "字", "𝒜"])
def test_a_name_that_is_taken_can_be_written(tmp_path: Path, letter: str) -> None:
    """A file system counts bytes, and a file has a longer name until it is whole."""
    lab = Lab.open(tmp_path)
    accepted, codes = [], set()
    for count in range(1, 100):
        try:
            path = lab.new_file(count * letter, ".toml")
        except InputError as error:
            codes.add(error.code)
            continue
        with replacing(path, overwrite=False) as half:
            half.write_text("")
        accepted.append(count)
    assert accepted == list(range(1, len(accepted) + 1))
    assert len(accepted) >= 40
    assert codes == {"bad-name"}


@given(st.text(max_size=30))
def test_whatever_is_named_is_inside_or_refused(name: str) -> None:
    lab = Lab(Path(os.path.realpath(".")))
    try:
        found = lab.path(name)
    except InputError:
        return
    assert found == lab.root or lab.root in found.parents


@given(st.text(max_size=100))
def test_a_new_file_stands_in_the_folder_itself(name: str) -> None:
    lab = Lab(Path(os.path.realpath(".")))
    try:
        found = lab.new_file(name, ".toml")
    except InputError:
        return
    assert found.parent == lab.root
    assert found.suffix == ".toml"
    assert not found.name.startswith(".")


def test_what_a_killed_process_left_half_is_deleted_and_nothing_else(tmp_path: Path) -> None:
    """Half files as ``destination`` leaves them where its process is killed."""
    lab = Lab.open(tmp_path)
    lab.laboratory_folder.mkdir()
    killed = [replacing(folder / "r.html", overwrite=False) for folder in (lab.root, lab.laboratory_folder)]
    for writing in killed:
        half = writing.__enter__()
        half.write_text("half")
        os.utime(half, (0, 0))
    others = [".r.html.part", "r.html.0a1b2c3d.part", ".mine.toml", ".r.html.0a1b2c3d.part.txt"]
    for name in others:
        (tmp_path / name).write_text("mine")
        os.utime(tmp_path / name, (0, 0))
    (tmp_path / ".now.html.0a1b2c3d.part").write_text("somebody writes it now")
    lab.forget_halves()
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {*others, ".now.html.0a1b2c3d.part"}


def test_the_runs_are_where_record_puts_them(tmp_path: Path) -> None:
    lab = Lab.open(tmp_path)
    assert lab.laboratory_folder == tmp_path / "runs"
    (tmp_path / "recording").mkdir()
    assert lab.laboratory_folder == tmp_path
    with pytest.raises(InputError, match="no such folder"):
        Lab.open(tmp_path / "none")
