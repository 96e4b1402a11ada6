"""A run's file as other programs see it: plain h5py and xarray, nothing of ipmclab on the reading side."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray

import ipmclab

UNITS = {
    "time": "s",
    "voltage": "V",
    "current": "A",
    "displacement": "m",
    "force": "N",
    "applied_voltage": "V",
}


@pytest.fixture(scope="module")
def simulated() -> ipmclab.Run:
    return ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=4.0, rate=50.0)


@pytest.fixture
def path(simulated: ipmclab.Run, tmp_path: Path) -> Path:
    target = tmp_path / "run.nc"
    ipmclab.write_run(simulated, target)
    return target


def text(value: object) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def test_h5py_sees_variables_units_and_dimension(path: Path, simulated: ipmclab.Run) -> None:
    with h5py.File(path) as file:
        for name, unit in UNITS.items():
            assert text(file[name].attrs["units"]) == unit
            np.testing.assert_array_equal(file[name][:], getattr(simulated, name))
            assert file[name].dtype == np.float64
            assert file[name].shape == (200,)
        assert file["time"].is_scale
        assert file["current"].dims[0][0].name == "/time"


def test_compression_and_checksums(path: Path) -> None:
    with h5py.File(path) as file:
        for name in ("voltage", "current", "displacement", "force"):
            assert file[name].compression == "gzip"
            assert file[name].compression_opts == 1
            assert file[name].shuffle
            assert file[name].fletcher32
    raw = path.read_bytes()
    assert raw[:8] == b"\x89HDF\r\n\x1a\n"
    assert raw[8] == 0, "superblock of the default libver: older readers (MATLAB before R2023b) need it"


def test_a_flipped_bit_is_caught_not_read(path: Path) -> None:
    with h5py.File(path) as file:
        place = file["current"].id.get_chunk_info(0)
    raw = bytearray(path.read_bytes())
    raw[place.byte_offset + place.size // 2] ^= 0x10
    path.write_bytes(bytes(raw))
    with pytest.raises(ipmclab.InputError) as caught:
        ipmclab.read_run(path)
    assert "run.nc" in str(caught.value)


def test_attributes_for_people_and_for_machines(path: Path, simulated: ipmclab.Run) -> None:
    with h5py.File(path) as file:
        attributes = {name: text(value) for name, value in file.attrs.items()}
    assert attributes["hold"] == "zero"
    assert attributes["content_sha256"] == simulated.content_sha256
    machine = json.loads(attributes["metadata_json"])
    assert isinstance(machine, dict)
    assert ipmclab.__version__ in attributes.get("software_version", "")
    assert any("step 1 V" in text for text in attributes.values())


def test_xarray_opens_it_by_itself(path: Path, simulated: ipmclab.Run) -> None:
    with xarray.open_dataset(path, engine="h5netcdf") as dataset:
        assert dict(dataset.sizes)["time"] == 200
        for name in ("voltage", "current", "displacement", "force", "applied_voltage"):
            assert dataset[name].dims == ("time",)
            assert dataset[name].attrs["units"] == UNITS[name]
            np.testing.assert_array_equal(dataset[name].values, getattr(simulated, name))
        np.testing.assert_allclose(dataset["time"].values.astype(float), simulated.time)


def test_metadata_quality_and_slow_channels_come_back(tmp_path: Path) -> None:
    time = np.arange(10) * 0.02
    current = np.linspace(0.06, 0.05, 10)
    current[3] = np.nan
    metadata = ipmclab.RunMetadata(
        sample=ipmclab.Sample(
            id="strip-7",
            counter_ion="Li+",
            solvent="water",
            coating="parylene",
            electrode="platinum",
            nominal_membrane_thickness=183e-6,
        ),
        mounting_id="2026-11-21-a",
        run_number=4,
        voltage_sensed="upstream of shunt",
        polarity="reversed",
        minutes_out_of_water=12.5,
        minutes_in_environment=3.0,
        clamp_pressure=2.0e4,
        chamber="on",
        operator="P. F.",
        notes="curls at rest: 2 mm",
        marks=(ipmclab.Mark(0.1, "touched the table"),),
    )
    run = ipmclab.Run.from_arrays(
        time=time,
        voltage=np.ones(10),
        current=current,
        temperature=[20.0, 20.5],
        relative_humidity=[80.0, 79.0],
        time_environment=[0.0, 0.1],
        hold="zero-before",
        quality={"current": np.array([0, 0, 0, 2, 0, 0, 0, 0, 4, 0], dtype=np.uint8)},
        metadata=metadata,
    )
    target = tmp_path / "full.nc"
    ipmclab.write_run(run, target)
    back = ipmclab.read_run(target)
    assert back.metadata.sample == metadata.sample
    for name in [
        "mounting_id",
        "run_number",
        "voltage_sensed",
        "polarity",
        "minutes_out_of_water",
        "minutes_in_environment",
        "clamp_pressure",
        "chamber",
        "operator",
        "notes",
        "marks",
    ]:
        assert getattr(back.metadata, name) == getattr(metadata, name), name
    assert back.content_sha256 == run.content_sha256
    with h5py.File(target) as file:
        assert file["temperature"].shape == (2,)
        assert text(file["temperature"].attrs["units"]) == "degC"
        assert text(file["relative_humidity"].attrs["units"]) == "percent"
        assert file["temperature"].dims[0][0].name == "/time_environment"
        assert np.isnan(file["current"][3])
        flags = file["current_quality"]
        assert flags.dtype.kind in "iu"
        assert list(flags[:]) == [0, 0, 0, 2, 0, 0, 0, 0, 4, 0]
        masks, meanings = flags.attrs["flag_masks"], text(flags.attrs["flag_meanings"]).split()
        assert dict(zip(meanings, (int(mask) for mask in masks), strict=True))["sentinel"] == 2
        joined = " ".join(f"{key}={text(value)}" for key, value in file.attrs.items())
        for fact in ("strip-7", "2026-11-21-a", "zero-before", "upstream of shunt"):
            assert fact in joined


def test_nothing_is_overwritten_without_leave(path: Path, simulated: ipmclab.Run) -> None:
    before = path.read_bytes()
    with pytest.raises(ipmclab.InputError, match=r"run\.nc"):
        ipmclab.write_run(replace(simulated, force=None), path)
    assert path.read_bytes() == before
    ipmclab.write_run(replace(simulated, force=None), path, overwrite=True)
    assert ipmclab.read_run(path).force is None


@pytest.mark.parametrize("kind", ["empty", "truncated", "text", "other netcdf", "missing", "folder"])
def test_files_that_are_no_run_are_refused_by_name(kind: str, path: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.nc"
    if kind == "empty":
        bad.write_bytes(b"")
    elif kind == "truncated":
        bad.write_bytes(path.read_bytes()[:-700])
    elif kind == "text":
        bad.write_text("time,voltage\n0,1\n", encoding="utf-8")
    elif kind == "other netcdf":
        xarray.Dataset({"sst": ("x", np.arange(3.0))}).to_netcdf(bad, engine="h5netcdf")
    elif kind == "folder":
        bad.mkdir()
    with pytest.raises(ipmclab.InputError) as caught:
        ipmclab.read_run(bad)
    assert "bad.nc" in str(caught.value)
    assert caught.value.code
