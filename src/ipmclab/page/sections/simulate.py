"""Simulate: what a strip would do, at every position of the sliders."""

from __future__ import annotations

import asyncio
from typing import Any

from nicegui import ui

from ipmclab.errors import InputError, IpmclabError
from ipmclab.model import Actuator, load_actuator, write_actuator
from ipmclab.page.commands import simulate_step
from ipmclab.page.context import Context
from ipmclab.page.elements.simulator import Simulator
from ipmclab.page.jobs.tasks.simulate import stamp
from ipmclab.page.replay import Replay
from ipmclab.page.run_table import runs_in_words
from ipmclab.page.sections.kept import Kept
from ipmclab.page.sections.parts import card, fail_at, step_view, text


def build(context: Context) -> None:
    """Fill the page."""
    _View(context).build()


class _View:
    """The actuator that is loaded, and the sliders on it."""

    def __init__(self, context: Context) -> None:
        self._workshop = context.workshop
        self._kept = Kept(context)
        self._loaded: tuple[str, Actuator, Simulator] | None = None
        self._told = 0

    def build(self) -> None:
        asked = ui.context.client.request.query_params
        self._run, key = asked.get("run"), asked.get("fit", "")
        fit = self._workshop.fit(key)
        ui.add_head_html('<script defer src="/static/simulate.js"></script>')
        with ui.element("section").classes("lab-card lab-bar"):
            self._actuator = ui.input(
                "Actuator, also with stages: friend-2+leak.cubic",
                value=fit.asked.name if fit is not None else asked.get("actuator", "" if key else "friend-2"),
                autocomplete=list(self._workshop.actuators()),
            )
            self._actuator.props("dense").classes("lab-wide lab-enters").on("keydown.enter", self._load)
            ui.button("Load", on_click=self._load).props("unelevated no-caps")
            self._name = ui.input("Save changed actuator as").props("dense").classes("lab-name")
            ui.button("Save", on_click=self._save).props("outline no-caps")
        self._missing = text("").classes("lab-bad").props("role=alert")
        self._show_missing(
            "This fit is no longer kept: load another actuator, or identify again." if key and not fit else ""
        )
        self._host = ui.element("div").classes("lab-full")
        with card("The same without the page"):
            self._step = step_view()
        for name, field in (("actuator", self._actuator), ("name", self._name)):
            self._kept.keep(name, field)
        ui.timer(0.01, self._begin, once=True)

    async def _begin(self) -> None:
        """What this window had loaded, with the run that it was laid over; the browser moves the sliders itself."""
        kept = await self._kept.values()
        view = kept.get("view")
        if isinstance(view, dict) and isinstance(view.get("actuator"), str):
            run = view.get("run")
            self._actuator.value, self._run = view["actuator"], run if isinstance(run, str) and run else None
        if isinstance(kept.get("name"), str):
            self._name.value = kept["name"]
        await self._load()
        if self._loaded is not None and isinstance(kept.get("actuator"), str):
            self._actuator.value = kept["actuator"]

    async def _load(self) -> None:
        fail_at(self._actuator, None)
        name = (self._actuator.value or "").strip()
        try:
            path = self._workshop.actuator_path(name)
            stamped = stamp(path)
            loaded = await asyncio.to_thread(load_actuator, path)
        except IpmclabError as error:
            fail_at(self._actuator, error)
            return
        self._show_missing("")
        fit = self._workshop.fit(name)
        if fit is not None:  # by its key, for in a later session another fit may have its name
            name, self._actuator.value = fit.key, fit.asked.name
        runs = await self._runs()
        if self._run is not None:
            runs = await self._find_run(runs)
        self._host.clear()
        with self._host:
            view = Simulator(name, loaded, runs=runs, run=self._run, stamp=stamped, on_asked=self._answer)
        self._loaded = (name, loaded, view)
        await self._workshop.runs.looked()
        if (now := await self._runs()) != runs:
            view.set_runs(now)

    def _show_missing(self, words: str) -> None:
        """What the address names and there is not."""
        self._missing.set_text(words)
        self._missing.set_visibility(bool(words))

    async def _find_run(self, runs: list[tuple[str, str]]) -> list[tuple[str, str]]:
        """The runs that can be laid over, with the one that the address names; that there is none such is said."""
        try:
            self._run = self._workshop.lab.below(self._workshop.runs.path(self._run or ""))
        except IpmclabError as error:
            self._show_missing(f"{error.message}: the voltage is that of a step instead.")
            self._run = None
            return runs
        if self._run not in dict(runs):  # recorded or copied just now
            await self._workshop.runs.looked()
            runs = await self._runs()
        return runs

    async def _runs(self) -> list[tuple[str, str]]:
        known = runs_in_words(await asyncio.to_thread(self._workshop.runs.rows))
        return [(key, f"{words} – {key}" if words else key) for key, words in known.items()]

    async def _answer(self, question: dict[str, Any]) -> None:
        if self._loaded is None:
            return
        name, loaded, _ = self._loaded
        self._told += 1
        told = self._told
        try:
            over = await asyncio.to_thread(self._replay, question["run"]) if question["run"] else None
            if told != self._told:
                return  # something newer is shown
            step = simulate_step(
                self._workshop.steps.file_name(name),
                question["changes"],
                signal=question["signal"],
                duration=float(question["duration"] or 0.0),
                rate=float(question["rate"] or 0.0),
                run=over,
                is_fit=loaded.fit_table is not None,
            )
        except (ValueError, IpmclabError):
            return  # the view says what is wrong
        self._step(self._workshop.steps.repeatable(step, [name]))

    def _replay(self, key: str) -> Replay:
        """What a step over a run has to know of it. May take as long as to read it."""
        return Replay.of(key, self._workshop.runs.read(key))

    async def _save(self) -> None:
        fail_at(self._name, None)
        try:
            path = self._workshop.new_actuator(self._name.value or "")
            if self._loaded is None:
                raise InputError("no actuator is loaded", code="no-actuator", repair="load one")
            _, actuator, view = self._loaded
            write_actuator(self._changed(actuator, view, await view.changes()), path)
        except IpmclabError as error:
            fail_at(self._name, error)
            return
        ui.notify(f"wrote {path.name}", type="positive")

    @staticmethod
    def _changed(actuator: Actuator, view: Simulator, changes: dict[str, float]) -> Actuator:
        """The actuator as the sliders say; what it refuses is said at the field of the parameter too.

        Raises
        ------
        InputError
        """
        try:
            return actuator.replace(**changes)
        except InputError as error:
            view.complain(error)
            raise
