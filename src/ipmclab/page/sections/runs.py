"""Runs: everything that was recorded or imported here, to find, to look at, to compare and to take along."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from typing import Any
from urllib.parse import quote, urlencode

from nicegui import ui

from ipmclab.errors import IpmclabError
from ipmclab.page.context import Context
from ipmclab.page.curves import run_panels
from ipmclab.page.elements.run_table import Chosen, RunTable
from ipmclab.page.elements.time_plot import TimePlot
from ipmclab.page.jobs.jobs import Job, JobCancelled
from ipmclab.page.lab_runs import MOST_COMPARED, labels
from ipmclab.page.run_table import MOST_SHOWN, RunFilter, table_rows
from ipmclab.page.sections.board import build_board
from ipmclab.page.sections.importing import build_import
from ipmclab.page.sections.parts import card, download, finding_bands, finding_list, plain_table, text
from ipmclab.page.sections.treatment import build_treatment
from ipmclab.page.workshop import Workshop
from ipmclab.store.catalogue.query import STATES, CatalogueRow
from ipmclab.units import CHANNELS


def build(context: Context) -> None:
    """Fill the page."""
    _View(context.workshop).build()


class _View:
    """The table with its filter, and what is chosen in it."""

    def __init__(self, workshop: Workshop) -> None:
        self._workshop = workshop
        self._rows: list[CatalogueRow] = []
        self._curves: str | None = None
        self._asked = 0
        self._reads, self._read = 0, 0  # of the catalogue: how many were begun, and which one is shown
        self._is_looking = True  # until a worker has been through the files

    def build(self) -> None:
        client = ui.context.client
        client.on_delete(lambda: self._workshop.curves.forget(self._curves))
        self._opened = [self._key(name) for name in client.request.query_params.getlist("run")]
        with ui.element("section").classes("lab-card"):
            with ui.element("div").classes("lab-title"):
                text("Runs", tag="h2")
                with ui.element("div").classes("lab-bar"):
                    ui.button("Look again", on_click=self._refresh).props("outline no-caps")
                    ui.button("Import a record", on_click=self._toggle_import).props("unelevated no-caps")
            self._build_filter()
            self._table = RunTable("Runs", {"show": "Show"}, self._show, opens=True)
            self._told = text("").classes("lab-quiet").props("role=status")
        with ui.element("div").classes("lab-full"):
            build_board(self._workshop.lab.laboratory_folder)
        self._import = ui.element("div").classes("lab-full")
        with self._import:
            build_import(self._workshop, self._imported)
        self._import.set_visibility(False)
        self._chosen = ui.element("div").classes("lab-column lab-full")
        ui.timer(0.01, self._begin, once=True)

    def _key(self, name: str) -> str:
        """A run as the table has it: the recorder names its files with their whole path."""
        try:
            return self._workshop.lab.below(name)
        except IpmclabError:
            return name  # what is wrong with it is said where it would be shown

    async def _begin(self) -> None:
        """What the catalogue has, at once; then what has become of the files."""
        await self._read_rows()
        if self._opened:
            self._table.choose("show", self._opened)
            await asyncio.gather(self._show(self._table.chosen), self._refresh())
        else:
            await self._refresh()

    async def _read_rows(self) -> None:
        self._reads += 1
        number = self._reads
        rows = await asyncio.to_thread(self._workshop.runs.rows)
        if number > self._read:  # one that was begun later may have come first
            self._read, self._rows = number, rows
        self._fill_choices()
        self._filter_rows()

    def _build_filter(self) -> None:
        with ui.element("div").classes("lab-bar"):
            self._text = ui.input("Search", on_change=self._filter_rows).props("dense outlined debounce=200 clearable")
            self._sample = self._choice("Sample")
            self._measured = self._choice("Measured")
            self._finding = self._choice("Findings")
            self._state = self._choice("State", {"": "any", **{state: state for state in STATES}})
        self._text.classes("lab-wide")
        self._fill_choices()

    def _choice(self, label: str, options: dict[str, str] | None = None) -> ui.select:
        made = ui.select(options or {"": "any"}, value="", label=label, on_change=self._filter_rows)
        made.props("dense outlined options-dense").classes("lab-choice")
        return made

    def _fill_choices(self) -> None:
        samples = sorted({row.sample for row in self._rows if row.sample})
        measured = [name for name in CHANNELS if any(name in row.measured for row in self._rows)]
        codes = sorted({code for row in self._rows for code in row.codes or () if code != "fingerprint"})
        self._sample.set_options({"": "any", **{name: name for name in samples}})
        self._measured.set_options({"": "any", **{name: CHANNELS[name].name for name in measured}})
        known = {"": "any or none", "none": "none", "any": "at least one", **{code: code for code in codes}}
        self._finding.set_options(known)

    def _filter_rows(self) -> None:
        wanted = RunFilter(
            text=self._text.value or "",
            sample=self._sample.value or "",
            measured=self._measured.value or "",
            finding=self._finding.value or "",
            state=self._state.value or "",
        )
        rows, count = table_rows(self._rows, wanted)
        self._table.show(rows)
        if not self._rows and self._is_looking:
            sentence = "Looking for runs…"
        elif not self._rows:
            sentence = "No runs yet: record one under Run, or import a record."
        else:
            sentence = f"{count} of {len(self._rows)} runs"
            if count > MOST_SHOWN:
                sentence += f", the newest {MOST_SHOWN} are shown"
            if self._is_looking:
                sentence += "; looking for others…"
        self._told.set_text(sentence)

    async def _refresh(self) -> None:
        """Let a worker look at the files, then show what the catalogue has."""
        self._is_looking = True
        self._filter_rows()
        problems: list[dict[str, str]] = []
        try:
            for job in self._workshop.runs.looks():
                while not job.is_over:
                    await asyncio.sleep(0.2)
                    if job.sentence.startswith("run "):
                        self._told.set_text(f"checking {job.sentence}")
                with contextlib.suppress(JobCancelled):  # another window's look took its place
                    problems = (await asyncio.wrap_future(job.future)).document["problems"]
        except IpmclabError as error:
            self._is_looking = False
            self._filter_rows()
            ui.notify(str(error), type="negative")
            return
        self._is_looking = False
        await self._read_rows()
        if problems:
            listed = "; ".join(f"{one['path']}: {one['message']}" for one in problems[:3])
            self._told.set_text(f"{self._told.text}. {len(problems)} files could not be read: {listed}")

    def _toggle_import(self) -> None:
        self._import.set_visibility(not self._import.visible)

    async def _imported(self, key: str) -> None:
        await self._refresh()
        self._table.choose("show", [key])
        await self._show(self._table.chosen)

    async def _copied(self, _: str) -> None:
        """A copy of the shown run was written: it comes into the table, and what is shown stays."""
        await self._refresh()

    async def _show(self, chosen: Chosen) -> None:
        """Draw the chosen runs."""
        self._asked += 1
        asked, keys = self._asked, chosen["show"]
        names = labels(keys)
        self._workshop.curves.forget(self._curves)
        self._chosen.clear()
        if not keys:
            return
        with self._chosen:
            if len(keys) > MOST_COMPARED:
                with card("Compared runs"):
                    text(f"{len(keys)} runs are chosen; {MOST_COMPARED} can be distinguished on one plot.")
                return
        try:
            runs = {
                name: await asyncio.to_thread(self._workshop.runs.read, key)
                for name, key in zip(names, keys, strict=True)
            }
        except IpmclabError as error:
            if asked == self._asked:
                with self._chosen, card("This run cannot be read"):
                    text(str(error)).classes("lab-bad").props("role=alert")
            return
        if asked != self._asked:
            return
        panels = run_panels(runs)
        self._curves = self._workshop.curves.add(panels)
        jobs = None
        if len(keys) == 1:
            path = {"run": str(self._workshop.runs.path(keys[0]))}
            jobs = (self._workshop.jobs.submit("look", path), self._workshop.jobs.submit("about", path))
        with self._chosen, card(names[0] if len(keys) == 1 else f"{len(keys)} runs compared"):
            plot = TimePlot(
                names[0] if len(keys) == 1 else " and ".join(names),
                [panel.as_dict() for panel in panels],
                self._curves,
                height=120 if len(panels) <= 4 else 95,
            )
            _downloads(keys)
        if jobs is not None:
            await self._show_findings(asked, *jobs, plot, [panel.as_dict() for panel in panels])
            if asked == self._asked:
                with self._chosen:
                    build_treatment(self._workshop, keys[0], runs[names[0]], self._copied)

    async def _show_findings(
        self, asked: int, job: Job, about: Job, plot: TimePlot, panels: list[dict[str, Any]]
    ) -> None:
        """What the checks say of the one run that is shown: on the plot where it is, and in words."""
        with self._chosen, card("Findings") as box:
            text("the run is being checked").classes("lab-quiet")
        try:
            document = (await asyncio.wrap_future(job.future)).document
        except JobCancelled:
            return
        except IpmclabError as error:
            document = None
            if asked == self._asked:
                with box:
                    text(str(error)).classes("lab-bad").props("role=alert")
        if document is None or asked != self._asked:
            return
        bands = finding_bands(document["findings"])
        plot.show(panels, self._curves, bands)
        box.clear()
        with box:
            text("Findings", tag="h2")
            finding_list(document["findings"])
        await self._show_about(asked, about)

    async def _show_about(self, asked: int, job: Job) -> None:
        """What the run says of itself, and its metrics."""
        try:
            document = (await asyncio.wrap_future(job.future)).document
        except (JobCancelled, IpmclabError):
            return  # what is wrong with the run is under its findings
        if asked != self._asked:
            return
        with self._chosen, ui.element("div").classes("lab-pair"):
            with card("About this run"):
                plain_table(
                    {"name": "", "value": ""},
                    [{"name": name, "value": value} for name, value in document["facts"]],
                    caption="About this run",
                )
            with card("Metrics"):
                headings = {"channel": "channel", "name": "metric", "value": "value", "unit": "unit"}
                plain_table({**headings, "interval": "95 %"}, document["metrics"], caption="Metrics")


def _downloads(keys: Sequence[str]) -> None:
    runs = urlencode([("run", key) for key in keys])
    with ui.element("div").classes("lab-bar"):
        if len(keys) == 1:
            one = quote(keys[0], safe="")
            download("netCDF", f"/runs/file?run={one}")
            for kind in ("csv", "xlsx", "mat"):
                download(kind.upper(), f"/runs/export?run={one}&kind={kind}")
        for kind in ("svg", "png", "pdf"):
            download(f"Figure {kind.upper()}", f"/runs/figure?{runs}&kind={kind}")
        with ui.element("a").props(f'href="/identify?{runs}"').classes("lab-download"):
            text("Identify from this" if len(keys) == 1 else "Identify from these", tag="span")
        if len(keys) == 1:
            with ui.element("a").props(f'href="/simulate?{runs}"').classes("lab-download"):
                text("Simulate over it", tag="span")
