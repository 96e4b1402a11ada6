"""Awkward records of a known truth: each guess is right, or it is asked."""

from __future__ import annotations

import datetime
import gzip
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import nptdms
import numpy as np
import openpyxl
import pytest
import scipy.io

from ipmclab.errors import InputError
from ipmclab.run import Run
from ipmclab.store.guess import guess_map
from ipmclab.store.importing import import_run

N = 60
STEP = 0.02  # s
TIME = STEP * np.arange(N)
VOLTAGE = np.where(np.arange(N) < 10, 0.0, 1.25)
CURRENT = np.where(np.arange(N) < 10, 0.0003, 0.0125 * np.exp(-np.arange(N) / 25.0) + 0.0021)
DISPLACEMENT = 1e-3 * (8.9 + 0.31 * np.sin(np.arange(N) / 9.0))
START = datetime.datetime(2026, 3, 5, 23, 59, 59, 500_000)  # the record goes over midnight

NUMBERS = {"time": TIME, "voltage": VOLTAGE, "current": CURRENT, "displacement": DISPLACEMENT}


def plain(value: float, scale: float = 1.0) -> str:
    return f"{value * scale:.6f}"


def stamps(write: Callable[[datetime.datetime], str], start: datetime.datetime = START) -> list[str]:
    return [write(start + datetime.timedelta(microseconds=20_000 * k)) for k in range(N)]


MONTHS = ("Jan", "Feb", "Mär", "Apr", "Mai", "Jun", "Jul", "Aug", "Sep", "Okt", "Nov", "Dez")


@dataclass
class Style:
    """How a record is written."""

    names: Sequence[str] = ("time (s)", "voltage (V)", "current (mA)", "laser (mm)")
    separator: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    before: str = ""
    units: Sequence[str] = ()
    between: str = ""
    end: str = "\n"
    trailing: str = ""
    times: Sequence[str] | None = None
    scales: Sequence[float] = (1.0, 1.0, 1e3, 1e3)
    write: Callable[[float, float], str] = plain
    spoil: Callable[[list[list[str]]], list[list[str]]] = lambda rows: rows
    answers: dict[str, str] = field(default_factory=dict)
    ending: str = ".csv"

    def rows(self) -> list[list[str]]:
        columns = [[self.write(v, s) for v in values] for values, s in zip(NUMBERS.values(), self.scales, strict=True)]
        columns = [[text.replace(".", self.decimal) for text in column] for column in columns]
        if self.times is not None:
            columns[0] = list(self.times)
        return self.spoil([list(row) for row in zip(*columns, strict=True)])

    def text(self) -> str:
        lines = [self.separator.join(row) + self.trailing for row in (self.names, self.units) if row]
        lines += [self.between] if self.between else []
        lines += [self.separator.join(row) + self.trailing for row in self.rows()]
        return self.before + self.end.join(lines) + self.end

    def save(self, folder: Path) -> Path:
        path = folder / f"record{self.ending}"
        content = self.text().encode(self.encoding)
        path.write_bytes(gzip.compress(content) if self.ending.endswith(".gz") else content)
        return path


def insert_column(cells: str | Sequence[str], at: int) -> Callable[[list[list[str]]], list[list[str]]]:
    given = [cells] * N if isinstance(cells, str) else list(cells)
    return lambda rows: [[*row[:at], cell, *row[at:]] for row, cell in zip(rows, given, strict=True)]


def lose(value: str) -> Callable[[list[list[str]]], list[list[str]]]:
    return lambda rows: [[*row[:3], value] if k in (30, 31, 40) else row for k, row in enumerate(rows)]


GERMAN = ("Zeit [s]", "Spannung [V]", "Strom [mA]", "Weg [mm]")
SPACED = "  "

STYLES: dict[str, Style] = {
    "plain": Style(),
    "semicolons": Style(separator=";"),
    "semicolons and commas": Style(GERMAN, ";", ","),
    "tabs": Style(separator="\t"),
    "tabs and commas": Style(GERMAN, "\t", ","),
    "bars": Style(separator="|"),
    "blanks": Style(("t_s", "U_V", "I_mA", "laser_mm"), "  "),
    "blanks with headings of two words": Style(separator="   "),
    "blanks and commas": Style(("t_s", "U_V", "I_mA", "laser_mm"), " ", ","),
    "quoted decimal commas": Style(decimal=",", write=lambda v, s: f'"{v * s:.6f}"'),
    "windows line ends": Style(end="\r\n"),
    "old mac line ends": Style(end="\r"),
    "separator at the end of each line": Style(separator=";", trailing=";"),
    "separator at the end of each row alone": Style(separator=",", spoil=lambda rows: [[*row, ""] for row in rows]),
    "byte order mark": Style(encoding="utf-8-sig"),
    "utf-16": Style(("t / ms", "U / V", "I / µA", "s / mm"), "\t", scales=(1e3, 1, 1e6, 1e3), encoding="utf-16"),
    "cp1252": Style(
        ("Zeit (ms)", "Spannung (V)", "Strom (µA)", "Weg (mm)"), ";", ",", "cp1252", scales=(1e3, 1, 1e6, 1e3)
    ),
    "cp1252 in words": Style(("temps (s)", "tension (V)", "courant (mA)", "déplacement (mm)"), ";", ",", "cp1252"),
    "cp1250": Style(("Czas (s)", "Napięcie (V)", "Prąd (mA)", "Ugięcie (mm)"), ";", ",", "cp1250"),
    "czech": Style(("Čas (s)", "Napětí (V)", "Proud (mA)", "Výchylka (mm)"), ";", ",", "cp1250"),
    "cp850": Style(
        ("Zeit (ms)", "Spannung (V)", "Strom (µA)", "Weg (mm)"), ";", ",", "cp850", scales=(1e3, 1, 1e6, 1e3)
    ),
    "gbk": Style(("时间 (s)", "电压 (V)", "电流 (mA)", "位移 (mm)"), encoding="gbk"),
    "shift_jis": Style(("時間 (s)", "電圧 (V)", "電流 (mA)", "変位 (mm)"), encoding="shift_jis"),
    "gzip": Style(ending=".csv.gz"),
    "text ending": Style(ending=".txt", separator="\t"),
    "units row": Style(("time", "voltage", "current", "laser"), units=("s", "V", "mA", "mm")),
    "units row in brackets": Style(("t", "U", "I", "x"), ";", ",", units=("[s]", "[V]", "[mA]", "[mm]")),
    # V is the symbol of the voltage, too.
    "units alone": Style(("s", "V", "mA", "mm"), answers={"channels.voltage.unit": "V"}),
    "units in words": Style(("Time (sec)", "Voltage (Volts)", "Current (milliamps)", "Laser (millimeters)")),
    "capital units": Style(("TIME (S)", "VOLTAGE (V)", "CURRENT (MA)", "LASER (MM)")),
    "units behind underscores": Style(("time_s", "voltage_V", "current_mA", "laser_mm")),
    "units behind slashes": Style(("t/s", "U/V", "I/mA", "x/mm")),
    "units in other sizes": Style(
        ("t [min]", "U [mV]", "I [A]", "x [um]"), scales=(1 / 60, 1e3, 1, 1e6), write=lambda v, s: repr(float(v * s))
    ),
    "numbers with powers": Style(write=lambda v, s: f"{v * s:.7E}"),
    "preamble": Style(before="Logger 3\nOperator: M. Weiß; strip 7\n\nDate, 5.3.2026\n\n"),
    "preamble with an open quote": Style(before='made by "X\n\n'),
    "preamble of many lines": Style(before="".join(f"setting {k}: {k / 7:.3f}\n" for k in range(45))),
    "comments": Style(before="# a rig\n# of two lines\n"),
    "heading in a comment": Style(("# time (s)", "voltage (V)", "current (mA)", "laser (mm)")),
    "comments among the rows": Style(spoil=lambda rows: [*rows[:30], ["# a note"], *rows[30:]]),
    "groups above the headings": Style(before="clock,amplifier,shunt,sensor\n"),
    "row below the units": Style(
        ("time", "voltage", "current", "laser"), units=("s", "V", "mA", "mm"), between="raw,raw,raw,raw"
    ),
    "column of words": Style(
        ("time (s)", "voltage (V)", "current (mA)", "laser (mm)", "state"), spoil=insert_column("ok", 4)
    ),
    "column of rows": Style(
        ("No.", "time (s)", "voltage (V)", "current (mA)", "laser (mm)"),
        spoil=insert_column([str(k) for k in range(N)], 0),
    ),
    "the time beside each channel": Style(
        ("time (s)", "voltage (V)", "time (s)", "current (mA)", "laser (mm)"),
        spoil=insert_column([f"{t:.3f}" for t in TIME], 2),
    ),
    "commanded and read": Style(
        ("time (s)", "U set (V)", "U (V)", "current (mA)", "laser (mm)"), spoil=insert_column("1.5", 1)
    ),
    "power beside": Style(
        ("time (s)", "voltage (V)", "current (mA)", "laser (mm)", "power (mW)"), spoil=insert_column("0.1", 4)
    ),
    "extension": Style(("time (s)", "voltage (V)", "current (mA)", "deflection (mm)")),
    "channel by its unit alone": Style(("time (s)", "ai0 (V)", "ai1 (mA)", "ai2 (mm)")),
    "nines": Style(spoil=lose("-99.9999")),
    "large nines": Style(spoil=lose("9999")),
    "overrange of Keithley": Style(spoil=lose("9.91E+37")),
    "blank readings": Style(spoil=lose("")),
    "words for no reading": Style(spoil=lose("#N/A")),
    "infinite readings": Style(spoil=lose("Inf")),
    "overrange of a meter": Style(spoil=lose("OVLD")),
    "overrange of a hand-held meter": Style(spoil=lose("O.L")),
    "dashes for no reading": Style(spoil=lose("---")),
    "dashes below the headings": Style(between="---,---,---,---"),
    "iso dates": Style(times=stamps(lambda t: t.isoformat(" ")), names=("timestamp", *Style.names[1:])),
    "iso dates with zone": Style(times=stamps(lambda t: t.isoformat() + "+01:00"), names=("time", *Style.names[1:])),
    "german dates": Style(("Datum", *GERMAN[1:]), ";", ",", times=stamps(lambda t: t.strftime("%d.%m.%Y %H:%M:%S,%f"))),
    "american dates": Style(
        ("Date", *Style.names[1:]),
        times=stamps(lambda t: t.strftime("%m/%d/%Y %I:%M:%S.%f ") + ("AM", "PM")[t.hour > 11]),
    ),
    "british dates": Style(("Date", *Style.names[1:]), times=stamps(lambda t: t.strftime("%d/%m/%Y %H:%M:%S.%f"))),
    "month names": Style(
        ("time", *Style.names[1:]),
        times=stamps(lambda t: f"{t.day:02d}-{('Jan', 'Feb', 'Mar')[t.month - 1]}-{t:%Y %H:%M:%S.%f}"),
    ),
    "german month names": Style(
        ("Zeit", *GERMAN[1:]), ";", ",", times=stamps(lambda t: f"{t.day}. {MONTHS[t.month - 1]} {t:%Y %H:%M:%S,%f}")
    ),
    "chinese dates": Style(
        ("日期", "电压 (V)", "电流 (mA)", "位移 (mm)"),
        times=stamps(lambda t: f"{t.year}年{t.month}月{t.day}日 {t:%H:%M:%S.%f}"),
    ),
    "compact dates": Style(("time", *Style.names[1:]), times=stamps(lambda t: t.strftime("%Y%m%d %H%M%S.%f"))),
    "time of day": Style(("time", *Style.names[1:]), times=stamps(lambda t: t.strftime("%H:%M:%S.%f"))),
    "date and time of day apart": Style(
        ("Date", "Time", *Style.names[1:]),
        times=stamps(lambda t: t.strftime("%H:%M:%S.%f")),
        spoil=insert_column(stamps(lambda t: t.strftime("%Y-%m-%d")), 0),
    ),
    "days of excel": Style(("date", *Style.names[1:]), times=[f"{46_086.9 + t / 86_400:.12f}" for t in TIME]),
    "seconds since 1970": Style(("time", *Style.names[1:]), times=[f"{1_772_755_199.5 + t:.3f}" for t in TIME]),
    "milliseconds since 1970": Style(
        ("time", *Style.names[1:]), times=[f"{1_772_755_199_500 + 1000 * t:.0f}" for t in TIME]
    ),
    "a time twice": Style(spoil=lambda rows: [*rows[:20], [rows[19][0], *rows[20][1:]], *rows[20:]]),
    # What nobody can know from the file is asked.
    "no units": Style(
        ("t", "U", "I", "laser"),
        answers={
            "channels.time.unit": "s",
            "channels.voltage.unit": "V",
            "channels.current.unit": "mA",
            "channels.displacement.unit": "mm",
        },
    ),
    "no time": Style(
        ("volts (V)", "current (mA)", "laser (mm)"),
        spoil=lambda rows: [row[1:] for row in rows],
        answers={"sampling_period": "20 ms"},
    ),
    "two voltages": Style(
        ("time (s)", "U1 (V)", "U2 (V)", "current (mA)", "laser (mm)"),
        spoil=insert_column("0.7", 1),
        answers={"channels.voltage.column": "U2 (V)"},
    ),
    "no names": Style(
        (),
        answers={
            "channels.time.column": "0",
            "channels.time.unit": "s",
            "channels.voltage.column": "1",
            "channels.voltage.unit": "V",
            "channels.current.column": "2",
            "channels.current.unit": "mA",
            "channels.displacement.column": "3",
            "channels.displacement.unit": "mm",
            "channels.force.column": "none",
            "channels.temperature.column": "none",
            "channels.relative_humidity.column": "none",
            "channels.chamber_temperature.column": "none",
            "channels.chamber_relative_humidity.column": "none",
        },
    ),
    "sensor in volts": Style(
        ("time (s)", "voltage (V)", "current (mA)", "laser (V)"),
        scales=(1, 1, 1e3, 400),
        answers={"channels.displacement.factor": "2.5"},
    ),
    "a number that may mean nothing": Style(spoil=lose("-1000"), answers={"channels.displacement.sentinels": "yes"}),
    "clock of whole seconds": Style(
        ("time", *Style.names[1:]),
        times=stamps(lambda t: t.strftime("%Y-%m-%d %H:%M:%S")),
        answers={"sampling_period": "20 ms"},
    ),
}

LOST = {name for name, style in STYLES.items() if style.spoil.__qualname__.startswith("lose")}


@pytest.mark.parametrize("name", STYLES)
def test_each_guess_is_right_or_asked(name: str, tmp_path: Path) -> None:
    style = STYLES[name]
    path = style.save(tmp_path)
    answers: dict[str, str] = {}
    guess = guess_map(path)
    while guess.questions:
        for question in guess.questions:
            assert question.key in style.answers, f"{question.key} is asked: {question.text}; took {guess.taken}"
            answers[question.key] = style.answers[question.key]
        guess = guess_map(path, answers)
    assert answers == style.answers  # nothing that cannot be known was taken
    assert_is_the_truth(import_run(path, guess.map), lost=name in LOST)


def assert_is_the_truth(run: Run, *, lost: bool = False) -> None:
    np.testing.assert_allclose(run.time - run.time[0], TIME, atol=2e-6)
    np.testing.assert_allclose(run.voltage, VOLTAGE, atol=2e-6)
    assert run.current is not None
    assert run.displacement is not None
    np.testing.assert_allclose(run.current, CURRENT, atol=2e-8)
    there = ~np.isnan(run.displacement)
    assert list(np.flatnonzero(~there)) == ([30, 31, 40] if lost else [])
    np.testing.assert_allclose(run.displacement[there], DISPLACEMENT[there], atol=2e-8)


def workbook(path: Path, rows: list[list[Any]], *, before: int = 0) -> Path:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for row in [[None]] * before + rows:
        sheet.append(row)
    book.save(path)
    return path


def numbers(heading: Sequence[str], times: Sequence[Any] = tuple(TIME)) -> list[list[Any]]:
    body = [
        [t, float(u), float(1e3 * i), float(1e3 * x)]
        for t, u, i, x in zip(times, VOLTAGE, CURRENT, DISPLACEMENT, strict=True)
    ]
    return [list(heading), *body]


def test_workbooks(tmp_path: Path) -> None:
    heading = ("Time", *Style.names[1:])
    dates = [START + datetime.timedelta(milliseconds=20 * k) for k in range(N)]
    for name, rows, before in (
        ("seconds.xlsx", numbers(Style.names), 0),
        ("dates.xlsx", numbers(heading, dates), 3),
        ("units.xlsx", [["t", "U", "I", "x"], ["s", "V", "mA", "mm"], *numbers(())[1:]], 0),
    ):
        path = workbook(tmp_path / name, rows, before=before)
        assert_is_the_truth(import_run(path, guess_map(path).map))


def test_matlab_and_labview_files(tmp_path: Path) -> None:
    scipy.io.savemat(
        tmp_path / "record.mat",
        {"t_s": TIME, "U_V": VOLTAGE, "I_mA": 1e3 * CURRENT, "x_mm": 1e3 * DISPLACEMENT, "rate": 50.0},
    )
    with nptdms.TdmsWriter(tmp_path / "record.tdms") as writer:
        for name, unit, values in (("U", "V", VOLTAGE), ("I", "A", CURRENT), ("laser", "m", DISPLACEMENT)):
            writer.write_segment(
                [nptdms.ChannelObject("log", name, values, {"unit_string": unit, "wf_increment": STEP})]
            )
    for name in ("record.mat", "record.tdms"):
        assert_is_the_truth(import_run(tmp_path / name, guess_map(tmp_path / name).map))


def test_a_mark_that_may_stand_for_thousands_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_text("t [ms];U [mV];x [um]\n" + "".join(f"{k};{k % 7};{k + 1},{k + 200}\n" for k in range(40)))
    (question,) = guess_map(path).questions
    assert question.key == "file.decimal"
    assert import_run(path, guess_map(path, {"file.decimal": ","}).map).displacement[3] == pytest.approx(4.203e-6)  # type: ignore[index]
    with pytest.raises(InputError, match=r"in column .x \[um\]. is not a number; write decimal = "):
        import_run(path, guess_map(path, {"file.decimal": "."}).map)


@pytest.mark.parametrize(
    ("cell", "row", "told"),
    [
        ("0.100000", 20, "do not rise at line 22"),
        ("", 20, "are missing at line 22"),
        ("", 0, "are missing at line 2"),
    ],
)
def test_times_that_go_back_or_are_missing_are_told_with_their_line(
    cell: str, row: int, told: str, tmp_path: Path
) -> None:
    path = Style(spoil=lambda rows: [*rows[:row], [cell, *rows[row][1:]], *rows[row + 1 :]]).save(tmp_path)
    (question,) = guess_map(path).questions
    assert question.key == "sampling_period"
    assert question.text.startswith(f"the times in 'time (s)' {told}: what is the time between")


def test_of_a_table_with_one_row_the_period_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "one.csv"
    path.write_text("time (s),voltage (V),current (A)\n0.0,1.0,0.1\n", encoding="utf-8")
    assert [question.key for question in guess_map(path).questions] == ["sampling_period"]


def test_times_that_come_twice_are_told_with_their_line(tmp_path: Path) -> None:
    path = STYLES["a time twice"].save(tmp_path)
    guess = guess_map(path)
    assert "left out: rows with the time of the row before (1, first at line 22)" in guess.taken
    del guess.table["channels"]["time"]["duplicates"]
    with pytest.raises(InputError, match=r'record\.csv: line 22: .* is that of the row before .* duplicates = "drop"'):
        import_run(path, guess.map)


def test_the_map_says_what_was_taken_and_what_is_not_known(tmp_path: Path) -> None:
    path = STYLES["no time"].save(tmp_path)
    text = guess_map(path).as_toml("record.csv")
    assert "# current: column 'current (mA)', mA" in text
    assert "# sampling_period is not known" in text
    whole = tmp_path / "map.toml"
    whole.write_text('sampling_period = "20 ms"\n' + text)
    assert_is_the_truth(import_run(path, whole))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"nothing\nbut words\n", "no table of numbers"),
        (bytes(range(256)) * 4, "this is no text"),
        (b"\x89HDF\r\n\x1a\n" + bytes(40), "this is an HDF5 file"),
        (b"pressure (Pa),density (kg/m3)\n1,2\n3,4\n", "no column that can be the voltage"),
    ],
)
def test_what_is_no_record_is_refused(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        guess_map(path)


@pytest.mark.skipif("IPMCLAB_REAL_RUNS" not in os.environ, reason="IPMCLAB_REAL_RUNS is not set")
class TestRealRuns:
    """The maps that were written by hand say what is in the records; the twins above have the same faults."""

    FOLDER = Path(os.environ.get("IPMCLAB_REAL_RUNS", "."))
    MAPS = Path(__file__).parents[2] / "docs" / "import_maps"

    @pytest.mark.parametrize("name", ["step_1V", "step_2V", "step_2V_poor", "step_3V", "platform_export_1V"])
    def test_only_what_the_file_lacks_is_asked(self, name: str) -> None:
        path = next(self.FOLDER.glob(f"{name}.*"))
        units = {"voltage": "V", "current": "A", "displacement": "mm", "force": "N"}
        answers = {"sampling_period": "40 ms"}
        if path.suffix == ".xlsx":  # its headings have no units
            answers |= {f"channels.{channel}.unit": unit for channel, unit in units.items()}
        assert {question.key for question in guess_map(path).questions} == set(answers)
        # The workbook is the table of step_1V (test_real_records.py), which is read in a fifth of the time.
        twin = "step_1V" if path.suffix == ".xlsx" else name
        known = import_run(self.FOLDER / f"{twin}.csv.gz", self.MAPS / f"{twin}.toml")
        run = import_run(path, guess_map(path, answers).map)
        assert run.displacement is not None
        assert known.displacement is not None
        np.testing.assert_array_equal(run.voltage, known.voltage)
        np.testing.assert_array_equal(run.current, known.current)
        np.testing.assert_array_equal(np.isnan(run.displacement), np.isnan(known.displacement))


@pytest.mark.parametrize(
    ("unit", "readings"),
    [("K", (293.15, 298.15)), ("Kelvin", (293.15, 298.15)), ("°F", (68.0, 77.0)), ("degF", (68.0, 77.0))],
)
def test_degrees_of_other_scales_have_another_zero(tmp_path: Path, unit: str, readings: tuple[float, float]) -> None:
    """How many degC 1 K is was asked, and the answer 1 made 293 degC of 20."""
    file = tmp_path / "warm.csv"
    file.write_text(f"time (s),voltage (V),temperature ({unit})\n0,0,{readings[0]}\n0.02,1,{readings[1]}\n", "utf-8")
    guess = guess_map(file)
    assert not guess.questions
    assert f"temperature: column 'temperature ({unit})', {unit}" in guess.taken
    assert import_run(file, guess.map).temperature == pytest.approx([20.0, 25.0])


def test_an_empty_column_is_no_voltage_and_neither_is_the_time(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    rows = [f"{t},{u},,{i}" for t, u, i in zip(TIME, VOLTAGE, CURRENT, strict=True)]
    path.write_text("\n".join(["time (s),first,second,third", *rows]))
    asked = {question.key: question for question in guess_map(path).questions}
    assert asked["channels.voltage.column"].choices == ("first", "third")


def test_what_is_the_time_is_nothing_else(tmp_path: Path) -> None:
    path = STYLES["no names"].save(tmp_path)
    asked = {question.key: question for question in guess_map(path, {"channels.time.column": "0"}).questions}
    assert asked["channels.voltage.column"].choices == ("1", "2", "3")
