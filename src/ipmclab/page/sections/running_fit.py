"""A fit that waits or is worked on: how far it is, and its first answer as soon as that is there."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from ipmclab.page.fit_cards import FitCard
from ipmclab.page.jobs.jobs import Jobs
from ipmclab.page.sections.parts import plain_table, text

_COLUMNS: Final = {"name": "first answer", "value": "value", "unit": "unit"}
_FOLLOWS: Final = (
    "These values are found. Intervals, and what the model lacks, follow. “Keep this fit” stops here and keeps what is "
    "found; “Cancel” loses it."
)
_KEPT: Final = "It stops here, and keeps what is found."


class RunningFit:
    """What is shown of a fit until it is over; it is built where it is made.

    Parameters
    ----------
    one : FitCard
    jobs : Jobs
    """

    def __init__(self, one: FitCard, jobs: Jobs) -> None:
        self._one = one
        self._jobs = jobs
        self._bar = ui.element("progress").props(f'max=1 aria-label="Progress of {one.asked.name}"')
        self._doing = text("").classes("lab-quiet").props("role=status")
        self._follows = text("").props("role=status")
        self._first = ui.element("div").classes("lab-column")
        self._keep: ui.button | None = None
        self.look()

    def look(self) -> None:
        """Show what is new of it."""
        job = self._one.job
        if job.fraction is not None:
            self._bar.props(f"value={job.fraction:.3f}")
        waits = "waiting for the fit before" if job.state == "waiting" else job.sentence
        self._doing.set_text(f"{waits} ({job.seconds:.0f} s)" if waits else "")
        if job.first is not None and self._keep is None:
            with self._first:
                plain_table(_COLUMNS, job.first, caption=f"First answer of {self._one.asked.name}")
                with ui.element("div").classes("lab-bar"):
                    self._keep = ui.button("Keep this fit", on_click=lambda: self._jobs.keep(job))
                    self._keep.props("outline no-caps dense")
        if self._keep is not None:
            self._follows.set_text(_KEPT if job.is_kept else _FOLLOWS)
            self._keep.set_enabled(not job.is_kept)
