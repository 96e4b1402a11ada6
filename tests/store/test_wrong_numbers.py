"""Records that would be read as other numbers than were measured: each is refused, or read right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nptdms
import numpy as np
import openpyxl
import pytest
import scipy.io

from ipmclab.errors import InputError
from ipmclab.run import QUALITY_FLAGS, Run
from ipmclab.store.import_map import ImportMap
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
        "content", ["U,I\n0,1\n1,2\n,\n,,\n", ",\nU,I\n,\n0,1\n1,2\n", "U,I\n\n0,1\n\n  \n1,2\n", "U,I,\n0,1,\n1,2,\n"]
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
