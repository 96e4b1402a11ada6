"""What is asked of a run that is shown: whether a strip that curls can be tested, and a copy without vibration."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.commands import baseline_step, smooth_step
from ipmclab.page.jobs.jobs import JobCancelled
from ipmclab.page.sections.parts import card, fail_at, plain_table, step_view, text
from ipmclab.page.workshop import Workshop
from ipmclab.run import Run
from ipmclab.units import FREQUENCY, LENGTH, TIME, Quantity, parse_quantity

if TYPE_CHECKING:
    from pathlib import Path

_STEM = 70  # letters of a name, to which a word is added

Written = Callable[[str], Awaitable[None]]
"""Called with a run that was written, by its path below the folder."""


def build_treatment(workshop: Workshop, key: str, run: Run, written: Written) -> None:
    """Cards for one run: of its curl where no voltage was on it, of its vibration where it shows the tip."""
    from ipmclab.measurement.curl import NO_VOLTAGE
    from ipmclab.measurement.smooth import CHANNELS_OF_THE_TIP

    tip = [name for name in CHANNELS_OF_THE_TIP if name in run.channels]
    if "displacement" in tip and float(np.abs(run.voltage).max()) <= NO_VOLTAGE:
        with card("Without voltage"):
            _Baseline(workshop, key)
    if tip:
        with card("Vibration of a fan"):
            _Smooth(workshop, key, written)


class _Form:
    """Fields, a button, and below them what came of it."""

    def __init__(self, workshop: Workshop, key: str) -> None:
        self._workshop, self._key = workshop, key
        self._path = str(workshop.runs.path(key))

    def _field(self, label: str, value: str) -> ui.input:
        return ui.input(label, value=value).props("dense outlined")

    def _number(self, field: ui.input, quantity: Quantity) -> float | None:
        """What is in a field [SI]; None where it is wrong, which the field then says."""
        fail_at(field, None)
        try:
            return parse_quantity(field.value or "", quantity, where="")
        except InputError as error:
            fail_at(field, error)
            return None

    async def _done(self, task: str, arguments: dict[str, Any], box: ui.element) -> dict[str, Any] | None:
        """What a worker says of the run; None where it refuses, which is in the box then."""
        box.clear()
        with box:
            text("the run is being read").classes("lab-quiet").props("role=status")
        job = self._workshop.jobs.submit(task, {"run": self._path, **arguments})
        try:
            result: dict[str, Any] = (await asyncio.wrap_future(job.future)).document
        except JobCancelled:
            return None
        except IpmclabError as error:
            box.clear()
            with box:
                text(str(error)).classes("lab-bad").props("role=alert")
            return None
        box.clear()
        return result


class _Baseline(_Form):
    def __init__(self, workshop: Workshop, key: str) -> None:
        from ipmclab.measurement.curl import SHARE, TEST

        super().__init__(workshop, key)
        text("How fast the strip curls by itself, and whether it can be tested in this air.").classes("lab-quiet")
        with ui.element("div").classes("lab-bar"):
            self._displacement = self._field("A test is expected to show", "1.3 mm")
            self._test = self._field("Length of one test", f"{TEST:g} s")
            self._share = self._field("Part that the curl may make", f"{SHARE:g}")
            ui.button("Judge the curl", on_click=self._judge).props("unelevated no-caps")
        self._result = ui.element("div")

    async def _judge(self) -> None:
        displacement, test = self._number(self._displacement, LENGTH), self._number(self._test, TIME)
        fail_at(self._share, None)
        try:
            share = float(self._share.value)
        except (TypeError, ValueError):
            fail_at(self._share, "give a number between 0 and 1, such as 0.05")
            return
        if displacement is None or test is None:
            return
        asked = {"displacement": displacement, "test": test, "share": share}
        result = await self._done("baseline", asked, self._result)
        if result is None:
            return
        with self._result:
            words = text(result["words"][:1].upper() + result["words"][1:]).props("role=status")
            if result["verdict"] == "no":
                words.classes("lab-bad")
            given = (str(one.value).strip() for one in (self._displacement, self._test, self._share))
            step_view()(baseline_step(self._key, *given))


class _Smooth(_Form):
    def __init__(self, workshop: Workshop, key: str, written: Written) -> None:
        super().__init__(workshop, key)
        self._written = written
        text(
            "A copy without what is faster than the strip bends, in displacement and force alone. A fit needs none: to "
            "it vibration is noise."
        ).classes("lab-quiet")
        stem = key.rpartition("/")[2].removesuffix(".nc")[:_STEM]
        with ui.element("div").classes("lab-bar"):
            self._below = self._field("What is slower stays", "5 Hz")
            self._name = self._field("Save the copy as", f"{stem}-smooth").props("suffix=.nc").classes("lab-wide")
            ui.button("Save a smooth copy", on_click=self._smooth).props("unelevated no-caps")
        self._result = ui.element("div")

    async def _smooth(self) -> None:
        lab, below = self._workshop.lab, self._number(self._below, FREQUENCY)
        fail_at(self._name, None)
        try:
            out: Path = lab.new_file(self._name.value or "", ".nc")  # refuses what is no plain name
            folder = lab.laboratory_folder if lab.laboratory_folder.is_dir() else lab.root
            out = folder / out.name
            if out.exists():
                raise InputError(f"{lab.below(out)} exists already", code="file-exists", repair="choose another name")
        except InputError as error:
            fail_at(self._name, error)
            return
        if below is None:
            return
        result = await self._done("smooth", {"below": below, "out": str(out)}, self._result)
        if result is None:
            return
        with self._result:
            headings = {"channel": "channel", "rms": "taken out (rms)", "frequency": "most of it at", "share": "share"}
            plain_table(headings, result["taken_out"], caption="What was taken out")
            step_view()(smooth_step(self._key, below, lab.below(out)))
        ui.notify(f"wrote {lab.below(out)}", type="positive")
        await self._written(lab.below(out))
