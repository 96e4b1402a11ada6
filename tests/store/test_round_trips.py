"""A run comes back from every file exactly as it went in."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ipmclab.run import QUALITY_FLAGS, SLOW_CHANNELS, Finding, Mark, Run, RunMetadata, ZeroReading
from ipmclab.sample import Sample
from ipmclab.store.exporting import export_run
from ipmclab.store.importing import import_run
from ipmclab.store.run_file import read_run, write_run
from ipmclab.units import CHANNELS
from tests.profiles import costly

finite = st.floats(allow_nan=False, allow_infinity=False)
readings = st.floats(allow_infinity=False, allow_nan=True)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
positive = st.floats(min_value=1e-12, max_value=1e6)


@st.composite
def times(draw: st.DrawFn, least: int) -> np.ndarray:
    values = draw(st.sets(st.floats(-1e9, 1e9), min_size=least, max_size=20))
    return np.array(sorted({value + 0.0 for value in values}))  # +0.0: -0.0 and 0.0 are one time


@st.composite
def metadata(draw: st.DrawFn) -> RunMetadata:
    sample = st.builds(Sample, id=texts.filter(bool), counter_ion=st.none() | texts, dry_mass=st.none() | positive)
    channels = st.sampled_from(list(CHANNELS))
    return RunMetadata(
        origin=draw(st.sampled_from(["measured", "simulated", "virtual bench"])),
        sample=draw(st.none() | sample),
        mounting_id=draw(st.none() | texts),
        run_number=draw(st.none() | st.integers(-(2**40), 2**40)),
        signal=draw(st.none() | texts),
        voltage_sensed=draw(st.sampled_from([None, "electrodes", "upstream of shunt"])),
        shunt_resistance=draw(st.none() | finite),
        minutes_out_of_water=draw(st.none() | finite),
        clamp_pressure=draw(st.none() | finite),
        chamber=draw(st.sampled_from([None, "on", "off"])),
        temperature=draw(st.none() | finite),
        notes=draw(st.none() | texts),
        marks=tuple(draw(st.lists(st.builds(Mark, time=finite, text=texts), max_size=3))),
        starts_from_rest=draw(st.none() | st.booleans()),
        sampling_period_known=draw(st.booleans()),
        ranges=draw(st.dictionaries(channels, st.tuples(finite, finite), max_size=2)),
        calibrations=draw(st.dictionaries(channels, texts, max_size=2)),
        parameters=draw(st.dictionaries(texts, finite, max_size=3)),
        state=draw(st.sampled_from([None, "complete", "aborted", "recovered"])),
        source_resistance=draw(st.none() | finite),
        zeros=tuple(
            ZeroReading(channel, kind, "after", value, abs(value), draw(st.none() | finite))
            for channel, kind, value in draw(
                st.lists(st.tuples(channels, st.sampled_from(["zero", "tare", "preload"]), finite), max_size=2)
            )
        ),
        uncertainties=draw(st.dictionaries(channels, finite, max_size=2)),
        limits=draw(st.dictionaries(texts, texts, max_size=2)),
        findings=tuple(draw(st.lists(findings(), max_size=2))),
    )


def findings() -> st.SearchStrategy[Finding]:
    rows = st.integers(0, 10**9)
    return st.builds(
        Finding,
        code=texts,
        severity=st.sampled_from(["info", "warning", "error"]),
        message=texts,
        repair=texts,
        channel=st.none() | texts,
        samples=st.lists(st.tuples(rows, rows), max_size=2).map(tuple),
        effect=st.sampled_from(["none", "mask", "lower_bound", "upper_bound"]),
        values=st.dictionaries(texts, finite | st.integers(-(2**40), 2**40) | texts | st.none(), max_size=3),
    )


@st.composite
def runs(draw: st.DrawFn) -> Run:
    time = draw(times(2))
    slow = draw(st.none() | times(1))
    columns: dict[str, Any] = {"voltage": draw(arrays(np.float64, len(time), elements=finite))}
    for name in draw(st.sets(st.sampled_from([name for name in CHANNELS if name != "voltage"]))):
        rows = slow if slow is not None and name in SLOW_CHANNELS else time
        columns[name] = draw(arrays(np.float64, len(rows), elements=readings))
    flagged = draw(st.sets(st.sampled_from(sorted(columns))))
    bits = st.integers(0, sum(QUALITY_FLAGS.values()))
    return Run.from_arrays(
        time=time,
        time_environment=slow,
        hold=draw(st.sampled_from(["zero", "zero-before", "first", "unknown"])),
        raw={
            name: draw(arrays(np.float64, len(time), elements=readings))
            for name in draw(st.sets(st.sampled_from([*columns, "output"])))
        },
        quality={name: draw(arrays(np.uint8, len(columns[name]), elements=bits)) for name in flagged},
        metadata=draw(metadata()),
        **columns,
    )


def assert_same(got: Run, given: Run) -> None:
    assert got.hold == given.hold
    assert got.metadata == given.metadata
    np.testing.assert_array_equal(got.time, given.time)
    assert got.channels.keys() == given.channels.keys()
    for name, values in given.channels.items():
        assert got.channels[name].dtype == np.float64
        np.testing.assert_array_equal(got.channels[name], values)
    assert got.quality.keys() == given.quality.keys()
    for name, bits in given.quality.items():
        np.testing.assert_array_equal(got.quality[name], bits)
    assert got.raw.keys() == given.raw.keys()
    for name, values in given.raw.items():
        np.testing.assert_array_equal(got.raw[name], values)
    if given.time_environment is None:
        assert got.time_environment is None
    else:
        np.testing.assert_array_equal(got.time_environment, given.time_environment)
    assert got.content_sha256 == given.content_sha256


@costly(2)
@given(run=runs())
def test_every_file_gives_the_run_back(run: Run) -> None:
    """The laboratory's own, and each export without a map. To draw a run costs more than to write and read it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.nc"
        write_run(run, path)
        assert_same(read_run(path), run)
        assert [file.name for file in Path(folder).iterdir()] == ["run.nc"]
        for ending in (".csv", ".xlsx", ".mat"):
            export = path.with_suffix(ending)
            export_run(run, export)
            assert_same(import_run(export), run)
