"""Runs and samples: what is refused, what is kept."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from ipmclab.errors import InputError
from ipmclab.run import QUALITY_FLAGS, Run
from ipmclab.sample import Sample


def made(**changes: Any) -> Run:
    arrays: dict[str, Any] = {"time": [0.0, 0.02, 0.04], "voltage": [0.0, 1.0, 1.0], "current": [0.0, 0.06, np.nan]}
    return Run.from_arrays(**{**arrays, **changes})


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"current": [0.0, 0.1]}, "unequal-lengths", "2 values for 3 times"),
        ({"time": [0.0, 0.02, 0.02]}, "bad-time", "row 2 is at 0.02 s, not after 0.02 s"),
        ({"time": [0.0, 0.02, np.nan]}, "bad-time", "row 2 is nan"),
        ({"time": [0.0], "voltage": [0.0], "current": None}, "too-short", "1 rows"),
        ({"voltage": [0.0, np.nan, 1.0]}, "voltage-gap", "sample 1"),
        ({"current": [0.0, np.inf, 0.0]}, "infinite-reading", "sample 1"),
        ({"hold": "linear"}, "unknown-hold", "zero-before"),
        ({"current": [[0.0, 1.0, 2.0]]}, "bad-array", "shape"),
        ({"current": ["a", "b", "c"]}, "bad-array", "not an array"),
        ({"curent": [0.0, 1.0, 1.0]}, "unknown-channel", "readings of no channel: 'curent'; did you mean 'current'?"),
        ({"quality": {"force": [0, 0, 0]}}, "unknown-channel", "force"),
        ({"quality": {"current": [0, 0]}}, "unequal-lengths", "2 flags for 3"),
        ({"quality": {"current": [0, 256, 0]}}, "bad-quality", "current_quality: not an array of quality bits"),
        ({"quality": {"current": np.array([0, -1, 0])}}, "bad-quality", "from 0 to 255"),
        ({"quality": {"current": [0, 0.5, 0]}}, "bad-quality", "whole numbers"),
        ({"quality": {"current": ["a", "b", "c"]}}, "bad-quality", "not an array of quality bits"),
        ({"raw": {"forse": [0, 0, 0]}}, "unknown-channel", "raw: raw readings of no channel: 'forse'; did you mean"),
        ({"raw": {"output": [0, 0]}}, "unequal-lengths", "output_raw: 2 values for 3 times"),
        ({"raw": {"force": [0, 0, np.inf]}}, "infinite-reading", "force_raw: sample 2"),
        ({"current": np.array([0.0, 1j, 0.0])}, "bad-array", "current: not an array of numbers"),
        ({"time": np.array([0, 1, 2], dtype="M8[s]")}, "bad-array", "time: not an array of numbers"),
    ],
)
def test_a_run_that_cannot_be_is_refused(changes: dict[str, Any], code: str, words: str) -> None:
    """Each refusal names the channel, the row and the value."""
    with pytest.raises(InputError) as caught:
        made(**changes)
    assert caught.value.code == code
    assert words in str(caught.value)


def test_a_masked_reading_is_missing() -> None:
    """What stands below a mask, such as the fill value of a file, is no reading."""
    run = made(current=np.ma.masked_equal([0.0, 1e20, 0.05], 1e20))
    np.testing.assert_array_equal(run.current, [0.0, np.nan, 0.05])
    with pytest.raises(InputError, match="voltage: sample 1"):
        made(voltage=np.ma.masked_equal([0.0, 1e20, 1.0], 1e20))


def test_the_dataset_has_units_and_flags() -> None:
    """run.data carries what the file carries."""
    run = made(quality={"current": [0, 0, QUALITY_FLAGS["missing"]]})
    assert run.data["current"].attrs["units"] == "A"
    assert run.data["current_quality"].attrs["flag_meanings"].split()[0] == "missing"
    assert run.data["time"].attrs["units"] == "s"


def test_raw_readings_stand_beside_the_quantity() -> None:
    """Raw volts have a value at each row, also for a channel that is kept at the times of the environment."""
    run = made(
        raw={"relative_humidity": [4.5, 4.5, 4.6], "output": [0, 1, 1]},
        relative_humidity=[45.0],
        time_environment=[0.0],
    )
    assert run.raw["output"].dtype == np.float64
    assert run.data["relative_humidity_raw"].dims == ("time",)
    assert run.data["output_raw"].attrs == {"units": "V", "long_name": "commanded output"}
    assert list(run.arrays)[-2:] == ["relative_humidity_raw", "output_raw"]
    assert run.channels.keys() == {"voltage", "current", "relative_humidity"}


def test_slow_channels_have_their_own_time() -> None:
    """Temperature on its own time base does not need a value at every row."""
    run = made(temperature=[20.0], time_environment=[0.0])
    assert run.data["temperature"].dims == ("time_environment",)


def test_the_content_hash_sees_every_edit() -> None:
    """A copy has the same hash; another value, hold, name or flag has another."""
    run = made()
    again = made()
    assert run.content_sha256 == again.content_sha256
    others = [
        made(current=[0.0, 0.06, 0.05]),
        made(hold="zero-before"),
        made(raw={"current": [0.0, 0.06, 0.05]}),
        made(current=None, force=[0.0, 0.06, np.nan]),
        made(quality={"current": [0, 0, 1]}),
    ]
    assert len({run.content_sha256, *(other.content_sha256 for other in others)}) == 6


def test_uniform_rows_and_rate() -> None:
    """The rate is the mean rate; a jittered clock is not uniform."""
    assert made().rate == 50.0
    assert made().is_uniform
    assert not made(time=[0.0, 0.021, 0.04]).is_uniform


def test_from_arrays_takes_copies() -> None:
    """Changing the caller's array afterwards does not change the run."""
    voltage = np.array([0.0, 1.0, 1.0])
    run = made(voltage=voltage)
    voltage[:] = 7.0
    assert run.voltage[1] == 1.0


def test_a_sample_reads_back_as_it_was_written() -> None:
    """Every field goes through its text and back."""
    sample = Sample(
        id="strip-1",
        membrane="Nafion N117",
        nominal_membrane_thickness=183e-6,
        electrode="platinum",
        plating_loading=0.1,
        counter_ion="Li+",
        solvent="water",
        coating="none",
        dry_mass=103e-6,
        hydrated_mass=113e-6,
        soak_time=86400.0,
        electrode_thickness=8e-6,
        micrographs=("surface.png", "cross section.png"),
        plated_by="OEM",
        source="a thesis",
    )
    assert None not in dataclasses.asdict(sample).values()
    assert Sample.from_table(sample.to_table()) == sample


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"id": "a", "dry_mas": "1 mg"}, "did you mean 'dry_mass'?"),
        ({"id": "a", "dry_mass": "1 mm"}, "not a mass"),
        ({"id": "a", "dry_mass": 1.0}, "not a text"),
        ({"id": "a", "dry_mass": "-1 mg"}, "not above 0"),
        ({"id": "a", "soak_time": "24 mm"}, "not a time"),
        ({"id": "a", "electrode_thickness": "0 um"}, "not above 0"),
        ({"id": "a", "micrographs": ["a.png", 1]}, "no list of texts"),
        ({"id": "a", "micrographs": ["a;b.png"]}, "no list of texts"),
        ({"membrane": "Nafion"}, "needs an id"),
    ],
)
def test_a_wrong_sample_table_is_refused(table: dict[str, Any], words: str) -> None:
    """Unknown keys, wrong units and missing ids are named."""
    with pytest.raises(InputError, match="sample") as caught:
        Sample.from_table(table)
    assert words in str(caught.value)


def test_the_readings_of_a_run_cannot_be_changed() -> None:
    """What a fit certifies is what was read: other numbers are another run."""
    given = np.array([0.0, 0.06, 0.05])
    run = Run.from_arrays(
        time=[0.0, 0.02, 0.04],
        voltage=[0.0, 1.0, 1.0],
        current=given,
        quality={"current": [0, 4, 0]},
        raw={"current": given},
    )
    before = run.content_sha256
    assert run.current is not None
    for values in (*run.arrays.values(), run.quality["current"], run.raw["current"], run.data["current"].values):
        with pytest.raises(ValueError, match="read-only"):
            values[1] = 1
    given[1] = 0.5  # the caller's own array stays its own
    assert run.content_sha256 == before
    assert dataclasses.replace(run, current=2 * run.current).content_sha256 != before
    object.__setattr__(run, "current", 2 * run.current)  # even what goes round every door shows
    assert run.content_sha256 != before
