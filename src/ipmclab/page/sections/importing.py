"""A foreign record becomes a run: its columns are said above their first rows, tried, and saved with their map."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

import tomli_w
from nicegui import ui

from ipmclab.destination import write_text
from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.commands import import_step
from ipmclab.page.curves import Panel, Series
from ipmclab.page.elements.column_map import ColumnMap, Said, channel_tables
from ipmclab.page.elements.file_choice import FileChoice
from ipmclab.page.elements.time_plot import TimePlot
from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.jobs import JobCancelled
from ipmclab.page.lab import plain_name
from ipmclab.page.sections.parts import card, fail_at, finding_bands, finding_list, sentence, step_view, text
from ipmclab.page.workshop import Workshop
from ipmclab.store.import_map import EXAMPLE_PERIOD
from ipmclab.units import CHANNELS

ENDINGS: Final = (".csv", ".txt", ".dat", ".gz", ".xlsx", ".mat", ".tdms", ".lvm")

_SKIP: Final = "file.skip_lines"
_MOUNTING: Final = "metadata.mounting_id"

_IN_A_FORM: Final = {
    "no-time": "say which column is the time, or fill in the sampling period",
    "period-mismatch": "empty the sampling period",
    "missing-key": "say above a column that it is the voltage: every run has one",
    "ragged-row": "see that the file is complete, what separates the columns, and the lines before the table",
    "unit-mismatch": "choose “as in the file”, or write the factor 1 where the file is wrong",
}
"""What to do about a mistake where a form is in place of the map: of each code."""

_MARKS: Final = {
    "decimal-comma": "choose the comma as the decimal mark",
    "decimal-point": "choose the point as the decimal mark",
}
"""The same for numbers in a file that is a text: no other form says how they are written."""

_HOLDS: Final = {
    "unknown": "not known (the delay is estimated)",
    "zero-before": "each row was read just before the output changed",
    "zero": "each row was read just as the output changed",
    "first": "straight lines between rows",
}

Done = Callable[[str], Awaitable[None]]


def build_import(workshop: Workshop, on_done: Done) -> None:
    """The card with which a record is imported; ``on_done`` gets the path of the run."""
    _Import(workshop, on_done).build()


def repair_in_a_form(error: IpmclabError, where: str, *, is_text: bool) -> str:
    """What to do about a mistake in the form.

    Parameters
    ----------
    error : IpmclabError
        Of the import map that the form stands for.
    where : str
        The place in the map.
    is_text : bool
        Whether the form says how the numbers of the file are written.

    Examples
    --------
    >>> comma = InputError("'1,5' has a comma", code="decimal-comma", repair="write '1.5'")
    >>> repair_in_a_form(comma, "channels.current", is_text=True)
    "write '1.5'"
    >>> repair_in_a_form(comma, "rig.csv: row 2, column 1", is_text=True)
    'choose the comma as the decimal mark'
    """
    is_typed = where.startswith("channels.") or where.endswith("sampling_period")
    if error.code in _MARKS and not is_typed:
        return _MARKS[error.code] if is_text else "correct it in a copy of the file: its numbers have a decimal point"
    if error.code in _IN_A_FORM and (error.code != "missing-key" or where == "channels"):
        return _IN_A_FORM[error.code]
    return error.repair


class _Import:
    def __init__(self, workshop: Workshop, on_done: Done) -> None:
        self._workshop = workshop
        self._on_done = on_done
        self._path: Path | None = None
        self._name = ""
        self._layout: dict[str, Any] = {}
        self._previewed: dict[str, Any] = {}
        self._columns: list[dict[str, str]] = []
        self._said = Said()
        self._curves: str | None = None
        self._asked = 0
        self._misread: IpmclabError | None = None  # why the record cannot be read as the form says

    def build(self) -> None:
        with card("Import a record"):
            with ui.element("div").classes("lab-bar"):
                here = {"": "–", **{name: name for name in self._files()}}
                choice = ui.select(here, value="", label="A record of this folder").props(
                    "dense outlined options-dense"
                )
                choice.classes("lab-wide")
                FileChoice("or one of this computer", ",".join(ENDINGS), self._sent).classes("lab-wide")
            self._message = text("").classes("lab-bad").props("role=alert")
            self._form = ui.element("div").classes("lab-column")

        async def chosen() -> None:
            if choice.value:
                await self._open(self._workshop.lab.path(choice.value), Path(choice.value).name)

        choice.on_value_change(chosen)
        ui.context.client.on_delete(self._forget)

    def _forget(self) -> None:
        """What a browser sent is needed no more; a file of the folder stays."""
        self._workshop.uploads.forget(self._path)

    def _files(self) -> list[str]:
        lab = self._workshop.lab
        found = [path for path in sorted(lab.root.glob("*")) if path.suffix.lower() in ENDINGS and path.is_file()]
        return [lab.below(path) for path in found[:200]]

    async def _sent(self, file: dict[str, str]) -> None:
        path = self._workshop.scratch / Path(file["key"]).name
        if path.is_file():
            await self._open(path, file["name"])

    async def _open(self, path: Path, name: str) -> None:
        """Read the first rows of a record as it seems to be written, and put the form together."""
        self._message.set_text("")
        if path != self._path:
            self._forget()
        self._path, self._name = path, name
        try:
            preview = await self._preview(None)
        except IpmclabError as error:
            self._message.set_text(self._named(str(error)))
            self._form.clear()
            return
        if preview is None:
            return
        self._previewed, self._layout, self._misread = preview, preview["file"], None
        self._said = Said()
        self._form.clear()
        with self._form:
            self._build_form()

    async def _read_again(self) -> None:
        """Read the record as the form says now: its columns are shown again, all else stays as it was filled in."""
        self._clear_errors()
        self._said.keep(self._columns)
        try:
            layout = self._wanted_layout()
            preview = await self._preview(layout)
        except IpmclabError as error:
            self._misread = error
            self._complain_of_layout(error)
            return
        if preview is None:
            return
        self._previewed, self._layout, self._misread = preview, layout, None
        self._result.clear()
        self._show_columns()

    async def _preview(self, layout: dict[str, Any] | None) -> dict[str, Any] | None:
        """What the first rows are; None where something newer was asked meanwhile."""
        self._asked += 1
        asked = self._asked
        try:
            frame = await self._do("preview", {"path": str(self._path), "file": layout})
        except JobCancelled:
            return None
        except IpmclabError:
            if asked != self._asked:
                return None
            raise
        return frame.document if asked == self._asked else None

    def _named(self, words: str) -> str:
        """What is said of a file, with the name that its owner gave it: one that was sent is kept under another."""
        assert self._path is not None
        return words.replace(str(self._path), self._name).replace(self._path.name, self._name)

    async def _do(self, task: str, arguments: dict[str, Any]) -> Frame:
        job = self._workshop.jobs.submit(task, arguments, title="import")
        return await asyncio.wrap_future(job.future)

    def _build_form(self) -> None:
        self._count = text("").props("role=status")
        if self._layout["format"] == "csv":
            self._build_layout()
        self._table_place = ui.element("div").classes("lab-full")
        self._show_columns()
        with ui.element("div").classes("lab-bar"):
            self._period = ui.input("Sampling period, without a time column").props(
                f"dense outlined stack-label placeholder='{EXAMPLE_PERIOD}'"
            )
            self._hold = ui.select(_HOLDS, value="unknown", label="The voltage between rows")
            self._hold.props("dense outlined options-dense")
            self._sample = ui.input("Sample").props("dense outlined")
            self._mounting = ui.input("Mounting").props("dense outlined")
            for one in (self._period, self._hold, self._sample, self._mounting):
                one.classes("lab-wide")
        with ui.element("div").classes("lab-bar"):
            ui.button("Try", on_click=self._try).props("outline no-caps")
            stem = re.sub(r"[^\w .+-]", "_", self._name.partition(".")[0]) or "record"
            self._save_as = ui.input("Save as", value=stem).props("dense outlined suffix=.nc").classes("lab-wide")
            ui.button("Save the run", on_click=self._save).props("unelevated no-caps")
        self._wrong = text("").classes("lab-bad").props("role=alert")
        self._result = ui.element("div").classes("lab-column")

    def _show_columns(self) -> None:
        """The columns as they were read last, with what was said of them."""
        preview = self._previewed
        self._count.set_text(f"{self._name}: {preview['count']} rows, {len(preview['names'])} columns")
        self._columns = self._said.begin(preview["names"], preview["guesses"])
        self._table_place.clear()
        with self._table_place:
            self._map = ColumnMap(preview["names"], preview["rows"], self._columns, self._mapped)

    def _build_layout(self) -> None:
        layout, again = self._layout, self._read_again
        with ui.element("div").classes("lab-bar"):
            marks = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "blanks"}
            self._separator = ui.select(
                marks, value=layout.get("separator", ","), label="Between columns", on_change=again
            )
            decimals = {".": "point", ",": "comma"}
            self._decimal = ui.select(decimals, value=layout.get("decimal", "."), label="Decimal mark", on_change=again)
            self._skip = ui.number("Lines before the table", value=layout.get("skip_lines", 0))
            self._skip.on("change", again)
            for one in (self._separator, self._decimal, self._skip):
                one.props("dense outlined options-dense").classes("lab-choice")
            self._header = ui.switch("names in the first line", value=layout.get("header", True), on_change=again)
            self._units = ui.switch("units in the next line", value=layout.get("units_row", False), on_change=again)
        self._layout_wrong = text("").classes("lab-bad").props("role=alert")

    def _wanted_layout(self) -> dict[str, Any]:
        """How the form says that the text is written.

        Raises
        ------
        InputError
            A number of lines that is none.
        """
        skip = self._skip.value or 0
        if not math.isfinite(skip) or skip < 0 or skip != int(skip):
            raise InputError(
                f"{skip:g} is no number of lines",
                code="bad-number",
                where=_SKIP,
                repair="write 0 or a whole number above",
            )
        said = {"separator": self._separator.value, "decimal": self._decimal.value, "header": self._header.value}
        said |= {"units_row": self._units.value, "skip_lines": int(skip)}
        return {**self._layout, **said}  # its comments and its letters stay as they seem to be

    def _mapped(self, columns: list[dict[str, str]]) -> None:
        if len(columns) == len(self._columns):  # else of those that were shown before
            self._columns = columns

    def _table(self) -> dict[str, Any]:
        """The import map that the form says.

        Raises
        ------
        InputError
        """
        table: dict[str, Any] = {"hold": self._hold.value, "file": self._layout}
        if self._period.value:
            table["sampling_period"] = self._period.value.strip()
        table["channels"] = channel_tables(self._previewed["names"], self._columns)
        if self._sample.value:
            table["sample"] = {"id": plain_name(self._sample.value, "sample")}
        if self._mounting.value:
            table["metadata"] = {"mounting_id": plain_name(self._mounting.value, _MOUNTING)}
        return table

    async def _try(self) -> None:
        """Import without writing; what is wrong is said where it is."""
        await self._import(None)

    async def _import(self, out: Path | None) -> dict[str, Any] | None:
        """The map by which it was imported: what the form says may be another when the worker is done."""
        if self._misread is not None:  # as is said at its field: to say it again would undo what is being typed there
            return None
        self._clear_errors()
        try:
            table = self._table()
            asked = {"path": str(self._path), "name": self._name, "map": table, "out": out and str(out)}
            frame = await self._do("import", asked)
        except JobCancelled:
            return None
        except IpmclabError as error:
            self._result.clear()  # it is of what the form said before
            self._complain(error)
            return None
        self._show(frame)
        return table

    def _show(self, frame: Frame) -> None:
        document, time = frame.document, frame.arrays["time"]
        panels = [
            Panel.of(name, CHANNELS[name], [Series(name, name, time, frame.arrays[name])])
            for name in CHANNELS
            if name in frame.arrays
        ]
        self._workshop.curves.forget(self._curves)
        self._curves = self._workshop.curves.add(panels)
        bands = finding_bands(document["findings"])
        self._result.clear()
        with self._result:
            text(f"{document['rows']} rows, {document['duration']:.6g} s at {document['rate']:.6g} Hz").props(
                "role=status"
            )
            for words in document["unmet"]:
                text(f"{words}: see what was said of lost readings.").classes("lab-bad").props("role=alert")
            TimePlot(self._name, [panel.as_dict() for panel in panels], self._curves, bands=bands, height=95)
            finding_list(document["findings"])

    async def _save(self) -> None:
        lab = self._workshop.lab
        fail_at(self._save_as, None)
        try:
            lab.new_file(self._save_as.value or "", ".nc")  # refuses what is no plain name
            folder = lab.laboratory_folder if lab.laboratory_folder.is_dir() else lab.root
            stem = self._save_as.value.strip().removesuffix(".nc")
            out, map_file = folder / f"{stem}.nc", folder / f"{stem}.map.toml"
            for path in (out, map_file):
                if path.exists():
                    raise InputError(
                        f"{lab.below(path)} exists already", code="file-exists", repair="choose another name"
                    )
        except InputError as error:
            fail_at(self._save_as, error)
            return
        table = await self._import(out)
        if table is None:
            return
        write_text(tomli_w.dumps(table), map_file, overwrite=False)
        assert self._path is not None
        sent = self._path.parent == self._workshop.scratch
        with self._result:
            step_view()(import_step(self._name, lab.below(map_file), lab.below(out), sent=sent))
        ui.notify(f"wrote {lab.below(out)} and its map", type="positive")
        self._forget()
        await self._on_done(lab.below(out))

    def _clear_errors(self) -> None:
        self._wrong.set_text("")
        self._map.complain({})
        fail_at(self._period, None)
        fail_at(self._sample, None)
        fail_at(self._mounting, None)
        if self._layout["format"] == "csv":
            fail_at(self._skip, None)
            self._layout_wrong.set_text("")

    def _complain_of_layout(self, error: IpmclabError) -> None:
        """Say why the record cannot be read as the form says: at the field of the lines where these leave no table."""
        if error.where == _SKIP:
            fail_at(self._skip, error)
        elif error.code == "empty-file" and self._skip.value:
            fail_at(self._skip, "no rows of numbers come after so many lines; write a smaller number")
        else:
            known = _IN_A_FORM | _MARKS
            message = f"{error.message}; {known[error.code]}" if error.code in known else sentence(error)
            self._layout_wrong.set_text(self._named(f"{error.where}: {message}" if error.where else message))

    def _complain(self, error: IpmclabError) -> None:
        """Say what is wrong at the column or the field that it belongs to."""
        where = error.where.removeprefix("map: ").removeprefix("map")
        channel = where.split("channels.", 1)[1].split(".")[0] if "channels." in where else ""
        place = next((k for k, column in enumerate(self._columns) if channel and column["channel"] == channel), None)
        repair = repair_in_a_form(error, where, is_text=self._layout["format"] == "csv")
        message = self._named(f"{error.message}; {repair}" if repair else error.message)
        if place is not None:
            self._map.complain({place: message})
        elif "sampling_period" in where or error.code == "no-time":
            fail_at(self._period, message)
        elif where.startswith("sample"):
            fail_at(self._sample, message)
        elif where == _MOUNTING:
            fail_at(self._mounting, message)
        else:
            self._wrong.set_text(self._named(f"{where}: {message}") if where else message)
