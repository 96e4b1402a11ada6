"""A foreign record becomes an import map: what can be found is taken and said, what cannot be known is asked."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter

from ipmclab.errors import InputError
from ipmclab.run import FloatArray
from ipmclab.store.guess.headings import Heading, channels_of, read_heading
from ipmclab.store.guess.layout import sheet_layout, text_layout
from ipmclab.store.guess.readings import Readings, find_dates, find_sentinels
from ipmclab.store.import_map import MAPPED, ImportMap
from ipmclab.store.importers import File, format_of_start, read_columns
from ipmclab.store.importers.columns import Columns
from ipmclab.store.importers.xlsx import XlsxFile, columns_of, read_sheets
from ipmclab.store.importing import check_source

NONE: Final = "none"
"""The answer to a question about a column that the record lacks."""

_ASKED_CHANNELS: Final = tuple(name for name in MAPPED if name not in ("time", "applied_voltage"))
_FEW_DUPLICATES: Final = 0.05  # of the rows: more is a clock that is coarser than the rows
_DAYS: Final = (
    (20_000.0, 80_000.0),
    (690_000.0, 800_000.0),
)  # since 1900, as Excel counts, and since 0, as MATLAB does
_SINCE: Final = {"s": ((1e9, 4.5e9),), "ms": ((1e12, 4.5e12),)}  # since 1970 or 1904
_KELVIN: Final = (1.0, -273.15)
_FAHRENHEIT: Final = (5.0 / 9.0, -160.0 / 9.0)
_DEGREES: Final = {
    **dict.fromkeys(("k", "kelvin"), _KELVIN),
    **dict.fromkeys(("f", "fahrenheit"), _FAHRENHEIT),
}
"""Factor and offset to degC: no factor alone turns these units into it."""


@dataclass(frozen=True)
class Question:
    """What only the user of a record can know.

    Parameters
    ----------
    key : str
        Its place in the import map, such as ``"channels.current.unit"``.
    text : str
    choices : tuple of str
        What can be answered; empty where any text can.
    example : str
    """

    key: str
    text: str
    choices: tuple[str, ...] = ()
    example: str = ""


@dataclass(frozen=True)
class Guess:
    """What a foreign record seems to be.

    Parameters
    ----------
    table : mapping
        The import map as far as it is known.
    taken : tuple of str
        What was taken for what, in words.
    left_out : tuple of str
        The columns that are no channel.
    questions : tuple of Question
        What cannot be known; none where the map is whole.
    unused : tuple of str
        Keys of the answers that nothing asked for: they changed nothing.
    """

    table: dict[str, Any]
    taken: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    questions: tuple[Question, ...] = ()
    unused: tuple[str, ...] = ()

    @property
    def map(self) -> ImportMap:
        """The import map.

        Raises
        ------
        InputError
            Something is not known yet.
        """
        if self.questions:
            first = self.questions[0]
            raise InputError(
                f"not known: {first.text}", code="open-question", where=first.key, repair="answer it in the import map"
            )
        return ImportMap.from_table(self.table)

    def as_toml(self, title: str) -> str:
        """The import map as a file, with a line for each question that is open."""
        import tomli_w

        asked = "".join(
            f"# {question.key} is not known: {question.text}"
            + (f" ({', '.join(question.choices)})" if question.choices else f" (for example {question.example!r})")
            + "\n"
            for question in self.questions
        )
        text = "".join(f"# {line}\n" for line in (*self.taken, *self.left_out))
        head = f"# {title}: what was found in it. Correct here what is wrong.\n#\n"
        return f"{head}{text}{asked}\n{tomli_w.dumps(self.table)}"


def guess_map(path: str | os.PathLike[str], answers: Mapping[str, str] | None = None) -> Guess:
    """What a foreign record seems to be.

    Parameters
    ----------
    path : str or path
    answers : mapping of str to str, optional
        To questions that an earlier guess asked, by their keys.

    Raises
    ------
    InputError
        No such file, one of a kind that no importer reads, or without a table of numbers.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "record.csv"
    ...     _ = file.write_text("Zeit [s];Spannung [V];Strom\\n0,00;0,0;0\\n0,02;1,0;60\\n")
    ...     guess = guess_map(file)
    ...     whole = guess_map(file, {"channels.current.unit": "mA"})
    >>> [question.key for question in guess.questions]
    ['channels.current.unit']
    >>> whole.map.channels["current"].unit
    'mA'
    """
    return _Guesser(Path(path), dict(answers or {})).guess()


def guess_file(path: Path) -> dict[str, Any]:
    """How a file seems to be written: the ``[file]`` table of an import map."""
    return _Guesser(path, {}).find_file()[0]


def guess_channels(path: Path, file: dict[str, Any], columns: Columns) -> list[str | None]:
    """What each column seems to be; None where that is not known."""
    guesser = _Guesser(path, {})
    with contextlib.suppress(InputError):  # none can be the voltage: what was found before stays
        guesser.read_columns(file, columns, None)
    found = guesser.table["channels"]
    return [next((name for name, keys in found.items() if keys["column"] == one.name), None) for one in guesser.all]


@dataclass
class _Column:
    place: int
    name: int | str
    heading: Heading
    readings: Readings | None
    """None where its cells are no numbers."""


@dataclass
class _Guesser:
    path: Path
    answers: dict[str, str]
    columns: Columns = field(init=False)
    table: dict[str, Any] = field(default_factory=dict)
    used: set[int] = field(default_factory=set)
    all: list[_Column] = field(default_factory=list)
    taken: list[str] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    asked: set[str] = field(default_factory=set)

    def guess(self) -> Guess:
        check_source(self.path)
        file, names = self.find_file()
        if self.questions and self.questions[-1].key.startswith("file."):
            return Guess({"file": file}, tuple(self.taken), (), tuple(self.questions))
        self.read_columns(file, self._read(file), names)
        spare = [column for column in self.all if column.place not in self.used]
        left_out = [f"left out: column {self._label(column)}" for column in spare if not self._is_blank(column)]
        unused = tuple(key for key in self.answers if key not in self.asked)
        return Guess(self.table, tuple(self.taken), tuple(left_out), tuple(self.questions), unused)

    def read_columns(self, file: dict[str, Any], columns: Columns, names: tuple[str, ...] | None) -> None:
        """Find what each column is; ``names`` are its headings where the table cannot name them."""
        self.columns = columns if names is None else replace(columns, names=names)
        self.table = {"file": file, "channels": {}}
        self.all = [self._column(place, by_place=names is not None) for place in range(len(columns.cells))]
        self.used = {column.place for column in self.all if column.heading.is_row}
        self._time()
        for channel in _ASKED_CHANNELS:
            self._channel(channel)
        self._pair_indices()

    # How the file is written.

    def find_file(self) -> tuple[dict[str, Any], tuple[str, ...] | None]:
        with self.path.open("rb") as stream:
            kind = format_of_start(stream.read(32), str(self.path))
        if kind == "xlsx":
            return self._sheet(), None
        if kind:
            return {"format": kind}, None
        layout = text_layout(self.path)
        file = layout.file
        if layout.open_decimal:
            shown = "a decimal comma" if file.get("decimal") == "," else "a decimal point"
            answer = self._ask(
                Question(
                    "file.decimal",
                    f"the numbers may have {shown} or thousands marks: which mark is the decimal one?",
                    (".", ","),
                )
            )
            if answer:
                file = {key: value for key, value in file.items() if key != "decimal"}
                file |= {"decimal": ","} if answer == "," else {}
        marks = {"\t": "tabs", " ": "blanks"}
        self._take(
            f"text table: columns separated by {marks.get(file['separator'], repr(file['separator']))}, "
            f"decimal {'comma' if file.get('decimal') == ',' else 'point'}, {file.get('encoding', 'utf-8')}"
            + (f", after {file['skip_lines']} lines" if file.get("skip_lines") else "")
        )
        return file, layout.names

    def _sheet(self) -> dict[str, Any]:
        self._sheets = read_sheets(self.path)
        found = {name: layout for name, rows in self._sheets.items() if (layout := sheet_layout(rows)) is not None}
        if not found:
            raise InputError(
                "no sheet has a table of numbers", code="no-table", where=str(self.path), repair="see what was saved"
            )
        sheet = next(iter(found))
        if len(found) > 1:
            sheet = self._ask(Question("file.sheet", "which sheet holds the record?", tuple(found))) or sheet
        named = {} if sheet == next(iter(self._sheets)) else {"sheet": sheet}
        self._take(f"workbook: sheet {sheet!r}")
        return {"format": "xlsx", **named, **found[sheet]}

    def _read(self, file: dict[str, Any]) -> Columns:
        options = TypeAdapter[Any](File).validate_python(file)
        if isinstance(options, XlsxFile):
            return columns_of(self._sheets, options, str(self.path))
        return read_columns(self.path, options)

    # What its columns mean.

    def _column(self, place: int, *, by_place: bool) -> _Column:
        name = self.columns.names[place]
        below = self.columns.units[place] if self.columns.units else None
        said = name.partition("/")[2] if self.table["file"]["format"] == "tdms" else name  # without its group
        heading = read_heading(said, below)
        unique = bool(name) and self.columns.names.count(name) == 1 and not by_place
        return _Column(place, name if unique else place, heading, Readings.of(self.columns, place))

    def _is_blank(self, column: _Column) -> bool:
        return column.readings is not None and not column.readings.count

    def _label(self, column: _Column) -> str:
        name = self.columns.names[column.place]
        return repr(name) if name else f"number {column.place}"

    def _take(self, text: str) -> None:
        self.taken.append(text)

    def _ask(self, question: Question) -> str:
        """The answer to a question; an empty text where it is still open."""
        self.asked.add(question.key)
        answer = self.answers.get(question.key, "").strip()
        if answer and question.choices and answer not in question.choices:
            raise InputError(
                f"{answer!r} is not one of {', '.join(question.choices)}",
                code="bad-answer",
                where=question.key,
                repair="answer with one of these",
            )
        if not answer:
            self.questions.append(question)
        return answer

    def _choose(self, channel: str, among: Sequence[_Column], text: str, *, optional: bool) -> _Column | None:
        labels = {str(column.name): column for column in among}
        answer = self._ask(Question(f"channels.{channel}.column", text, (*labels, NONE) if optional else tuple(labels)))
        return labels.get(answer)

    def _is_open(self, key: str) -> bool:
        return any(question.key == key for question in self.questions)

    def _time(self) -> None:
        if self.columns.clocks and any(self.columns.clocks):
            self._take("the file records its sampling period")
            return
        named = [column for column in self.all if "time" in column.heading.channels and not column.heading.is_row]
        named = named or [column for column in self.all if column.heading.of_unit == ("time",) and column.readings]
        rising = [column for column in named if column.readings and column.readings.rises]
        stated = [column for column in rising if column.heading.unit]
        chosen = stated or rising
        if len(chosen) > 1:
            picked = self._choose("time", chosen, "which column is the time?", optional=False)
            if picked is None:
                return
            chosen = [picked]
        if chosen:
            self._numeric_time(chosen[0])
        elif not self._dates([column for column in self.all if column.readings is None]):
            rising = [column for column in self.all if self._may_be_time(column)]
            picked = self._choose("time", rising, "is one of these the time?", optional=True) if rising else None
            if picked is not None:
                self._numeric_time(picked)
            elif not self._is_open("channels.time.column"):
                self._period("the file does not say when its rows were read: what is the time between two rows?")

    def _may_be_time(self, column: _Column) -> bool:
        return (
            column.readings is not None
            and column.readings.is_regular
            and not column.heading.is_row
            and not column.heading.channels
            and column.heading.of_unit in ((), ("time",))
            and not column.heading.foreign_unit
        )

    def _period(self, text: str) -> None:
        answer = self._ask(Question("sampling_period", text, example="20 ms"))
        if answer:
            self.table["sampling_period"] = answer

    def _numeric_time(self, column: _Column) -> None:
        readings = column.readings
        assert readings is not None
        unit, since = column.heading.unit if "time" in column.heading.of_unit else "", False
        step = float(np.median(np.diff(readings.present))) if readings.count > 1 else 0.0
        if not unit and step < 1e-2 and any(low < readings.present[0] < high for low, high in _DAYS):
            unit, since = "d", True
        for known, spans in _SINCE.items():
            if unit in ("", known) and any(low < readings.present[0] < high for low, high in spans):
                unit, since = known, True
        if not unit:
            unit = self._ask(
                Question(
                    "channels.time.unit",
                    f"in which unit is the time {self._label(column)}? It steps by {step:.6g}",
                    tuple(MAPPED["time"].units),
                )
            )
        self._place_time(column, {"unit": unit} if unit else {}, readings.values, in_words=unit or "unit not known")
        if since and "time" in self.table["channels"]:
            self.table["channels"]["time"]["zero_rows"] = [0, 1]

    def _dates(self, texts: Sequence[_Column]) -> bool:
        """Take one column of dates, or one with the date and one with the time of day, for the time."""
        found = find_dates([self.columns.cells[column.place] for column in texts])
        if found is None:
            return False
        places, order, times = found
        keys: dict[str, Any] = {"dates": order}
        if len(places) > 1:
            keys["date_column"] = texts[places[0]].name
            self.used.add(texts[places[0]].place)
        self._place_time(texts[places[-1]], keys, times, in_words=order)
        return True

    def _place_time(self, column: _Column, keys: dict[str, Any], times: FloatArray, *, in_words: str) -> None:
        self.used.add(column.place)
        steps = np.diff(times)
        again = np.flatnonzero(steps == 0.0)
        if len(again) > _FEW_DUPLICATES * len(times):
            self._period(
                f"the times in {self._label(column)} are coarser than the rows ({len(again)} rows have the time of the "
                "row before): what is the time between two rows?"
            )
            return
        if len(again):
            keys["duplicates"] = "drop"
            line = self.columns.place(int(again[0]) + 1, column.place)
            self._take(f"left out: rows with the time of the row before ({len(again)}, first at {line})")
        self.table["channels"]["time"] = {"column": column.name, **keys}
        self._take(f"time: column {self._label(column)}, {in_words}")

    def _channel(self, channel: str) -> None:
        left = [column for column in self.all if column.place not in self.used and not self._is_blank(column)]
        free = [column for column in left if column.readings is not None]
        # A column of readings that cannot be read as numbers is not left out: its import says which cell is wrong.
        spoilt = [column for column in left if column.readings is None and self._has_digits(column)]
        worded = [column for column in free if self._means(column) == channel]
        worded = worded or [column for column in spoilt if self._means(column) == channel]
        read = [column for column in worded if not column.heading.is_commanded]
        chosen = read or worded
        if not chosen:
            by_unit = [column for column in free if not column.heading.channels and self._unit_says(column, channel)]
            chosen = by_unit
        if not chosen and channel == "voltage":
            unknown = [column for column in free if not column.heading.channels and not column.heading.foreign_unit]
            unknown = [column for column in unknown if not column.heading.unit]
            if not unknown:
                raise InputError(
                    "no column that can be the voltage: every run has one",
                    code="no-voltage",
                    where=str(self.path),
                    repair="see what was saved, or write a map: docs/files.md, Import maps",
                )
            picked = self._choose(channel, unknown, "which column is the voltage?", optional=False)
            chosen = [] if picked is None else [picked]
        elif not chosen and self._unknown(free) and self._is_nameless():
            picked = self._choose(
                channel, self._unknown(free), f"which column is the {MAPPED[channel].name}?", optional=True
            )
            chosen = [] if picked is None else [picked]
        if len(chosen) > 1:
            text = f"several columns can be the {MAPPED[channel].name}: which one was read at the strip?"
            picked = self._choose(channel, chosen, text, optional=channel != "voltage")
            chosen = [] if picked is None else [picked]
        if chosen:
            self._place(channel, chosen[0])

    def _has_digits(self, column: _Column) -> bool:
        return any(letter.isdigit() for cell in self.columns.cells[column.place] for letter in str(cell))

    def _is_nameless(self) -> bool:
        return not any(self.columns.names)

    def _unknown(self, free: Sequence[_Column]) -> list[_Column]:
        return [column for column in free if not column.heading.channels and not column.heading.unit]

    def _means(self, column: _Column) -> str:
        """The channel that the words of a heading mean, with its unit; an empty text where they mean none."""
        heading = column.heading
        said = tuple(name for name in heading.channels if name != "time")
        if heading.unit and (agreed := [name for name in said if name in heading.of_unit and name != "voltage"]):
            return agreed[0] if len(agreed) == 1 else ""
        if len(said) > 1:  # "laser voltage": what a sensor gives as a voltage
            said = tuple(name for name in said if name != "voltage")
        return said[0] if len(said) == 1 else ""

    def _unit_says(self, column: _Column, channel: str) -> bool:
        return channels_of(column.heading.unit) == (channel,) and not column.heading.is_commanded

    def _place(self, channel: str, column: _Column) -> None:
        self.used.add(column.place)
        quantity, heading = MAPPED[channel], column.heading
        readings = column.readings or Readings(np.zeros(1))
        keys: dict[str, Any] = {"column": column.name}
        unit = heading.unit if channel in heading.of_unit else ""
        foreign = heading.foreign_unit or (heading.unit if heading.unit and not unit else "")
        bare = foreign.lower().removeprefix("°").removeprefix("deg").strip(" _")
        line = _DEGREES.get(bare) if channel == "temperature" else None
        if line is not None:
            keys |= {"factor": line[0], "offset": line[1], "unit": "degC"}
        elif foreign:
            answer = self._ask(
                Question(
                    f"channels.{channel}.factor",
                    f"the {quantity.name} {self._label(column)} is in {foreign}: how many {quantity.display_unit} is 1 "
                    f"{foreign}?",
                    example="2.5",
                )
            )
            if answer:
                keys |= {"factor": _number(answer, f"channels.{channel}.factor"), "unit": quantity.display_unit}
        elif unit:
            keys["unit"] = unit
        else:
            span = f"from {np.min(readings.present):.6g} to {np.max(readings.present):.6g}"
            unit = self._ask(
                Question(
                    f"channels.{channel}.unit",
                    f"in which unit is the {quantity.name} {self._label(column)}? It goes {span}",
                    tuple(quantity.units),
                )
            )
            keys |= {"unit": unit} if unit else {}
        lost = self._sentinels(channel, readings)
        if lost:
            keys["sentinels"] = lost
        self.table["channels"][channel] = keys
        self._take(
            f"{quantity.name}: column {self._label(column)}, {foreign if line else keys.get('unit', 'unit not known')}"
            + (f"; {', '.join(f'{one:g}' for one in lost)} is no reading" if lost else "")
        )

    def _sentinels(self, channel: str, readings: Readings) -> list[float]:
        sure, perhaps = find_sentinels(readings.present)
        if channel == "voltage":
            perhaps = []  # the levels of a signal are far apart, too
        for value, count in perhaps:
            answer = self._ask(
                Question(
                    f"channels.{channel}.sentinels",
                    f"{count} readings of the {MAPPED[channel].name} are exactly {value:g}, far from all others: "
                    "does that mean that nothing was read?",
                    ("yes", "no"),
                )
            )
            sure = [*sure, value] if answer == "yes" else sure
        return sure

    def _pair_indices(self) -> None:
        """Where every channel has a column of its own that counts its rows, give each its own."""
        rows = {column.place: column for column in self.all if column.heading.is_row and column.readings}
        if len(rows) < 2:
            return
        places = {column.name: column.place for column in self.all}
        for channel in self.table["channels"].values():
            partner = rows.get(places[channel["column"]] - 1)
            if partner is not None and partner.readings is not None and partner.readings.counts_rows:
                channel["index"] = partner.name


def _number(text: str, where: str) -> float:
    from ipmclab.units import NUMBER, parse_quantity

    return parse_quantity(text, NUMBER, where=where)
