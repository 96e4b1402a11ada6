"""What is shown of a fit: what is known, the parameters, measured against model, findings, and how to keep it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final
from urllib.parse import urlencode

from nicegui import ui

from ipmclab.errors import IpmclabError
from ipmclab.fit.mountings import NEXT_STRIP
from ipmclab.fit.verdict import REFUSED
from ipmclab.page.curves import compared_panels
from ipmclab.page.elements.time_plot import TimePlot
from ipmclab.page.fit_cards import FitCard
from ipmclab.page.sections.kept import Kept
from ipmclab.page.sections.parts import card, download, fail_at, finding_list, plain_table, step_view, text
from ipmclab.page.workshop import Workshop

_PARAMETERS: Final = {
    "symbol": "",
    "name": "parameter",
    "value": "value",
    "unit": "unit",
    "interval": "95 % interval",
    "next_mounting": "next mounting",
    "remark": "",
}
_KNOWN: Final = {
    "name": "",
    "value": "value",
    "unit": "unit",
    "interval": "95 % interval",
    "remark": "",
}
_OUTPUTS: Final = {
    "run": "run",
    "output": "output",
    "fit": "fit",
    "rmse": "RMSE",
    "of_range": "of range",
    "noise": "noise",
    "left": "what is left",
}
_LEFT_OUT: Final = {
    "run": "run",
    "output": "output",
    "fit": "fit",
    "rmse": "RMSE",
    "inside": "in its band",
    "change": "what it changes most",
    "remark": "",
}


_PLACES: Final = {
    "models": "Compared with other models",
    "measured": "Measured against model",
    "profiles": "How well each is known",
    "left-out": "Runs left out",
    "findings": "Findings",
}
"""What is below the parameters, and how links to it are called."""

_MAY_LACK: Final = {"profiles": "profiles", "left-out": "left_out"}
"""Of these, what not every fit has, and where it would stand."""

_NAME: Final = "name of "
"""What a browser keeps begins so, where it is the name that a fit is to be saved by."""


class FitView:
    """A fit in full.

    Parameters
    ----------
    workshop : Workshop
    kept : Kept
        What the browser keeps of the section.
    on_saved : callable
        Called when it was saved.
    """

    def __init__(self, workshop: Workshop, kept: Kept, on_saved: Callable[[], None]) -> None:
        self._workshop = workshop
        self._kept = kept
        self._on_saved = on_saved
        self._names: dict[str, str] = {}  # what was written to save a fit by, of those that were shown
        self._curves: str | None = None

    def build(self) -> None:
        """Make room for it."""
        self._box = ui.element("div").classes("lab-column")
        with self._box, card("Fit"):
            text("Choose runs, a model and what is free; then Identify.").classes("lab-quiet")

    def forget(self) -> None:
        """Its curves are shown no more."""
        self._workshop.curves.forget(self._curves)

    def go_on(self, kept: Mapping[str, Any]) -> None:
        """The names that this window had written to save fits by."""
        said = {key.removeprefix(_NAME): name for key, name in kept.items() if key.startswith(_NAME)}
        self._names = {key: name for key, name in said.items() if isinstance(name, str)}

    def show(self, one: FitCard) -> None:
        """Show a fit that is done."""
        assert one.frame is not None
        document = one.frame.document
        self._box.clear()
        with self._box:
            with card(one.asked.name):
                empty = {place for place, key in _MAY_LACK.items() if not document[key]}
                _build_jumps({place: words for place, words in _PLACES.items() if place not in empty})
                for words, is_bad in known_in_words(document):
                    text(words).classes("lab-bad" if is_bad else "")
                plain_table(_shown(document["parameters"]), document["parameters"], caption="Parameters")
                if document.get("known"):
                    columns = {**_KNOWN, "name": document.get("known_title", "")}
                    plain_table(columns, document["known"], caption="What these runs determine")
                self._build_keep(one)
            with card("Measured against model", place="measured"):
                self._build_plot(one)
                plain_table(_OUTPUTS, document["outputs"], caption="How each output was met")
            if document["profiles"]:
                with card("How well each is known", place="profiles"):
                    with ui.element("div").classes("lab-bar"):
                        download("SVG", f"/fits/{one.key}/profiles?kind=svg")
                        download("CSV", f"/fits/{one.key}/profiles?kind=csv")
                    ui.html(document["profiles"]["svg"], sanitize=False).classes("lab-figure")
                    text(document["profiles"]["caption"]).classes("lab-quiet")
                    text(document["profiles"]["sentence"])
            if document["left_out"]:
                with card("Each run as the others predict it", place="left-out"):
                    plain_table(_LEFT_OUT, document["left_out"], caption="Runs left out")
            with card("Findings", place="findings"):
                finding_list(document["findings"])
            with card("How this fit was asked for"), ui.element("details"):
                text("command and Python", tag="summary")
                start = one.made.start
                before = [] if start is None else [start.key]
                step_view()(self._workshop.steps.repeatable(self._workshop.steps.of(one.made), before))

    def _build_plot(self, one: FitCard) -> None:
        assert one.frame is not None
        frame = one.frame
        labels = [run["label"] for run in frame.document["runs"]]
        plot: TimePlot | None = None

        def draw(place: int) -> tuple[list[dict[str, Any]], str]:
            panels = compared_panels(frame.arrays, {str(place): "model"}, residuals=True)
            self.forget()
            self._curves = self._workshop.curves.add(panels)
            return [panel.as_dict() for panel in panels], self._curves

        if len(labels) > 1:
            options = dict(enumerate(labels))
            choice = ui.select(options, value=0, label="Run").props("dense outlined options-dense")
            choice.on_value_change(lambda: plot.show(*draw(choice.value)) if plot is not None else None)
        plot = TimePlot(f"{one.asked.name} measured against model", *draw(0), height=110)

    def _build_keep(self, one: FitCard) -> None:
        with ui.element("div").classes("lab-bar"):
            name = ui.input(
                "Save as an actuator",
                value=self._names.get(one.key, one.asked.name.replace(" ", "-")),
                on_change=lambda event: self._names.update({one.key: event.value or ""}),
            )
            name.props("dense outlined suffix=.toml")
            name.classes("lab-wide")
            self._kept.keep(f"{_NAME}{one.key}", name)

            def save() -> None:
                fail_at(name, None)
                try:
                    below = self._workshop.save_fit(one, name.value or "")
                except IpmclabError as error:
                    fail_at(name, error)
                    return
                ui.notify(f"wrote {below}", type="positive")
                self._on_saved()

            ui.button("Save", on_click=save).props("unelevated no-caps")
            download("TOML", f"/fits/{one.key}")
            for label, address in (
                ("Simulate with it", f"/simulate?{urlencode({'fit': one.key})}"),
                ("Report on it", f"/report?{urlencode({'fit': one.key})}"),
            ):
                with ui.element("a").props(f'href="{address}"').classes("lab-download"):
                    text(label, tag="span")


def _build_jumps(places: Mapping[str, str]) -> None:
    """Links to what is further down."""
    with ui.element("nav").props('aria-label="Of this fit"').classes("lab-jumps"):
        for place, words in places.items():
            with ui.element("a").props(f'href="#lab-{place}"'):
                text(words, tag="span")


def known_in_words(document: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """What a fit knows, sentence by sentence, and whether each calls for caution."""
    open_ones = [row["name"] for row in document["parameters"] if not row["determined"]]
    found = [(document["verdict"], document["verdict"].startswith(REFUSED))]
    if not document["converged"]:
        found.append((f"It did not converge: {document['message']}. These numbers are not a model.", True))
    if open_ones:
        verb, listed = "is" if len(open_ones) == 1 else "are", ", ".join(open_ones)
        words = f"{len(open_ones)} of {document['free']} parameters {verb} not determined by these runs: {listed}."
        found.append((words, True))
    else:
        found.append((f"All {document['free']} free parameters are determined by these runs.", False))
    if document["averaged"]:
        listed = ", ".join(document["averaged"])
        found.append((f"The mountings differ, so one value for all of them holds for none: {listed}.", True))
    if document["next_mounting_unknown"]:
        words = document["next_mounting_unknown"]
        found.append((f"{words[:1].upper()}{words[1:]}; {NEXT_STRIP}.", False))
    found += [(words, True) for words in document["undetermined"]]
    found += [(one["message"], True) for one in document["findings"] if one["severity"] == "error"]
    return found


def _shown(rows: list[dict[str, Any]]) -> dict[str, str]:
    """The columns of the table of parameters, without those that say nothing."""
    return {
        key: heading
        for key, heading in _PARAMETERS.items()
        if heading or key == "symbol" or any(row.get(key) for row in rows)
        if key != "next_mounting" or any(row.get(key, "–") != "–" for row in rows)
    }
