"""Simulate: what a strip would do, at every position of the sliders."""

from __future__ import annotations

import asyncio
from typing import Any

from nicegui import ui

from ipmclab.errors import IpmclabError
from ipmclab.page.commands import simulate_step
from ipmclab.page.context import Context
from ipmclab.page.elements.simulator import Simulator
from ipmclab.page.sections.parts import card, fail_at, step_view
from ipmclab.page.workshop import labels


def build(context: Context) -> None:
    """Fill the page."""
    workshop = context.workshop
    asked = ui.context.client.request.query_params
    ui.add_head_html('<script defer src="/static/simulate.js"></script>')
    state: dict[str, Any] = {"changes": {}}
    with ui.element("section").classes("lab-card lab-bar"):
        actuator = ui.input(
            "Actuator, also with stages: friend-2+leak.cubic",
            value=asked.get("actuator", "friend-2"),
            autocomplete=list(workshop.actuators()),
        )
        actuator.props("dense").classes("lab-wide")
        load = ui.button("Load").props("unelevated no-caps")
        name = ui.input("Save changed actuator as").props("dense").classes("lab-name")
        save = ui.button("Save").props("outline no-caps")
    host = ui.element("div").classes("lab-full")
    with card("The same without the page"):
        step = step_view()

    def tell(question: dict[str, Any]) -> None:
        state.update(question)
        try:
            told = simulate_step(
                actuator.value,
                question["changes"],
                signal=question["signal"],
                duration=float(question["duration"] or 0.0),
                rate=float(question["rate"] or 0.0),
                run=question["run"] or None,
            )
        except ValueError:
            return
        step(told)

    async def show() -> None:
        from ipmclab import load_actuator

        fail_at(actuator, None)
        try:
            loaded = await asyncio.to_thread(load_actuator, workshop.actuator_path(actuator.value.strip()))
        except IpmclabError as error:
            fail_at(actuator, error)
            return
        runs = await listed()
        host.clear()
        with host:
            view = Simulator(actuator.value.strip(), loaded, runs=runs, run=asked.get("run"), on_asked=tell)
        await workshop.looked()
        if (now := await listed()) != runs:
            view.set_runs(now)

    async def listed() -> list[tuple[str, str]]:
        keys = await asyncio.to_thread(workshop.run_keys)
        return list(zip(keys, labels(keys), strict=True))

    async def keep() -> None:
        from ipmclab import load_actuator, write_actuator

        fail_at(name, None)
        try:
            path = context.lab.new_file(name.value or "", ".toml")
            loaded = await asyncio.to_thread(load_actuator, workshop.actuator_path(actuator.value.strip()))
            write_actuator(loaded.replace(**state["changes"]), path)
        except IpmclabError as error:
            fail_at(name, error)
            return
        ui.notify(f"wrote {path.name}", type="positive")

    load.on_click(show)
    actuator.on("keydown.enter", show)
    save.on_click(keep)
    ui.timer(0.01, show, once=True)
