"""Models side by side: what each predicts of runs from their voltage alone."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from nicegui import ui

from ipmclab.errors import IpmclabError
from ipmclab.page.commands import validate_step
from ipmclab.page.curves import compared_panels
from ipmclab.page.elements.checks import Checks
from ipmclab.page.elements.time_plot import TimePlot
from ipmclab.page.fit_cards import FitCard
from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.jobs import JobCancelled
from ipmclab.page.sections.kept import Kept, texts
from ipmclab.page.sections.parts import card, finding_list, plain_table, step_view, text
from ipmclab.page.workshop import Workshop

MOST_MODELS: Final = 6
"""On one plot: so many can be distinguished."""

_SCORES: Final = {
    "output": "output",
    "run": "run",
    "model": "model",
    "fit": "fit",
    "rmse": "RMSE",
    "of_range": "of range",
    "max_error": "largest error",
    "inside": "in its band",
    "remark": "",
}


class PredictionView:
    """Models compared with runs that they may not have been fitted to.

    Parameters
    ----------
    workshop : Workshop
    kept : Kept
        What the browser keeps of the section.
    runs : callable
        Gives the runs to predict.
    """

    def __init__(self, workshop: Workshop, kept: Kept, runs: Callable[[], Sequence[str]]) -> None:
        self._workshop = workshop
        self._kept = kept
        self._runs = runs
        self._curves: str | None = None
        self._asked = 0

    def build(self) -> None:
        """Make the form."""
        with card("Models side by side, on runs to predict", place="models"):
            with ui.element("div").classes("lab-bar"):
                self._models = Checks("Models", self._workshop.models())
                self._models.classes("lab-wide")
                self._kept.keep("models", self._models, "said")
                ui.button("Predict", on_click=self._predict).props("unelevated no-caps")
            self._message = text("").props("role=status").classes("lab-quiet")
            self._box = ui.element("div").classes("lab-column")

    def forget(self) -> None:
        """Its curves are shown no more."""
        self._workshop.curves.forget(self._curves)

    def go_on(self, kept: Mapping[str, Any]) -> None:
        """The models that this window had chosen, in addition to those that are chosen and that it was not offered
        then."""
        said = texts(kept.get("models"), ("chosen", "offered"))
        if said is not None:
            new = [key for key in self._models.chosen if key not in said["offered"]]
            self._models.offer(self._workshop.models(), [*said["chosen"], *new])

    def refill(self) -> None:
        """The models may have become more."""
        self._models.offer(self._workshop.models())

    def offer(self, one: FitCard) -> None:
        """Compare a fit with what is compared already; at once where it has runs to predict."""
        self._models.offer(self._workshop.models(), list(dict.fromkeys([*self._models.chosen, one.key])))
        if self._runs():
            ui.timer(0.01, self._predict, once=True)

    async def _predict(self) -> None:
        self._message.set_text("")
        self._models.complain("")
        chosen, runs = list(self._models.chosen), list(self._runs())
        if not runs:
            self._message.set_text("Choose runs to predict: the box “Predict” in the table.")
            return
        if not 1 <= len(chosen) <= MOST_MODELS:
            self._models.complain(f"Choose 1 to {MOST_MODELS} models.")
            return
        known = self._workshop.models()
        names = [known[key] for key in chosen]
        self._asked += 1
        asked = self._asked
        self._message.set_text("predicting")
        try:
            arguments = {
                "models": [self._workshop.actuator_path(key) for key in chosen],
                "names": names,
                "runs": [str(self._workshop.runs.path(key)) for key in runs],
            }
            job = self._workshop.jobs.submit("validate", arguments, title="prediction")
            frame = await asyncio.wrap_future(job.future)
        except JobCancelled:
            return
        except IpmclabError as error:
            if asked == self._asked:  # else something newer was asked
                self._message.set_text(str(error))
            return
        if asked == self._asked:
            self._message.set_text("")
            self._show(frame, names)
            with self._box, ui.element("details"):
                text("command and Python", tag="summary")
                files = [self._workshop.steps.file_name(key) for key in chosen]
                step_view()(self._workshop.steps.repeatable(validate_step(files, runs), chosen))

    def _show(self, frame: Frame, names: Sequence[str]) -> None:
        document = frame.document
        plot: TimePlot | None = None

        def draw(place: int) -> tuple[list[dict[str, Any]], str]:
            models = {f"{model}.{place}": name for model, name in enumerate(names)}
            panels = compared_panels(frame.arrays, models, residuals=True)
            self.forget()
            self._curves = self._workshop.curves.add(panels)
            return [panel.as_dict() for panel in panels], self._curves

        self._box.clear()
        with self._box:
            seen = [
                f"{name} was identified from {run}: that score shows the fit, not a prediction."
                for name, used in zip(names, document["used"], strict=True)
                for run, one in zip(document["runs"], used, strict=True)
                if one
            ]
            for words in seen:
                text(words).classes("lab-bad")
            rows = [{**row, "run": row["run"] if not row["pooled"] else "all runs"} for row in document["scores"]]
            known = {key: heading for key, heading in _SCORES.items() if any(row.get(key) for row in rows)}
            plain_table(known, rows, caption="Scores")
            if len(document["runs"]) > 1:
                choice = ui.select(dict(enumerate(document["runs"])), value=0, label="Run")
                choice.props("dense outlined options-dense")
                choice.on_value_change(lambda: plot.show(*draw(choice.value)) if plot is not None else None)
            plot = TimePlot("Predicted runs", *draw(0), height=110)
            if document["findings"]:
                finding_list(document["findings"])
