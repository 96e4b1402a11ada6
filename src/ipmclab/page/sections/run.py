"""Run: an experiment from its choice to its runs, with the bench live."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Coroutine
from dataclasses import replace
from typing import Any, Final

from nicegui import ui
from nicegui.elements.mixins.validation_element import ValidationElement

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.context import Context
from ipmclab.page.elements.time_plot import TimePlot
from ipmclab.page.experiment_form import FIELDS, GROUPS, Draft, FormField, Unsaved
from ipmclab.page.experiments import HARMLESS, Checked, check, experiments, limit_at, preview, rigs, save
from ipmclab.page.sections.parts import sentence

_NEW: Final = ""

_ANSWER: Final = 30.0
"""How long [s] a browser may take to say what it has kept: a busy one is slow while it starts."""

_STEERING: Final = """
<section class="lab-card" id="lab-progress" tabindex="-1" aria-label="The experiment at the bench">
  <div id="lab-plan"></div>
  <div id="lab-outcome"></div>
  <div id="lab-question" aria-live="assertive"></div>
  <div id="lab-steer"></div>
  <p id="lab-run-said" role="status"></p>
</section>
<section class="lab-card" id="lab-climate-card" aria-label="Conditions" hidden><h2>Conditions</h2>
  <div id="lab-climate"></div>
  <div id="lab-equilibrium" hidden>
    <progress aria-label="Within tolerance" max="1" value="0"></progress><span></span></div>
  <ol id="lab-conditions" tabindex="0" aria-label="Each condition in its turn"></ol></section>
<section class="lab-card" id="lab-steps-card" aria-label="Steps">
  <ol id="lab-steps" tabindex="0" aria-label="Steps"></ol>
  <details id="lab-watched"></details>
</section>
<section class="lab-card" id="lab-recorded-card" aria-label="Recorded" hidden><h2>Recorded</h2>
  <ul id="lab-recorded"></ul></section>
<section class="lab-card" id="lab-notes-card" hidden><h2>What happened</h2>
  <ul id="lab-notes" tabindex="0" aria-label="What happened"></ul></section>
"""

_READINGS: Final = """
<section class="lab-card" id="lab-readings" aria-label="Readings">
  <div class="lab-row" id="lab-seat"></div>
  <div class="lab-numbers" id="lab-numbers" aria-live="off"></div>
  <div id="lab-progress-bar" hidden><progress aria-label="Rows read" max="1" value="0"></progress><span></span></div>
</section>
"""


def build(context: Context) -> None:
    """Fill the page."""
    ui.add_head_html('<script defer src="/static/bench.js"></script>')
    ui.add_head_html(f'<script defer src="/static/draft.js" data-lab="{context.lab.mark}"></script>')
    with ui.element("div").classes("lab-columns"):
        with ui.element("div").classes("lab-column"):
            ui.html(_STEERING, sanitize=False).classes("lab-column lab-when-busy lab-spread")
            with ui.element("section").classes("lab-card lab-when-free").props('aria-label="Set up an experiment"'):
                form = _Form(context)
                form.build()
        with ui.element("div").classes("lab-column"):
            form.build_preview()
            ui.html(_READINGS, sanitize=False).classes("lab-second")
            with ui.element("section").classes("lab-card lab-second").props('aria-label="Live plots"'):
                TimePlot("Bench", live=True, height=112)


class _Form:
    """The form of an experiment: every change is looked at, and the voltage drawn again."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._lab = context.lab
        self._seat = context.seat()
        self._draft = Draft.new()
        self._unsaved: Unsaved | None = None
        self._inputs: dict[str, Any] = {}
        self._asked = 0
        self._checked: Checked | None = None
        self._curves: str | None = None
        self._left: str | None = None
        self._filling = False
        self._is_tried = False  # no message for a field not reached yet

    def build(self) -> None:
        """Put the form together."""
        names = experiments(self._lab)
        ui.html("<h2>Experiment</h2>", sanitize=False)
        options = {_NEW: "a new one", **{name: name for name in names}}
        self._choice = ui.select(options, label="Experiment", value=_NEW, on_change=self._choose)
        self._choice.props("dense outlined options-dense").classes("lab-wide")
        with ui.element("div").classes("lab-row lab-remark") as self._back:
            self._reported_back = ui.label().props("role=status")
            ui.button("Drop it", on_click=self._drop).props("outline no-caps dense padding='2px 10px'")
        self._back.set_visibility(False)
        with ui.element("div").classes("lab-fields"):
            for one in FIELDS:
                if one.group == "main":
                    self._field(one)
        for group, title in GROUPS.items():
            with (
                ui.expansion(title).classes("lab-wide lab-fold").props("dense"),
                ui.element("div").classes("lab-fields"),
            ):
                for one in FIELDS:
                    if one.group == group:
                        self._field(one)
        self._message = ui.label().classes("lab-bad").props("role=alert")
        self._name = ui.input("File name", value=self._draft.name).props('dense outlined suffix=".toml"')
        self._name.classes("lab-wide").on("update:model-value", self._rename)
        self._name.on("update:model-value", js_handler=_kept_as("name"))
        with ui.element("div").classes("lab-row"):
            ui.button("Save", on_click=self._save).props("outline no-caps")
            self._prepare_button = ui.button("Check the plan", on_click=self._prepare).props("no-caps unelevated")
        ui.timer(0.05, self._begin, once=True)

    def build_preview(self) -> None:
        """The voltage that the form asks for, and what would be done."""
        self._preview = ui.element("section").classes("lab-card").props('id=lab-preview aria-label="What it will do"')
        with self._preview:
            ui.html("<h2>Voltage that will be applied</h2>", sanitize=False)
            self._plot = TimePlot("Voltage that will be applied", height=150)
            self._summary = ui.label().classes("lab-quiet").props("role=status")

    def _field(self, one: FormField) -> None:
        value = self._draft.values[one.key]
        made: Any

        def picked() -> Coroutine[Any, Any, None] | None:
            return None if self._filling else self._picked(one.key)

        if one.kind == "switch":
            made = ui.switch(one.label, value=bool(value), on_change=picked)
        elif one.kind == "choice":
            made = ui.select(dict(one.choices), label=one.label, value=value, on_change=picked)
        elif one.kind == "rig":
            known = rigs(self._lab)
            options = [*known, *([str(value)] if value not in known else [])]
            made = ui.select(options, label=one.label, value=value, on_change=picked)
        elif one.kind == "lines":
            made = ui.textarea(one.label, value=str(value), on_change=self._typed)
            made.props("autogrow debounce=250 input-style='min-height: 2.6em'")
        else:
            made = ui.input(one.label, value=str(value), on_change=self._typed).props("debounce=250")
        if isinstance(made, ui.input | ui.textarea):
            made.on("update:model-value", js_handler=_kept_as(one.key))
        if one.kind != "switch":
            made.props("dense outlined options-dense").classes("lab-entry")
            if one.hint:
                made.props(f'stack-label placeholder="{one.hint}"')
            if one.kind == "lines" or one.key in ("title", "actuator", "notes"):
                made.classes("lab-wide")
        else:
            made.classes("lab-wide")
        self._inputs[one.key] = made

    async def _begin(self) -> None:
        """Continue with what this browser has kept, if anything, and if nothing was chosen or typed meanwhile."""
        blank = self._draft
        try:
            kept = await ui.run_javascript("LabDraft.kept()", timeout=_ANSWER)
        except TimeoutError:  # it stays kept: reloaded, the page asks again
            kept = None
        unsaved = await asyncio.to_thread(Unsaved.of, self._lab, kept)
        self._take()
        if self._draft != blank:
            return
        if unsaved.draft != unsaved.base or unsaved.origin:
            self._unsaved = unsaved
            self._fill(unsaved.draft, unsaved.origin)
        if unsaved.draft != unsaved.base:
            self._reported_back.text = (
                f"As you left it, not saved yet{f'; {unsaved.problem}' if unsaved.problem else '.'}"
            )
            self._back.set_visibility(True)
        await self._look()

    async def _drop(self) -> None:
        """What was not saved is wanted no more."""
        if self._unsaved is not None:
            self._fill(self._unsaved.base, self._unsaved.origin)
            self._begun(self._unsaved.base)
        await self._look()

    def _begun(self, base: Draft) -> None:
        """Nothing is unsaved: the form shows a file, or a new experiment."""
        self._back.set_visibility(False)
        ui.run_javascript(f"LabDraft.begin({json.dumps(base.name)}, {json.dumps(base.digest)})")

    def _fill(self, draft: Draft, origin: str) -> None:
        self._draft = draft
        self._filling = True
        for key, made in self._inputs.items():
            value = self._draft.values[key]
            if isinstance(made, ui.select) and value not in made.options:
                known = made.options
                made.set_options({**known, value: "as in the file"} if isinstance(known, dict) else [*known, value])
            made.value = value
        self._name.value = self._draft.name
        self._choice.value = origin if origin in self._choice.options else _NEW
        self._filling = False

    def _choose(self) -> Coroutine[Any, Any, None] | None:
        return None if self._filling else self._chosen(self._choice.value or _NEW)

    async def _chosen(self, name: str) -> None:
        try:
            draft = Draft.read(self._lab, name) if name else Draft.new()
        except InputError as error:
            self._message.text = str(error)
            return
        self._fill(draft, name)
        self._begun(draft)
        await self._look()

    async def _picked(self, key: str) -> None:
        """A choice was made, which the browser learns from us: it shows what we answer."""
        if key == "rig":
            await self._propose_limit()
        for one in {key, "limits.current"} if key == "rig" else {key}:
            ui.run_javascript(f"LabDraft.keep({json.dumps(one)}, {json.dumps(self._inputs[one].value)})")
        await self._look()

    async def _propose_limit(self) -> None:
        """Another bench: a limit of the current that nobody chose becomes one whose passing this bench can read."""
        before = str(self._draft.values["rig"])
        proposed = await asyncio.to_thread(limit_at, self._lab, before)
        field = self._inputs["limits.current"]
        if (field.value or "").strip() == proposed:
            self._filling = True
            field.value = await asyncio.to_thread(limit_at, self._lab, str(self._inputs["rig"].value))
            self._filling = False

    def _typed(self) -> Coroutine[Any, Any, None] | None:
        return None if self._filling else self._look()

    def _rename(self) -> None:
        self._name.error = None
        self._take()

    def _take(self) -> None:
        values = {key: made.value if made.value is not None else "" for key, made in self._inputs.items()}
        self._draft = replace(self._draft, values=values, name=(self._name.value or "").strip())

    async def _look(self) -> None:
        """Check the draft, draw its voltage, and say what is wrong at each field."""
        self._take()
        self._asked += 1
        asked, draft = self._asked, self._draft
        checked = await asyncio.to_thread(check, self._lab, draft)
        panels = []
        hidden = {"signals", "duration", "rest_before", "rest_after"} & set(checked.errors)
        if checked.experiment is not None and not (hidden and checked.plan is None and _is_repaired(draft, checked)):
            panels = await asyncio.to_thread(preview, checked.experiment)
        if asked != self._asked:
            return  # something newer is being looked at
        self._checked = checked
        unnamed = {"sample"} if not self._is_tried and not draft.values["sample"] else set()
        self._show_errors({key: text for key, text in checked.errors.items() if key not in unnamed})
        store = self._context.workshop.curves
        store.forget(self._left)  # not the ones of just now: the browser may be fetching them
        self._left, self._curves = self._curves, store.add(panels) if panels else None
        self._plot.show([panel.as_dict() for panel in panels], self._curves)
        self._preview.props["data-name"] = draft.name  # shown beside a plan of this name too
        self._preview.update()
        self._summary.text = _summary(checked) if panels else "It is drawn once the fields that are marked are correct."

    def _show_errors(self, errors: Any) -> None:
        for key, made in self._inputs.items():
            if isinstance(made, ValidationElement):
                made.error = errors.get(key)
        others = [text for key, text in errors.items() if not isinstance(self._inputs.get(key), ValidationElement)]
        self._message.text = "; ".join(others)

    async def _save(self) -> bool:
        self._take()
        try:
            path = save(self._lab, self._draft)
        except IpmclabError as error:
            if error.code != "file-exists":
                self._name.error = f"{error.message}; {error.repair}"
                return False
            # Focus may leave it: STOP and ZERO stay in reach of the keyboard.
            with ui.dialog().props('allow-focus-outside aria-label="Replace a file"') as dialog, ui.card():
                ui.label(f"{error.message}. Replace it?")
                with ui.row():
                    ui.button("Replace it", on_click=lambda: dialog.submit(True)).props("no-caps")
                    ui.button("Leave it", on_click=lambda: dialog.submit(False)).props("no-caps flat")
            if not await dialog:
                self._name.error = "give another name"
                return False
            path = save(self._lab, self._draft, replace=True)
        self._name.error = None
        if path.stem not in self._choice.options:
            self._choice.set_options({_NEW: "a new one", **{name: name for name in experiments(self._lab)}})
        self._filling = True
        self._choice.value = path.stem  # the form shows this one from now on
        self._filling = False
        self._begun(Draft.read(self._lab, path.stem))
        return True

    def _look_at_name(self) -> bool:
        """Whether the file can be called that; what is wrong is at its field."""
        self._name.error = None
        if not self._draft.name:
            self._name.error = "give the experiment a file name, such as step-1V"
            return False
        try:
            self._lab.new_file(self._draft.name, ".toml")
        except InputError as error:
            self._name.error = f"{error.message}; {error.repair}"
            return False
        return True

    async def _prepare(self) -> None:
        """Save, and let the recorder plan it: it then waits for the start."""
        self._is_tried = True
        await self._look()
        is_named = self._look_at_name()
        if self._checked is None or self._checked.errors:
            self._message.text = self._message.text or "correct the fields that are marked"
            return
        if not is_named or not await self._save():
            return
        self._prepare_button.disable()
        try:
            job = {"experiment": str(self._lab.new_file(self._draft.name, ".toml"))}
            await asyncio.to_thread(self._context.bench.prepare, self._seat, job)
        except IpmclabError as error:
            self._refuse(error)
        finally:
            self._prepare_button.enable()

    def _refuse(self, error: IpmclabError) -> None:
        """Say what the recorder refuses at the field that it belongs to."""
        place = error.where.rpartition(": ")[2]
        field = self._inputs.get("actuator" if place == "stages" else place)
        if isinstance(field, ValidationElement):
            field.error = sentence(error)
            self._message.text = "correct the fields that are marked"
        else:
            self._message.text = str(error)


def _kept_as(key: str) -> str:
    """What the browser does by itself when a field is typed in."""
    return f"(value) => LabDraft.keep({json.dumps(key)}, value)"


def _is_repaired(draft: Draft, checked: Checked) -> bool:
    """Whether what is drawn would be something else than what is in the form."""
    assert checked.experiment is not None
    lines = [line for line in str(draft.values["signals"]).splitlines() if line.strip()]
    planned = [str(signal) for signal in checked.experiment.signals]
    is_none = "signals" in checked.errors and planned == [HARMLESS]
    return (
        is_none
        or len(lines) != len(planned)
        or any(key in checked.errors for key in ("duration", "rest_before", "rest_after"))
    )


def _summary(checked: Checked) -> str:
    """What would be done, in a line."""
    if checked.plan is None:
        return ""
    plan = checked.plan
    minutes, seconds = divmod(round(plan.seconds), 60)
    runs = [run for run in plan.runs if run.purpose != "fingerprint"]
    lasts = f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
    rows = sum(run.rows for run in plan.runs)
    remarks = [remark[:1].upper() + remark[1:] for remark in plan.remarks]
    facts = [f"{len(runs)} run{'s' * (len(runs) != 1)}, at least {lasts}, {rows} rows on {plan.rig.name}", *remarks]
    return ". ".join(facts)
