"""A foreign record becomes a run: its columns are said above their first rows, tried, and saved with their map."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

import tomli_w
from nicegui import ui

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.commands import import_step
from ipmclab.page.curves import Panel, Series
from ipmclab.page.elements.column_map import ColumnMap, channel_tables
from ipmclab.page.elements.file_choice import FileChoice
from ipmclab.page.elements.time_plot import TimePlot
from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.jobs import JobCancelled
from ipmclab.page.sections.parts import card, fail_at, finding_bands, finding_list, sentence, step_view, text
from ipmclab.page.workshop import Workshop
from ipmclab.units import CHANNELS

ENDINGS: Final = (".csv", ".txt", ".dat", ".gz", ".xlsx", ".mat", ".tdms", ".lvm")

_IN_A_FORM: Final = {
    "no-time": "say which column is the time, or fill in the sampling period",
    "period-mismatch": "empty the sampling period",
    "missing-key": "say above a column that it is the voltage: every run has one",
}
"""What to do about a mistake where a form stands in place of the map: of each code."""

_HOLDS: Final = {
    "unknown": "not known (the delay is estimated)",
    "zero-before": "each row was read just before the output changed",
    "zero": "each row was read just as the output changed",
    "first": "straight lines between rows",
}

Done = Callable[[str], Awaitable[None]]


def build_import(workshop: Workshop, on_done: Done) -> None:
    """The card with which a record is imported; ``on_done`` is told the path of the run."""
    _Import(workshop, on_done).build()


class _Import:
    def __init__(self, workshop: Workshop, on_done: Done) -> None:
        self._workshop = workshop
        self._on_done = on_done
        self._path: Path | None = None
        self._name = ""
        self._layout: dict[str, Any] = {}
        self._seen: dict[str, Any] = {}
        self._columns: list[dict[str, str]] = []
        self._curves: str | None = None

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

    async def _sent(self, told: dict[str, str]) -> None:
        path = self._workshop.scratch / Path(told["key"]).name
        if path.is_file():
            await self._open(path, told["name"])

    async def _open(self, path: Path, name: str, layout: dict[str, Any] | None = None) -> None:
        """Read the first rows, and put the form together."""
        self._message.set_text("")
        if path != self._path:
            self._forget()
        self._path, self._name = path, name
        try:
            frame = await self._do("preview", {"path": str(path), "file": layout})
        except JobCancelled:
            return
        except IpmclabError as error:
            self._message.set_text(self._named(str(error)))
            if layout is None:
                self._form.clear()
            return
        self._seen, self._layout = frame.document, frame.document["file"]
        self._form.clear()
        with self._form:
            self._build_form()

    def _named(self, told: str) -> str:
        """What is said of a file, with the name that its owner gave it: one that was sent is kept under another."""
        assert self._path is not None
        return told.replace(str(self._path), self._name).replace(self._path.name, self._name)

    async def _do(self, task: str, arguments: dict[str, Any]) -> Frame:
        job = self._workshop.jobs.submit(task, arguments, title="import")
        return await asyncio.wrap_future(job.future)

    def _build_form(self) -> None:
        seen = self._seen
        text(f"{self._name}: {seen['count']} rows, {len(seen['names'])} columns").props("role=status")
        if self._layout["format"] == "csv":
            self._build_layout()
        self._map = ColumnMap(seen["names"], seen["rows"], seen["guesses"], self._mapped)
        with ui.element("div").classes("lab-bar"):
            self._period = ui.input("Sampling period, without a time column").props(
                "dense outlined stack-label placeholder='20 ms'"
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

    def _build_layout(self) -> None:
        layout = self._layout

        async def again() -> None:
            new = {"format": "csv", "separator": separator.value, "decimal": decimal.value, "header": header.value}
            new |= {"units_row": units.value, "skip_lines": int(skip.value or 0)}
            new |= {key: layout[key] for key in ("comment", "encoding") if key in layout}
            assert self._path is not None
            await self._open(self._path, self._name, new)

        with ui.element("div").classes("lab-bar"):
            marks = {",": "comma", ";": "semicolon", "\t": "tab"}
            separator = ui.select(marks, value=layout.get("separator", ","), label="Between columns", on_change=again)
            decimal = ui.select({".": "point", ",": "comma"}, value=layout.get("decimal", "."), label="Decimal mark")
            decimal.on_value_change(again)
            skip = ui.number("Lines before the table", value=layout.get("skip_lines", 0), min=0, precision=0)
            skip.on("change", again)
            for one in (separator, decimal, skip):
                one.props("dense outlined options-dense").classes("lab-choice")
            header = ui.switch("names in the first line", value=layout.get("header", True), on_change=again)
            units = ui.switch("units in the next line", value=layout.get("units_row", False), on_change=again)

    def _mapped(self, columns: list[dict[str, str]]) -> None:
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
        table["channels"] = channel_tables(self._seen["names"], self._columns)
        if self._sample.value:
            table["sample"] = {"id": self._sample.value.strip()}
        if self._mounting.value:
            table["metadata"] = {"mounting_id": self._mounting.value.strip()}
        return table

    async def _try(self) -> Frame | None:
        """Import without writing; what is wrong is said where it is."""
        return await self._import(None)

    async def _import(self, out: Path | None) -> Frame | None:
        self._clear_errors()
        try:
            table = self._table()
            frame = await self._do("import", {"path": str(self._path), "map": table, "out": out and str(out)})
        except JobCancelled:
            return None
        except IpmclabError as error:
            self._complain(error)
            return None
        self._show(frame)
        return frame

    def _show(self, frame: Frame) -> None:
        told, time = frame.document, frame.arrays["time"]
        panels = [
            Panel.of(name, CHANNELS[name], [Series(name, name, time, frame.arrays[name])])
            for name in CHANNELS
            if name in frame.arrays
        ]
        self._workshop.curves.forget(self._curves)
        self._curves = self._workshop.curves.add(panels)
        bands = finding_bands(told["findings"])
        self._result.clear()
        with self._result:
            text(f"{told['rows']} rows, {told['duration']:.6g} s at {told['rate']:.6g} Hz").props("role=status")
            TimePlot(self._name, [panel.as_dict() for panel in panels], self._curves, bands=bands, height=95)
            finding_list(told["findings"])

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
        if await self._import(out) is None:
            return
        map_file.write_text(tomli_w.dumps(self._table()), encoding="utf-8")
        with self._result:
            step_view()(import_step(self._name, lab.below(map_file), lab.below(out)))
        ui.notify(f"wrote {lab.below(out)} and its map", type="positive")
        self._forget()
        await self._on_done(lab.below(out))

    def _clear_errors(self) -> None:
        self._wrong.set_text("")
        self._map.complain({})
        fail_at(self._period, None)
        fail_at(self._sample, None)

    def _complain(self, error: IpmclabError) -> None:
        """Say what is wrong at the column or the field that it belongs to."""
        where = error.where.removeprefix("map: ").removeprefix("map")
        channel = where.split("channels.", 1)[1].split(".")[0] if "channels." in where else ""
        place = next((k for k, column in enumerate(self._columns) if channel and column["channel"] == channel), None)
        told = self._named(sentence(error))
        if error.code in _IN_A_FORM and (error.code != "missing-key" or where == "channels"):
            told = f"{error.message}; {_IN_A_FORM[error.code]}"
        if place is not None:
            self._map.complain({place: told})
        elif "sampling_period" in where or error.code == "no-time":
            fail_at(self._period, told)
        elif where.startswith("sample"):
            fail_at(self._sample, told)
        else:
            self._wrong.set_text(self._named(f"{where}: {told}") if where else told)
