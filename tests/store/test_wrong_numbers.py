"""Records that would be read as other numbers than were measured: each is refused, or read right."""

from __future__ import annotations

import datetime
import zipfile
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import openpyxl
import pytest
import scipy.io

from ipmclab.errors import InputError
from ipmclab.run import QUALITY_FLAGS, Run
from ipmclab.store.import_map import ImportMap
from ipmclab.store.importers import mat, xlsx
from ipmclab.store.importing import import_run

VOLTAGE = {"column": "U", "unit": "V"}
CURRENT = {"column": "I", "unit": "A"}


def read(path: Path, *, file: dict[str, Any] | None = None, period: str | None = "20 ms", **table: Any) -> Run:
    table |= {} if period is None else {"sampling_period": period}
    return import_run(path, ImportMap.from_table({"file": file or {"format": "csv"}, **table}))


def text(tmp_path: Path, content: str, name: str = "record.csv") -> Path:
    path = tmp_path / name
    path.write_text(content)
    return path


class TestRowsOfATextTable:
    def test_a_row_of_blank_cells_is_one_of_missing_readings(self, tmp_path: Path) -> None:
        """To leave it out would bring all rows below to earlier times."""
        path = text(tmp_path, "U;I\n0;1\n ;\n1;2\n")
        with pytest.raises(InputError, match=r"voltage: sample 1 \(and 0 more\) is NaN"):
            read(path, file={"format": "csv", "separator": ";"}, channels={"voltage": VOLTAGE})

    @pytest.mark.parametrize(
        "content",
        [
            "U,I\n0,1\n1,2\n,\n,,\n",
            ",\nU,I\n,\n0,1\n1,2\n",
            "U,I\n\n0,1\n\n  \n1,2\n",
            "U,I,\n0,1,\n1,2,\n",
            "U,I\n0,1,,\n1,2,\n",
        ],
    )
    def test_around_the_table_and_as_blank_lines_they_are_none(self, content: str, tmp_path: Path) -> None:
        run = read(text(tmp_path, content), channels={"voltage": VOLTAGE, "current": CURRENT})
        np.testing.assert_array_equal(run.voltage, [0, 1])
        np.testing.assert_array_equal(run.current, [1, 2])

    def test_a_line_is_named_by_its_number_in_the_file(self, tmp_path: Path) -> None:
        path = text(tmp_path, "from Lab 3\nU,I\n#\nV,A\nup,up\n,\n0,1\n,\n1,fault\n,\n")
        file = {"format": "csv", "skip_lines": 1, "units_row": True, "skip_rows": 1, "comment": "#"}
        with pytest.raises(InputError, match="line 9: 'fault' in column 'I'"):
            read(path, file=file, channels={"voltage": VOLTAGE, "current": CURRENT})

    def test_units_for_another_number_of_columns(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"record\.csv: units: 1 cells, the lines before have 2"):
            read(
                text(tmp_path, "U,I\nV\n0,1\n1,2\n"),
                file={"format": "csv", "units_row": True},
                channels={"voltage": VOLTAGE},
            )

    def test_of_rows_with_one_time_the_first_is_kept(self, tmp_path: Path) -> None:
        time = {"column": "t", "unit": "s", "duplicates": "drop"}
        run = read(
            text(tmp_path, "t,U,I\n0,0,1\n1,1,2\n1,1,9\n1,1,9\n2,1,3\n"),
            period=None,
            channels={"time": time, "voltage": VOLTAGE, "current": CURRENT},
        )
        np.testing.assert_array_equal(run.time, [0, 1, 2])
        np.testing.assert_array_equal(run.current, [1, 2, 3])


class TestReadTogether:
    def test_vectors_of_other_lengths_have_no_common_rows(self, tmp_path: Path) -> None:
        path = tmp_path / "record.mat"
        scipy.io.savemat(path, {"U": [0.0, 1.0, 1.0, 1.0], "T": [20.0, 21.0], "n": [0.0, 2.0]})
        channels = {"voltage": VOLTAGE, "temperature": {"column": "T", "unit": "degC"}}
        with pytest.raises(InputError, match=r"nothing says which belong together: voltage 4, temperature 2; leave"):
            read(path, file={"format": "mat"}, channels=channels)
        channels["temperature"]["index"] = "n"
        run = read(path, file={"format": "mat"}, channels=channels)
        np.testing.assert_array_equal(run.temperature, [20, np.nan, 21, np.nan])
        scipy.io.savemat(path, {"U": [0.0, 1.0, 1.0, 1.0], "T": [20.0, 21.0], "n": [0.0, 1.0, 2.0]})
        with pytest.raises(InputError, match="2 readings of temperature have 3 row numbers; name the column"):
            read(path, file={"format": "mat"}, channels=channels)

    def test_dates_of_other_rows_than_the_times_of_day(self, tmp_path: Path) -> None:
        path = tmp_path / "a.tdms"
        with nptdms.TdmsWriter(path) as writer:
            cells = {"D": ["2026-03-03"], "T": ["09:00", "09:01"], "U": [0.0, 1.0]}
            writer.write_segment([nptdms.ChannelObject("r", name, values) for name, values in cells.items()])
        time = {"column": "r/T", "date_column": "r/D", "dates": "year-month-day"}
        channels = {"time": time, "voltage": {**VOLTAGE, "column": "r/U"}}
        with pytest.raises(InputError, match="1 dates for 2 times of day; name the column with the date of each row"):
            read(path, file={"format": "tdms"}, period=None, channels=channels)

    def tdms(self, path: Path, **channels: tuple[list[float], float | None]) -> Path:
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    nptdms.ChannelObject(
                        "r", name, np.array(values), {} if period is None else {"wf_increment": period}
                    )
                    for name, (values, period) in channels.items()
                ]
            )
        return path

    def test_a_clock_says_to_which_rows_a_shorter_waveform_belongs(self, tmp_path: Path) -> None:
        channels = {"voltage": {**VOLTAGE, "column": "r/U"}, "current": {**CURRENT, "column": "r/I"}}
        path = self.tdms(tmp_path / "same.tdms", U=([0.0, 1.0, 1.0], 0.5), I=([3.0, 4.0], 0.5))
        run = read(path, file={"format": "tdms"}, period=None, channels=channels)
        np.testing.assert_array_equal(run.current, [3, 4, np.nan])
        np.testing.assert_array_equal(run.quality["current"], [0, 0, QUALITY_FLAGS["missing"]])
        np.testing.assert_array_equal(run.time, [0.0, 0.5, 1.0])
        path = self.tdms(tmp_path / "none.tdms", U=([0.0, 1.0, 1.0], 0.5), I=([3.0, 4.0], None))
        with pytest.raises(InputError, match="nothing says which belong together: voltage 3, current 2"):
            read(path, file={"format": "tdms"}, period=None, channels=channels)

    def test_a_time_column_is_none_for_channels_of_two_rates(self, tmp_path: Path) -> None:
        path = self.tdms(tmp_path / "a.tdms", t=([0.0, 0.5], None), U=([0.0, 1.0], 0.5), I=([3.0, 4.0], 1.0))
        channels = {"time": {"column": "r/t", "unit": "s"}, "voltage": {**VOLTAGE, "column": "r/U"}}
        run = read(path, file={"format": "tdms"}, period=None, channels=channels)
        np.testing.assert_array_equal(run.time, [0.0, 0.5])
        channels["current"] = {**CURRENT, "column": "r/I"}
        with pytest.raises(InputError, match=r"not read together: from 0 s every 0\.5 s and from 0 s every 1 s"):
            read(path, file={"format": "tdms"}, period=None, channels=channels)

    @pytest.mark.parametrize(
        ("times", "good"),
        [
            (["0", "0.1", "0.2"], True),
            (["0.04", "0.14", ""], True),  # stamped one after the other; it ends early
            (["0.06", "0.16", "0.26"], False),
            (["-0.06", "0.04", "0.14"], False),
            (["0", "0.2", "0.4"], False),
            (["0", "", ""], True),
            (["0.01", "", ""], False),  # one time says nothing of the step
        ],
    )
    def test_labview_may_give_each_channel_times_of_its_own(self, times: list[str], good: bool, tmp_path: Path) -> None:
        head = (
            "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\n"
            "X_Dimension\tTime\tTime\n***End_of_Header***\nX_Value\tU\tX_Value\tI\n"
        )
        rows = zip(["0", "0.1", "0.2"], times, strict=True)
        path = text(tmp_path, head + "".join(f"{a}\t{k}\t{b}\t{k}\n" for k, (a, b) in enumerate(rows)), "a.lvm")
        for period, time in ((None, {"time": {"column": 0, "unit": "s"}}), ("100 ms", {})):
            channels = time | {"voltage": VOLTAGE, "current": CURRENT}
            if good:
                np.testing.assert_array_equal(
                    read(path, file={"format": "lvm"}, period=period, channels=channels).current, [0, 1, 2]
                )
                continue
            with pytest.raises(InputError, match="the times in column 2 are not those in column 0; leave the channel"):
                read(path, file={"format": "lvm"}, period=period, channels=channels)
            del channels["current"]
            assert len(read(path, file={"format": "lvm"}, period=period, channels=channels)) == 3

    @pytest.mark.parametrize(
        ("layout", "tag", "names"),
        [
            ("One", "\tVolts\t\tmm\tmA", "X_Value\tP\tU\tL\tI"),
            ("Multi", "\tVolts\t\tmm\tmA", "X_Value\tP\tX_Value\tU\tX_Value\tL\tX_Value\tI"),
            ("Multi", "\tVolts\t\t\t\tmm\t\tmA\t", "X_Value\tP\tX_Value\tU\tX_Value\tL\tX_Value\tI"),
        ],
    )
    def test_a_labview_channel_without_a_unit_leaves_the_units_of_the_others(
        self, layout: str, tag: str, names: str, tmp_path: Path
    ) -> None:
        head = (
            f"LabVIEW Measurement\nSeparator\tTab\nX_Columns\t{layout}\n***End_of_Header***\n"
            f"Y_Unit_Label{tag}\nX_Dimension\tTime\t\tTime\n***End_of_Header***\n{names}\n"
        )
        one, two = ("0\t1\t0\t0\t0\t2\t0\t3", "1\t1\t1\t0\t1\t2\t1\t3") if layout == "Multi" else ("0\t1\t0\t2\t3",) * 2
        path = text(tmp_path, f"{head}{one}\n{two}\n", "a.lvm")
        channels = {"voltage": VOLTAGE, "displacement": {"column": "L"}, "current": {"column": "I"}}
        run = read(path, file={"format": "lvm"}, channels=channels)
        np.testing.assert_array_equal(run.displacement, [0.002, 0.002])
        np.testing.assert_array_equal(run.current, [0.003, 0.003])
        channels["voltage"] = {"column": "U"}
        with pytest.raises(InputError, match=r"voltage\.unit: no unit"):
            read(path, file={"format": "lvm"}, channels=channels)

    def test_a_labview_file_says_itself_how_it_is_written(self, tmp_path: Path) -> None:
        head = (
            "LabVIEW Measurement\nSeparator,Comma\nX_Columns,One\n***End_of_Header***\nSamples,2,3\n"
            "Y_Unit_Label,V,mA\nX_Dimension,Time,Time\n***End_of_Header***\nX_Value,U,I\n"
        )
        channels = {"time": {"column": 0, "unit": "s"}, "voltage": {"column": "U"}, "current": {"column": "I"}}
        path = text(tmp_path, head + "0,0,1\n0.5,1,2\n1,1,3\n", "a.lvm")
        run = read(path, file={"format": "lvm"}, period=None, channels=channels)
        np.testing.assert_array_equal(run.current, [0.001, 0.002, 0.003])
        for content, message in (
            (head + "0,0,1\n0.5,1,2\n", "2 rows, the header promises 3"),  # as many as its longest channel has
            (head.replace("Time,Time", "Time,Frequency") + "0,0,1\n0.5,1,2\n1,1,3\n", "not Time"),
        ):
            with pytest.raises(InputError, match=message):
                read(text(tmp_path, content, "a.lvm"), file={"format": "lvm"}, period=None, channels=channels)

    def test_one_column_is_not_two_channels(self, tmp_path: Path) -> None:
        with pytest.raises(
            InputError, match=r"channels\.current\.column: column 0 of .* is mapped to voltage too; name the column"
        ):
            read(text(tmp_path, "U,I\n0,1\n1,2\n"), channels={"voltage": VOLTAGE, "current": {**CURRENT, "column": 0}})

    def test_a_reading_without_a_row_number_has_no_row(self, tmp_path: Path) -> None:
        current = {**CURRENT, "index": "n", "sentinels": [-9.0]}
        path = text(tmp_path, "U,n,I\n0,0,7\n1,1,8\n1,,-9\n1,,NaN\n")
        run = read(path, channels={"voltage": VOLTAGE, "current": current})
        np.testing.assert_array_equal(run.current, [7, 8, np.nan, np.nan])
        none = read(text(tmp_path, "U,n,I\n0,,\n1,,NaN\n"), channels={"voltage": VOLTAGE, "current": current}).current
        np.testing.assert_array_equal(none, [np.nan, np.nan])  # type: ignore[arg-type]
        with pytest.raises(InputError, match="line 2: -1 in the index column 'n' of current is not a row number"):
            read(text(tmp_path, "U,n,I\n0,-1,1\n1,0,2\n"), channels={"voltage": VOLTAGE, "current": current})
        path = text(tmp_path, "U,n,I\n0,0,7\n1,1,8\n1,,NaN\n1,,9\n")
        with pytest.raises(InputError, match="line 5: 1 readings of current have no row number; name the column"):
            read(path, channels={"voltage": VOLTAGE, "current": current})


class TestZeroAtRest:
    @pytest.mark.parametrize(
        ("voltage", "rows", "change"),
        [
            (["0", "0", "0.09", "0.09", "2"], [0, 4], 2),  # what comes after the rows that are taken does not count
            (["0", "0", "0.09", "0.09", "2"], [0, 5], None),
            (["", "0", "1", "1", "1"], [1, 5], 2),  # a gap before them does not hide the change
            (["0", "0", "0", "1", "1"], [0, 5], None),
            (["0", "0", "0.01", "0.01", "0.01"], [0, 5], None),
            (["0", "0", "-0.011", "0", "0"], [0, 5], 2),
            (["0", "0", "0"], [0, 3], None),
            (["0", "0", "0.051", "1", "1"], [0, 5], 2),
            (["0", "0", "0.05", "1", "1"], [0, 5], None),  # up to a twentieth of the largest change is noise
        ],
    )
    def test_the_voltage_of_the_rows_that_are_taken(
        self, voltage: list[str], rows: list[int], change: int | None, tmp_path: Path
    ) -> None:
        path = text(tmp_path, "U,I\n" + "".join(f"{u},{k}\n" for k, u in enumerate(voltage)))
        channels = {"voltage": VOLTAGE, "current": {**CURRENT, "zero_rows": [0, 3]}}
        if change is None:
            assert read(path, rows=rows, channels=channels).current[0] == rows[0] - 1.0  # type: ignore[index]
            return
        with pytest.raises(InputError, match=f"the voltage changes at row {change}"):
            read(path, rows=rows, channels=channels)

    def test_a_zero_before_the_rows_that_are_taken_is_at_rest_too(self, tmp_path: Path) -> None:
        path = text(tmp_path, "U,I\n0,0\n1,1\n1,2\n1,3\n1,4\n")
        channels = {"voltage": VOLTAGE, "current": {**CURRENT, "zero_rows": [0, 2]}}
        with pytest.raises(InputError, match="the voltage changes at row 1"):
            read(path, rows=[3, 5], channels=channels)


class TestScaling:
    def test_points_that_lose_the_reading(self, tmp_path: Path) -> None:
        voltage = {**VOLTAGE, "points": [[0.0, 1.0], [10.0, 1.0]]}
        with pytest.raises(InputError, match=r"voltage\.points: a factor of 0 loses the reading; give two different"):
            read(tmp_path / "no.csv", channels={"voltage": voltage})

    def test_the_source_resistance_has_bounds(self, tmp_path: Path) -> None:
        path = text(tmp_path, "U\n0\n1\n")
        run = read(path, channels={"voltage": VOLTAGE}, metadata={"source_resistance": "50 mohm"})
        assert run.metadata.source_resistance == 0.05
        with pytest.raises(InputError, match=r"source_resistance: '2 Mohm' is outside 0 to 1e\+06 ohm"):
            read(path, channels={"voltage": VOLTAGE}, metadata={"source_resistance": "2 Mohm"})

    def test_numbers_of_a_workbook_that_are_texts_with_a_comma(self, tmp_path: Path) -> None:
        path, book = tmp_path / "record.xlsx", openpyxl.Workbook()
        assert book.active is not None
        for row in (["U", "I"], ["0,5", 1.5], [None, None], ["-2,5e-1", 2]):
            book.active.append(row)
        book.save(path)
        channels = {"voltage": {**VOLTAGE, "column": "I"}, "current": {**CURRENT, "column": "U"}}
        with pytest.raises(InputError, match=r"cell A2: '0,5' .*; write decimal = \",\" under \[file\]"):
            read(path, file={"format": "xlsx"}, channels=channels)
        file = {"format": "xlsx", "decimal": ","}
        with pytest.raises(InputError, match=r"sample 1 \(and 0 more\) is NaN"):
            read(path, file=file, channels=channels)  # a blank row is one of missing readings
        book.active["B3"] = 1
        book.save(path)
        np.testing.assert_array_equal(read(path, file=file, channels=channels).current, [0.5, np.nan, -0.25])

    def test_row_times_are_the_decimals_that_people_write(self, tmp_path: Path) -> None:
        path = text(tmp_path, "U\n0\n1\n1\n1\n")
        for period, times in (("40 ms", [0, 0.04, 0.08, 0.12]), ("0.3 s", [0, 0.3, 0.6, 3 * 0.3])):
            assert read(path, period=period, channels={"voltage": VOLTAGE}).time.tolist() == times

    def test_true_is_no_number(self, tmp_path: Path) -> None:
        path, book = tmp_path / "record.xlsx", openpyxl.Workbook()
        assert book.active is not None
        for row in (["U"], [0], [True]):
            book.active.append(row)
        book.save(path)
        with pytest.raises(InputError, match="cell A3: True in column 'U' is not a number"):
            read(path, file={"format": "xlsx"}, channels={"voltage": VOLTAGE})

    def test_a_date_and_a_time_of_day_in_cells_of_their_own(self, tmp_path: Path) -> None:
        path, book = tmp_path / "record.xlsx", openpyxl.Workbook()
        assert book.active is not None
        day = datetime.date(2026, 3, 3)
        for row in (["D", "T", "U"], [day, datetime.time(9), 0], [day, datetime.time(9, 0, 2), 1]):
            book.active.append(row)
        book.save(path)
        time = {"column": "T", "date_column": "D", "dates": "year-month-day"}
        table = {"file": {"format": "xlsx"}, "channels": {"time": time, "voltage": VOLTAGE}}
        np.testing.assert_array_equal(import_run(path, ImportMap.from_table(table)).time, [0, 2])


SHEET = (
    '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><dimension ref="A1"/><sheetData>'
    '<row r="1"><c r="A1" t="inlineStr"><is><t>U</t></is></c><c r="B1" t="inlineStr"><is><t>I</t></is></c></row>'
    '<row r="2"><c r="A2"><v>1</v></c></row><row r="3"><c r="A3"><f>A2+1</f><v>2</v></c><c r="B3"><v>6</v></c></row>'
    '<row r="5"><c r="B5"><v>7</v></c><c r="C5"><v>8</v></c></row><row r="6"/></sheetData></worksheet>'
)


def test_cells_of_a_workbook_stand_where_they_say(tmp_path: Path) -> None:
    """Its size is wrong, a formula has its value, a row and cells are left out."""
    path = tmp_path / "record.xlsx"
    openpyxl.Workbook().save(path)
    with zipfile.ZipFile(path) as book:
        parts = {name: book.read(name) for name in book.namelist()}
    with zipfile.ZipFile(path, "w") as book:
        for name, part in parts.items():
            book.writestr(name, SHEET if name.endswith("sheet1.xml") else part)
    columns = xlsx.read(path, xlsx.XlsxFile(format="xlsx"))
    assert columns.names == ("U", "I", "")
    assert columns.cells == ((1, 2, None, None), (None, 6, None, 7), (None, None, None, 8))
    assert columns.place(3, 2) == "sheet 'Sheet', cell C5"


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_vectors_of_a_matlab_file(version: str, tmp_path: Path) -> None:
    """Columns of a square matrix; numbers of all classes, and nothing else."""
    path = tmp_path / "record.mat"
    square = np.array([[0.0, 3.0], [1.0, 4.0]])
    kinds = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
    numbers = {"double": np.float64, "single": np.float32} | {kind: np.dtype(kind) for kind in kinds}
    if version == "5":
        table = {name: np.array([1, 2], kind) for name, kind in numbers.items()}
        scipy.io.savemat(path, table | {"m": square, "text": "ab", "scalar": 1.0, "many": [{"a": 1}, {"a": 2}]})
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, kind in (numbers | {"logical": np.uint8, "char": np.uint16}).items():
                file[name] = np.array([[1, 2]], kind)
                file[name].attrs["MATLAB_class"] = np.bytes_(name)
            file["m"] = square.T
            file["empty"] = np.array([0, 0], np.uint64)
            file["empty"].attrs["MATLAB_empty"] = 1
            file["#refs#/a"] = square
            for name in ("m", "empty", "#refs#/a"):
                file[name].attrs["MATLAB_class"] = np.bytes_("double")
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    columns = mat.read(path, mat.MatFile(format="mat"))
    assert set(columns.names) == {*numbers, "m[0]", "m[1]"} | ({"logical"} if version == "7.3" else set())
    found = {name: columns.numbers(k).tolist() for k, name in enumerate(columns.names)}
    assert (found.pop("m[0]"), found.pop("m[1]")) == ([0, 1], [3, 4])
    assert all(values == [1, 2] for values in found.values())


def test_a_waveform_may_begin_later_than_its_stamp(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as writer:
        about = {"wf_increment": 0.5, "wf_start_offset": 2.5}
        writer.write_segment([nptdms.ChannelObject("r", "U", np.array([0.0, 1.0]), about)])
    run = read(path, file={"format": "tdms"}, period=None, channels={"voltage": {**VOLTAGE, "column": "r/U"}})
    np.testing.assert_array_equal(run.time, [2.5, 3.0])


def test_a_cell_of_a_workbook_is_named_below_what_stands_before_it(tmp_path: Path) -> None:
    path, book = tmp_path / "record.xlsx", openpyxl.Workbook()
    assert book.active is not None
    for row in (["Lab 3"], ["strip 7"], ["U", "n", "I"], ["[V]", None, "(mA)"], ["up"], [0, 0, 1.0], [1, 1, "x"]):
        book.active.append(row)
    book.save(path)
    file = {"format": "xlsx", "skip_lines": 2, "units_row": True, "skip_rows": 1}
    channels = {"voltage": {"column": "U"}, "current": {"column": "I"}}
    with pytest.raises(InputError, match="cell C7: 'x' in column 'I'"):
        read(path, file=file, channels=channels)
    book.active["C7"] = 2.0
    book.save(path)
    np.testing.assert_array_equal(read(path, file=file, channels=channels).current, [0.001, 0.002])
    with pytest.raises(InputError, match="no rows of numbers in sheet 'Sheet'"):
        read(path, file={**file, "skip_lines": 7}, channels=channels)
