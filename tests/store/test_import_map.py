"""What an import map may say, and what is said of one that is wrong."""

from __future__ import annotations

import contextlib
import copy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.errors import InputError
from ipmclab.store.import_map import ImportMap, load_import_map

MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
GOOD: dict[str, Any] = {
    "sampling_period": "20 ms",
    "file": {"format": "csv"},
    "channels": {
        "voltage": {"column": "U", "unit": "V"},
        "displacement": {"column": "laser", "unit": "mm", "sentinels": [-99.9999], "zero_rows": [0, 10], "sign": -1},
    },
    "sample": {"id": "2", "dry_mass": "103 mg"},
    "metadata": {"shunt_resistance": "1 ohm", "minutes_out_of_water": "2 h", "voltage_sensed": "electrodes"},
}


def test_metadata_have_units_in_the_map_and_si_numbers_in_the_run() -> None:
    metadata = ImportMap.from_table(GOOD).run_metadata()
    assert metadata.shunt_resistance == 1.0
    assert metadata.minutes_out_of_water == 120.0
    assert metadata.sample is not None
    assert metadata.sample.dry_mass == 103e-6


def test_the_hold_of_a_foreign_record_is_unknown_unless_stated() -> None:
    assert ImportMap.from_table(GOOD).hold == "unknown"
    assert ImportMap.from_table({**GOOD, "hold": "zero-before"}).hold == "zero-before"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("sampling_peroid", "1 s", r"sampling_peroid: unknown key 'sampling_peroid'; did you mean 'sampling_period'\?"),
        ("sampling_period", "40", r"sampling_period: '40' has no unit; write for example '20 ms'"),
        ("sampling_period", "40 mm", "sampling_period: '40 mm' is not a time: the unit 'mm' is not one of s, ms"),
        ("sampling_period", "0 s", "sampling_period: '0 s' is not above 0"),
        (
            "sampling_period",
            0.04,
            "sampling_period: 0.04 is not a text; write it in quotes; a quantity is a number with its unit, such as",
        ),
        ("hold", "zeroth", "hold: 'zeroth' is not 'zero', 'zero-before', 'first' or 'unknown'; did you mean 'zero'"),
        ("sampling_period", "1e-320 s", "sampling_period: '1e-320 s' is outside 1e-09 s to 1e[+]09 s; correct"),
        ("sampling_period", "1e300 h", "sampling_period: '1e300 h' is outside 1e-09 s to"),
        ("rows", [5, 5], r"rows: \[5, 5\] holds no row"),
        ("rows", [-5, 5], "rows.0: -5 is below 0; give 0 or more"),
        ("file.format", "xls", r"file\.format: unknown format 'xls'; did you mean 'xlsx'\?"),
        ("file.format", "word", "file.format: unknown format 'word'; known: 'binary', 'csv', 'lvm'"),
        ("file", {"formt": "xlsx"}, r"file\.formt: unknown key 'formt'; did you mean 'format'\?"),
        ("file.format", None, 'file: it does not say what kind of file this is; add format = "csv"'),
        ("file", "csv", "file: 'csv' is not a table"),
        ("channels.voltage.zero_at", 12.4, "channels.voltage.zero_at: 12.4 is not a text; write it in quotes"),
        ("file.separatr", ";", r"file\.separatr: unknown key 'separatr'; did you mean 'separator'\?"),
        ("file.separator", ":", r"file\.separator: ':' is not ',', ';', .* or"),
        ("file.skip_lines", -1, "file.skip_lines: -1 is below 0"),
        ("file.skip_lines", "2", "file.skip_lines: '2' is not a whole number; write a whole number without quotes"),
        ("file.header", "no", "file.header: 'no' is neither true nor false; write true"),
        ("channels.volts", {"column": 1}, r"channels\.volts: unknown channel 'volts'; did you mean 'voltage'\?"),
        ("channels.voltage", None, r"channels: no voltage; add \[channels\.voltage\]: every run has one"),
        ("channels.voltage.colum", "U", r"channels\.voltage\.colum: unknown key 'colum'; did you mean 'column'\?"),
        ("channels.voltage.column", None, "channels.voltage.column: this key is missing; add it"),
        ("channels.voltage.column", "laser", "displacement.column: column 'laser' is mapped to voltage too; name the"),
        ("channels.voltage.column", 1.5, "channels.voltage.column: 1.5 is not a whole number"),
        ("channels.voltage.unit", "mm", "channels.voltage.unit: 'mm' is not one of V, mV, uV; give a unit of voltage"),
        ("channels.voltage.factor", "2", "channels.voltage.factor: '2' is not a number; write a number without"),
        ("channels.voltage.factor", 0.0, "channels.voltage.factor: a factor of 0 loses the reading"),
        ("channels.voltage.factor", float("nan"), "channels.voltage.factor: nan is not a finite number"),
        ("channels.voltage.points", [[0, 0], [0, 1]], "channels.voltage.points: both points are at 0; give two"),
        ("channels.voltage.points", [[0, 0]], "channels.voltage.points.1: this key is missing"),
        ("channels.voltage.sign", 2, "channels.voltage.sign: 2 is not 1 or -1; write one of these"),
        ("channels.voltage.range", [1.0, -1.0], r"channels.voltage.range: \[1.0, -1.0\] does not increase; give \[low"),
        ("channels.displacement.zero_at", "3 mm", "zero_rows: zero_at and zero_rows are both given; keep one of them"),
        ("channels.displacement.zero_rows", [10, 0], r"zero_rows: \[10, 0\] holds no row"),
        (
            "channels.time",
            {"column": "t", "unit": "s"},
            "sampling_period: a time column and a sampling period are both",
        ),
        ("sample.id", None, 'sample.id: a sample needs an id; add id = "..."'),
        ("sample.dry_mass", "103 ml", "sample.dry_mass: '103 ml' is not a mass"),
        ("metadata.shunt_resistence", "1 ohm", "unknown key 'shunt_resistence'; did you mean 'shunt_resistance'"),
        ("metadata.shunt_resistance", 1.0, "metadata.shunt_resistance: 1.0 has no unit; write for example '1.0 ohm'"),
        (
            "metadata.shunt_resistance",
            "-1 ohm",
            "metadata.shunt_resistance: '-1 ohm' is outside 0 to 1e[+]06 ohm; give",
        ),
        ("metadata.relative_humidity", "101 %", "relative_humidity: '101 %' is outside 0 to 100 percent; give the"),
        ("metadata.temperature", "-300 degC", "temperature: '-300 degC' is outside -273.15 to 1000 degC"),
        ("metadata.clamp_pressure", "-1 bar", "clamp_pressure: '-1 bar' is outside 0 to 1e[+]09 Pa"),
        ("metadata.minutes_in_environment", "-5 min", "'-5 min' is outside 0 to inf min"),
        ("metadata.minutes_out_of_water", 5, "5 has no unit; write for example '5 min'"),
        ("metadata.minutes_out_of_water", "2 V", "metadata.minutes_out_of_water: '2 V' is not a time"),
        ("metadata.chamber", "ajar", "metadata.chamber: 'ajar' is not 'on', 'still' or 'off'"),
        (
            "metadata",
            {"voltage_sensed": "upstream of shunt"},
            "metadata.shunt_resistance: the voltage was sensed upstream of the shunt, but the shunt is not stated; add",
        ),
        ("metadata.calibrations", {}, "metadata.calibrations: unknown key 'calibrations'"),
    ],
)
def test_a_wrong_entry_is_named_with_its_repair(path: str, value: Any, message: str) -> None:
    table = copy.deepcopy(GOOD)
    inner = table
    *outer, key = path.split(".")
    for name in outer:
        inner = inner[name]
    if value is None:
        del inner[key]
    else:
        inner[key] = value
    with pytest.raises(InputError, match=message) as caught:
        ImportMap.from_table(table, where="lab.toml")
    assert str(caught.value).startswith("lab.toml: ")


@pytest.mark.parametrize("key", ["factor", "offset"])
def test_points_and_factor_contradict(key: str) -> None:
    table = copy.deepcopy(GOOD)
    table["channels"]["voltage"] |= {"points": [[0, 0], [1, 2]], key: 1.0}
    with pytest.raises(InputError, match="points and factor or offset are both given; keep one of them"):
        ImportMap.from_table(table)


@pytest.mark.parametrize(
    ("scaling", "line"),
    [
        ({}, (1.0, 0.0)),
        ({"factor": -2.0}, (-2.0, 0.0)),
        ({"offset": 3.0}, (1.0, 3.0)),
        ({"factor": 2.0, "offset": -3.0}, (2.0, -3.0)),
        ({"points": [[2, 5], [10, 29]]}, (3.0, -1.0)),
        ({"points": [[10, 29], [2, 5]]}, (3.0, -1.0)),
    ],
)
def test_a_scaled_number_has_a_line_and_needs_a_unit(scaling: dict[str, Any], line: tuple[float, float]) -> None:
    channel = ImportMap.from_table({**GOOD, "channels": {"voltage": {"column": "U", **scaling}}}).channels["voltage"]
    assert channel.line == line
    assert channel.is_scaled == bool(scaling)


def test_what_metadata_can_be_reaches_to_its_bounds() -> None:
    bounds = {
        "shunt_resistance": ("ohm", 0.0, 1e6),
        "source_resistance": ("ohm", 0.0, 1e6),
        "mass": ("kg", 0.0, 1.0),
        "clamp_pressure": ("Pa", 0.0, 1e9),
        "temperature": ("degC", -273.15, 1000.0),
        "relative_humidity": ("percent", 0.0, 100.0),
        "minutes_out_of_water": ("min", 0.0, None),
        "minutes_in_environment": ("min", 0.0, None),
    }
    for key, (unit, low, high) in bounds.items():
        for end, beyond in ((low, -0.01), (high, 1.01)):
            if end is None:
                continue
            told = ImportMap.from_table({**GOOD, "metadata": {key: f"{end} {unit}"}}).run_metadata()
            assert getattr(told, key) == pytest.approx(end)
            with pytest.raises(InputError, match=f"metadata.{key}: .* is outside"):
                ImportMap.from_table({**GOOD, "metadata": {key: f"{end * beyond if end > 0 else end - 0.01} {unit}"}})


def test_a_sampling_period_reaches_to_its_bounds() -> None:
    for period in (1e-9, 1e9):
        assert ImportMap.from_table({**GOOD, "sampling_period": f"{period!r} s"}).period == period
    for period in (0.9e-9, 1.1e9):
        with pytest.raises(InputError, match=r"sampling_period: .* is outside 1e-09 s to"):
            ImportMap.from_table({**GOOD, "sampling_period": f"{period!r} s"})


@pytest.mark.parametrize(
    ("name", "keys", "message"),
    [
        ("time", {"dates": "day-month-year"}, None),
        ("time", {"dates": "day-month-year", "date_column": "D", "duplicates": "drop"}, None),
        ("time", {"unit": "ms", "factor": 2.0, "index": "n", "duplicates": "drop"}, None),
        ("current", {"unit": "A", "factor": 2.0, "index": "n"}, None),
        ("current", {"dates": "day-month-year"}, "channels.current.dates: dates is a key of the time; move it"),
        ("current", {"date_column": "D"}, "channels.current.date_column: date_column is a key of the time"),
        ("current", {"duplicates": "drop"}, "channels.current.duplicates: duplicates is a key of the time"),
        ("time", {"date_column": "D"}, "time.date_column: the order of the date is not stated; add dates, such as"),
        ("time", {"date_column": "D", "dates": "time of day"}, "time.date_column: the order of the date is not"),
        ("time", {"dates": "time of day", "unit": "s"}, "time.unit: dates and unit are both given; keep one"),
        ("time", {"dates": "time of day", "factor": 1.0}, "time.factor: dates and factor are both given"),
        ("time", {"dates": "time of day", "offset": 1.0}, "time.offset: dates and offset are both given"),
        ("time", {"dates": "time of day", "points": [[0, 0], [1, 1]]}, "time.points: dates and points are both"),
        ("time", {"dates": "time of day", "index": "n"}, "time.index: dates and index are both given"),
    ],
)
def test_keys_of_the_time(name: str, keys: dict[str, Any], message: str | None) -> None:
    channels = {"voltage": {"column": "U"}, name: {"column": "t", **keys}}
    table = {"file": {"format": "csv"}, "channels": channels}
    if message is None:
        assert set(ImportMap.from_table(table).channels) == {"voltage", name}
        return
    with pytest.raises(InputError, match=message):
        ImportMap.from_table(table)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("range", [1.0, 1.0], r"voltage.range: \[1.0, 1.0\] does not increase"),
        ("range", ["0", 1.0], "voltage.range.0: '0' is not a number"),
        ("range", [True, 2.0], "voltage.range.0: True is not a number"),
        ("points", [[0, 0], [1, "2"]], "voltage.points.1.1: '2' is not a number"),
        ("sentinels", ["-99.9"], "voltage.sentinels.0: '-99.9' is not a number"),
        ("sentinels", -99.9, "voltage.sentinels: -99.9 is not a list"),
        ("zero_rows", [0.0, 5.0], "voltage.zero_rows.0: 0.0 is not a whole number"),
        ("zero_rows", [0, True], "voltage.zero_rows.1: True is not a whole number"),
        ("column", True, "voltage.column: True is not a"),
    ],
)
def test_a_value_of_another_kind_is_never_converted(key: str, value: Any, message: str) -> None:
    table = {**GOOD, "channels": {"voltage": {"column": "U", key: value}}}
    with pytest.raises(InputError, match=message):
        ImportMap.from_table(table)


def test_a_map_file_is_toml(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    with pytest.raises(InputError, match=r"lab\.toml: no such file"):
        load_import_map(path)
    path.write_text("hold = zero")
    with pytest.raises(InputError, match=r"lab\.toml: not a TOML file: .*line 1"):
        load_import_map(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"lab\.toml: the file cannot be read as text"):
        load_import_map(path)
    with pytest.raises(InputError, match="this is a folder, not an import map; name a file in it"):
        load_import_map(tmp_path)
    path.write_text((MAPS / "step_1V.toml").read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert load_import_map(path) == load_import_map(MAPS / "step_1V.toml")


def test_a_unit_may_be_spelled_as_people_write_it() -> None:
    table = copy.deepcopy(GOOD)
    table["channels"]["displacement"]["unit"] = "µm"
    assert ImportMap.from_table(table).channels["displacement"].unit == "um"


def test_every_map_of_the_documentation_is_sound() -> None:
    maps = sorted(MAPS.glob("*.toml"))
    assert len(maps) >= 7
    for path in maps:
        assert load_import_map(path).channels["voltage"].unit == "V"


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
keys = st.sampled_from(
    ["file", "channels", "sampling_period", "hold", "rows", "sample", "metadata", "voltage", "column"]
)


@given(
    table=st.dictionaries(keys, values, max_size=4),
    channel=st.dictionaries(
        st.sampled_from(["column", "unit", "factor", "points", "range", "zero_at", "sign"]), values
    ),
    metadata=st.dictionaries(
        st.sampled_from(["chamber", "notes", "clamp_pressure", "run_number", "recorded_at"]), values
    ),
)
def test_no_table_gives_a_traceback(table: dict[str, Any], channel: dict[str, Any], metadata: dict[str, Any]) -> None:
    for tried in (table, {**GOOD, **table}, {**GOOD, "channels": {"voltage": channel}}, {**GOOD, "metadata": metadata}):
        with contextlib.suppress(InputError):
            ImportMap.from_table(tried)


@given(content=st.binary(max_size=60) | st.text(max_size=60).map(lambda text: text.encode("utf-8", "replace")))
def test_no_file_gives_a_traceback(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "map.toml"
    path.write_bytes(content)
    with pytest.raises(InputError):
        load_import_map(path)
