"""Report: everything about a fit in one file, made here, opened here, and taken along."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from nicegui import ui

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.commands import Step, report_step
from ipmclab.page.context import Context
from ipmclab.page.elements.checks import Checks
from ipmclab.page.jobs.jobs import JobCancelled
from ipmclab.page.run_table import runs_in_words
from ipmclab.page.sections.parts import card, download, fail_at, step_view, text
from ipmclab.page.workshop import Workshop

_NEXT: Final = 0.25  # s between looks at the job


def build(context: Context) -> None:
    """Fill the page."""
    _View(context.workshop).build()


class _View:
    def __init__(self, workshop: Workshop) -> None:
        self._workshop = workshop

    def build(self) -> None:
        asked = ui.context.client.request.query_params.get("fit")
        with ui.element("div").classes("lab-columns"):
            with ui.element("div").classes("lab-column"), card("Make a report"):
                fits = self._workshop.every_fit()
                self._fit = ui.select(fits, value=asked if asked in fits else None, label="Fit", on_change=self._choose)
                self._fit.props("dense outlined options-dense")
                self._runs = ui.element("div").classes("lab-quiet")
                self._unseen = Checks("Runs to predict", {}, self._show)
                self._unseen.set_visibility(False)
                self._name = ui.input("File name", value="report", on_change=self._show)
                self._name.props("dense outlined suffix=.html debounce=300")
                self._over = ui.switch("replace a report of this name", value=False)
                self._make = ui.button("Make the report", on_click=self._write).props("unelevated no-caps")
                self._progress = text("").classes("lab-quiet").props("role=status")
                self._message = text("").classes("lab-bad").props("role=alert")
                if asked and asked not in fits:
                    self._message.set_text("This fit is no longer kept: choose another, or identify again.")
                elif not fits:
                    self._message.set_text("No fit yet: make one under Identify.")
            with ui.element("div").classes("lab-column"):
                with card("Reports of this folder"):
                    self._list = ui.element("ul").classes("lab-reports")
                with card("The same without the page"):
                    self._step = step_view()
        self._used: list[str] = []
        self._show_reports()
        ui.timer(0.01, self._choose, once=True)

    async def _choose(self) -> None:
        """Find the runs that the fit was made from."""
        fail_at(self._fit, None)
        self._used = []
        if not self._fit.value:
            return
        self._message.set_text("")
        try:
            self._used, missing = await asyncio.to_thread(self._workshop.runs_of_fit, self._fit.value)
        except IpmclabError as error:
            fail_at(self._fit, error)
            return
        if missing:
            fail_at(
                self._fit,
                f"it was made from {', '.join(missing)}, which this folder lacks; copy the run files into it, "
                "and look again under Runs",
            )
        known = runs_in_words(await asyncio.to_thread(self._workshop.runs.rows))
        self._show_used(known)
        others = {key: words or key for key, words in known.items() if key not in self._used}
        one = self._workshop.fit(self._fit.value)
        held = [key for key in one.asked.held if key in others] if one is not None else []
        self._unseen.offer(others, held, {key: key for key, words in others.items() if words != key})
        self._unseen.set_visibility(bool(others))
        self._show()

    def _show_used(self, known: Mapping[str, str]) -> None:
        self._runs.clear()
        if not self._used:
            return
        with self._runs:
            text("Made from", tag="span")
            with ui.element("ul").classes("lab-made-from"):
                for key in self._used:
                    with ui.element("li"):
                        text(known.get(key) or key, tag="span")
                        if known.get(key):
                            text(key, tag="small")

    def _show(self) -> None:
        if self._fit.value:
            self._step(self._last_step())

    def _last_step(self) -> Step:
        file = self._workshop.steps.file_name(self._fit.value)
        stem = (self._name.value or "").strip().removesuffix(".html") or "report"
        step = report_step(file, self._used, self._unseen.chosen, f"{stem}.html")
        return self._workshop.steps.repeatable(step, [self._fit.value])

    async def _write(self) -> None:
        self._message.set_text("")
        self._unseen.complain("")
        fail_at(self._name, None)
        if not self._fit.value:
            fail_at(self._fit, "choose a fit")
            return
        if self._fit.error:
            return
        try:
            path = self._workshop.lab.new_file(self._name.value or "", ".html")
            if path.exists() and not self._over.value:
                raise InputError(
                    f"{path.name} exists already",
                    code="file-exists",
                    repair="choose another name, or allow replacing it",
                )
        except IpmclabError as error:
            fail_at(self._name, error)
            return
        found = self._find()
        if found is None:
            return
        arguments = {
            **found,
            "out": str(path),
            "command": self._last_step().command,
            "overwrite": bool(self._over.value),
        }
        job = self._workshop.jobs.submit("report", arguments, title=path.name)
        self._make.disable()
        try:
            while not job.is_over:
                self._progress.set_text(f"{job.sentence or job.state} ({job.seconds:.0f} s)")
                await asyncio.sleep(_NEXT)
            await asyncio.wrap_future(job.future)
            self._progress.set_text(f"wrote {path.name}")
        except JobCancelled:
            self._progress.set_text("cancelled")
        except IpmclabError as error:
            self._progress.set_text("")
            self._message.set_text(str(error))
        finally:
            self._make.enable()
        self._show_reports()

    def _find(self) -> dict[str, Any] | None:
        """The files of the fit and of the runs; None where one of them is gone, which is said where it was chosen."""
        try:
            fit = self._workshop.actuator_path(self._fit.value)
            if not Path(fit).is_file():
                raise InputError(
                    f"there is no file {self._fit.value!r} any more",
                    code="no-such-file",
                    repair="choose another fit, or put it back",
                )
            runs = [str(self._workshop.runs.path(key)) for key in self._used]
        except IpmclabError as error:
            fail_at(self._fit, error)
            return None
        try:
            validation = [str(self._workshop.runs.path(key)) for key in self._unseen.chosen]
        except IpmclabError as error:
            self._unseen.complain(f"{error.message}; choose it no longer, or put it back")
            return None
        return {"fit": fit, "runs": runs, "validation": validation}

    def _show_reports(self) -> None:
        self._list.clear()
        with self._list:
            names = self._workshop.reports()
            if not names:
                with ui.element("li"):
                    text("None yet.", tag="span").classes("lab-quiet")
            for name in names:
                with ui.element("li").classes("lab-title"):
                    with ui.element("a").props(f'href="/reports/{quote(name)}" target=_blank rel=noopener'):
                        text(name, tag="span")
                    written = datetime.fromtimestamp((self._workshop.lab.root / name).stat().st_mtime)
                    text(f"{written:%Y-%m-%d %H:%M}", tag="span").classes("lab-quiet")
                    download("Download", f"/reports/{quote(name)}?save=true")
