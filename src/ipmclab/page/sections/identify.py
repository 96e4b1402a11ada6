"""Identify: from runs to a model of the strip, with what is known and what is not, and what it predicts."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Collection
from typing import Any, Final

from nicegui import ui

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.commands import identify_step
from ipmclab.page.context import Context
from ipmclab.page.elements.free_table import FreeTable
from ipmclab.page.elements.run_table import Chosen, RunTable
from ipmclab.page.fit_cards import FitCard, FitRequest
from ipmclab.page.run_table import RunFilter, table_rows
from ipmclab.page.sections.fit_view import FitView
from ipmclab.page.sections.kept import Kept, texts
from ipmclab.page.sections.next_runs import NextRunsView
from ipmclab.page.sections.parts import card, fail_at, sentence, step_view, text
from ipmclab.page.sections.prediction import PredictionView
from ipmclab.page.sections.running_fit import RunningFit

_PERIOD: Final = 0.25  # s between looks at the jobs
_STATE_MOUNTING: Final = "state its mounting where it is recorded or imported, or choose “free per run”"


def build(context: Context) -> None:
    """Fill the page."""
    _View(context).build()


class _View:
    """The form, the jobs, and the fit that is shown."""

    def __init__(self, context: Context) -> None:
        self._workshop = context.workshop
        self._kept = Kept(context)
        self._awaited: FitCard | None = None  # is shown once it is over, unless another is shown before
        self._told: dict[str, tuple[Any, ...]] = {}
        self._cards: dict[str, ui.element] = {}
        self._running: dict[str, RunningFit] = {}
        self._rows: list[dict[str, Any]] = []

    def build(self) -> None:
        client = ui.context.client
        self._opened = client.request.query_params.getlist("run")
        with card("Runs"):
            self._table = RunTable(
                "Runs to identify from, and runs to predict",
                {"fit": "Fit", "held": "Predict"},
                self._chose,
                columns=("file", "recorded", "sample", "mounting", "signal", "measured", "duration", "findings"),
            )
            self._count = text("").classes("lab-quiet").props("role=status")
            self._missing = text("").classes("lab-bad").props("role=alert")
        with ui.element("div").classes("lab-columns"):
            with ui.element("div").classes("lab-column"):
                self._build_form()
                self._build_jobs()
                self._build_step()
            with ui.element("div").classes("lab-column"):
                self._fit = FitView(self._workshop, self._kept, self._refill)
                self._fit.build()
                self._prediction = PredictionView(self._workshop, self._kept, lambda: self._table.chosen["held"])
                self._prediction.build()
                self._next = NextRunsView(self._workshop, self._kept)
                self._next.build()
        for name, field in (("actuator", self._actuator), ("name", self._name)):
            self._kept.keep(name, field)
        for name, table in (("runs", self._table), ("free", self._free)):
            self._kept.keep(name, table, "chosen")
        client.on_delete(self._fit.forget)
        client.on_delete(self._prediction.forget)
        ui.timer(0.01, self._begin, once=True)

    def _build_form(self) -> None:
        with card("Model"):
            self._actuator = ui.input(
                "Actuator, also with stages: friend-2+leak.cubic",
                value="friend-2",
                autocomplete=list(self._workshop.actuators()),
                on_change=self._read_names,
            ).props("dense outlined debounce=300")
            self._free = FreeTable(self._show_step)
            self._offered = self._workshop.next_name()
            self._name = ui.input("Name of the fit", value=self._offered, on_change=self._show_step)
            self._name.props("dense outlined")
            self._message = text("").classes("lab-bad").props("role=alert")
            ui.button("Identify", on_click=self._identify).props("unelevated no-caps")

    def _build_step(self) -> None:
        with card("The same without the page"):
            self._step = step_view()

    def _build_jobs(self) -> None:
        with card("Fits of this session"):
            self._jobs = ui.element("div").classes("lab-column")
            self._none = text("None yet.").classes("lab-quiet")
        ui.timer(_PERIOD, self._look_at_jobs)

    def _offer_name(self) -> None:
        """Another name, where nobody wrote one: that of the last offer may have been taken, also in another browser."""
        is_own = self._name.value != self._offered
        self._offered = self._workshop.next_name()
        if not is_own:
            self._name.value = self._offered

    async def _begin(self) -> None:
        kept = await self._kept.values()
        await self._read_rows()
        self._choose_opened()
        self._continue(kept)
        self._chose(self._table.chosen)
        await self._read_names()
        self._fit.go_on(kept)
        at_work = [one for one in self._workshop.fits if not one.job.is_over]
        done = [one for one in self._workshop.fits if one.frame is not None]
        if done:
            self._show(done[-1])
        self._awaited = at_work[-1] if at_work else None
        self._prediction.go_on(kept)
        self._next.go_on(kept)
        await self._workshop.runs.looked()
        await self._read_rows()
        if not self._rows:
            self._count.set_text("No runs yet: record one under Run, or import one under Runs.")

    async def _read_rows(self) -> None:
        self._rows = [row for row in (await asyncio.to_thread(self._table_rows)) if row["key"]]
        self._table.show(self._rows)

    def _choose_opened(self) -> None:
        """Choose the runs that the address names, and say which of them there are not."""
        found, missing = [], []
        for name in self._opened:
            try:
                found.append(self._workshop.lab.below(self._workshop.runs.path(name)))
            except InputError as error:
                missing.append(error.message)
        self._missing.set_text("; ".join(missing))
        self._missing.set_visibility(bool(missing))
        if found:
            self._table.choose("fit", list(dict.fromkeys(found)))

    def _continue(self, kept: dict[str, Any]) -> None:
        """The form as this window left it; a run that is gone is chosen no longer."""
        for name, field in (("actuator", self._actuator), ("name", self._name)):
            if isinstance(kept.get(name), str):
                field.value = kept[name]
        if (free := texts(kept.get("free"), tuple(self._free.chosen))) is not None:
            self._free.choose(free)
        for role, keys in (texts(kept.get("runs"), tuple(self._table.chosen)) or {}).items():
            self._table.choose(role, [key for key in keys if self._is_there(key)])

    def _is_there(self, key: str) -> bool:
        try:
            self._workshop.runs.path(key)
        except InputError:
            return False
        return True

    def _table_rows(self) -> list[dict[str, Any]]:
        return table_rows(self._workshop.runs.rows(), RunFilter())[0]

    def _chose(self, chosen: Chosen) -> None:
        fit, held = len(chosen["fit"]), len(chosen["held"])
        self._count.set_text(f"{fit} to identify from, {held} to predict")
        self._show_step()

    async def _read_names(self) -> None:
        """The parameters of the actuator, to be freed by name."""
        from ipmclab import load_actuator

        fail_at(self._actuator, None)
        name = self._actuator.value
        try:
            path = self._workshop.actuator_path((name or "").strip())
            actuator = await asyncio.to_thread(load_actuator, path)
        except IpmclabError as error:
            fail_at(self._actuator, error)
            return
        if name == self._actuator.value:  # else another was written meanwhile
            self._free.offer(actuator)
            self._show_step()

    def _request(self) -> FitRequest:
        chosen, free = self._table.chosen, self._free.chosen
        return FitRequest(
            name=(self._name.value or "").strip() or self._offered,
            actuator=(self._actuator.value or "").strip(),
            runs=tuple(chosen["fit"]),
            free=tuple(free["free"]),
            per_run=tuple(free["per_run"]),
            per_mounting=tuple(free["per_mounting"]),
            prior=tuple(free["prior"]),
            held=tuple(chosen["held"]),
        )

    def _show_step(self) -> None:
        asked, name = self._request(), self._offered
        with contextlib.suppress(InputError):  # shown when it is asked for
            self._workshop.refuse_name(asked.name)
            name = asked.name
        step = identify_step(
            self._workshop.steps.file_name(asked.actuator),
            asked.runs or ("RUN.nc",),
            asked.free if asked.free or asked.per_run or asked.per_mounting else ("NAMES",),
            asked.per_run,
            asked.per_mounting,
            asked.prior,
            out=f"{name.replace(' ', '-')}.toml",
        )
        self._step(self._workshop.steps.repeatable(step, [asked.actuator]))

    def _identify(self) -> None:
        self._message.set_text("")
        self._free.complain("")
        fail_at(self._name, None)
        self._offer_name()
        asked = self._request()
        if not asked.runs:
            self._message.set_text("Choose a run to identify from: the box “Fit” in the table.")
            return
        if not (asked.free or asked.per_run or asked.per_mounting):
            self._free.complain("Nothing is free: choose a group such as electrical, or parameters.")
            return
        try:
            self._awaited = self._workshop.identify(asked)
        except IpmclabError as error:
            fields = {"name": self._name, "actuator": self._actuator}
            if error.where in fields:
                fail_at(fields[error.where], error)
            else:
                self._message.set_text(str(error))
            return
        self._name.value = self._offered  # a name of one's own is given once
        self._kept.forget("name")
        self._look_at_jobs()

    def _look_at_jobs(self) -> None:
        """Draw the fits to which something happened, and show the one that was waited for."""
        fits = self._workshop.fits
        # Not when a fit that waited begins: what is pressed just then stays where it is.
        now = {one.key: (one.job.state if one.job.is_over else "", one.job.is_over, one.saved) for one in fits}
        if now != self._told:
            self._offer_name()
            self._draw_jobs({key for key, state in now.items() if self._told.get(key) != state})
            self._told = now
        for one in fits:
            if one.key in self._running and not one.job.is_over:
                self._running[one.key].look()
        if self._awaited is not None and self._awaited.job.is_over:
            self._show(self._awaited)

    def _draw_jobs(self, changed: Collection[str]) -> None:
        """Draw some fits again, the newest first; the others stay, so that a click on them finds its button."""
        fits = self._workshop.fits
        self._none.set_visibility(not fits)
        for key in self._cards.keys() - {one.key for one in fits}:
            self._cards.pop(key).delete()
        for one in fits:
            if one.key not in self._cards:
                with self._jobs:
                    self._cards[one.key] = ui.element("div").classes("lab-job")
                self._cards[one.key].move(target_index=0)
            if one.key in changed:
                self._running.pop(one.key, None)
                self._cards[one.key].clear()
                with self._cards[one.key]:
                    self._draw_job(one)

    def _draw_job(self, one: FitCard) -> None:
        with ui.element("div").classes("lab-title"):
            text(one.asked.name, tag="strong")
            if not one.job.is_over:
                button = ui.button("Cancel", on_click=lambda: self._workshop.jobs.cancel(one.job))
                button.props("outline no-caps dense")
            elif one.frame is not None:
                ui.button("Show", on_click=lambda: self._show(one)).props("outline no-caps dense")
        if not one.job.is_over:
            self._running[one.key] = RunningFit(one, self._workshop.jobs)
        else:
            text(_outcome(one)).classes("lab-bad" if one.job.state == "failed" else "lab-quiet")

    def _show(self, one: FitCard) -> None:
        self._awaited = None
        error = one.job.error
        if error is not None:
            if error.code == "no-mounting":  # whose run says of which it is not, the name shows it
                self._free.complain(f"{error.where}: {error.message}; {_STATE_MOUNTING}")
            elif error.where.startswith(("free", "per_run", "per_mounting", "prior")):
                self._free.complain(sentence(error))
            else:
                self._message.set_text(f"{one.asked.name}: {error}")
            return
        if one.frame is None:
            return
        self._fit.show(one)
        self._prediction.offer(one)
        self._next.offer(one)

    def _refill(self) -> None:
        """A fit was saved: it can be chosen as an actuator."""
        self._actuator.set_autocomplete(list(self._workshop.actuators()))
        self._prediction.refill()
        self._next.refill()
        self._show_step()


def _outcome(one: FitCard) -> str:
    error = one.job.error
    if error is not None:
        return f"failed: {error.where + ': ' if error.where else ''}{sentence(error)}"
    if one.frame is None:
        return "cancelled"
    document = one.frame.document
    open_ones = sum(not row["determined"] for row in document["parameters"])
    known = f"{document['free'] - open_ones} of {document['free']} parameters determined"
    saved = f", saved as {one.saved}" if one.saved else ""
    return f"{'' if document['converged'] else 'did not converge, '}{known}, {one.job.seconds:.1f} s{saved}"
