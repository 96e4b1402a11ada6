"""What stands in a run file, how it is written, and what reading says of a file that is none."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import load_actuator, simulate
from ipmclab.errors import InputError, IpmclabError
from ipmclab.run import QUALITY_FLAGS, Run, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store import run_file
from ipmclab.store.run_file import peek, read_run, write_run


@pytest.fixture(scope="module")
def run() -> Run:
    time = np.arange(500) / 50
    current = 0.06 * np.exp(-time)
    current[100:110] = np.nan
    return Run.from_arrays(
        time=time,
        voltage=np.ones(500),
        current=current,
        temperature=[20.0, 20.5],
        relative_humidity=[80.0, 79.0],
        time_environment=[0.0, 9.0],
        hold="zero-before",
        quality={"current": np.where(np.isnan(current), QUALITY_FLAGS["sentinel"], 0)},
        metadata=RunMetadata(
            sample=Sample(id="2", dry_mass=103e-6),
            mounting_id="2-a",
            signal="step 1 V",
            voltage_sensed="electrodes",
            shunt_resistance=1.0,
            ranges={"current": (-0.2, 0.2)},
        ),
    )


@pytest.fixture(scope="module")
def content(run: Run, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("run") / "run.nc"
    write_run(run, path)
    return path.read_bytes()


@pytest.fixture
def file(content: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "run.nc"
    path.write_bytes(content)
    return path


def test_the_file_is_the_dataset_of_the_run(run: Run, file: Path) -> None:
    with xarray.open_dataset(file, engine="h5netcdf") as opened:
        xarray.testing.assert_equal(opened, run.data)
        assert {name: opened[name].attrs.get("units") for name in ("time", "voltage", "current")} == {
            "time": "s",
            "voltage": "V",
            "current": "A",
        }
        assert opened["temperature"].dims == ("time_environment",)
        assert opened["current_quality"].attrs["flag_meanings"].split() == list(QUALITY_FLAGS)
        np.testing.assert_array_equal(opened["current_quality"].attrs["flag_masks"], list(QUALITY_FLAGS.values()))


def test_people_read_the_attributes(file: Path, run: Run) -> None:
    with xarray.open_dataset(file, engine="h5netcdf") as opened:
        assert opened.attrs["hold"] == "zero-before"
        assert opened.attrs["sample_id"] == "2"
        assert opened.attrs["shunt_resistance"] == "1.0 ohm"
        assert opened.attrs["ranges"] == "current: -0.2 to 0.2 A"
        document = json.loads(opened.attrs["metadata_json"])
    assert document["hold"] == "zero-before"
    assert document["content_sha256"] == run.content_sha256
    assert document["metadata"]["sample"]["id"] == "2"


def test_a_peek_tells_texts_that_are_there_and_of_no_run_nothing(file: Path, tmp_path: Path) -> None:
    with h5py.File(file, "r+") as stored:
        stored.attrs["number"] = 3.0
    assert peek(file, ("signal", "hold", "purpose", "number")) == {"signal": "step 1 V", "hold": "zero-before"}
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "text").write_text("time,voltage\n")
    for name in ("nowhere", "empty", "text", "."):
        assert peek(tmp_path / name, ("signal",)) == {}


def test_old_readers_open_it_and_a_flipped_bit_is_caught(file: Path) -> None:
    # Superblock version 0 is what HDF5 1.8 wrote; MATLAB's library refuses the newest one.
    assert file.read_bytes()[8] == 0
    with h5py.File(file) as stored:
        for name in ("time", "voltage", "current", "current_quality"):
            dataset = stored[name]
            assert (dataset.compression, dataset.compression_opts) == ("gzip", 1)
            assert dataset.shuffle
            assert dataset.fletcher32
        chunk = stored["current"].id.get_chunk_info(0)
    damaged = bytearray(file.read_bytes())
    damaged[chunk.byte_offset + chunk.size // 2] ^= 0x10
    file.write_bytes(damaged)
    with pytest.raises(InputError, match="the file is damaged"):
        read_run(file)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such permissions")
def test_other_users_may_read_it_like_any_new_file(file: Path, run: Run, tmp_path: Path) -> None:
    write_run(run, tmp_path / "new.nc")
    (tmp_path / "plain").write_bytes(b"")
    assert (tmp_path / "new.nc").stat().st_mode == (tmp_path / "plain").stat().st_mode


class TestWriting:
    def test_an_existing_file_stays_without_leave(self, run: Run, tmp_path: Path) -> None:
        path = tmp_path / "run.nc"
        path.write_text("precious")
        with pytest.raises(InputError, match=r"run\.nc: the file exists already; choose another name, or allow"):
            write_run(run, path)
        assert path.read_text() == "precious"
        write_run(run, path, overwrite=True)
        assert read_run(path).content_sha256 == run.content_sha256

    def test_no_folder_is_made(self, run: Run, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"the folder .* does not exist"):
            write_run(run, tmp_path / "new" / "run.nc")
        assert not (tmp_path / "new").exists()

    def test_another_ending_is_refused(self, run: Run, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"a run file ends in \.nc, not in '\.csv'; .*export"):
            write_run(run, tmp_path / "run.csv")

    def test_a_folder_of_that_name_is_refused(self, run: Run, tmp_path: Path) -> None:
        (tmp_path / "run.nc").mkdir()
        with pytest.raises(InputError, match="this is a folder"):
            write_run(run, tmp_path / "run.nc", overwrite=True)

    @pytest.mark.parametrize("name", ["a" * 300 + ".nc", "a\0.nc"])
    def test_a_name_that_no_file_can_have_is_refused(self, name: str, run: Run, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"this cannot be the name of a file here: .*; give another name"):
            write_run(run, tmp_path / name)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.skipif(os.name == "nt", reason="Windows makes links with special rights only")
    def test_a_link_stays_and_its_file_is_written(self, run: Run, tmp_path: Path) -> None:
        link, target = tmp_path / "link.nc", tmp_path / "target.nc"
        link.symlink_to(target)
        write_run(run, link)
        assert read_run(target).content_sha256 == run.content_sha256
        with pytest.raises(InputError, match=r"link\.nc: the file exists already"):
            write_run(run, link)
        target.write_text("old")
        write_run(run, link, overwrite=True)
        assert link.is_symlink()
        assert read_run(target).content_sha256 == run.content_sha256

    @pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), RuntimeError("HDF error")])
    def test_a_failure_leaves_the_old_file_and_nothing_else(
        self, run: Run, file: Path, failure: Exception, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        old = file.read_bytes()

        def fail(run: Run, document: str, path: Path) -> None:
            path.write_bytes(old[:1000])
            raise failure

        monkeypatch.setattr(run_file, "_write", fail)
        with pytest.raises(IpmclabError, match="cannot be written"):
            write_run(run, file, overwrite=True)
        assert file.read_bytes() == old
        assert list(file.parent.iterdir()) == [file]

    def test_what_reads_back_differently_does_not_replace_the_file(
        self, run: Run, file: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        old = file.read_bytes()
        honest = run_file._write

        def lose_a_row(run: Run, document: str, path: Path) -> None:
            honest(run, document, path)
            with h5py.File(path, "r+") as stored:
                stored["current"][-1] = 0.0

        monkeypatch.setattr(run_file, "_write", lose_a_row)
        with pytest.raises(IpmclabError, match="differs"):
            write_run(run, file, overwrite=True)
        assert file.read_bytes() == old

    def test_metadata_that_no_file_can_keep_are_refused(self, tmp_path: Path) -> None:
        run = Run.from_arrays(time=[0, 1], voltage=[0, 1], metadata=RunMetadata(shunt_resistance=float("nan")))
        with pytest.raises(InputError, match="the metadata of the run cannot be written"):
            write_run(run, tmp_path / "run.nc")
        assert list(tmp_path.iterdir()) == []


def write_document(stored: h5py.File, text: str) -> None:
    stored.attrs["metadata_json"] = text
    stored.attrs["metadata_sha256"] = hashlib.sha256(text.encode()).hexdigest()


def edit_document(change: Callable[[dict], object]) -> Callable[[Path], None]:
    def edit(path: Path) -> None:
        with h5py.File(path, "r+") as stored:
            document = json.loads(stored.attrs["metadata_json"])
            change(document)
            write_document(stored, json.dumps(document))

    return edit


def set_attribute(value: str | None) -> Callable[[Path], None]:
    def edit(path: Path) -> None:
        with h5py.File(path, "r+") as stored:
            del stored.attrs["metadata_json"]
            if value is not None:
                write_document(stored, value)

    return edit


def change_the_shunt(path: Path) -> None:
    with h5py.File(path, "r+") as stored:
        stored.attrs["metadata_json"] = stored.attrs["metadata_json"].replace('resistance": 1.0', 'resistance": 9.0')


def break_the_text(path: Path) -> None:
    """A byte of the metadata's text that is no UTF-8."""
    content = path.read_bytes()
    path.write_bytes(content.replace(b'"signal": "step', b'"signal": "\x80tep'))


def change_a_value(path: Path) -> None:
    with h5py.File(path, "r+") as stored:
        stored["voltage"][7] = 1.5


def remove_the_voltage(path: Path) -> None:
    with h5py.File(path, "r+") as stored:
        del stored["voltage"]


def turn_time_back(path: Path) -> None:
    with h5py.File(path, "r+") as stored:
        stored["time"][7] = 0.0


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: path.unlink(), "no such file"),
        (lambda path: path.write_bytes(b""), r"the file is empty \(0 bytes\)"),
        (lambda path: path.write_bytes(b"time,voltage\n0,1\n"), "this is not a netCDF-4 file; import"),
        (lambda path: path.write_bytes(path.read_bytes()[:5]), "the file is truncated"),
        (lambda path: path.write_bytes(path.read_bytes()[:-1]), "the file is truncated"),
        (lambda path: (path.unlink(), path.mkdir()), "this is a folder"),
        (set_attribute(None), r"no run: it has no attribute metadata_json \(variables: .*current"),
        (set_attribute("{"), "metadata_json: damaged, it is not JSON"),
        (set_attribute("[1]"), "metadata_json: it does not say"),
        (
            edit_document(lambda d: d.update(format_version=2)),
            "format version 2, this ipmclab reads versions up to 1; upd",
        ),
        (edit_document(lambda d: d.update(hold="zeroth")), "zeroth"),
        (edit_document(lambda d: d.update(content_sha256="0")), "the checksum does not match: content_sha256 is '0'"),
        (edit_document(lambda d: d["metadata"].update(chambre="on")), "unknown key 'chambre'; did you mean 'chamber'"),
        (
            edit_document(lambda d: d["metadata"].update(chamber="ajar")),
            "metadata_json.metadata.chamber: 'ajar' is not 'on', 'still' or 'off'",
        ),
        (edit_document(lambda d: d["metadata"].update(run_number="3")), "run_number: '3' is not a whole number"),
        (
            edit_document(lambda d: d["metadata"]["sample"].update(membrain="Nafion")),
            "metadata.sample: unknown key 'membrain'; did you mean 'membrane'",
        ),
        (
            edit_document(lambda d: d["metadata"].update(marks=[{"time": 1.0, "text": "lamp", "by": "me"}])),
            "metadata.marks: unknown key 'by'",
        ),
        (edit_document(lambda d: d.update(format_version=-1)), "damaged, the format version is -1; take a copy"),
        (edit_document(lambda d: d.update(format_version=True)), "damaged, the format version is True"),
        (edit_document(lambda d: d.pop("metadata")), "metadata: None"),
        (break_the_text, "the checksum of the metadata does not match: metadata_sha256 is"),
        (change_the_shunt, "the checksum of the metadata does not match: metadata_sha256 is"),
        (change_a_value, "the checksum does not match"),
        (remove_the_voltage, "no voltage in it"),
        (turn_time_back, r"run\.nc: time: row 7 is at 0 s, not after"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(file: Path, damage: Callable[[Path], object], message: str) -> None:
    damage(file)
    with pytest.raises(InputError, match=message) as caught:
        read_run(file)
    assert caught.value.where.startswith(str(file))


def test_a_name_that_no_file_can_have_is_not_read() -> None:
    with pytest.raises(InputError, match="it cannot be opened"):
        read_run("a" * 300 + ".nc")


@given(data=st.data())
def test_no_damage_gives_a_traceback_or_other_numbers(
    data: st.DataObject, content: bytes, run: Run, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.nc"
    damaged = bytearray(content[: data.draw(st.just(len(content)) | st.integers(0, len(content)))])
    for _ in range(data.draw(st.integers(0, 3)) if damaged else 0):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(damaged)
    try:
        got = read_run(path)
    except InputError:
        return
    assert got.content_sha256 == run.content_sha256
    assert got.metadata == run.metadata


def test_a_heap_that_hdf5_would_walk_for_ever_is_refused(tmp_path: Path) -> None:
    """One flipped bit in the length of a text: the walk comes to free room of no length, and stays there."""
    path = tmp_path / "step.nc"
    write_run(simulate(load_actuator("friend-2"), "step 1 V", duration=1.0, rate=50.0), path)
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL\x01\0\0\0")
    end = heap + int.from_bytes(content[heap + 8 : heap + 16], "little")
    place, endless = heap + 16, []
    while number := int.from_bytes(content[place : place + 2], "little"):
        length = int.from_bytes(content[place + 8 : place + 16], "little")
        for bit in range(12):
            there = place + 16 + ((length ^ (1 << bit)) + 7) // 8 * 8
            if there + 16 <= end and not any(content[there : there + 16]):
                endless.append((place + 8, length ^ (1 << bit), number))
        place += 16 + (length + 7) // 8 * 8
    assert endless
    at, wrong, _ = endless[0]
    content[at : at + 8] = wrong.to_bytes(8, "little")
    (tmp_path / "flipped.nc").write_bytes(content)
    with pytest.raises(InputError, match=rf"the ends of its texts are lost \(heap at byte {heap}\)") as caught:
        read_run(tmp_path / "flipped.nc")
    assert caught.value.code == "damaged-file"
    assert len(read_run(path)) == 50
