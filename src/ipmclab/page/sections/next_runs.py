"""Which runs to record next: the information of each on a fitted strip for its time on the bench."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any, Final

from nicegui import ui

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.commands import next_step
from ipmclab.page.fit_cards import FitCard
from ipmclab.page.jobs.jobs import JobCancelled
from ipmclab.page.lab import files_of
from ipmclab.page.sections.kept import Kept
from ipmclab.page.sections.parts import card, fail_at, plain_table, sentence, step_view, text
from ipmclab.page.workshop import Workshop
from ipmclab.signals import parse
from ipmclab.units import CURRENT, TIME, VOLTAGE, Quantity, parse_quantity

_GOALS: Final = {
    "parameters": "narrow the parameters",
    "prediction": "predict signals better",
    "model": "distinguish it from another model",
}
_RUNS: Final = {
    "run": "run",
    "signal": "signal",
    "duration": "for",
    "bench": "on the bench",
    "gain": "gain each minute [nats]",
    "remark": "",
}
_EXPECTED: Final = {
    "name": "parameter",
    "value": "value",
    "now": "95 % interval now",
    "after": "after these runs",
    "unit": "unit",
}


class NextRunsView:
    """The form of ``ipmclab next FIT``, and its answer.

    Parameters
    ----------
    workshop : Workshop
    kept : Kept
        What the browser keeps of the section.
    """

    def __init__(self, workshop: Workshop, kept: Kept) -> None:
        self._workshop = workshop
        self._kept = kept
        self._asked = 0

    def build(self) -> None:
        """Make the form."""
        with card("Which run next", place="next"):
            text("The runs that give most information on a strip, for their time on the bench.").classes("lab-quiet")
            with ui.element("div").classes("lab-bar"):
                self._fit = ui.select(self._workshop.every_fit(), label="Fit to ask")
                self._fit.props("dense outlined options-dense").classes("lab-wide")
                self._goal = ui.select(_GOALS, value="parameters", label="What for", on_change=self._chose_goal)
                self._goal.props("dense outlined options-dense").classes("lab-wide")
            with ui.element("div").classes("lab-bar"):
                self._minutes = self._field("Time on the bench", "15 min")
                self._voltage = self._field("Largest voltage", "1.2 V")
                self._current = self._field("Largest current, if any", "")
                self._longest = self._field("Longest signal", "160 s")
            self._inputs = ui.textarea("Signals to predict, one a line", value="sine 1 V 0.1 Hz for 40 s")
            self._inputs.props("dense outlined autogrow")
            self._rival = self._field("Other model: a stage such as leak.exponential, or a fit of this strip", "")
            ui.button("Propose runs", on_click=self._propose).props("unelevated no-caps")
            self._message = text("").props("role=status").classes("lab-quiet")
            self._box = ui.element("div").classes("lab-column")
        self._chose_goal()
        for name, field in {"goal": self._goal, **self._fields()}.items():
            self._kept.keep(f"next {name}", field)

    def go_on(self, kept: Mapping[str, Any]) -> None:
        """The form as this window left it."""
        for name, field in self._fields().items():
            said = kept.get(f"next {name}")
            if isinstance(said, str):
                field.value = said
        goal = kept.get("next goal")
        goals = {label: name for name, label in _GOALS.items()}
        if isinstance(goal, dict) and goal.get("label") in goals:
            self._goal.value = goals[goal["label"]]

    def offer(self, one: FitCard) -> None:
        """Ask of a fit that is shown."""
        self.refill()
        self._fit.value = one.key

    def refill(self) -> None:
        """The fits may have become more."""
        self._fit.set_options(self._workshop.every_fit())

    def _field(self, label: str, value: str) -> ui.input:
        return ui.input(label, value=value).props("dense outlined")

    def _fields(self) -> dict[str, ui.input | ui.textarea]:
        return {
            "minutes": self._minutes,
            "voltage": self._voltage,
            "current": self._current,
            "longest": self._longest,
            "inputs": self._inputs,
            "rival": self._rival,
        }

    def _chose_goal(self) -> None:
        self._inputs.set_visibility(self._goal.value == "prediction")
        self._rival.set_visibility(self._goal.value == "model")

    def _number(self, field: ui.input, quantity: Quantity, example: str) -> float:
        """What is in a field [SI].

        Raises
        ------
        InputError
            It is no such quantity above 0, which the field then says.
        """
        try:
            found = parse_quantity(field.value or "", quantity, where="", example=example)
            if not found > 0.0:
                raise InputError(
                    f"{field.value!r}, it must be above 0", code="out-of-range", repair=f"give for example {example!r}"
                )
            return found
        except InputError as error:
            fail_at(field, error)
            raise

    def _signals(self) -> list[str]:
        """The signals to predict, where the goal asks for them; the field says what is wrong with one."""
        if self._goal.value != "prediction":
            return []
        found = [line.strip() for line in (self._inputs.value or "").splitlines() if line.strip()]
        try:
            for one in found:
                if files_of(one):
                    raise InputError(
                        "a signal from a file is not asked for here",
                        code="bad-signal",
                        repair="name one in words, or ask in a terminal",
                    )
                parse(one)
        except InputError as error:
            fail_at(self._inputs, error)
            raise
        return found

    def _other_model(self) -> tuple[str, str]:
        """The other model as a worker is given it, and as a command names it; empty where none is asked for."""
        name = (self._rival.value or "").strip() if self._goal.value == "model" else ""
        is_file = name.endswith(".toml") or self._workshop.fit(name) is not None
        if not is_file:
            return name, name
        try:
            return self._workshop.actuator_path(name), self._workshop.steps.file_name(name)
        except InputError as error:
            fail_at(self._rival, error)
            raise

    def _request(self) -> dict[str, Any] | None:
        """What a worker is asked; None where the form says what is wrong."""
        for field in (self._fit, *self._fields().values()):
            fail_at(field, None)
        if not self._fit.value:
            fail_at(self._fit, "choose a fit; Identify makes one")
            return None
        try:
            self._number(self._voltage, VOLTAGE, "1.2 V")
            if (self._current.value or "").strip():
                self._number(self._current, CURRENT, "100 mA")
            return {
                "fit": self._workshop.actuator_path(self._fit.value),
                "goal": self._goal.value,
                "minutes": self._number(self._minutes, TIME, "15 min") / 60.0,
                "longest": self._number(self._longest, TIME, "160 s"),
                "limits": self._limits(),
                "inputs": self._signals(),
                "rival": self._other_model()[0],
            }
        except InputError as error:
            if error.where == "actuator":
                fail_at(self._fit, error)
            return None

    def _limits(self) -> dict[str, str]:
        texts = {"voltage": self._voltage.value or "", "current": self._current.value or ""}
        return {name: value.strip() for name, value in texts.items() if value.strip()}

    async def _propose(self) -> None:
        self._message.set_text("")
        self._box.clear()
        asked = self._request()
        if asked is None:
            return
        step = next_step(
            self._workshop.steps.file_name(self._fit.value),
            asked["goal"],
            asked["minutes"],
            limits=asked["limits"],
            longest=(self._longest.value or "").strip(),
            inputs=asked["inputs"],
            rival=self._other_model()[1],
        )
        step = self._workshop.steps.repeatable(step, [self._fit.value])
        self._asked += 1
        this = self._asked
        self._message.set_text("asking the model")
        try:
            job = self._workshop.jobs.submit("propose", asked, title="the next runs")
            document = (await asyncio.wrap_future(job.future)).document
        except JobCancelled:
            return
        except IpmclabError as error:
            if this == self._asked:  # else something newer was asked
                self._complain(error)
            return
        if this != self._asked:
            return
        self._message.set_text("")
        with self._box:
            known = {key: heading for key, heading in _RUNS.items() if any(row[key] for row in document["runs"])}
            plain_table(known, document["runs"], caption="Runs to record next")
            for words in document["sentences"]:
                text(words)
            plain_table(_EXPECTED, document["expected"], caption="What is expected of them")
            text(document["how"])
            for words in document["remarks"]:
                text(f"Remark: {words}.").classes("lab-quiet")
            with ui.element("details"):
                text("command and Python", tag="summary")
                step_view()(step)

    def _complain(self, error: IpmclabError) -> None:
        """Say why no run is proposed, at the field that it belongs to."""
        field = self._fields().get(error.where.removeprefix("limits.").partition(".")[0])
        if field is not None:
            fail_at(field, error)
            self._message.set_text("")
        else:
            self._message.set_text(sentence(error) if error.where == "allowed" else str(error))
