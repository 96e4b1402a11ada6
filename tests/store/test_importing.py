"""Foreign records, written by their own libraries, become runs."""

from __future__ import annotations

import contextlib
import gc
import gzip
import io
import struct
import sys
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import openpyxl
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.errors import InputError
from ipmclab.run import QUALITY_FLAGS, Run
from ipmclab.store.exporting import export_run
from ipmclab.store.import_map import ImportMap
from ipmclab.store.importers import xlsx
from ipmclab.store.importing import import_run
from ipmclab.store.run_file import read_run

VOLTAGE = [0.0, 0.0, 1.0, 1.0, 1.0]
CURRENT_MILLIAMPERE = [0.125, -0.5, 60.25, 50.5, 45.75]
PERIOD = 0.02


def make_map(file: dict[str, Any], *, period: str | None = "20 ms", **changes: Any) -> ImportMap:
    channels = {"voltage": {"column": "U", "unit": "V"}, "current": {"column": "I", "unit": "mA"}}
    table = {"file": file, "channels": channels | changes.pop("channels", {}), **changes}
    return ImportMap.from_table(table if period is None else {"sampling_period": period, **table})


def assert_is_the_record(run: Run, *, first_row: int = 0) -> None:
    np.testing.assert_allclose(run.time, PERIOD * np.arange(len(run)) + run.time[0], rtol=1e-14)
    np.testing.assert_array_equal(run.voltage, VOLTAGE[first_row:])
    assert run.current is not None
    np.testing.assert_allclose(run.current, np.array(CURRENT_MILLIAMPERE[first_row:]) / 1000, rtol=1e-15)


def table_text(separator: str = ",", decimal: str = ".", lead: str = "U{s}I\n") -> str:
    rows = (f"{u}{{s}}{i}\n" for u, i in zip(VOLTAGE, CURRENT_MILLIAMPERE, strict=True))
    return lead.format(s=separator) + "".join(rows).replace(".", decimal).format(s=separator)


class TestTextTables:
    @pytest.mark.parametrize(
        ("text", "file"),
        [
            (table_text(), {}),
            (table_text(";", ","), {"separator": ";", "decimal": ","}),
            (table_text("\t"), {"separator": "\t"}),
            (table_text(lead="Recorded by X\n\nU{s}I\nV{s}mA\n"), {"skip_lines": 2, "units_row": True}),
            (table_text(lead='% made, "by hand\nU{s}I\n'), {"comment": "%"}),
            (table_text(lead='"Recorded" by X,"\n"\nU{s}I\n'), {"skip_lines": 2}),
            (table_text(lead="U{s}I\n").replace("\n", "\r\n"), {}),
            ("\ufeff" + table_text(), {}),
        ],
    )
    def test_every_dialect_gives_the_same_run(self, text: str, file: dict[str, Any], tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_text(text, encoding="utf-8", newline="")
        assert_is_the_record(import_run(path, make_map({"format": "csv", **file})))

    def test_gzip_encoding_and_numbered_columns(self, tmp_path: Path) -> None:
        path = tmp_path / "record.csv.gz"
        path.write_bytes(gzip.compress(table_text(lead="电压{s}电流\n").encode("gbk")))
        channels = {"voltage": {"column": "电压", "unit": "V"}, "current": {"column": 1, "unit": "mA"}}
        file = {"format": "csv", "encoding": "gbk"}
        assert_is_the_record(import_run(path, make_map(file, channels=channels)))
        path.write_bytes(gzip.compress(table_text(lead="").encode()))
        channels["voltage"]["column"] = 0
        file = {"format": "csv", "header": False}
        assert_is_the_record(import_run(path, make_map(file, channels=channels)))

    def test_the_unit_may_stand_in_the_file(self, tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_text(table_text(lead="U,I\n[V],[mA]\n"))
        file = {"format": "csv", "units_row": True}
        channels = {"voltage": {"column": "U"}, "current": {"column": "I"}}
        assert_is_the_record(import_run(path, make_map(file, channels=channels)))
        with pytest.raises(
            InputError, match=r"channels\.current\.unit: the map says 'A', the file 'mA' \(column 'I'\); leave the unit"
        ):
            import_run(path, make_map(file, channels={"current": {"column": "I", "unit": "A"}}))
        bare = {"voltage": {"column": 0}, "current": {"column": 1, "unit": "mA"}}
        with pytest.raises(
            InputError, match=r"channels\.voltage\.unit: no unit; state the unit of the numbers: V, mV, uV"
        ):
            import_run(path, make_map({"format": "csv", "skip_lines": 2, "header": False}, channels=bare))

    @pytest.mark.parametrize(
        "heading", ["I [mA]", "I (mA)", "I_mA", "I / mA", "I/mA", "I in mA", "Strom, mA", "I_[ mA ]"]
    )
    def test_the_unit_may_stand_in_the_heading(self, heading: str, tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_text(table_text(";", lead=f"Kanal A{{s}}{heading}\n"))
        file = {"format": "csv", "separator": ";"}
        voltage = {"column": "Kanal A", "unit": "V"}
        for current in ({"column": heading, "unit": "mA"}, {"column": heading}, {"column": 1}):
            assert_is_the_record(import_run(path, make_map(file, channels={"voltage": voltage, "current": current})))
        wrong = {"voltage": voltage, "current": {"column": 1, "unit": "A"}}
        with pytest.raises(InputError) as caught:
            import_run(path, make_map(file, channels=wrong))
        assert f"channels.current.unit: the map says 'A', the file 'mA' (column {heading!r}); " in str(caught.value)
        wrong["current"]["factor"] = 1.0  # says that the heading is wrong
        assert import_run(path, make_map(file, channels=wrong)).current is not None

    def test_a_heading_that_ends_in_another_word_has_no_unit(self, tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_text(table_text(lead="U_A{s}I (m)\n"))
        channels = {"voltage": {"column": "U_A", "unit": "V"}, "current": {"column": "I (m)", "unit": "mA"}}
        assert_is_the_record(import_run(path, make_map({"format": "csv"}, channels=channels)))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", r"the file is empty \(0 bytes\)"),
            ("U,I\n", "no rows of numbers in it"),
            ("U,I\n0,1\n0\n", "line 3: 1 cells, the lines before have 2; see that the file is whole"),
            ("U,I\n0,1\n0,1,2\n", "line 3: 3 cells, the lines before have 2"),
            ("U,I\n0,1\n\n0,fault\n", "line 4: 'fault' in column 'I' is not a number; correct it in a copy"),
            ("U,I\n0,1\n0,1_000\n", "line 3: '1_000' in column 'I' is not a number"),
            ('U,I\n0,1\n0,"1,5"\n', """line 3: '1,5' in column 'I' is not a number; write decimal = "," under"""),
            (
                'U,I\n0,1\n0,"1,000.5"\n',
                "line 3: '1,000.5' .* seems to have a thousands mark as well as the decimal '.' of the",
            ),
            ("U,I\n0,1\n0,1'000\n", "it seems to have a thousands mark"),
            ("U,J\n0,1\n0,1\n", "channels.current.column: .* has no column 'I'; known: 'U', 'J'"),
            ("U,I,I\n0,1,2\n0,1,2\n", "has 2 columns 'I'; name the column by its number"),
            ("U,I\n0,1\n,2\n", "voltage: sample 1 .* is NaN"),
            ('U,I\n0,1\n0,"2\n', "line 3: it cannot be read as a text table: unexpected end of data"),
            ("U,I\n0,1\n", "1 rows, at least 2 are needed"),
        ],
    )
    def test_what_is_wrong_is_named_with_its_line(self, text: str, message: str, tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            import_run(path, make_map({"format": "csv"}))

    @pytest.mark.parametrize("number", ["1.000,0", "-1.000.000", "1 000,5"])
    def test_a_thousands_mark_beside_a_decimal_comma(self, number: str, tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_text(f"U;I\n0;1,5\n0;{number}\n")
        with pytest.raises(
            InputError, match=r"line 3: .* it seems to have a thousands mark as well as the decimal ','"
        ):
            import_run(path, make_map({"format": "csv", "separator": ";", "decimal": ","}))

    def test_a_file_of_another_kind_is_named_by_its_first_bytes(self, tmp_path: Path) -> None:
        run = Run.from_arrays(time=[0, 1, 2], voltage=[0, 1, 1])
        for ending, kind in (("xlsx", r"an Excel workbook \(\.xlsx\)"), ("mat", r"a MATLAB file \(\.mat\)")):
            path = tmp_path / f"record.{ending}"
            export_run(run, path)
            message = rf"this is {kind}, the map says format = 'csv'; write format = \"{ending}\" under \[file\] of"
            with pytest.raises(InputError, match=message):
                import_run(path, make_map({"format": "csv"}))
        path = tmp_path / "old.xls"
        path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(504))
        with pytest.raises(InputError, match=r"old kind \(\.xls\), the map says format = 'xlsx'; save it as \.xlsx"):
            import_run(path, make_map({"format": "xlsx"}))

    def test_text_in_another_encoding_without_a_map(self, tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_bytes("Größe;I\n0;1\n".encode("latin-1"))
        with pytest.raises(InputError, match="nothing says what its columns mean; give an import map"):
            import_run(path)

    def test_bytes_that_are_not_the_stated_text(self, tmp_path: Path) -> None:
        path = tmp_path / "record.csv"
        path.write_bytes(b"U,I\n0,\xff\n")
        with pytest.raises(
            InputError, match=r"it is not text in utf-8: .*position 6: invalid start byte; give its encoding in the map"
        ):
            import_run(path, make_map({"format": "csv"}))
        path.write_bytes(gzip.compress(b"U,I\n0,1\n" * 99)[:-20])
        with pytest.raises(InputError, match="it cannot be read as gzip"):
            import_run(path, make_map({"format": "csv"}))


class TestMeaning:
    """What a map makes of the numbers, whatever their format."""

    def run(self, tmp_path: Path, text: str, **changes: Any) -> Run:
        path = tmp_path / "record.csv"
        path.write_text(text)
        return import_run(path, make_map({"format": "csv"}, **changes))

    def test_scaling_zero_and_sign_in_this_order(self, tmp_path: Path) -> None:
        laser = {"column": "L", "unit": "mm", "points": [[2.0, 0.0], [10.0, 25.0]], "zero_rows": [0, 2], "sign": -1}
        run = self.run(
            tmp_path, "U,I,L\n0,0,5.9\n0,0,6.1\n1,0,7.2\n", channels={"displacement": {**laser, "range": [2.0, 10.0]}}
        )
        assert run.displacement is not None
        np.testing.assert_allclose(run.displacement, [0.1 / 8 * 0.025, -0.1 / 8 * 0.025, -1.2 / 8 * 0.025], rtol=1e-12)
        np.testing.assert_allclose(run.metadata.ranges["displacement"], (-0.0125, 0.0125), rtol=1e-12)
        assert run.metadata.calibrations["displacement"] == (
            "column 'L', from 2.0 to 10.0 read as 0.0 to 25.0 mm; minus 0.0125 m (mean of rows 0 to 1); sign reversed"
        )

    @pytest.mark.parametrize(("late", "expected"), [(2, [2, 4, 9, np.nan]), (-1, [np.nan, 0, 1, 2]), (9, [np.nan] * 4)])
    def test_a_channel_that_was_read_late_or_early(self, late: int, expected: list[float], tmp_path: Path) -> None:
        current = {"column": "I", "unit": "A", "rows_late": late, "zero_rows": [0, 1]}
        run = self.run(tmp_path, "U,I\n0,1\n0,2\n1,3\n1,5\n1,10\n", channels={"current": current}, rows=[0, 4])
        assert run.current is not None
        missing = np.isnan(expected)
        np.testing.assert_array_equal(run.current, expected)
        flags = run.quality.get("current", np.zeros(4, np.uint8))
        np.testing.assert_array_equal(flags > 0, missing)
        assert f"{abs(late)} row" in run.metadata.calibrations["current"]

    def test_what_others_are_late_beside_is_not_late(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"voltage.rows_late: the voltage is what others are late beside"):
            self.run(tmp_path, "U,I\n0,1\n", channels={"voltage": {"column": "U", "unit": "V", "rows_late": 1}})

    @pytest.mark.parametrize(
        ("zero", "rows", "change"),
        [
            ([0, 3], None, None),
            ([0, 4], None, 3),
            ([0, 8], None, 3),
            ([4, 6], None, 3),
            ([4, 6], [4, 9], None),  # the record that is taken starts there, at rest
            ([4, 7], [4, 9], 6),
        ],
    )
    def test_a_zero_is_taken_before_the_voltage_changes(
        self, zero: list[int], rows: list[int] | None, change: int | None, tmp_path: Path
    ) -> None:
        text = "U,I\n" + "".join(f"{u},{k}\n" for k, u in enumerate([0.003, 0, -0.002, 1, 0, 0, 1, 1, 1]))
        changes = {"channels": {"current": {"column": "I", "unit": "mA", "zero_rows": zero}}}
        changes |= {} if rows is None else {"rows": rows}
        if change is None:
            self.run(tmp_path, text, **changes)
            return
        message = rf"zero_rows: rows .* are to be at rest, but the voltage changes at row {change}; end at {change} or"
        with pytest.raises(InputError, match=message):
            self.run(tmp_path, text, **changes)

    def test_factor_offset_and_a_stated_zero(self, tmp_path: Path) -> None:
        current = {"column": "I", "unit": "mA", "factor": 100.0, "offset": 5.0, "zero_at": "2 mA"}
        run = self.run(tmp_path, "U,I\n0,0.5\n1,1\n", channels={"current": current})
        assert run.current is not None
        np.testing.assert_allclose(run.current, [0.053, 0.103], rtol=1e-14)

    def test_sentinels_and_gaps_are_told_apart(self, tmp_path: Path) -> None:
        current = {"column": "I", "unit": "mA", "sentinels": [-99.9999]}
        run = self.run(tmp_path, "U,I\n0,-99.9999\n1,Inf\n1,\n1,NaN\n1,-80.17\n", channels={"current": current})
        assert run.current is not None
        np.testing.assert_array_equal(np.isnan(run.current), [True, True, True, True, False])
        sentinel, missing = QUALITY_FLAGS["sentinel"], QUALITY_FLAGS["missing"]
        np.testing.assert_array_equal(run.quality["current"], [sentinel, missing, missing, missing, 0])
        assert "voltage" not in run.quality

    def test_a_stated_period_is_not_a_known_one(self, tmp_path: Path) -> None:
        assert not self.run(tmp_path, "U,I\n0,0\n1,1\n").metadata.sampling_period_known
        time = {"time": {"column": "t", "unit": "ms"}}
        run = self.run(tmp_path, "t,U,I\n0,0,0\n20,1,1\n60,1,1\n", period=None, channels=time)
        assert run.metadata.sampling_period_known
        np.testing.assert_array_equal(run.time, [0.0, 0.02, 0.06])

    @pytest.mark.parametrize(
        ("text", "changes", "message"),
        [
            (
                "t,U,I\n0,0,0\n2,0,0\n1,0,0\n",
                {},
                r"\.csv: line 4: the time 1 s is not after .* before, 2 s; sort the rows",
            ),
            ("t,U,I\n0,0,0\n,0,0\n1,0,0\n", {}, r"record\.csv: line 3: the row has no time; cut the record there"),
            ("U,I\n0,0\n1,1\n", {"time": None}, "neither the map nor the file says when the rows were read; add"),
            ("t,U,I\n0,0,0\n2,0,0\n", {"rows": [0, 3]}, "rows: rows 0 to 3, but the file has 2; end at 2 or before"),
            (
                "t,U,I\n0,0,0\n2,0,0\n",
                {"zero": [0, 9]},
                r"zero_rows: rows \[0, 9\] hold no reading of current .* 2 rows",
            ),
            ("t,U,I\n0,0,\n2,0,0\n", {"zero": [0, 1]}, r"zero_rows: rows \[0, 1\] hold no reading"),
            ("t,U,I\n0,0,0\n2,0,1\n", {"factor": 1e300, "range": [0, 1e300]}, r"current.range: .* too large to be"),
            ("t,U,I\n0,0,0\n2,0,1e308\n", {"factor": 99.0}, "line 3: 1e[+]308 in current is too large to be scaled"),
        ],
    )
    def test_what_does_not_fit_is_refused(
        self, text: str, changes: dict[str, Any], message: str, tmp_path: Path
    ) -> None:
        channels: dict[str, Any] = {"time": {"column": "t", "unit": "s"}, "current": {"column": "I", "unit": "A"}}
        if "time" in changes:
            del channels["time"]
        if "zero" in changes:
            channels["current"]["zero_rows"] = changes["zero"]
        channels["current"] |= {key: changes[key] for key in ("factor", "range") if key in changes}
        rows = {"rows": changes["rows"]} if "rows" in changes else {}
        with pytest.raises(InputError, match=message):
            self.run(tmp_path, text, period=None, channels=channels, **rows)

    def test_rows_cut_the_record_and_keep_its_time(self, tmp_path: Path) -> None:
        run = self.run(tmp_path, table_text(), rows=[1, 5])
        assert_is_the_record(run, first_row=1)
        assert run.time[0] == PERIOD

    def test_row_numbers_place_the_readings(self, tmp_path: Path) -> None:
        indexed = {"current": {"column": "I", "index": "n", "unit": "A"}}
        run = self.run(tmp_path, "U,n,I\n0,0,7\n1,2,8\n1,,\n", channels=indexed)
        np.testing.assert_array_equal(run.current, [7, np.nan, 8])
        np.testing.assert_array_equal(run.quality["current"], [0, QUALITY_FLAGS["missing"], 0])
        with pytest.raises(InputError, match="line 3: 0 in the index column 'n' of current is not a row number above"):
            self.run(tmp_path, "U,n,I\n0,0,7\n1,0,8\n", channels=indexed)
        with pytest.raises(InputError, match=r"2 rows are numbered up to 1e[+]09 in the index column 'n'"):
            self.run(tmp_path, "U,n,I\n0,0,7\n1,1e9,8\n", channels=indexed)
        # Of ten rows nine may have been lost, and a thousand beside; beyond that it is a column of something else.
        text = "U,n,I\n0,0,7\n1,{},8\n" + 1018 * "1,,\n"
        assert len(self.run(tmp_path, text.format(1019), channels=indexed)) == 1020
        with pytest.raises(InputError, match="2 rows are numbered up to 1020"):
            self.run(tmp_path, text.format(1020), channels=indexed)

    def test_row_numbers_may_count_from_one(self, tmp_path: Path) -> None:
        current = {"column": "I", "index": "n", "unit": "A"}
        both = {"voltage": {"column": "U", "index": "n", "unit": "V"}, "current": current}
        text = "n,U,I\n{},0,7\n{},0,8\n{},1,9\n"
        from_zero, from_one = (self.run(tmp_path, text.format(*rows), channels=both) for rows in ((0, 1, 2), (1, 2, 3)))
        np.testing.assert_array_equal(from_one.current, from_zero.current)
        np.testing.assert_array_equal(from_one.time, from_zero.time)
        # Beside a voltage that has every row, an index that begins at 1 says that a channel lacks the first.
        alone = self.run(tmp_path, "n,U,I\n1,0,7\n2,1,8\n,1,\n", channels={"current": current})
        np.testing.assert_array_equal(alone.current, [np.nan, 7, 8])

    def test_other_repairs(self, tmp_path: Path) -> None:
        good = make_map({"format": "csv"})
        with pytest.raises(InputError, match="no such file; see where the record was saved"):
            import_run(tmp_path / "nowhere.csv", good)
        with pytest.raises(InputError, match="no such file"):
            import_run(tmp_path / ("a" * 300), good)
        with pytest.raises(InputError, match="this is a folder; name a record in it"):
            import_run(tmp_path, good)
        path = tmp_path / "record.csv"
        path.write_text(table_text())
        with pytest.raises(InputError, match="nothing says what its columns mean; give an import map"):
            import_run(path)
        path.rename(tmp_path / "record.nc")
        with pytest.raises(InputError, match="read a run file with read_run"):
            import_run(tmp_path / "record.nc")
        with pytest.raises(InputError, match=r"column 2, but .* has 2 columns; give a number from 0 to 1"):
            self.run(tmp_path, table_text(), channels={"current": {"column": 2, "unit": "A"}})


class TestThesisBinary:
    """Appendix A.2: [4 x N] doubles; the factors below are those of its script, the force corrected to 98.0665 mN."""

    def write(self, path: Path) -> np.ndarray:
        time = np.arange(2000) / 50
        table = np.stack([time, 0.06 * np.exp(-time), 6.0 + np.sin(time), np.sin(time)])
        path.write_bytes(b"".join(struct.pack("<4d", *row) for row in table.T))
        return table

    def test_displacement(self, tmp_path: Path, maps: Path) -> None:
        table = self.write(tmp_path / "exp1.bin")
        run = import_run(tmp_path / "exp1.bin", maps / "friend_displacement.toml")
        assert run.hold == "zero-before"
        assert run.metadata.sampling_period_known
        np.testing.assert_array_equal(run.time, table[0])
        np.testing.assert_array_equal(run.current, table[1])
        np.testing.assert_array_equal(run.voltage, table[3])
        millimetres = 1 * (((table[2] / 500) * 1000) - 4) / 16 * 25 - 12.3
        assert run.displacement is not None
        np.testing.assert_allclose(run.displacement, millimetres / 1000, atol=1e-16)
        np.testing.assert_allclose(run.metadata.ranges["displacement"], (-0.0123, 0.0127))

    def test_force(self, tmp_path: Path, maps: Path) -> None:
        table = self.write(tmp_path / "exp1.bin")
        run = import_run(tmp_path / "exp1.bin", maps / "friend_force.toml")
        assert run.force is not None
        np.testing.assert_allclose(run.force, table[2] / 10 * 98.0665e-3 - 4.393e-3, rtol=1e-13)

    def test_a_cut_file_and_another_byte_order(self, tmp_path: Path, maps: Path) -> None:
        path = tmp_path / "exp1.bin"
        table = self.write(path)
        path.write_bytes(path.read_bytes()[:-3])
        with pytest.raises(InputError, match="63997 bytes are 1999 rows of 32 bytes and 29 bytes more; copy the file"):
            import_run(path, maps / "friend_force.toml")
        path.write_bytes(table.T.astype(">f8").tobytes())
        with pytest.raises(InputError, match="time"):
            import_run(path, maps / "friend_force.toml")
        channels = {name: {"column": k, "unit": unit} for name, k, unit in (("time", 0, "s"), ("voltage", 3, "V"))}
        big = {"format": "binary", "columns": ["t", "a", "b", "c"], "byte_order": "big"}
        run = import_run(path, ImportMap.from_table({"file": big, "channels": channels}))
        np.testing.assert_array_equal(run.voltage, table[3])


class TestWorkbooks:
    PAIRED = {  # noqa: RUF012
        "channels": {
            "voltage": {"column": "纵轴 - 电压", "index": "时间 Point - 电压", "unit": "V"},
            "current": {"column": "纵轴 - 电流", "index": "时间 Point - 电流", "unit": "mA"},
        }
    }

    def write(self, path: Path, rows: list[list[Any]], title: str = "Sheet") -> None:
        book = openpyxl.Workbook()
        assert book.active is not None
        book.active.title = title
        for row in rows:
            book.active.append(row)
        book.save(path)

    def paired(self) -> list[list[Any]]:
        header = ["时间 Point - 电流", "纵轴 - 电流", "时间 Point - 电压", "纵轴 - 电压", "Point", "R"]
        body: list[list[Any]] = [
            [k, CURRENT_MILLIAMPERE[k], k, VOLTAGE[k], k, "Inf" if k < 2 else 16.0] for k in range(5)
        ]
        return [header, *body, [None, None, None, None, 5, "Inf"]]

    def test_pairs_of_row_number_and_value(self, tmp_path: Path) -> None:
        self.write(tmp_path / "export.xlsx", self.paired())
        assert_is_the_record(import_run(tmp_path / "export.xlsx", make_map({"format": "xlsx"}, **self.PAIRED)))

    def test_a_shorter_column_is_missing_at_its_end(self, tmp_path: Path) -> None:
        rows = self.paired()
        rows[5][0] = rows[5][1] = None
        rows[3][1] = "Inf"
        self.write(tmp_path / "export.xlsx", rows)
        run = import_run(tmp_path / "export.xlsx", make_map({"format": "xlsx"}, **self.PAIRED))
        assert run.current is not None
        np.testing.assert_array_equal(np.isnan(run.current), [False, False, True, False, True])
        np.testing.assert_array_equal(run.quality["current"], np.array([0, 0, 1, 0, 1]) * QUALITY_FLAGS["missing"])

    def test_what_is_wrong_is_named_with_its_cell(self, tmp_path: Path) -> None:
        path = tmp_path / "export.xlsx"
        rows = self.paired()
        rows[3][1] = "fault"
        self.write(path, rows, "run 1")
        paired = make_map({"format": "xlsx"}, **self.PAIRED)
        with pytest.raises(InputError, match="sheet 'run 1', cell B4: 'fault' in column '纵轴 - 电流' is not a number"):
            import_run(path, paired)
        with pytest.raises(InputError, match="no sheet 'run 2'; its sheets: 'run 1'"):
            import_run(path, make_map({"format": "xlsx", "sheet": "run 2"}, **self.PAIRED))
        self.write(path, rows[:1])
        with pytest.raises(InputError, match="no rows of numbers in sheet"):
            import_run(path, paired)
        path.write_bytes(path.read_bytes()[:-40])
        with pytest.raises(InputError, match=r"it cannot be read as an Excel workbook \(\.xlsx\)"):
            import_run(path, paired)


class TestMatlab:
    def test_version_5(self, tmp_path: Path) -> None:
        path = tmp_path / "record.mat"
        table = np.array([np.arange(5) * PERIOD, CURRENT_MILLIAMPERE])
        scipy.io.savemat(path, {"data": table, "run": {"U": np.array(VOLTAGE, np.float32)}, "note": "text", "k": 1.0})
        channels = {
            "time": {"column": "data[0]", "unit": "s"},
            "voltage": {"column": "run.U", "unit": "V"},
            "current": {"column": "data[1]", "unit": "mA"},
        }
        mat = make_map({"format": "mat"}, period=None, channels=channels)
        assert_is_the_record(import_run(path, mat))
        with pytest.raises(InputError, match=r"no column 'U'; .*'run.U'"):
            import_run(path, make_map({"format": "mat"}))
        path.write_bytes(path.read_bytes()[:-60])
        with pytest.raises(InputError, match="it cannot be read as a MATLAB file"):
            import_run(path, mat)
        scipy.io.savemat(path, {"note": "text", "z": np.array([1j, 2j])})
        with pytest.raises(InputError, match="no vectors of numbers in it"):
            import_run(path, mat)

    def test_version_7_3(self, tmp_path: Path) -> None:
        """MATLAB's own layout: a 512-byte block with its banner, then HDF5 with the first dimension last."""
        path = tmp_path / "record.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in (("data", np.array([VOLTAGE, CURRENT_MILLIAMPERE])), ("s/I", [CURRENT_MILLIAMPERE])):
                file[name] = np.asarray(values)
                file[name].attrs["MATLAB_class"] = np.bytes_("double")
            file["s"].attrs["MATLAB_class"] = np.bytes_("struct")
            file["text"] = np.array([[72], [105]], np.uint16)
            file["text"].attrs["MATLAB_class"] = np.bytes_("char")
        banner = b"MATLAB 7.3 MAT-file, Platform: PCWIN64".ljust(124) + b"\x00\x02IM"
        path.write_bytes(banner + path.read_bytes()[len(banner) :])
        channels = {"voltage": {"column": "data[0]", "unit": "V"}, "current": {"column": "s.I", "unit": "mA"}}
        mat = make_map({"format": "mat"}, channels=channels)
        assert_is_the_record(import_run(path, mat))
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.raises(InputError, match=r"it cannot be read as a MATLAB file: .*truncated"):
            import_run(path, mat)


class TestTdms:
    CHANNELS = {  # noqa: RUF012
        "voltage": {"column": "run/U", "unit": "V"},
        "current": {"column": "run/I", "unit": "mA"},
    }

    def write(self, path: Path, current_period: float = PERIOD, *, late: str = "2026-11-21T09:00:00") -> None:
        def properties(period: float, started: str = "2026-11-21T09:00:00") -> dict[str, Any]:
            start = {"wf_start_time": np.datetime64(started, "us"), "wf_start_offset": 0.0}
            return {"wf_increment": period, "unit_string": "Volts", **start}

        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    nptdms.ChannelObject("run", "U", np.array(VOLTAGE), properties(PERIOD)),
                    nptdms.ChannelObject("run", "I", np.array(CURRENT_MILLIAMPERE), properties(current_period, late)),
                ]
            )

    def test_the_file_brings_its_period(self, tmp_path: Path) -> None:
        path = tmp_path / "record.tdms"
        self.write(path)
        run = import_run(path, make_map({"format": "tdms"}, period=None, channels=self.CHANNELS))
        assert_is_the_record(run)
        assert run.metadata.sampling_period_known
        with pytest.raises(InputError, match=r"the map states .* 0\.04 s, but the file records 0\.02 s; leave it out"):
            import_run(path, make_map({"format": "tdms"}, period="40 ms", channels=self.CHANNELS))

    def test_channels_of_two_rates_are_refused(self, tmp_path: Path) -> None:
        path = tmp_path / "record.tdms"
        self.write(path, current_period=0.04)
        with pytest.raises(InputError, match=r"not read together: from 0 s every 0\.02 s and from 0 s every 0\.04 s"):
            import_run(path, make_map({"format": "tdms"}, period=None, channels=self.CHANNELS))

    def test_channels_that_started_at_other_times_are_refused(self, tmp_path: Path) -> None:
        path = tmp_path / "record.tdms"
        self.write(path, late="2026-11-21T09:00:00.500000")
        with pytest.raises(
            InputError, match=r"not read together: from 0 s every 0\.02 s and from 0\.5 s every 0\.02 s"
        ):
            import_run(path, make_map({"format": "tdms"}, period=None, channels=self.CHANNELS))
        # Writers stamp the channels of one reading one after the other: up to half a row is no delay.
        tdms = make_map({"format": "tdms"}, period=None, channels=self.CHANNELS)
        for micros in (900, 9_900):
            self.write(path, late=f"2026-11-21T09:00:00.{micros:06d}")
            assert_is_the_record(import_run(path, tdms))
        for micros in (10_100, 19_900):
            self.write(path, late=f"2026-11-21T09:00:00.{micros:06d}")
            with pytest.raises(InputError, match=rf"not read together: .* and from {micros / 1e6:g} s every 0\.02 s"):
                import_run(path, tdms)

    def test_a_cut_file(self, tmp_path: Path) -> None:
        path = tmp_path / "record.tdms"
        self.write(path)
        tdms = make_map({"format": "tdms"}, period=None, channels=self.CHANNELS)
        path.write_bytes(path.read_bytes()[:-12])
        with pytest.raises(InputError, match="the file is truncated: its last segment is not whole"):
            import_run(path, tdms)
        path.write_bytes(b"not TDMS at all, whatever its name says")
        with pytest.raises(InputError, match="it cannot be read as TDMS"):
            import_run(path, tdms)

    def test_a_missing_package_is_named(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        path = tmp_path / "record.tdms"
        self.write(path)
        monkeypatch.setitem(sys.modules, "nptdms", None)
        with pytest.raises(InputError, match=r'npTDMS.* is not installed; .*uv tool install "\.\[tdms\]"'):
            import_run(path, make_map({"format": "tdms"}, period=None, channels=self.CHANNELS))


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t{decimal}
Multi_Headings\tNo
X_Columns\t{x_columns}
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t
Samples\t5\t5
Y_Unit_Label\tVolts\tmA
X_Dimension\tTime\tTime
***Start_Special***
X_Dimension\tFrequency
***End_Special***
X0\t0{decimal}0E+0\t0{decimal}0E+0
Delta_X\t0{decimal}020000\t0{decimal}020000
***End_of_Header***\t\t
"""


def lvm_text(x_columns: str = "One", decimal: str = ".", remark: str = "") -> str:
    rows = []
    for k in range(5):
        x = f"{k * PERIOD:.6f}" if x_columns != "No" else ""
        cells = [x, VOLTAGE[k], *([x] if x_columns == "Multi" else []), CURRENT_MILLIAMPERE[k]]
        rows.append("\t".join(map(str, cells)).replace(".", decimal) + (f"\t{remark}" if k == 2 else ""))
    names = "X_Value\tU\tX_Value\tI\tComment\n" if x_columns == "Multi" else "X_Value\tU\tI\tComment\n"
    return LVM.format(decimal=decimal, x_columns=x_columns) + names + "\n".join(rows) + "\n"


class TestLabviewText:
    @pytest.mark.parametrize("x_columns", ["No", "One", "Multi"])
    @pytest.mark.parametrize("decimal", [".", ","])
    def test_all_three_layouts(self, x_columns: str, decimal: str, tmp_path: Path) -> None:
        path = tmp_path / "record.lvm"
        path.write_text(lvm_text(x_columns, decimal, remark="lamp on"))
        time = {} if x_columns == "No" else {"time": {"column": 0, "unit": "s"}}
        channels = {"current": {"column": "I"}} | time  # its unit stands in the file
        run = import_run(path, make_map({"format": "lvm"}, period=None, channels=channels))
        assert_is_the_record(run)
        assert run.metadata.sampling_period_known

    def test_a_record_without_x_values_begins_at_its_x0(self, tmp_path: Path) -> None:
        path = tmp_path / "record.lvm"
        zeros = "X0\t0.0E+0\t0.0E+0"
        assert zeros in lvm_text("No")
        path.write_text(lvm_text("No").replace(zeros, "X0\t2.5E+0\t2.5E+0"))
        lvm = make_map({"format": "lvm"}, period=None, channels={"current": {"column": "I"}})
        run = import_run(path, lvm)
        assert_is_the_record(run)
        assert run.time[0] == 2.5
        path.write_text(lvm_text("No").replace(zeros, "X0\t0.0E+0\t2.5E+0"))
        with pytest.raises(
            InputError, match=r"not read together: from 0 s every 0\.02 s and from 2\.5 s every 0\.02 s"
        ):
            import_run(path, lvm)

    @pytest.mark.parametrize(
        ("tags", "read"),
        [
            ("Date\t2026/11/21\t2026/11/21\nTime\t09:00:00{d}5\t09:00:00{d}5", 0.0),
            ("Time\t09:00:00{d}5\t09:00:00{d}5096141014099121094", 0.0),  # stamped one after the other
            ("Time\t09:00:00{d}5\t09:00:00{d}5106141014099121094", "from 0 s .* and from 0.0106"),
            ("Time\t09:00:03\t09:00:01", "from 0 s every 0.02 s and from 2 s every 0.02 s"),
            ("Date\t2026/11/21\t2026/11/22\nTime\t09:00:03\t09:00:03", "and from 86400 s"),
            ("Date\t2026/11/21\t2026/11/22\nTime\t23:59:59{d}995\t00:00:00{d}004", 0.0),
            ("Date\t2026/11/21\t1903/12/31\nTime\t09:00:00\t19:00:00", 0.0),  # a stamp that was never set
            ("Time\t09:00:00\t", 0.0),
            ("Date\t2026/11/21\t\nTime\t09:00:00\t09:00:01", "and from 1 s"),
            ("Time\tearly\tlate", "Date and Time of channel 0 are 'early', not a date"),
        ],
    )
    @pytest.mark.parametrize("decimal", [".", ","])
    def test_a_channel_without_x_values_begins_at_its_own_time(
        self, tags: str, read: float | str, decimal: str, tmp_path: Path
    ) -> None:
        path, lines = tmp_path / "record.lvm", tags.format(d=decimal)
        path.write_text(lvm_text("No", decimal).replace("X0\t", f"{lines}\nX0\t"))
        lvm = make_map({"format": "lvm"}, period=None, channels={"current": {"column": "I"}})
        if isinstance(read, str):
            with pytest.raises(InputError, match=read):
                import_run(path, lvm)
            path.write_text(path.read_text().replace("Relative", "Absolute"))  # X0 is then the time of day and all
            read = 0.0
        run = import_run(path, lvm)
        assert_is_the_record(run)
        assert run.time[0] == read

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (lvm_text()[5:], "it does not start with 'LabVIEW Measurement'"),
            (lvm_text()[:90], "0 lines '.*End_of_Header.*'; one run has two"),
            (lvm_text() + LVM, "4 lines"),
            (lvm_text()[:-20], "4 rows, the header promises 5; copy the file again"),
            (lvm_text() + "0.1\t1\n", "line 26: 2 cells, the columns are 4"),
            (lvm_text().replace("Time\tTime", "Frequency\tFrequency"), "X_Dimension is .* not Time"),
            (lvm_text("No").replace("0.020000\t", "often\t"), "Delta_X of channel 0 are .*'often'.*not two numbers"),
            (lvm_text().replace("60.25", "fault"), "line 23: 'fault' in column 'I' is not a number"),
        ],
    )
    def test_what_is_wrong_is_named(self, text: str, message: str, tmp_path: Path) -> None:
        path = tmp_path / "record.lvm"
        path.write_text(text)
        channels = {"time": {"column": 0, "unit": "s"}, "current": {"column": "I"}} if "No" not in text[90:150] else {}
        with pytest.raises(InputError, match=message):
            import_run(path, make_map({"format": "lvm"}, period=None, channels=channels))


@pytest.fixture
def maps() -> Path:
    return Path(__file__).parents[2] / "docs" / "import_maps"


cells = st.sampled_from([",", ";", "\t", "\n", '"', ".", "U", "I", "1", "0", "-", "e", "#", "Inf", " ", "\0", "\r"])


@given(content=st.binary(max_size=80) | st.lists(cells, max_size=40).map(lambda parts: "".join(parts).encode()))
@pytest.mark.parametrize(
    "file",
    [
        {"format": "csv"},
        {"format": "csv", "separator": ";", "decimal": ",", "header": False, "comment": "#"},
        {"format": "csv", "encoding": "utf-16", "units_row": True, "skip_lines": 1},
        {"format": "binary", "columns": ["U", "I"]},
        {"format": "lvm"},
        {"format": "xlsx"},
        {"format": "mat"},
        {"format": "tdms"},
    ],
    ids=str,
)
def test_no_bytes_give_a_traceback(
    file: dict[str, Any], content: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / f"record.{file['format']}"
    path.write_bytes((b"LabVIEW Measurement\n" if file["format"] == "lvm" else b"U,I\n") + content)
    channels = {"voltage": {"column": 0, "unit": "V"}, "current": {"column": 1, "unit": "A"}}
    with contextlib.suppress(InputError):
        import_run(path, make_map(file, channels=channels))


@given(data=st.data())
@pytest.mark.parametrize("ending", ["csv", "xlsx", "mat", "tdms", "lvm"])
def test_no_damage_gives_a_traceback(
    ending: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.getbasetemp()
    whole, damaged = folder / f"whole.{ending}", folder / f"damaged.{ending}"
    if not whole.exists():
        if ending == "tdms":
            TestTdms().write(whole)
        elif ending == "lvm":
            whole.write_text(lvm_text("No"))
        else:
            export_run(Run.from_arrays(time=[0, 1, 2], voltage=VOLTAGE[:3], current=VOLTAGE[2:]), whole)
    content = bytearray(whole.read_bytes())
    del content[data.draw(st.just(len(content)) | st.integers(0, len(content))) :]
    for _ in range(data.draw(st.integers(0, 4)) if content else 0):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    damaged.write_bytes(content)
    file = {"format": ending} | ({"comment": "#"} if ending == "csv" else {})
    channels = {"voltage": {"column": 0, "unit": "V"}, "current": {"column": 1, "unit": "A"}}
    foreign = make_map(file, period=None if ending in ("tdms", "lvm") else "1 s", channels=channels)
    for import_map in (foreign, None):
        with contextlib.suppress(InputError):
            import_run(damaged, import_map)


@pytest.mark.parametrize("ending", ["csv", "xlsx", "mat", "tdms", "lvm", "nc"])
def test_a_file_that_is_refused_is_open_no_more(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"damaged.{ending}"
    if ending == "xlsx":
        with zipfile.ZipFile(path, "w") as book:  # a workbook so far
            book.writestr("[Content_Types].xml", "<Types/>")
    else:
        path.write_bytes({"tdms": b"TDSm", "lvm": b"LabVIEW Measurement\n"}.get(ending, b"damaged"))
    with pytest.raises(InputError) as caught:  # whose frames hold what they opened
        read_run(path) if ending == "nc" else import_run(path, make_map({"format": ending}))
    still = [one for one in gc.get_objects() if isinstance(one, io.IOBase) and not one.closed]
    assert not [one for one in still if str(getattr(one, "name", "")) == str(path)]
    assert caught.value.where


@pytest.mark.parametrize(("cell", "row"), [("XFD", 2000), ("A", 10**9)])
def test_a_sheet_whose_far_cell_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cell: str, row: int
) -> None:
    """The file is small: one cell far to the right widens every row, one far below makes rows up to it."""
    assert xlsx._MOST_CELLS == 2**24
    monkeypatch.setattr(xlsx, "_MOST_CELLS", 2**20)  # to count so far takes seconds
    path = tmp_path / "far.xlsx"
    openpyxl.Workbook().save(path)
    with zipfile.ZipFile(path) as book:
        parts = {name: book.read(name) for name in book.namelist()}
    rows = "".join(f'<row r="{k}"><c r="A{k}"><v>1</v></c></row>' for k in range(1, 2000))
    rows += f'<row r="{row}"><c r="{cell}{row}"><v>1</v></c></row>'
    sheet = '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'
    parts["xl/worksheets/sheet1.xml"] = sheet.format(rows).encode()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        for name, part in parts.items():
            book.writestr(name, part)
    assert path.stat().st_size < 2**16
    table = {"file": {"format": "xlsx"}, "channels": {"voltage": {"column": 0}}, "sampling_period": "20 ms"}
    with pytest.raises(InputError, match="make more than 1048576 cells") as told:
        import_run(path, ImportMap.from_table(table))
    assert "far to the right" in told.value.repair


def _workbook(path: Path, **parts: bytes) -> Path:
    """A workbook whose first sheet is what is given."""
    book = openpyxl.Workbook()
    book.save(path)
    with zipfile.ZipFile(path) as whole:
        kept = {part.filename: whole.read(part) for part in whole.infolist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as changed:
        for name, content in kept.items():
            changed.writestr(name, parts.get(name.rpartition("/")[2].removesuffix(".xml"), content))
    return path


_SHEET = b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData><row>'


@pytest.mark.parametrize(
    ("part", "content", "message"),
    [
        ("sheet1", _SHEET + b"<c>" * 4_000_000, "nested deeper"),
        ("sheet1", _SHEET + b"<c/>" * 4_000_000, "more elements at once"),
        ("styles", b"<s>" + b"<a/>" * 4_000_000 + b"</s>", "more elements at once"),
    ],
)
def test_a_small_workbook_that_unpacks_to_much_is_refused(
    part: str, content: bytes, message: str, tmp_path: Path
) -> None:
    """It would take its reader half a minute, and gigabytes."""
    path = _workbook(tmp_path / "record.xlsx", **{part: content})
    del content
    assert path.stat().st_size < 100_000
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=message):
            import_run(path, make_map({"format": "xlsx"}))
        assert tracemalloc.get_traced_memory()[1] < 64e6
    finally:
        tracemalloc.stop()


def test_packed_records_are_bounded_by_what_they_unpack_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ipmclab.store.importers.unpacked._MOST_TEXT", 2**20)
    monkeypatch.setattr("ipmclab.store.importers.unpacked._MOST_NUMBERS", 2**20)
    text = table_text() + "1,2\n" * 2**19
    (tmp_path / "record.csv.gz").write_bytes(gzip.compress(text.encode()))
    scipy.io.savemat(tmp_path / "packed.mat", {"U": np.zeros(2**19)}, do_compression=True)
    with h5py.File(tmp_path / "empty.mat", "w", userblock_size=512) as file:  # a gigabyte of which nothing is written
        file.create_dataset("U", (1, 2**27), dtype="f8", chunks=(1, 2**16)).attrs["MATLAB_class"] = np.bytes_("double")
    with (tmp_path / "empty.mat").open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + struct.pack("<HH", 0x0200, 0x4D49))
    for name, kind in (("record.csv.gz", "csv"), ("packed.mat", "mat"), ("empty.mat", "mat")):
        with pytest.raises(InputError, match="unpacked it has more than 1 MiB"):
            import_run(tmp_path / name, make_map({"format": kind}))
    (tmp_path / "record.csv").write_text(text)  # as large on the disk: nobody is surprised
    assert len(import_run(tmp_path / "record.csv", make_map({"format": "csv"}))) > 2**19
